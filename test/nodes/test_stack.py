# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""One process: the collector is frozen once warm; contacts come without a frame on the wire.

With a hand the grip is part of it, and decides the same numbers as over DDS and without ROS.
"""

from __future__ import annotations

import gc
import inspect
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock

from reference import grip_roads
from reference.made_bags import read_all
from tactile_ros import messages
from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.evaluation.recording_files import LoadedRecording, load
from tactile_ros.evaluation.replay import replay
from tactile_ros.msg import TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes import grip_node, lifecycle, stack
from tactile_ros.nodes.graph import BagPlayback, Graph, SensorSetup, replaying, sensing
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.nodes.player_node import as_received
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor
from tactile_ros.types import (
    STATE_FIELDS,
    ContactStates,
    Frame,
    FrameStatus,
    Recording,
    TaxelStatus,
)  # fmt: skip

if TYPE_CHECKING:
    from conftest import Port, Ros

DEEPEST = 8  # calls from the callback that takes frames to the estimator
PATIENCE_S = 120.0
TOLERANCE = 1e-9
TOUCHES = 20  # that conftest plays
# ids count touches since the start of the stream, warm-up rows included
TIMELESS = [n for n in STATE_FIELDS if not n.startswith(('object_pose', 'contacts_id'))]


def setting(folder: Path, touches_file: Path, calibration: Path, stack: bool) -> SensorSetup:
    """The touches through the graph, as fast as it goes, into a bag."""
    return SensorSetup(
        source='recorded',
        port=str(folder / 'port'),
        recording=str(touches_file),
        calibration=str(calibration),
        bag=str(folder / ('stack' if stack else 'nodes')),
        stack=stack,
        speed_up=float('inf'),
        namespace='hand/thumb',
    )


def graph_of(chosen: SensorSetup) -> Graph:
    """The graph, whose player waits as long as these tests for all others to start."""
    return sensing(chosen).with_parameters('player', {'patience_s': PATIENCE_S})


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where bags are."""
    return tmp_path_factory.mktemp('roads')


@pytest.fixture(scope='module')
def bags(folder: Path, touches_file: Path, calibration: Path) -> dict[str, LoadedRecording]:
    """Bags of both live roads."""
    loaded = {}
    for one_process in (False, True):
        chosen = setting(folder, touches_file, calibration, one_process)
        with Running(graph_of(chosen)) as running:
            assert running.children['player'].wait(PATIENCE_S) == 0, running.lines
            codes = running.stop()
        assert set(codes.values()) == {0}, running.lines
        assert 'ERROR' not in str(running.lines)
        said = ' '.join(running.lines['player'])
        assert f'0 lost; {TOUCHES} tares done, 0 refused' in said
        found = load(chosen.bag)
        assert not found.sentences
        loaded['stack' if one_process else 'nodes'] = found.recordings[0]
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
    assert len(bag.contacts.rows) == len(bag.recording)
    # the one of the calibration, and one of every tare
    assert len(bag.baselines) == 1 + TOUCHES
    assert bag.recording.layout.frame_id == 'hand/thumb_tactile_link'
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
    assert done.agreement.largest < TOLERANCE, done.agreement
    assert not done.problems
    assert np.isfinite(done.states.position[:, :2]).all(axis=1).sum() >= TOUCHES
    # and it can fail: without the tares the numbers differ
    first = replace(bag, baselines=bag.baselines[:1])
    untared = replay(first, load_sensor('reskin_board').load(calibration))
    assert untared.agreement.largest > 1e-6


def test_both_live_roads_and_the_recording_itself_agree(
    bags: dict[str, LoadedRecording], touches: Recording, calibration: Path
) -> None:
    def column(states: ContactStates, name: str) -> np.ndarray:
        return np.asarray(getattr(states, name), np.float64)

    pipeline = load_sensor('reskin_board').load(calibration)
    # offline, from the recording without any bag: its tare rows do what the tare service does
    sent = np.array([as_received(encode(row)) for row in touches.values])
    offline = pipeline.process_batch(replace(touches, values=sent))
    touched = ~touches.tare
    for name in TIMELESS:
        nodes, one_process = (
            column(bag.contacts.states, name)[np.argsort(bag.contacts.rows)][rows_of(bag)]
            for bag in bags.values()
        )
        alone = column(offline, name)[touched]
        np.testing.assert_allclose(nodes, one_process, rtol=0, atol=TOLERANCE, err_msg=name)
        np.testing.assert_allclose(nodes[touched], alone, rtol=0, atol=TOLERANCE, err_msg=name)


def test_a_bag_that_is_played_gives_its_contacts_but_for_its_tares(
    ros: Ros, bags: dict[str, LoadedRecording], folder: Path, calibration: Path
) -> None:
    """The graph of replay.launch.py; the player's part, clock and two topics, is played here."""
    playback = BagPlayback(str(folder / 'nodes'), str(calibration), namespace='hand/thumb')
    ros.init()
    frames, layout = playback.topics
    kinds = {'/clock': Clock, frames: TactileFrame, layout: TactileLayout}
    said = {
        topic: ros.listener.create_publisher(kind, topic, qos(topic.rsplit('/', 1)[-1]))
        for topic, kind in kinds.items()
    }
    heard = ros.hear(TactileContacts, '/hand/thumb/contacts')
    recording, count = bags['nodes'].recording, 0
    with Running(replaying(playback)) as running:
        assert ros.until(lambda: all(one.get_subscription_count() for one in said.values()))
        for message in read_all(folder / 'nodes').messages:
            clock = Clock()
            clock.clock.sec, clock.clock.nanosec = divmod(message.log_ns, 10**9)
            said['/clock'].publish(clock)
            if message.topic in playback.topics:
                said[message.topic].publish(message.data)
            count += message.topic == frames
            # its clock would run ahead: frames would be stale
            assert ros.until(lambda count=count: len(heard) >= count), running.lines
        assert len(heard) == len(recording)
        assert running.stop() == {'contact_node': 0}, running.lines
    got = messages.read_contacts(heard, recording.layout.shape[0])
    pipeline = load_sensor('reskin_board').load(calibration)
    alone = pipeline.process_batch(replace(recording, tare=None))
    assert np.isfinite(alone.position[:, :2]).all(axis=1).sum() >= TOUCHES
    for name in STATE_FIELDS.keys() - {'object_pose', 'object_pose_cov'}:
        np.testing.assert_allclose(
            got[name], getattr(alone, name), rtol=0, atol=TOLERANCE, err_msg=name
        )


def test_ctrl_c_while_everything_still_loads_is_silent() -> None:
    code = (
        'import os, signal, sys\n'
        'import tactile_ros.nodes.__main__ as entry\n'
        'entry.import_module = lambda name: os.kill(os.getpid(), signal.SIGINT)\n'
        'sys.argv = ["nodes", "sensor_node"]\n'
        'entry.start()\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, '')


@pytest.fixture
def collector() -> Iterator[None]:
    interval = sys.getswitchinterval()
    gc.unfreeze()
    yield
    gc.unfreeze()
    sys.setswitchinterval(interval)


@pytest.mark.usefixtures('collector')
def test_contacts_come_without_a_frame_on_the_wire_and_by_few_calls(
    ros: Ros, port: Port, calibration: Path, rows: np.ndarray
) -> None:
    ros.init(f'port:={port.port}', f'calibration:={calibration}')
    contact, sensor = (ros.add(node) for node in stack.build())
    heard: list[TactileContacts] = ros.hear(TactileContacts, 'contacts')
    lifecycle.start([contact, sensor])
    estimation, chains = contact.loop.pipeline.estimation, []
    estimate = estimation.estimate

    def spied(*given: object, **named: object) -> object:
        chains.append([frame.function for frame in inspect.stack(0)])
        return estimate(*given, **named)

    estimation.estimate = spied
    waiting = cycle(rows)
    assert ros.until(lambda: heard or port.play([next(waiting)]))
    port.play([next(waiting) for _ in range(10)])
    assert ros.until(lambda: len(heard) > 10)
    sequence = [message.sequence for message in heard]
    assert sequence == list(range(sequence[0], sequence[0] + len(heard)))
    assert ros.listener.count_subscribers('frame') == 0
    assert {chain.index('_deliver') for chain in chains} <= set(range(DEEPEST + 1)), chains[0]
    # the collector is frozen once warm
    assert gc.get_freeze_count() == 0
    assert ros.until(lambda: gc.get_freeze_count() or port.play([next(waiting)]))


def test_boards_that_hang_or_have_no_power_are_not_valid(
    ros: Ros, port: Port, calibration: Path, rows: np.ndarray
) -> None:
    """Through driver and DDS: the last reading again and again, new ones, then zeros."""
    ros.init(f'port:={port.port}', f'calibration:={calibration}')
    nodes = [ros.add(node) for node in stack.build()]
    heard: list[TactileContacts] = ros.hear(TactileContacts, 'contacts')
    lifecycle.start(nodes)
    sent = 0

    def play(some: np.ndarray) -> None:
        nonlocal sent
        port.play(some)
        sent += len(some)

    def answers(some: np.ndarray) -> list[TactileContacts]:
        first = sent
        for row in some:
            play(row[None])
            assert ros.until(lambda: heard[-1].sequence == sent - 1)
        return [message for message in heard if message.sequence >= first]

    assert ros.until(lambda: heard or play(rows[:1] + 1e-6 * sent))
    assert ros.until(lambda: heard[-1].sequence == sent - 1)
    assert all(message.valid for message in answers(rows[:100])[-50:])
    hung = answers(np.repeat(rows[99:100], 20, axis=0))
    assert not any(message.valid for message in hung[4:])
    assert hung[4].status & FrameStatus.STALE
    assert (np.array([message.taxel_status for message in hung[10:]]) & TaxelStatus.STUCK).all()
    assert answers(rows[100:120])[-1].valid
    dead = answers(np.zeros((5, *rows.shape[1:])))
    assert not any(message.valid or message.in_contact == 1 for message in dead)
    assert (np.array([message.taxel_status for message in dead]) & TaxelStatus.DEAD).all()


@pytest.fixture(scope='module')
def press(tmp_path_factory: pytest.TempPathFactory) -> object:
    return grip_roads.learnt_press(tmp_path_factory.mktemp('force') / 'force.npz')


@pytest.mark.parametrize('direct', [True, False])
def test_every_road_commands_the_same(
    ros: Ros, press: object, monkeypatch: pytest.MonkeyPatch, direct: bool
) -> None:
    clock = grip_roads.Clock()
    monkeypatch.setattr(grip_node, 'time', SimpleNamespace(monotonic=clock.monotonic))
    live = grip_roads.lived(ros, press, clock, direct)
    alone = grip_roads.offline(press)
    assert 40 < len(live) == len(alone) <= grip_roads.ROWS
    assert np.ptp(live, axis=0)[0] > 0.02
    np.testing.assert_allclose(live, alone, rtol=0, atol=1e-9)


def test_of_frames_that_waited_the_newest_is_answered_and_a_slip_in_any_counts(ros: Ros) -> None:
    ros.init('hand:=joint_trajectory')
    grip = ros.add(grip_node.GripNode())
    taken = []
    grip._take = lambda topic, touch, sequence, _: taken.append(
        (topic, touch.force, touch.valid, touch.slip, sequence)
    )
    frames = [Frame(k, k, np.zeros((1, 1))) for k in (1, 2, 3)]
    states = [
        SimpleNamespace(
            valid=True,
            status=0,
            force=np.full(3, float(k)),
            slip=slip,
            contacts=[],
            force_cov=np.full((3, 3), np.nan),
        )
        for k, slip in enumerate((-1, 1, -1))
    ]
    grip.take_states('/left/contacts', frames, states)
    grip.take_states('/left/contacts', frames[2:], states[2:])
    two = [2.0, 2.0, 2.0]
    assert taken == [('/left/contacts', two, True, 1, 3), ('/left/contacts', two, True, -1, 3)]


def test_the_nodes_of_a_hand_have_the_names_of_the_processes(ros: Ros) -> None:
    ros.init('hand:=joint_trajectory', 'seed:=3', 'source:=simulated')
    nodes = [ros.add(node) for node in stack.build()]
    names = [node.get_fully_qualified_name() for node in nodes]
    assert names == [
        '/grip_node', '/left/contact_node', '/right/contact_node',
        '/left/sensor_node', '/right/sensor_node',
    ]  # fmt: skip
    assert [node.get_parameter('seed').value for node in nodes[3:]] == [3, 4]
    assert nodes[0].direct == {'/left/contacts', '/right/contacts'}
    lifecycle.start(nodes)
    assert ros.until(lambda: not nodes[0].missing or nodes[0].missing == ['joint states'])
    assert ros.listener.count_subscribers('/left/contacts') == 0
