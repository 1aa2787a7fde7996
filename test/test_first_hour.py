# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""docs/first_hour.md, typed line by line; a simulated board is at its port."""

import importlib
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from reference.help_examples import ROOT, blocks, lines
from tactile_ros import sensors
from tactile_ros.cli.main import main
from tactile_ros.evaluation.recording_files import load
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Twin

PAGE = ROOT / 'docs' / 'first_hour.md'
COMMANDS = lines(PAGE)
PORT = '/dev/ttyACM0'
FAST = {
    'doctor': '--seconds 1', 'view': '--seconds 1 --port 0 --no-open', 'replay': '--jobs 1',
    'calibrate': '--estimator ridge --page 0 --hold 0.1 --presses 6',
}  # fmt: skip
NODES = ('run', 'record')  # beside each other, in the last test


def told(language: str) -> str:
    """The one block of the page in a language."""
    ((_, text),) = [block for block in blocks(PAGE) if block[0] == language]
    return text


@pytest.fixture(scope='module')
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('home')


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Be there, with the sensors that `export` names."""
    monkeypatch.chdir(home)
    monkeypatch.setenv('TACTILE_SENSORS', f'{home}/my_sensors')
    monkeypatch.setattr(sensors, '__path__', [*sensors.__path__, f'{home}/my_sensors'])
    importlib.invalidate_caches()
    yield
    sys.modules.pop('tactile_ros.sensors.my_pad', None)  # nobody else has it


def board() -> Twin:
    """A simulated board that is pressed; not yet entered."""
    spec = load_sensor('my_pad')
    return spec.simulate(spec.config(), spec.connection())


@pytest.mark.parametrize('line', [one for one in COMMANDS if one.split()[1] not in NODES])
def test_a_line_of_the_page_works(
    line: str, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = shlex.split(line)[1:]
    words += FAST.get(words[0], '').split()
    if words[0] == 'new':
        assert main(words) == 0
        return
    with board() as twin:
        port = twin.port  # type: ignore[attr-defined]
        if words[:1] == ['view'] and '--sensor' not in words:
            (home / 'tactile.toml').write_text(told('toml').replace(PORT, port))
        assert main([word.replace(PORT, port) for word in words]) == 0
    printed = capsys.readouterr()
    if words[0] == 'doctor':
        assert 'malformed' not in printed.out
    if words[0] == 'calibrate':
        assert 'position_xyz' in printed.out
        assert 'force_z ' in printed.out  # of a pad that tells no shear


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.skipif(find_spec('rclpy') is None, reason='without ROS 2')
def test_nodes_run_and_are_recorded(home: Path) -> None:
    run, record = (shlex.split(line)[1:] for line in COMMANDS[-2:])
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    with board() as twin:
        text = told('toml').replace(PORT, twin.port)  # type: ignore[attr-defined]
        (home / 'tactile.toml').write_text(text)
        nodes = subprocess.Popen(
            [sys.executable, '-m', 'tactile_ros', *run, '--seconds', '300'], env=environment,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            while twin.awaited and nodes.poll() is None:  # type: ignore[attr-defined]
                time.sleep(0.05)
            # of a busy machine the recorder hears nothing at first
            tries = {'my_bag': '5', 'again': '30', 'once_more': '120'}
            words = ([*record, '-o', bag, '--seconds', long] for bag, long in tries.items())
            assert any(main(line) == 0 for line in words)
        finally:
            nodes.terminate()
            nodes.wait()
    bag = next(home / name for name in reversed(tries) if (home / name).exists())
    (one,) = load(bag).recordings
    assert one.recording.layout.sensor == 'my_pad'
    assert len(one.recording) > 5
    assert one.contacts is not None
