# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile new`: its sensor works at once: it conforms, it is read; nothing is written over."""

import importlib
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tactile_ros import sensors
from tactile_ros.cli import new
from tactile_ros.cli.main import main
from tactile_ros.sensors import load_sensor

ROOT = Path(__file__).resolve().parents[2]
SUITES = (
    'test/devices/test_device_conformity.py', 'test/sensors/test_conformity.py',
    'test/sensors/test_registry.py',
)  # fmt: skip
# one estimates as the other: how they are read differs
WHICH = 'frame_pad or line_pad and not test_conformity'


@pytest.fixture(scope='module')
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which two sensors were begun."""
    folder = tmp_path_factory.mktemp('home') / 'my_sensors'
    for command in (['line_pad', '--taxels', '4x4', '--lines'], ['frame_pad', '--taxels', '2x3']):
        assert main(['new', *command, '--folder', str(folder)]) == 0
    return folder


@pytest.mark.slow
def test_new_sensors_pass_the_suites_of_conformity(home: Path) -> None:
    environment = {**os.environ, 'TACTILE_SENSORS': str(home)}
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', *SUITES, '-q', '-k', WHICH,
         '-p', 'no:cacheprovider'],
        env=environment, cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:]
    assert ' passed' in done.stdout


@pytest.mark.parametrize('key', ['line_pad', 'frame_pad'])
def test_new_sensor_is_read_through_a_pseudo_terminal(
    home: Path, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sensors, '__path__', [*sensors.__path__, str(home)])
    importlib.invalidate_caches()
    spec = load_sensor(key)
    config = spec.config(noise=0.0)
    wanted = spec.presses(config, 0, 1, noise=0.0).values[75]
    assert wanted.max() > 0.1
    with spec.simulate(config, spec.connection(), lambda t: wanted) as twin:
        own = spec.open(config, spec.connection(port=twin.port), time.monotonic_ns)  # type: ignore[attr-defined]
        with own as device:
            frames = [device.read(60.0) for _ in range(3)]
    for frame in frames:
        assert np.abs(frame.values - wanted).max() <= 0.51 / 1023


def test_new_says_what_comes_next(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('TACTILE_SENSORS', '/elsewhere')
    assert main(['new', 'my_pad', '--taxels', '2x2', '--lines']) == 0
    assert capsys.readouterr().out.splitlines() == [
        'my_sensors/my_pad/__init__.py',
        'next:',
        f'  export TACTILE_SENSORS={tmp_path}/my_sensors:/elsewhere',
        '  tactile view --sensor my_pad',
        '  tactile doctor --sensor my_pad --port /dev/ttyACM0',
    ]


def full(*_: object) -> None:
    raise OSError(28, 'No space left on device')


@pytest.mark.parametrize('kind', ['folder', 'link', 'nothing'])
def test_new_writes_over_nothing_and_leaves_nothing_half(
    tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / 'my_pad'
    if kind == 'folder':
        place.mkdir()
    elif kind == 'link':
        place.symlink_to('nowhere')
    before = list(tmp_path.iterdir())
    monkeypatch.setattr(new, 'write_atomically', full)
    assert main(['new', 'my_pad', '--taxels', '2x2', '--folder', str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert ('No space left' if kind == 'nothing' else f'{place} exists already') in said
    assert list(tmp_path.rglob('*')) == before


@pytest.mark.parametrize(
    ('key', 'words'),
    [
        *((key, 'no word of Python') for key in ('My_Pad', '../pad', 'lambda')),
        ('a' * 41, '40 at most'),
        ('taxel_array', 'KEY must be a new name, none of five_wire_skin'),
        ('anyskin', 'KEY must be a new name'),
        ('regression', 'KEY must be a new name'),
    ],
)
def test_new_refuses_a_key(
    tmp_path: Path, key: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['new', key, '--taxels', '4x4', '--folder', str(tmp_path)]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('taxels', ['4', '0x4', '4x4x4', '17x16', '-1x2', 'axb'])
def test_new_refuses_a_shape(taxels: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(['new', 'my_pad', f'--taxels={taxels}'])
    assert 'must be ROWSxCOLUMNS, such as 4x4, of 1 to 256 taxels' in capsys.readouterr().err


@pytest.mark.parametrize('lines', [True, False])
def test_new_sensors_of_any_size_fit_their_port(lines: bool) -> None:
    for rows, columns in ((16, 16), (13, 19), (7, 4), (1, 1)):
        held: dict[str, object] = {'__name__': __name__}
        exec(new.sensor('tried', rows, columns, lines=lines), held)
        spec = held['SENSOR']
        config = spec.config(rate_hz=80.0)  # type: ignore[attr-defined]
        assert spec.open(config, spec.connection(), time.monotonic_ns) is not None  # type: ignore[attr-defined]
