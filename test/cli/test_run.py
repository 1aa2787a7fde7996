# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile run` and `tactile record`: processes and ports, how they end, and empty bags."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from types import SimpleNamespace

import pytest

from tactile_ros.cli import record, run
from tactile_ros.cli.main import main
from tactile_ros.errors import DeviceError, RecordingError, TactileError
from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.nodes.graph import Graph, Process
from tactile_ros.sensors import load_sensor


def options(*words: str) -> Namespace:
    parser = ArgumentParser()
    run.add_arguments(parser)
    return parser.parse_args(words)


def test_run_starts_the_sensors_of_a_hand_in_one_process() -> None:
    words = '--hand allegro_v5 --ports /dev/ttyACM0,/dev/ttyACM1 --mock-hand --params-file a'
    graph = run.graph_of(options(*words.split(), '--fingers', 'thumb,index'))
    assert [one.executable for one in graph.processes] == ['mock_hand', 'stack']
    stack = graph['stack']
    assert (stack.params_file, stack.parameters['fingers']) == ('a', ['thumb', 'index'])


def test_run_takes_the_only_port_or_names_those_that_there_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    here = ['/dev/ttyS0', '/dev/ttyUSB3']
    monkeypatch.setattr(run, 'list_ports', lambda: here)
    assert run.graph_of(options())['stack'].parameters['port'] == '/dev/ttyUSB3'
    twin = run.graph_of(options('--sensor', 'gradiometer', '--simulated'))['stack'].parameters
    assert (twin['simulated'], twin['seed'], 'port' in twin) == (True, 1, False)
    here.append('/dev/ttyACM1')
    with pytest.raises(DeviceError, match=r'--port must name .*there are /dev/ttyUSB3, /dev/ttyA'):
        run.graph_of(options())
    del here[1:]
    with pytest.raises(DeviceError, match=r'--port must name .*none is here: plug the board in'):
        run.graph_of(options())


def test_run_refuses_the_calibration_of_another_sensor(tmp_path: Path) -> None:
    path = tmp_path / 'other.npz'
    load_sensor('five_wire_skin').pipeline().save(path)
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


@pytest.mark.ros
def test_record_makes_a_bag_and_says_where_it_is_or_that_nothing_came(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    empty, bag = tmp_path / 'empty', tmp_path / 'bag'
    assert main(['record', '-o', str(empty), '--seconds', '0.1']) == 1
    assert f'{empty} was removed, nothing was received in /:' in capsys.readouterr().err
    empty.mkdir()
    assert main(['record', '-o', str(empty)]) == 1
    assert 'exists already' in capsys.readouterr().err
    monkeypatch.setattr('tactile_ros.cli.record.refuse_empty', lambda *_: None)
    assert main(['record', '-o', str(bag), '--seconds', '0.1']) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f'bag: {bag}'

    def overtaken(path: Path) -> None:  # by another recorder
        path.mkdir()
        (path / 'other.mcap').touch()

    monkeypatch.setattr('tactile_ros.cli.record.refuse_unwritable', overtaken)
    assert main(['record', '-o', str(tmp_path / 'taken')]) == 1
    said = capsys.readouterr()
    assert 'taken is not empty; choose a new folder' in said.out
    assert 'ended with code 1; its last lines say why' in said.err
    assert [one.name for one in (tmp_path / 'taken').iterdir()] == ['other.mcap']


def test_record_refuses_a_place_or_a_namespace_that_cannot_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'file').touch()
    monkeypatch.setattr('tactile_ros.cli.record.Running', lambda *_, **__: pytest.fail('started'))
    assert main(['record', '-o', str(tmp_path / 'file' / 'bag')]) == 1
    assert 'file/bag cannot be written: Not a directory' in capsys.readouterr().err
    for namespace in ('../x', 'a\x1b[31mb', 'a' * 5000, '1a', 'a b'):
        assert main(['record', '-o', str(tmp_path / 'bag'), '--namespace', namespace]) == 2
        said = capsys.readouterr().err
        assert said.startswith('tactile record: namespace must be at most 200 letters')
        assert '\x1b' not in said
        assert len(said) < 250
    assert not (tmp_path / 'bag').exists()


def running(*alive: bool) -> SimpleNamespace:
    """Processes that say one after the other whether they live, then do."""
    answers = iter(alive)
    graph = Graph((Process('record', {}), Process('sensor_node', {})))
    return SimpleNamespace(graph=graph, is_alive=lambda _: next(answers, True))


@pytest.mark.parametrize(
    ('alive', 'patience_s', 'count'),
    [((), 60.0, 3), ((True, True, True, False), 60.0, 1), ((), -1.0, 1)],
)
def test_wait_for_frames_looks_until_they_come_or_a_process_ends(
    alive: tuple[bool, ...], patience_s: float, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Path] = []

    def load(bag: Path) -> None:
        seen.append(bag)
        if len(seen) < 3:
            msg = 'holds no frames'
            raise RecordingError(msg)

    monkeypatch.setattr(record, 'load', load)
    monkeypatch.setattr(record, 'LOOK_S', 0.0)
    monkeypatch.setattr(record, 'FIRST_FRAME_S', patience_s)
    if patience_s < 0:
        with pytest.raises(TactileError, match='no frame came within -1 s: holds no frames'):
            record.wait_for_frames(running(*alive), Path('bag'))
    else:
        record.wait_for_frames(running(*alive), Path('bag'))
    assert len(seen) == count


def test_record_refuses_a_bag_without_a_message(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag'):
        pass
    with pytest.raises(TactileError, match='nothing was received in /thumb'):
        record.refuse_empty(tmp_path / 'bag', 'thumb')
    assert not (tmp_path / 'bag').exists()  # the same command can be given again
    with BagWriter(tmp_path / 'other') as other:
        other.write('/label', 'std_msgs/msg/String', 1, b'\0' * 8)
    record.refuse_empty(tmp_path / 'other', '')
