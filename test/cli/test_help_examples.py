# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Every command of --help and of the pages runs on small real input, or says why it is not."""

from __future__ import annotations

import json
import shlex
import shutil
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from benchmarks.harness.rows import BenchResult, Row
from benchmarks.replay import write_bag
from reference import enrolled_skin
from reference.help_examples import ROOT, examples, lines, typed_on_pages
from tactile_ros.cli import calibrate, compare, view
from tactile_ros.cli.main import main
from tactile_ros.evaluation.bag import BagWriter, all_types
from tactile_ros.sensors import load_sensor
from tactile_ros.types import STATE_FIELDS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tactile_ros.evaluation.recording_files import LoadedRecording
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Recording

STEP_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000
MOST_ROWS = 1200
SHOWN = 20  # frames, after which whoever looks presses Ctrl-C
GRAPH = 'starts the ROS graph for half a minute or more: '
NODES = 'runs nodes until Ctrl-C: test/cli/test_run.py'
LIVE = 'needs running nodes: '
MADE_ON_ITS_PAGE = 'its sensor is made on that page; test/sensors/test_adding_a_sensor.py'
GUIDED = 'guides a hand for minutes; test_guided.py'
LONG = 'measures for minutes to hours: `make bench` runs it'
# test_docs.py has their own parsers take them
PARSED_ALONE = {
    'tactile demo': GRAPH + '`make demo`',
    'tactile demo --seed 1 --output out/other': GRAPH + '`make demo`',
    'tactile demo --sensor gradiometer': GRAPH + 'cut short in test_twin_demo.py',
    'tactile demo --sensor taxel_array --json': GRAPH + 'cut short in test_twin_demo.py',
    'tactile run --sensor reskin_board --port /dev/ttyACM0 --calibration out/mine.npz': NODES,
    'tactile run --sensor reskin_board --port /dev/ttyACM0': NODES,
    'tactile run --sensor gradiometer --simulated': NODES,
    'tactile run --hand allegro_v5 --calibrations out/fingers --mock-hand': NODES,
    'tactile demo grasp': 'simulates for minutes; its scenes are run in test/simulation',
    'tactile doctor --sensor magnet_pad --set buses=[/dev/i2c-3] --probe --json':
        'asks real buses; test_doctor.py asks a simulated one',
    'tactile enrol mug --presses 3': LIVE + 'test/nodes/test_enrolment_server.py',
    'tactile enrol mug --namespace thumb --replace': LIVE + 'test/nodes/test_enrolment_server.py',
    'tactile enrol mug --forget': LIVE + 'test/nodes/test_enrolment_server.py',
    'tactile record -o out/my_bag': LIVE + 'test_commands.py, test/nodes/test_stack.py',
    'tactile record -o out/thumb --namespace thumb --seconds 20': LIVE + 'test_commands.py',
    'tactile replay bags/* --calibration a.npz --scheduler tcp://10.0.0.1:8786':
        'needs a Dask cluster; test/evaluation/test_fleet.py starts one',
    'tactile calibrate --live --sensor anyskin --port /dev/ttyACM0 --truth weights:50,200 '
    '-o my.npz': GUIDED,
    'tactile calibrate --live --sensor reskin_board -o out/simulated.npz': GUIDED,
    'tactile view': LIVE + 'test/nodes/test_viewer_node.py',
    'tactile view --namespace thumb --namespace index --control': LIVE
    + 'test/nodes/test_viewer_node.py',
    'tactile bench reskin': LONG,
    'tactile bench devices --quick': LONG,
    'tactile bench fidelity --figures docs/images': LONG,
    'tactile bench all --jobs 2': LONG,
    'tactile bench roads --quick --json': LONG,
    # of the pages
    'tactile bench all --jobs 4 --figures benchmarks/results': LONG,
    'tactile bench grasp --full': LONG,
    'tactile bench latency': LONG,
    'tactile demo --sensor pinch_pad': MADE_ON_ITS_PAGE,
    'tactile doctor --sensor pinch_pad --simulated': MADE_ON_ITS_PAGE,
    'tactile doctor --sensor magnet_pad --set buses=[/dev/i2c-3] --probe':
        'asks real buses; test_doctor.py asks a simulated one',
    'tactile replay /data/bags/* --calibration /data/a.npz --scheduler tcp://10.0.0.1:8786':
        'needs a Dask cluster; test/evaluation/test_fleet.py starts one',
}  # fmt: skip
FIRST_HOUR = lines(ROOT / 'docs' / 'first_hour.md')
PARSED_ALONE |= {
    line: 'typed in its order in test/test_first_hour.py'
    for line in FIRST_HOUR if line.startswith('tactile') and line not in examples()
}  # fmt: skip
LINES = [*dict.fromkeys([*examples(), *typed_on_pages()])]
WRITTEN = ('-o', '--save', '--report', '--mcap', '--png', '--repair')
WRITTEN += ('--csv', '--parquet', '--lerobot')


def in_time(recording: Recording) -> Recording:
    """The same as a stream of 100 Hz, with the truth that a message holds."""
    rows = np.arange(len(recording))
    truth = {name: value for name, value in recording.truth.items() if name in STATE_FIELDS}
    stamp_ns = START_NS + STEP_NS * rows
    return replace(recording, stamp_ns=stamp_ns, sequence=rows, stream=None, truth=truth)


def write_bags(folder: Path, recording: Recording, pipeline: Pipeline) -> None:
    """Bags of live runs, as a recorder hears them."""
    shown = 'out/demo/reskin_board/bags/place'
    names = shown, 'bags/place', 'bags/one', 'bags/two', 'my_bag', 'another_bag'
    for number, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        part = recording.select(slice(160 * number, 160 * number + 160))
        write_bag(folder / name, pipeline, in_time(part))
    add_load_cell(folder / 'my_bag')
    (presses,) = (folder / 'my_bag').glob('*.mcap')
    shutil.copyfile(presses, folder / 'my_presses.mcap')


def add_load_cell(bag: Path) -> None:
    """A probe whose load cell tells the force of every frame, in a bag that has none."""
    store = all_types()
    kinds = (
        store.types[f'geometry_msgs/msg/{name}'] for name in ('WrenchStamped', 'Wrench', 'Vector3')
    )
    stamped, wrench, vector = kinds
    told = bag.rename(bag.with_name('without_load_cell'))
    with AnyReader([told], default_typestore=store) as reader, BagWriter(bag) as writer:
        for number, (topic, log_ns, data) in enumerate(reader.messages()):
            writer.write(topic.topic, topic.msgtype, log_ns, bytes(data))
            if topic.topic == '/frame':
                frame = store.deserialize_cdr(data, topic.msgtype)
                push = vector(x=0.0, y=0.0, z=1.0 + number % 2)
                said = stamped(
                    header=frame.header,
                    wrench=wrench(force=push, torque=vector(x=0.0, y=0.0, z=0.0)),
                )
                cell = bytes(store.serialize_cdr(said, said.__msgtype__))
                writer.write('/probe/wrench', said.__msgtype__, log_ns + 1, cell)


@pytest.fixture(scope='module')
def place(tmp_path_factory: pytest.TempPathFactory, taught_skin: Path) -> Path:
    """A folder with all that the examples name."""
    folder = tmp_path_factory.mktemp('examples')
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial']
    pipeline = spec.pipeline(estimator='ridge').fit(spatial.select(slice(0, 800)))
    (folder / 'out/demo/reskin_board/calibrations').mkdir(parents=True)
    for name in (
        'place.npz',
        'out/demo/reskin_board/calibrations/place.npz',
        'a.npz',
        'b.npz',
        'out/mine.npz',
        'out/other.npz',
    ):
        pipeline.save(folder / name)
    write_bags(folder, spatial.select(slice(800, None)), pipeline)
    skin = enrolled_skin.SPEC.load(taught_skin)
    skin.save(folder / 'skin.npz')
    write_bag(folder / 'out/my_bag', skin, in_time(enrolled_skin.new_head(3)))
    (folder / 'my_board.yaml').write_text('rate_hz: 100.0\n')
    (folder / 'my_pad.yaml').write_text('shear_modulus: 4.0e4\n')
    rows = [
        Row(method, 'mm', error, aim=0.5, us_single=us, compared='place', method=method)
        for method, error, us in (('ridge', 0.4, 60.0), ('kNN', 0.7, 20.0))
    ]
    for name in ('reskin', 'devices'):
        BenchResult(name, f'tactile bench {name}', [0], rows).write(folder / 'benchmarks/results')
    return folder


@pytest.fixture
def port() -> Iterator[str]:
    """Where a simulated board sends its bytes."""
    spec = load_sensor('reskin_board')
    with spec.simulate(spec.config(), spec.connection(), None, 0) as twin:
        yield twin.port


@pytest.fixture(autouse=True)
def somebody_looks_for_a_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """A live view ends by Ctrl-C; its twin is not learned from, which takes seconds."""
    monkeypatch.setattr(view, 'fitted', lambda spec, config, _: spec.pipeline(config))
    for viewer in (view.Viewer, view.PageServer):
        monkeypatch.setattr(viewer, 'show', stops(viewer.show))


def stops(show: Callable[..., None]) -> Callable[..., None]:
    """The same until some frames were shown."""
    seen = count(1)

    def stop(*what: object) -> None:
        show(*what)
        if next(seen) >= SHOWN:
            raise KeyboardInterrupt

    return stop


@pytest.fixture(autouse=True)
def few_rows_are_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shipped recording is as long as `MOST_ROWS`."""
    whole = calibrate.find

    def first(*what: object) -> tuple[list[LoadedRecording], list[str]]:
        found, problems = whole(*what)
        part = slice(0, MOST_ROWS)
        return [replace(one, recording=one.recording.select(part)) for one in found], problems

    for command in (calibrate, compare):
        monkeypatch.setattr(command, 'find', first)


def typed(line: str, port: str) -> list[str]:
    """Words as a shell gives them; the board's port is the twin's, and nothing takes long."""
    words = []
    for word in shlex.split(line)[1:]:
        found = sorted(map(str, Path().glob(word))) if '*' in word else [word]
        assert found, f'nothing is {word}'
        words += [port if name == '/dev/ttyACM0' else name for name in found]
    if words[0] == 'doctor' and '--sensor' in words:
        words += ['--seconds', '1.5']
    if words[0] == 'replay':
        words += ['--jobs', '1']  # no processes, which take seconds to start
    if words[0] == 'view' and '--mcap' not in words:
        words += ['--port', '0', '--no-open']  # that of the viewer may be in use
        words = [word for word in words if word != '--loop']  # which waits for a page
    return words


def written(name: str) -> dict[Path, int]:
    """Files that a word of an option stands for, and when each was written (ns)."""
    return {path: path.stat().st_mtime_ns for path in Path().glob(f'{name}*')}


def code_of(words: list[str]) -> int:
    """Exit code of the command."""
    try:
        return main(words)
    except SystemExit as stop:  # of --help
        return int(stop.code or 0)


@pytest.mark.parametrize('line', [line for line in LINES if line not in PARSED_ALONE])
def test_an_example_runs(
    line: str, place: Path, port: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    if '--foxglove' in line or '--mcap' in line:
        pytest.importorskip('foxglove')
    if '--parquet' in line or '--lerobot' in line:
        pytest.importorskip('pyarrow', reason='pyarrow is not installed: pip install pyarrow')
    if '--png' in line:
        pytest.importorskip('resvg_py')
    monkeypatch.chdir(place)
    words = typed(line, port)
    before = {name: written(name) for option, name in pairwise(words) if option in WRITTEN}
    nothing_is_connected = int(line == 'tactile doctor')  # on most machines that run this
    code = code_of(words)
    printed = capsys.readouterr()
    assert code <= nothing_is_connected, printed.err
    if code:
        assert 'nothing is connected' in printed.out
    assert 'left out' not in printed.err
    if '--json' in words:
        assert json.loads(printed.out)
    for name, files in before.items():
        assert written(name).items() - files.items(), f'{name} was not written'


def test_what_is_parsed_alone_is_an_example_with_a_reason() -> None:
    assert set(PARSED_ALONE) <= set(LINES)
    assert all(len(reason) >= 20 for reason in PARSED_ALONE.values())


def test_a_load_cell_alone_tells_force_and_no_rest(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    cell = ['--truth', '/probe/wrench']
    learn = ['calibrate', 'reskin_board', 'my_bag', '-o', 'out/force.npz', '--estimator', 'ridge']
    assert main([*learn, *cell]) == 0
    printed = capsys.readouterr()
    assert 'force' in printed.out
    assert 'it cannot be tared' in printed.err
    judge = ['replay', 'my_bag', '--calibration', 'out/force.npz', '--jobs', '1', *cell]
    assert main(judge) == 1
    assert 'fitted on readings without a baseline' in capsys.readouterr().err
    # with the rests that another topic tells it can
    assert main([*learn, *cell, '--truth', 'truth/contacts']) == 0
    assert 'it cannot be tared' not in capsys.readouterr().err
    assert main([*judge, '--tolerance', '0.004', '--delay', '0.001']) == 0
    told = capsys.readouterr().out
    assert 'normal RMSE (N)' in told
    assert '/probe/wrench: within 4 ms, 1 ms late' in told
