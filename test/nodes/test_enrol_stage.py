"""A lesson beside a stream: what waits for what, until when it can be withdrawn, what is told."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.nodes.contact_loop import ContactStage
from tactile_ros.nodes.enrolment_server import CLOSED, EnrolStage, Learned, Lesson
from tactile_ros.types import ContactStates, Frame, Layout

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tactile_ros.types import Recording

LAYOUT = Layout(np.zeros((1, 3)), ('p',), '1')
WINDOW = 2
PATIENCE_S = 60.0
PRESS = (0.0, 5.0, 5.0, 5.0, 0.0)


class Skin:
    """A pipeline that learns names; `gate` is passed on the way into a file."""

    sensor, layout, digest = 'toy', LAYOUT, 'one and only'
    config = SimpleNamespace(window=WINDOW)
    report: dict[str, dict[str, float]] = {}  # noqa: RUF012

    def __init__(self, gate: Callable[[], None] = lambda: None) -> None:
        self.estimation = SimpleNamespace(enrol=True)
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
        self.learned: list[Learned] = []
        self.changes: list[object] = []
        self.file = Skin(self.pass_gate)
        self.stage = ContactStage(Skin(), 3, False, lambda _: None)  # type: ignore[arg-type]
        self.enrol = EnrolStage(
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

        def end(learned: Learned) -> None:
            self.learned.append(learned)
            self.ended.set()

        self.enrol.begin(Lesson('mug'), lambda *_: None, end)
        self.feed(*PRESS)
        assert self.reached.wait(PATIENCE_S)

    def finish(self) -> Learned:
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
    assert room.stage.tally.frames == 3 * len(PRESS)
    assert not room.ended.is_set()
    assert room.finish().success
    assert room.file.saved == len(room.changes) == 1


def test_a_lesson_can_be_withdrawn_until_its_class_is_written(room: Room) -> None:
    room.begin()
    assert room.enrol.cancel()
    assert room.finish() == Learned(False, 'cancelled', cancelled=True)
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
    assert room.finish() == Learned(False, 'ZeroDivisionError: division by zero')
    assert room.changes == []


def test_once_a_watch_is_taken_away_no_frame_is_in_it(room: Room) -> None:
    order: list[str] = []

    def watch(*_: object) -> None:
        room.pass_gate()
        order.append('watched')

    def take_away() -> None:
        room.stage.watch = None
        order.append('taken away')

    room.stage.watch = watch
    stream, other = (threading.Thread(target=one) for one in (lambda: room.feed(0.0), take_away))
    stream.start()
    assert room.reached.wait(PATIENCE_S)
    other.start()
    other.join(0.05)  # time to go wrong in
    room.opened.set()
    for thread in (stream, other):
        thread.join(PATIENCE_S)
    assert order == ['watched', 'taken away']
