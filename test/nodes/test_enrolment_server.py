# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Classes from presses over real DDS: learned, recognised, kept, refused, forgotten."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from std_msgs.msg import String

from reference import enrolled_skin
from tactile_ros.action import Enrol
from tactile_ros.messages import fill_frame
from tactile_ros.msg import TactileContacts, TactileFrame
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.enrolment_server import (
    CLOSED,
    Enrolment,
    EnrolmentClient,
    EnrolRequest,
    refusal,
)
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.sensors import load_sensor
from tactile_ros.srv import ForgetContact
from tactile_ros.types import ContactStates, Frame, Layout, Recording

if TYPE_CHECKING:
    from conftest import Ros

SPEC = load_sensor('multipole_skin')
PATIENCE_S = 60.0
PRESS = (0.0, 5.0, 5.0, 5.0, 0.0)


class Skin:
    """A pipeline that learns names; `gate` is passed on the way into a file."""

    sensor, layout, digest = 'toy', Layout(np.zeros((1, 3)), ('p',), '1'), 'one and only'
    failures = 0
    config = SimpleNamespace(window=2)
    estimation = SimpleNamespace(learns_classes=True)
    baseline = np.zeros((1, 1))
    report: dict[str, dict[str, float]] = {}  # noqa: RUF012

    def __init__(self, gate: Callable[[], None] = lambda: None) -> None:
        self.label_names: tuple[str, ...] = ()
        self.gate, self.saved = gate, 0

    def process(self, frame: Frame) -> object:
        touched = np.array([int(frame.values[0, 0] > 1)])
        known = {'in_contact': touched, 'valid': np.array([True]), 'status': np.array([0])}
        return ContactStates.assemble(1, 1, known)[0]

    def enrol(self, _: Recording, label: str) -> None:
        if label.strip():
            self.gate()
        self.label_names = (*self.label_names, label)

    def forget(self, label: str) -> None:
        if label == 'odd':
            msg = 'nobody foresaw this'
            raise RuntimeError(msg)
        self.label_names = tuple(name for name in self.label_names if name != label)

    def save(self, _: str) -> None:
        self.saved += 1


class Room:
    """A stream, a lesson beside it, and a gate that holds the lesson before it is learned."""

    def __init__(self) -> None:
        self.reached, self.opened, self.ended = (threading.Event() for _ in range(3))
        self.learned: list[Enrol.Result] = []
        self.changes: list[object] = []
        self.file = Skin(self.pass_gate)
        self.loop = ContactLoop(Skin(), 3, False, lambda _: None)  # type: ignore[arg-type]
        self.enrol = Enrolment(
            self.loop, 'skin.npz', lambda _: self.file, Skin.digest, self.changes.append
        )  # type: ignore[arg-type]
        self.count = 0

    def pass_gate(self) -> None:
        self.reached.set()
        assert self.opened.wait(PATIENCE_S)

    def feed(self, *values: float) -> None:
        for value in values:
            self.loop.process([Frame(self.count, self.count, np.full((1, 1), value))])
            self.count += 1

    def begin(self) -> None:
        """A lesson of one press, up to the gate."""

        def end(learned: Enrol.Result) -> None:
            self.learned.append(learned)
            self.ended.set()

        self.enrol.begin(EnrolRequest('mug'), lambda *_: None, end)
        self.feed(*PRESS)
        assert self.reached.wait(PATIENCE_S)

    def finish(self) -> Enrol.Result:
        self.opened.set()
        assert self.ended.wait(PATIENCE_S)
        return self.learned[0]


@pytest.fixture
def room() -> Iterator[Room]:
    made = Room()
    yield made
    made.opened.set()
    made.enrol.close()


def test_no_frame_waits_while_a_class_is_judged(room: Room) -> None:
    room.begin()
    room.feed(*PRESS, *PRESS)  # would hang here
    assert room.loop.statistics.frames == 3 * len(PRESS)
    assert not room.ended.is_set()
    assert room.finish().success
    assert room.file.saved == len(room.changes) == 1


def test_enrolment_can_be_withdrawn_until_its_class_is_written(room: Room) -> None:
    room.begin()
    assert room.enrol.cancel()
    assert room.finish() == refusal('cancelled')
    assert (room.file.saved, room.changes) == (0, [])
    assert not room.enrol.cancel()


def test_a_class_that_is_being_written_is_not_withdrawn(room: Room) -> None:
    refused: list[bool] = []
    room.file.save = lambda _: refused.append(room.enrol.cancel())  # type: ignore[method-assign]
    room.begin()
    assert room.finish().success
    assert refused == [False]
    assert len(room.changes) == 1


def test_whoever_asks_hears_the_end_whatever_happens(room: Room) -> None:
    assert room.enrol.forget('odd') == (False, 'RuntimeError: nobody foresaw this')
    room.file.save = lambda _: 1 / 0  # type: ignore[assignment, method-assign, return-value]
    room.begin()
    assert room.finish() == refusal('ZeroDivisionError: division by zero')
    assert (room.changes, room.file.saved) == ([], 0)
    room.enrol.close()
    assert room.enrol.forget('mug') == (False, CLOSED)


def test_once_an_observer_is_taken_away_no_frame_is_in_it(room: Room) -> None:
    order: list[str] = []

    def watch(*_: object) -> None:
        room.pass_gate()
        order.append('watched')

    def take_away() -> None:
        room.loop.observe(None)
        order.append('taken away')

    room.loop.observe(watch)
    stream, other = (threading.Thread(target=one) for one in (lambda: room.feed(0.0), take_away))
    stream.start()
    assert room.reached.wait(PATIENCE_S)
    other.start()
    other.join(0.05)  # time to go wrong in
    room.opened.set()
    for thread in (stream, other):
        thread.join(PATIENCE_S)
    assert order == ['watched', 'taken away']


class Hand:
    """A contact_node, and who presses its skin, asks for classes and hears contacts."""

    def __init__(self, ros: Ros, presses: Recording, *parameters: str) -> None:
        ros.init('sensor:=multipole_skin', 'listeners:=1', *parameters)
        self.ros, self.presses, self.count = ros, presses, 0
        self.told: list[Enrol.Feedback] = []
        self.frame = ros.listener.create_publisher(TactileFrame, 'frame', qos())
        self.contacts: list[TactileContacts] = ros.hear(TactileContacts, 'contacts')
        self._calibrations: list[String] = ros.hear(String, 'calibration')
        self.enrol = ActionClient(ros.listener, Enrol, 'contact_node/enrol')
        self.start()

    def start(self) -> None:
        """A node that begins anew."""
        self.node = self.ros.add(ContactNode())
        lifecycle.start([self.node])
        heard = self.frame.get_subscription_count
        assert self.ros.until(lambda: heard() and self.node.is_ready())
        self.begin_stream()

    def begin_stream(self) -> None:
        self.contacts.clear()
        self.count = 0

    def end(self) -> None:
        """End the node as its process would."""
        self.ros.executor.remove_node(self.node)
        self.ros.nodes.remove(self.node)
        self.node.end()
        assert self.ros.until(lambda: not self.frame.get_subscription_count())

    def press(self, number: int, scale: float = 1.0) -> None:
        """One of the presses from rest to rest, heard to its end."""
        for row in enrolled_skin.press_of(self.presses, number, scale):
            message = TactileFrame()
            fill_frame(message, enrolled_skin.frame_of(self.count, row), 'palm')
            self.frame.publish(message)
            self.count += 1
        assert self.ros.until(lambda: len(self.contacts) == self.count)

    def ask(self, label: str, presses: int = 1, **more: object) -> object:
        """Ask for a class; the goal is under way."""
        assert self.ros.until(self.enrol.server_is_ready)
        goal = Enrol.Goal(label=label, presses=presses, **{'timeout': 60.0, **more})
        sent = self.enrol.send_goal_async(goal, lambda m: self.told.append(m.feedback))
        return self.ros.result(sent)

    def result(self, handle: object) -> object:
        """Status and result of a goal."""
        return self.ros.result(handle.get_result_async())

    def forget(self, label: str) -> bool:
        return self.ros.ask(ForgetContact, 'contact_node/forget', label=label).success

    def labels(self, last: int = 0) -> set[str]:
        """Names of the answers so far."""
        return {m.label_name for m in self.contacts[-last:] if m.label >= 0}

    def announced(self, count: int) -> dict[str, object]:
        """Calibration that is announced at last, of so many."""
        assert self.ros.until(lambda: len(self._calibrations) == count)
        return json.loads(self._calibrations[-1].data)


@pytest.fixture(scope='session')
def mugs() -> Recording:
    """Presses of one head at one place."""
    return enrolled_skin.new_head()


@pytest.fixture
def hand(ros: Ros, own_skin: Path, mugs: Recording) -> Hand:
    """Of a calibrated contact_node."""
    return Hand(ros, mugs, f'calibration:={own_skin}')


def test_a_class_is_learned_recognised_kept_and_forgotten(
    ros: Ros, hand: Hand, own_skin: Path
) -> None:
    before = SPEC.load(own_skin).digest
    hand.press(0)
    assert 'mug' not in hand.labels()
    handle = hand.ask('mug', 3)
    for number in (1, 2, 3):
        hand.press(number)
        assert ros.until(lambda n=number: len(hand.told) == n)
    assert [feedback.presses for feedback in hand.told] == [1, 2, 3]
    assert hand.told[0].message == 'press 1 of 3 taken'
    ended = hand.result(handle)
    assert ended.status == GoalStatus.STATUS_SUCCEEDED
    assert (ended.result.success, ended.result.index) == (True, 5)
    assert "'mug' learned from 3 presses; it takes 0 % of 8 known presses" in ended.result.message
    hand.begin_stream()
    hand.press(4)
    assert hand.labels() == {'mug'}
    # the file is what the stream goes on with
    kept = SPEC.load(own_skin)
    assert kept.label_names[-1] == 'mug'
    told = hand.announced(2)
    assert (told['sha256'], told['enrolled'], len(told['presses'])) == (kept.digest, 'mug', 3)
    # and a node that starts again knows the class
    hand.end()
    hand.start()
    hand.press(4)
    assert hand.labels() == {'mug'}
    told = hand.announced(3)
    assert (told['sha256'], told.get('enrolled')) == (kept.digest, None)
    assert hand.forget('mug')
    assert SPEC.load(own_skin).digest == before
    hand.press(5)
    assert hand.announced(4)['sha256'] == before
    assert 'mug' not in hand.labels(last=60)
    assert not hand.forget('mug')


def test_weak_and_clipped_presses_are_refused_and_say_so(ros: Ros, hand: Hand) -> None:
    handle = hand.ask('mug')
    for number, scale in ((1, 0.06), (1, 80.0), (2, 1.0)):
        hand.press(number, scale)
    assert hand.result(handle).result.success
    assert ros.until(lambda: len(hand.told) == 3)
    weak, clipped, good = hand.told
    assert (weak.presses, clipped.presses, good.presses) == (0, 0, 1)
    assert 'press harder' in weak.message
    assert 'clipped or faulty: press less' in clipped.message


def test_enrolment_that_ends_early_leaves_everything_as_it_was(
    ros: Ros, hand: Hand, own_skin: Path
) -> None:
    content = own_skin.read_bytes()
    handle = hand.ask('mug', 3)
    hand.press(0)
    assert ros.until(lambda: len(hand.told) == 1)
    busy = hand.result(hand.ask('cup'))
    assert busy.status == GoalStatus.STATUS_ABORTED
    assert 'another class is being enrolled' in busy.result.message
    for label, presses in ((' ', 1), ('mug', 101)):
        assert ' must be ' in hand.result(hand.ask(label, presses)).result.message
    ros.result(handle.cancel_goal_async())
    assert hand.result(handle).status == GoalStatus.STATUS_CANCELED
    late = hand.result(hand.ask('mug', 3, timeout=0.05))
    assert "0 of 3 presses of 'mug' came within 0.05 s" in late.result.message
    handle = hand.ask('mug')
    hand.node.trigger_deactivate()
    assert hand.result(handle).result.message == 'contact_node was deactivated'
    assert own_skin.read_bytes() == content
    assert 'activate it first' in hand.result(hand.ask('mug')).result.message


def test_the_client_of_the_command_line_hears_every_press_and_the_end(
    ros: Ros, hand: Hand
) -> None:
    told: list[tuple[int, str]] = []
    with EnrolmentClient() as client, ThreadPoolExecutor(1) as pool:
        asked = pool.submit(client.enrol, EnrolRequest('mug', 1), lambda *said: told.append(said))
        number = cycle(range(8))
        # until one press fell wholly into the lesson
        assert ros.until(lambda: asked.done() or hand.press(next(number)))
        assert asked.result().success
        assert told == [(1, 'press 1 of 1 taken')]
        forgotten = ros.result(pool.submit(client.forget, 'mug'))
        assert forgotten == (True, "'mug' forgotten; classes are 0, 1, 2, 3, 4")


def test_without_a_file_nothing_is_learned(ros: Ros, mugs: Recording) -> None:
    hand = Hand(ros, mugs)
    assert 'needs a calibration file' in hand.result(hand.ask('mug')).result.message
    assert not hand.forget('mug')
