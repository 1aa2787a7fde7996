"""Examples of the commands' --help, executed on the files that they name."""

from __future__ import annotations

import importlib
import shlex
from glob import glob
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.cli.main import COMMANDS, main
from tactile_ros.evaluation.figures import Plot, standalone
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

# what an example is given besides, so that it ends by itself and soon
ADDED = {
    'tactile replay bags/* --calibration a.npz --calibration b.npz --save out/compared': (
        '--jobs 1'
    ),
    'tactile doctor --sensor gradiometer --simulated': '--seconds 0.2',
    'tactile calibrate reskin_board my_bag/ -o out/mine.npz --config my_board.yaml': '--json',
    'tactile view out/demo/bags/place --speed 0.5': '--port 0 --seconds 0.1',
    'tactile calibrate reskin_board spatial -o out/place.npz': '--estimator ridge',
}
# seconds to minutes each, hardware, running nodes, or a cluster; executed in other tests
ELSEWHERE = (
    'tactile demo', 'tactile bench', 'tactile enrol', 'tactile record',
    'tactile doctor --sensor reskin_board', 'tactile doctor --sensor magnet_pad',
    'tactile view --', 'tactile replay bags/* --calibration a.npz --scheduler',
)  # fmt: skip


def examples() -> list[str]:
    """Those of every --help that can be executed here."""
    found = []
    for name in COMMANDS:
        text = importlib.import_module(f'tactile_ros.cli.{name}').__doc__ or ''
        found += [line.strip() for line in text.partition('example:\n')[2].splitlines()]
    topics = ('', 'tactile view')  # it would hear them until Ctrl-C
    return [line for line in found if line not in topics and not line.startswith(ELSEWHERE)]


@pytest.fixture(scope='module')
def place(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    """A folder with everything that the examples name."""
    folder = tmp_path_factory.mktemp('examples')
    for bag in ('out/demo/bags/place', 'bags/one', 'bags/two', 'my_bag'):
        (folder / bag).parent.mkdir(parents=True, exist_ok=True)
        write_bag(folder / bag)
    spec = load_sensor('reskin_board')
    pipeline = spec.pipeline(estimator='ridge')
    pipeline.fit(spec.recordings()['spatial'].select(slice(0, 300)))
    for name in ('out/demo/calibrations/place.npz', 'a.npz', 'b.npz'):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        pipeline.save(folder / name)
    (folder / 'my_board.yaml').write_text('rate_hz: 250.0\n')
    (folder / 'my_pad.yaml').write_text('radius: 0.008\n')
    plot = Plot((0, 1), (0, 1), 'x', 'y')
    plot.line(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 'line c0')
    rows = [Row('place', 'mm', 0.4, aim=0.5)]
    result = BenchResult('reskin', 'tactile bench', [0], rows, [], {'map': standalone(plot)})
    result.write(folder / 'benchmarks' / 'results')
    result.draw(folder / 'benchmarks' / 'results')
    return folder


@pytest.mark.parametrize('line', examples())
def test_examples_of_help_run(
    line: str, place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if ' view ' in line:
        pytest.importorskip('foxglove')
    if '--png' in line:
        pytest.importorskip('resvg_py')
    monkeypatch.chdir(place)
    words = shlex.split(f'{line} {ADDED.get(line, "")}')[1:]
    arguments = [path for word in words for path in (sorted(glob(word)) or [word])]  # noqa: PTH207
    if line.endswith('--help'):
        with pytest.raises(SystemExit, match='0'):
            main(arguments)
    else:
        # of a machine without ports, `doctor` alone finds what does not work
        assert main(arguments) in ((0, 1) if line == 'tactile doctor' else (0,))
    said = capsys.readouterr()
    assert said.out or said.err
    assert 'Traceback' not in said.err
