"""The reader's thread goes on through everything that a device can do."""

from __future__ import annotations

import itertools
import queue
import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.nodes import sensor_node
from tactile_ros.nodes.sensor_node import Reader
from tactile_ros.types import Frame, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

PATIENCE_S = 120.0


class Script:
    """A device that does what a list says: frames, errors, and errors on opening."""

    def __init__(self, *acts: object, refusals: int = 0) -> None:
        self.acts = queue.SimpleQueue()
        for act in acts:
            self.acts.put(act)
        self.refusals = refusals
        self.opened = 0
        self.closed = threading.Event()

    def __enter__(self) -> Script:
        if self.refusals:
            self.refusals -= 1
            msg = 'port x does not exist; ports here: y'
            raise DeviceError(msg)
        self.opened += 1
        return self

    def __exit__(self, *_: object) -> None:
        self.closed.set()

    def read(self, timeout: float) -> Frame:
        try:
            act = self.acts.get(timeout=min(timeout, 0.01))
        except queue.Empty:
            msg = 'nothing came'
            raise DeviceTimeout(msg) from None
        if isinstance(act, Exception):
            raise act
        return act


def frame(sequence: int, status: int = 0) -> Frame:
    bits = np.array([0, status], np.uint8) if status else None
    return Frame(sequence, sequence, np.zeros((2, 3)), status=bits)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(sensor_node, 'FIRST_RETRY_S', 0.001)
    return


def run(device: Script, frames: int, **options: object) -> tuple[Reader, list[Frame], list[str]]:
    """Read until so many frames came, then close."""
    got, said, enough = [], [], threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.extend(items)
        if len(got) >= frames:
            enough.set()
        if items[0].sequence in options.get('fails_at', ()):
            msg = 'a listener failed'
            raise RuntimeError(msg)

    read = Reader(device, deliver, said.append, options.get('ready'))
    read.open()
    read.start()
    came = enough.wait(PATIENCE_S)
    read.close()
    assert came
    assert device.closed.is_set()
    return read, got, said


def test_a_missing_port_is_told_once_and_tried_again() -> None:
    device = Script(frame(0), refusals=5)
    _, got, said = run(device, 1)
    assert [f.sequence for f in got] == [0]
    assert said[0] == 'port x does not exist; ports here: y; trying again'
    assert said.count(said[0]) == 1
    assert device.opened == 1


def test_errors_of_the_device_do_not_end_the_reader() -> None:
    device = Script(frame(0), DeviceError('the stream is text'), OSError('gone'), frame(1))
    read, got, said = run(device, 2)
    assert [f.sequence for f in got] == [0, 1]
    assert read.reading.failures == 2
    assert 'the stream is text' in said


def test_a_listener_that_fails_costs_one_frame() -> None:
    read, got, said = run(Script(frame(0), frame(1), frame(2)), 3, fails_at=(1,))
    assert [f.sequence for f in got] == [0, 1, 2]
    assert 'RuntimeError: a listener failed' in said
    assert read.reading.failures == 1


def test_frames_that_came_together_are_handed_on_together() -> None:
    class Bundled(Script):
        """A port that has kept two more frames back."""

        def waiting(self) -> list[Frame]:
            return [frame(k) for k in (1, 2)] if self.acts.empty() else []

    got, enough = [], threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.append([item.sequence for item in items])
        enough.set()

    read = Reader(Bundled(frame(0)), deliver, lambda _: None)
    read.open()
    read.start()
    assert enough.wait(PATIENCE_S)
    read.close()
    assert got == [[0, 1, 2]]
    assert read.reading.frames == 3


def test_nothing_is_read_before_everybody_is_there() -> None:
    device = Script(frame(0))
    asked = []

    def ready() -> bool:
        assert device.acts.qsize() == 1
        asked.append(True)
        return len(asked) > 3

    run(device, 1, ready=ready)
    assert len(asked) == 4


def test_flags_are_counted_and_named() -> None:
    stuck = frame(0, TaxelStatus.STUCK | TaxelStatus.SATURATED)
    read, _, _ = run(Script(stuck), 1)
    assert read.reading.taxels(TaxelStatus.STUCK) == [1]
    assert read.reading.taxels(TaxelStatus.ERROR) == []
    assert read.reading.flagged == 1


def test_a_full_queue_drops_the_oldest_and_counts() -> None:
    device = Script(frame(0))
    got, gate, taken = [], threading.Event(), threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.extend((item.sequence, item.dropped) for item in items)
        taken.set()
        assert gate.wait(PATIENCE_S)

    def complain(_: str) -> None:
        """What the empty script says."""

    read = Reader(device, deliver, complain, queue=3)
    read.open()
    read.start()
    assert taken.wait(PATIENCE_S)
    # all others are read while the listener still has the first
    for k in range(1, 10):
        device.acts.put(frame(k))
    while read.reading.frames < 10:
        assert not gate.wait(0.001)
    gate.set()
    read.close()
    first, *others = got
    assert first == (0, 0)
    # three were left, and say how many were lost before them
    assert others == [(k, 6) for k in (7, 8, 9)]
    assert read.reading.overruns == 6
    assert not {'reader', 'reader_queue'} & {thread.name for thread in threading.enumerate()}


def test_an_error_that_no_driver_may_raise_does_not_end_the_reader() -> None:
    read, got, said = run(Script(frame(0), ZeroDivisionError('by zero'), frame(1)), 2)
    assert [f.sequence for f in got] == [0, 1]
    assert 'ZeroDivisionError: by zero' in said
    assert read.reading.failures == 1


def test_stamps_and_marks_are_taken_once() -> None:
    read, _, _ = run(Script(frame(3), frame(5, TaxelStatus.STUCK)), 2)
    assert read.reading.take_stamps() == [3, 5]
    assert read.reading.take_stamps() == []
    assert read.reading.take_marks() == TaxelStatus.STUCK
    assert not read.reading.take_marks()


@pytest.mark.parametrize(('often', 'told'), [(19, True), (20, False)])
def test_a_reading_that_repeats_itself_now_and_then_is_not_told(often: int, told: bool) -> None:
    reading = sensor_node.Reading()
    for sequence in range(often):
        reading.note(frame(sequence, TaxelStatus.STALE if sequence == 3 else 0))
    assert bool(reading.take_marks()) is told


def test_what_was_kept_back_is_discarded_however_long_it_takes_to_decode(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = itertools.count(0.0, 4e-3)  # 4 ms from one look at the clock to the next
    monkeypatch.setattr(sensor_node, 'time', SimpleNamespace(monotonic=lambda: next(now)))

    class Buffered(Script):
        """Frames 0 to 4 were kept back; later ones come when somebody waits."""

        def read(self, timeout: float) -> Frame:
            if timeout == 0.0 and self.acts.qsize() <= 2:
                msg = 'nothing now'
                raise DeviceTimeout(msg)
            return super().read(max(timeout, 0.01))

    got, enough = [], threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.extend(item.sequence for item in items)
        if len(got) == 2:
            enough.set()

    device = Buffered(*(frame(k) for k in range(7)))
    read = Reader(device, deliver, lambda _: None, kept_back_s=25e-3)
    read.open()
    read.start()
    assert enough.wait(PATIENCE_S)
    read.close()
    assert got == [5, 6]
