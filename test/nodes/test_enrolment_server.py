"""Classes from presses over real DDS: learned, recognised, kept, refused, forgotten."""

from __future__ import annotations

import json
import threading
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle, pairwise
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.node import Node
from std_msgs.msg import String

from reference import enrolled_skin
from tactile_ros.action import Enrol
from tactile_ros.messages import fill_frame
from tactile_ros.msg import TactileContacts, TactileFrame
from tactile_ros.nodes import lifecycle, stack
from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.enrolment_server import (
    CLOSED,
    Enrolment,
    EnrolmentClient,
    EnrolRequest,
    EnrolResult,
)
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.sensors import load_sensor
from tactile_ros.srv import ForgetContact
from tactile_ros.types import ContactStates, Frame, Layout

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from conftest import Ros

    from tactile_ros.types import Recording

LAYOUT = Layout(np.zeros((1, 3)), ('p',), '1')
WINDOW = 2
PATIENCE_S = 60.0
PRESS = (0.0, 5.0, 5.0, 5.0, 0.0)


class Skin:
    """A pipeline that learns names; `gate` is passed on the way into a file."""

    sensor, layout, digest = 'toy', LAYOUT, 'one and only'
    failures = 0
    config = SimpleNamespace(window=WINDOW)
    report: dict[str, dict[str, float]] = {}  # noqa: RUF012

    def __init__(self, gate: Callable[[], None] = lambda: None) -> None:
        self.estimation = SimpleNamespace(learns_classes=True)
        self.stream = None
        self.label_names: tuple[str, ...] = ()
        self.baseline = np.zeros((1, 1))
        self.gate, self.saved = gate, 0

    def reset(self) -> None:
        """Nothing is remembered."""

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
        self.learned: list[EnrolResult] = []
        self.changes: list[object] = []
        self.file = Skin(self.pass_gate)
        self.stage = ContactLoop(Skin(), 3, False, lambda _: None)  # type: ignore[arg-type]
        self.enrol = Enrolment(
            self.stage, 'skin.npz', lambda _: self.file, Skin.digest, self.changes.append
        )  # type: ignore[arg-type]
        self.count = 0

    def pass_gate(self) -> None:
        self.reached.set()
        assert self.opened.wait(PATIENCE_S)

    def feed(self, *values: float) -> None:
        for value in values:
            self.stage.process(Frame(self.count, self.count, np.full((1, 1), value)))
            self.count += 1

    def begin(self) -> None:
        """A lesson of one press, up to the gate."""

        def end(learned: EnrolResult) -> None:
            self.learned.append(learned)
            self.ended.set()

        self.enrol.begin(EnrolRequest('mug'), lambda *_: None, end)
        self.feed(*PRESS)
        assert self.reached.wait(PATIENCE_S)

    def finish(self) -> EnrolResult:
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
    assert room.stage.statistics.frames == 3 * len(PRESS)
    assert not room.ended.is_set()
    assert room.finish().success
    assert room.file.saved == len(room.changes) == 1


def test_a_lesson_can_be_withdrawn_until_its_class_is_written(room: Room) -> None:
    room.begin()
    assert room.enrol.cancel()
    assert room.finish() == EnrolResult(False, 'cancelled', cancelled=True)
    assert (room.file.saved, room.changes) == (0, [])
    assert not room.enrol.cancel()


def test_a_class_that_is_being_written_is_not_withdrawn(room: Room) -> None:
    refused: list[bool] = []
    room.file.save = lambda _: refused.append(room.enrol.cancel())  # type: ignore[method-assign]
    room.begin()
    assert room.finish().success
    assert refused == [False]
    assert len(room.changes) == 1


def test_whoever_asks_to_forget_hears_the_end_whatever_happens(room: Room) -> None:
    assert room.enrol.forget('odd') == (False, 'RuntimeError: nobody foresaw this')
    assert room.file.saved == 0
    room.enrol.close()
    assert room.enrol.forget('mug') == (False, CLOSED)


def test_a_lesson_that_fails_in_an_unforeseen_way_says_so(room: Room) -> None:
    room.file.save = lambda _: 1 / 0  # type: ignore[assignment, method-assign, return-value]
    room.begin()
    assert room.finish() == EnrolResult(False, 'ZeroDivisionError: division by zero')
    assert room.changes == []


def test_once_a_watch_is_taken_away_no_frame_is_in_it(room: Room) -> None:
    order: list[str] = []

    def watch(*_: object) -> None:
        room.pass_gate()
        order.append('watched')

    def take_away() -> None:
        room.stage.observe(None)
        order.append('taken away')

    room.stage.observe(watch)
    stream, other = (threading.Thread(target=one) for one in (lambda: room.feed(0.0), take_away))
    stream.start()
    assert room.reached.wait(PATIENCE_S)
    other.start()
    other.join(0.05)  # time to go wrong in
    room.opened.set()
    for thread in (stream, other):
        thread.join(PATIENCE_S)
    assert order == ['watched', 'taken away']


SPEC = load_sensor('multipole_skin')
TEST_ENROLMENT_WINDOW = SPEC.config().window  # type: ignore[attr-defined]


class Hand(Node):
    """Presses the skin: sends frames, asks for classes, and hears contacts."""

    def __init__(self, presses: Recording) -> None:
        super().__init__('hand')
        self.contacts: list[TactileContacts] = []
        self.calibrations: list[dict[str, object]] = []
        self.told: list[Enrol.Feedback] = []
        self.presses = presses
        self.count = 0
        self.frame = self.create_publisher(TactileFrame, 'frame', qos())
        self.create_subscription(TactileContacts, 'contacts', self.contacts.append, qos())
        self.create_subscription(
            String, 'calibration', lambda m: self.calibrations.append(json.loads(m.data)),
            qos('layout'),
        )  # fmt: skip
        self.enrol = ActionClient(self, Enrol, 'contact_node/enrol')
        self.forget = self.create_client(ForgetContact, 'contact_node/forget')

    def send(self, values: np.ndarray) -> None:
        """Publish rows as frames at 80 Hz."""
        for row in values:
            message = TactileFrame()
            fill_frame(message, enrolled_skin.frame_of(self.count, row), 'palm')
            self.frame.publish(message)
            self.count += 1

    def press(self, ros: Ros, number: int, scale: float = 1.0) -> None:
        """One of the presses from rest to rest, heard to its end."""
        self.send(enrolled_skin.press_of(self.presses, number, scale))
        assert ros.until(lambda: len(self.contacts) == self.count)

    def ask(self, ros: Ros, label: str, presses: int = 1, **more: object) -> object:
        """Ask for a class; the goal is under way."""
        assert ros.until(self.enrol.server_is_ready)
        goal = Enrol.Goal(label=label, presses=presses, **{'timeout': 60.0, **more})
        sent = self.enrol.send_goal_async(goal, lambda m: self.told.append(m.feedback))
        assert ros.until(sent.done)
        return sent.result()

    def labels(self) -> list[int]:
        """Answers so far."""
        return [message.label for message in self.contacts if message.label >= 0]


def result(ros: Ros, handle: object) -> object:
    """Status and result of a goal."""
    future = handle.get_result_async()
    assert ros.until(future.done)
    return future.result()


@pytest.fixture(scope='session')
def mugs() -> Recording:
    """Presses of one head at one place."""
    return enrolled_skin.new_head()


@pytest.fixture
def pair(ros: Ros, own_skin: Path, mugs: Recording) -> tuple[ContactNode, Hand]:
    """A calibrated contact_node that is heard, and the hand."""
    ros.init('sensor:=multipole_skin', f'calibration:={own_skin}', 'listeners:=1')
    return connected(ros, mugs)


def connected(ros: Ros, mugs: Recording) -> tuple[ContactNode, Hand]:
    contact, hand = ros.add(ContactNode()), ros.add(Hand(mugs))
    lifecycle.start([contact])
    assert ros.until(lambda: hand.frame.get_subscription_count() and contact.is_heard())
    return contact, hand


def test_a_class_is_learned_recognised_kept_and_forgotten(
    ros: Ros, pair: tuple[ContactNode, Hand], own_skin: Path
) -> None:
    _, hand = pair
    before = SPEC.load(own_skin).digest
    hand.press(ros, 0)
    assert 5 not in hand.labels()
    handle = hand.ask(ros, 'mug', 3)
    for number in (1, 2, 3):
        hand.press(ros, number)
        assert ros.until(lambda n=number: len(hand.told) == n)
    assert [feedback.presses for feedback in hand.told] == [1, 2, 3]
    assert hand.told[0].message == 'press 1 of 3 taken'
    ended = result(ros, handle)
    assert ended.status == GoalStatus.STATUS_SUCCEEDED
    assert (ended.result.success, ended.result.index) == (True, 5)
    assert "'mug' learned from 3 presses; it takes 0 % of 8 known presses" in ended.result.message
    hand.contacts.clear()
    hand.count = 0  # a stream that begins anew
    hand.press(ros, 4)
    assert set(hand.labels()) == {5}
    assert {m.label_name for m in hand.contacts if m.label == 5} == {'mug'}
    # the file is what the stream goes on with, and a node that starts again knows the class
    kept = SPEC.load(own_skin)
    assert kept.label_names[-1] == 'mug'
    assert ros.until(lambda: len(hand.calibrations) == 2)
    assert hand.calibrations[-1]['sha256'] == kept.digest
    assert hand.calibrations[-1]['enrolled'] == 'mug'
    assert len(hand.calibrations[-1]['presses']) == 3
    answer = ros.call(hand.forget, ForgetContact.Request(label='mug'))
    assert answer.success
    assert SPEC.load(own_skin).digest == before
    hand.press(ros, 5)
    assert ros.until(lambda: len(hand.calibrations) == 3)
    assert hand.calibrations[-1]['sha256'] == before
    assert 5 not in [m.label for m in hand.contacts[-60:]]
    assert not ros.call(hand.forget, ForgetContact.Request(label='mug')).success


def test_a_node_that_starts_anew_knows_what_was_learned(
    ros: Ros, pair: tuple[ContactNode, Hand]
) -> None:
    contact, hand = pair
    handle = hand.ask(ros, 'mug', 2)
    for number in (1, 2):
        hand.press(ros, number)
    assert result(ros, handle).result.success
    assert ros.until(lambda: hand.calibrations[-1].get('enrolled') == 'mug')
    digest = hand.calibrations[-1]['sha256']
    contact.trigger_shutdown()
    ros.executor.remove_node(contact)
    ros.nodes.remove(contact)
    contact.destroy_node()
    assert ros.until(lambda: not hand.frame.get_subscription_count())
    again = ros.add(ContactNode())
    lifecycle.start([again])
    assert ros.until(lambda: hand.frame.get_subscription_count() and again.is_heard())
    hand.contacts.clear()
    hand.count = 0
    hand.press(ros, 4)
    assert {m.label_name for m in hand.contacts if m.label >= 0} == {'mug'}
    assert ros.until(lambda: hand.calibrations[-1].get('enrolled') is None)
    assert hand.calibrations[-1]['sha256'] == digest


def test_weak_and_clipped_presses_are_refused_and_say_so(
    ros: Ros, pair: tuple[ContactNode, Hand]
) -> None:
    _, hand = pair
    handle = hand.ask(ros, 'mug')
    hand.press(ros, 1, scale=0.08)
    hand.press(ros, 1, scale=80.0)
    hand.press(ros, 2)
    ended = result(ros, handle)
    assert ended.result.success
    assert ros.until(lambda: len(hand.told) == 3)
    weak, clipped, good = hand.told
    assert (weak.presses, clipped.presses, good.presses) == (0, 0, 1)
    assert 'press harder' in weak.message
    assert 'clipped or faulty: press less' in clipped.message


def test_a_lesson_that_ends_early_leaves_everything_as_it_was(
    ros: Ros, pair: tuple[ContactNode, Hand], own_skin: Path
) -> None:
    contact, hand = pair
    content = own_skin.read_bytes()
    handle = hand.ask(ros, 'mug', 3)
    hand.press(ros, 0)
    assert ros.until(lambda: len(hand.told) == 1)
    busy = result(ros, hand.ask(ros, 'cup'))
    assert busy.status == GoalStatus.STATUS_ABORTED
    assert 'another class is being enrolled' in busy.result.message
    cancelled = handle.cancel_goal_async()
    assert ros.until(cancelled.done)
    assert result(ros, handle).status == GoalStatus.STATUS_CANCELED
    late = result(ros, hand.ask(ros, 'mug', 3, timeout=0.05))
    assert "0 of 3 presses of 'mug' came within 0.05 s" in late.result.message
    handle = hand.ask(ros, 'mug')
    contact.trigger_deactivate()
    ended = result(ros, handle)
    assert ended.result.message == 'contact_node was deactivated'
    assert own_skin.read_bytes() == content
    inactive = result(ros, hand.ask(ros, 'mug'))
    assert 'activate it first' in inactive.result.message


def test_the_client_of_the_command_line_hears_every_press_and_the_end(
    ros: Ros, pair: tuple[ContactNode, Hand]
) -> None:
    _, hand = pair
    client = EnrolmentClient()
    told: list[tuple[int, str]] = []
    try:
        with ThreadPoolExecutor(1) as pool:

            def answer(call: Callable[..., object], *arguments: object) -> object:
                future = pool.submit(call, *arguments)
                assert ros.until(future.done)
                return future.result()

            asked = pool.submit(
                client.enrol, EnrolRequest('mug', 1), lambda *said: told.append(said)
            )
            number = cycle(range(8))
            # until one press fell wholly into the lesson
            assert ros.until(lambda: asked.done() or hand.press(ros, next(number)))
            assert asked.result().success
            assert told == [(1, 'press 1 of 1 taken')]
            assert answer(client.forget, 'mug') == (
                True, "'mug' forgotten; classes are 0, 1, 2, 3, 4"
            )  # fmt: skip
            refused = answer(client.enrol, EnrolRequest(' ', 1), print)
            assert 'label of enrol must be a name' in refused.message
    finally:
        client.close()


def test_without_a_file_nothing_is_learned(ros: Ros, mugs: Recording) -> None:
    ros.init('sensor:=multipole_skin', 'listeners:=1')
    _, hand = connected(ros, mugs)
    ended = result(ros, hand.ask(ros, 'mug'))
    assert 'needs a calibration file' in ended.result.message
    assert not ros.call(hand.forget, ForgetContact.Request(label='mug')).success


def test_one_answer_stands_on_the_last_frame_of_each_window_of_a_twin(
    ros: Ros, taught_skin: Path
) -> None:
    ros.init(
        'sensor:=multipole_skin', f'calibration:={taught_skin}', 'simulated:=true',
        'transport:=serial', 'seed:=1', 'contact_node:listeners:=1',
    )  # fmt: skip
    contact, sensor = (ros.add(node) for node in stack.build())
    listener = ros.add(Node('listener'))
    heard: list[TactileContacts] = []
    listener.create_subscription(TactileContacts, 'contacts', heard.append, qos())
    lifecycle.start([contact, sensor])
    assert ros.until(lambda: sum(m.label >= 0 for m in heard) >= 8)
    held = 0
    for message in heard:
        held = held + 1 if message.in_contact == 1 else 0
        answered = message.label >= 0
        assert not answered or held % TEST_ENROLMENT_WINDOW == 0, message.sequence
        assert message.label_probability > 0 if answered else np.isnan(message.label_probability)
    onsets = [m for m, n in pairwise(heard) if m.in_contact < n.in_contact]
    assert onsets
