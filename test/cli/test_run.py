# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""tactile run: which processes it starts, which port it takes, how it ends."""

from __future__ import annotations

from argparse import ArgumentParser
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from tactile_ros.cli import run
from tactile_ros.cli.main import main
from tactile_ros.errors import DeviceError, TactileError
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from pathlib import Path


def options(*words: str) -> SimpleNamespace:
    parser = ArgumentParser()
    run.add_arguments(parser)
    return parser.parse_args(words)


def test_run_starts_one_process_for_a_sensor() -> None:
    graph = run.graph_of(options('--sensor', 'anyskin', '--port', '/dev/ttyACM7'))
    (process,) = graph.processes
    assert process.executable == 'stack'
    assert process.parameters['port'] == '/dev/ttyACM7'
    simulated = run.graph_of(options('--sensor', 'gradiometer', '--simulated'))
    assert simulated['stack'].parameters['simulated'] is True


def test_run_starts_the_sensors_of_a_hand_in_one_process() -> None:
    words = ('--hand', 'allegro_v5', '--ports', '/dev/ttyACM0,/dev/ttyACM1', '--mock-hand')
    graph = run.graph_of(options(*words, '--fingers', 'thumb,index'))
    assert [process.executable for process in graph.processes] == ['mock_hand', 'stack']
    assert graph['stack'].parameters['fingers'] == ['thumb', 'index']


@pytest.mark.parametrize(
    ('here', 'said'),
    [
        (['/dev/ttyS0'], 'none is here: plug the board in'),
        (['/dev/ttyACM0', '/dev/ttyUSB1'], 'there are /dev/ttyACM0, /dev/ttyUSB1'),
    ],
)
def test_run_names_the_ports_where_it_cannot_choose(
    here: list[str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, 'list_ports', lambda: here)
    with pytest.raises(DeviceError, match=f'--port must name .*{said}'):
        run.graph_of(options())


def test_run_takes_the_only_port(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, 'list_ports', lambda: ['/dev/ttyS0', '/dev/ttyUSB3'])
    assert run.graph_of(options())['stack'].parameters['port'] == '/dev/ttyUSB3'


def test_run_refuses_the_calibration_of_another_sensor(tmp_path: Path) -> None:
    path = tmp_path / 'other.npz'
    spec = load_sensor('five_wire_skin')
    spec.pipeline().save(path)
    with pytest.raises(TactileError, match='is a calibration of five_wire_skin'):
        run.graph_of(options('--calibration', str(path), '--port', '/dev/ttyACM0'))


def test_run_ends_where_a_process_does(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Ended:
        def __init__(self, graph: object, hear: object) -> None:
            self.lines = {'stack': ['no such port']}

        def __enter__(self) -> Ended:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def is_alive(self, _: str) -> bool:
            return False

    monkeypatch.setattr(run, 'Running', Ended)
    assert main(['run', '--sensor', 'gradiometer', '--simulated']) == 1
    assert 'stack has ended; its last lines say why' in capsys.readouterr().err
