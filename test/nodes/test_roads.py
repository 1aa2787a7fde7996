"""Three roads, one number: processes over DDS, one process, and offline replay agree."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.recording_files import load
from tactile_ros.evaluation.replay import replay
from tactile_ros.nodes.graph import Graph, Setting, sensing
from tactile_ros.nodes.player import as_received
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor
from tactile_ros.types import STATE_FIELDS, ContactStates, Recording

if TYPE_CHECKING:
    from pathlib import Path

    from tactile_ros.evaluation.recording_files import LoadedRecording

PATIENCE_S = 120.0
TOLERANCE = 1e-9
# ids count touches since the start of the stream, warm-up rows included
TIMELESS = [n for n in STATE_FIELDS if not n.startswith(('object_pose', 'contacts_id'))]


def setting(folder: Path, touches_file: Path, calibration: Path, stack: bool) -> Setting:
    """The touches through the graph, as fast as it goes, into a bag."""
    return Setting(
        source='recorded',
        port=str(folder / 'port'),
        recording=str(touches_file),
        calibration=str(calibration),
        bag=str(folder / ('stack' if stack else 'nodes')),
        stack=stack,
        speed_up=float('inf'),
        namespace='hand/thumb',
    )


def graph_of(chosen: Setting) -> Graph:
    """The graph, whose player waits as long as these tests for all others to start."""
    return sensing(chosen).with_parameters('player', {'patience_s': PATIENCE_S})


@pytest.fixture(scope='module')
def bags(
    tmp_path_factory: pytest.TempPathFactory, touches_file: Path, calibration: Path
) -> dict[str, LoadedRecording]:
    """Bags of both live roads."""
    folder = tmp_path_factory.mktemp('roads')
    loaded = {}
    for stack in (False, True):
        chosen = setting(folder, touches_file, calibration, stack)
        with Running(graph_of(chosen)) as running:
            assert running.wait('player', PATIENCE_S) == 0, running.lines
            codes = running.stop()
        assert set(codes.values()) == {0}, running.lines
        said = ' '.join(running.lines['player'])
        assert '0 lost; 60 tares done, 0 refused' in said
        found = load(chosen.bag)
        assert not found.sentences
        loaded['stack' if stack else 'nodes'] = found.recordings[0]
    return loaded


@pytest.fixture(params=['nodes', 'stack'])
def bag(request: pytest.FixtureRequest, bags: dict[str, LoadedRecording]) -> LoadedRecording:
    return bags[request.param]


def rows_of(bag: LoadedRecording) -> np.ndarray:
    """Rows of the bag that have truth, which are the recording's, in its order."""
    return np.flatnonzero(bag.recording.truth['session'] >= 0)


def test_a_bag_holds_everything_that_a_replay_needs(
    bag: LoadedRecording, touches: Recording
) -> None:
    assert bag.name == 'hand/thumb'
    assert bag.contacts.unmatched == 0
    assert len(bag.contacts.rows) == len(bag.recording)
    # the one of the calibration, and one of every tare
    assert len(bag.baselines) == 61
    assert len(bag.calibrations) == 1
    rows = rows_of(bag)
    np.testing.assert_allclose(bag.recording.values[rows], touches.values, atol=1e-10)
    truth = {key: value[rows] for key, value in bag.recording.truth.items()}
    np.testing.assert_array_equal(truth['position'], touches.truth['position'])
    np.testing.assert_array_equal(truth['session'], touches.truth['session'])


def test_replaying_a_bag_gives_its_contacts(bag: LoadedRecording, calibration: Path) -> None:
    done = replay(bag, load_sensor('reskin_board').load(calibration))
    assert done.agreement.frames == len(bag.recording)
    assert done.agreement.without_contacts == 0
    assert done.agreement.largest < TOLERANCE, done.agreement.worst
    assert not done.problems
    assert np.isfinite(done.states.position[:, :2]).all(axis=1).sum() >= 60


def test_a_replay_can_fail(bag: LoadedRecording, calibration: Path) -> None:
    pipeline = load_sensor('reskin_board').load(calibration)
    first = replace(bag, baselines=bag.baselines[:1])
    assert replay(first, pipeline).agreement.largest > 1e-6


def timeless(states: ContactStates, rows: np.ndarray) -> dict[str, np.ndarray]:
    """What does not use time."""
    return {name: np.asarray(getattr(states, name), np.float64)[rows] for name in TIMELESS}


def test_both_live_roads_and_the_recording_itself_agree(
    bags: dict[str, LoadedRecording], touches: Recording, calibration: Path
) -> None:
    answers = []
    for bag in bags.values():
        order = np.argsort(bag.contacts.rows)
        states = timeless(bag.contacts.states, order)
        answers.append({name: x[rows_of(bag)] for name, x in states.items()})
    pipeline = load_sensor('reskin_board').load(calibration)
    # offline, from the recording without any bag: its tare rows do what the tare service does
    sent = np.array([as_received(encode(row)) for row in touches.values])
    offline = pipeline.process_batch(replace(touches, values=sent))
    touched = ~touches.tare
    alone = timeless(offline, touched)
    for name in TIMELESS:
        np.testing.assert_allclose(
            answers[0][name], answers[1][name], rtol=0, atol=TOLERANCE, err_msg=name
        )
        np.testing.assert_allclose(
            answers[0][name][touched], alone[name], rtol=0, atol=TOLERANCE, err_msg=name
        )


def rows_on_disk(bag: str, at_least: int) -> int:
    """Rows that a bag holds while it is still written, once they are enough."""
    deadline = time.monotonic() + PATIENCE_S
    rows = 0
    while rows < at_least and time.monotonic() < deadline:
        with suppress(RecordingError):  # it holds no frame yet
            rows = len(load(bag).recordings[0].recording)
    assert rows >= at_least
    return rows


def test_a_kill_leaves_a_bag_that_can_be_read(
    tmp_path: Path, touches_file: Path, calibration: Path
) -> None:
    chosen = replace(setting(tmp_path, touches_file, calibration, stack=True), loop=True)
    with Running(graph_of(chosen)) as running:
        running.wait_for_line('player', 'played 120 rows', PATIENCE_S)
        written = rows_on_disk(chosen.bag, at_least=61)
        running.signal('record', signal.SIGKILL)
        code = running.stop(['record'])['record']
        assert code == -signal.SIGKILL
        assert running.stop(['player', 'stack']) == {'player': 0, 'stack': 0}
    found = load(chosen.bag)
    loaded = found.recordings[0]
    assert len(loaded.recording) >= written
    assert np.isfinite(loaded.recording.values).all()
    done = replay(loaded, load_sensor('reskin_board').load(calibration))
    assert done.agreement.largest < TOLERANCE, done.agreement.worst


def test_ctrl_c_is_a_clean_end(tmp_path: Path) -> None:
    chosen = Setting(
        source='recorded', port=str(tmp_path / 'port'), bag=str(tmp_path / 'bag'), loop=True
    )
    with Running(sensing(chosen)) as running:
        running.wait_for_line('contact_node', 'no calibration', PATIENCE_S)
        codes = running.stop()
    assert set(codes.values()) == {0}, running.lines
    assert 'Traceback' not in str(running.lines)


def test_ctrl_c_while_everything_still_loads_is_silent() -> None:
    code = (
        'import os, signal, sys\n'
        'import tactile_ros.nodes.__main__ as entry\n'
        'entry.import_module = lambda name: os.kill(os.getpid(), signal.SIGINT)\n'
        'sys.argv = ["nodes", "sensor_node"]\n'
        'entry.main()\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, '')
