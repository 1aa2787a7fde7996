"""One thread that reads a device and hands its frames on, through whatever the port does.

With a queue a second thread hands on, so that a slow listener never delays the reading: a frame
that finds the queue full pushes the oldest one out, which is counted. Without one, frames that
have waited in the port are handed on together, so that whoever is late catches up.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import DeviceError, DeviceTimeout, TactileError
from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Device, Frame

READ_TIMEOUT_S = 0.25
FIRST_RETRY_S = 0.1
LONGEST_RETRY_S = 0.5
# the same complaint is not told again before
REPEAT_S = 10.0
# a quiet chip repeats itself now and then
RARELY = 0.05
MOST_STAMPS = 10_000
MOST_DISCARDING_S = 0.5


@dataclass
class Reading:
    """What the reader has seen, for diagnostics.

    Attributes
    ----------
    frames : int
        Read.
    overruns : int
        Of them those that were pushed out of a full queue.
    failures : int
        Errors of the device or of what came after it.
    waiting : bool
        Nothing is read before everybody who listens is there.
    sentence : str
        Why nothing comes now; empty while frames come.
    last : Frame or None
        The latest frame.
    flagged : int
        Taxel readings with a status bit.
    stamps : deque of int
        Acquisition times (ns) since they were taken last.
    marks : int
        Bits of `TaxelStatus` that came since they were taken last.
    fresh, stale : int
        Frames since then, and those with a STALE taxel.
    """

    frames: int = 0
    overruns: int = 0
    failures: int = 0
    waiting: bool = False
    sentence: str = 'no frame yet'
    last: Frame | None = None
    flagged: int = 0
    stamps: deque[int] = field(default_factory=lambda: deque(maxlen=MOST_STAMPS))
    marks: int = 0
    fresh: int = 0
    stale: int = 0

    def note(self, frame: Frame) -> None:
        """Count a frame."""
        self.frames += 1
        self.fresh += 1
        self.last = frame
        self.stamps.append(frame.stamp_ns or 0)
        if frame.status is not None:
            self.flagged += int(np.count_nonzero(frame.status))
            marks = int(np.bitwise_or.reduce(frame.status))
            self.marks |= marks
            self.stale += bool(marks & TaxelStatus.STALE)

    def take_stamps(self) -> list[int]:
        """Acquisition times (ns) since the last call."""
        return [self.stamps.popleft() for _ in range(len(self.stamps))]

    def take_marks(self) -> TaxelStatus:
        """Bits that came since the last call; STALE only if it came often."""
        marks = TaxelStatus(self.marks)
        if self.stale <= RARELY * self.fresh:
            marks &= ~TaxelStatus.STALE
        self.marks = self.fresh = self.stale = 0
        return marks

    def taxels(self, bit: TaxelStatus) -> list[int]:
        """Taxels of the latest frame that carry a status bit."""
        if self.last is None or self.last.status is None:
            return []
        return [int(i) for i in np.flatnonzero(self.last.status & int(bit))]


class Reader:
    """Read a device in a thread of its own until closed; no failure of the device ends it.

    Parameters
    ----------
    device : Device
        Not yet entered; opened again with growing pauses where its port is missing.
    deliver : callable
        Takes every frame once and in order: those that came together, one at a time from a queue.
    complain : callable
        Takes a sentence whenever the reason why nothing comes changes.
    ready : callable or None
        Nothing is read before it returns True: whoever must see the first frame is there.
    queue : int
        Frames that may wait for `deliver`, which runs in a thread of its own then; 0: it runs in
        the reader's thread, and the port's own buffer is the queue.
    kept_back_s : float
        Before reading begins, discard what the port hands over faster than this: it was kept
        back, and its age is unknown. 0: nothing is discarded.
    """

    def __init__(
        self,
        device: Device,
        deliver: Callable[[Sequence[Frame]], None],
        complain: Callable[[str], None],
        ready: Callable[[], bool] | None = None,
        queue: int = 0,
        kept_back_s: float = 0.0,
    ) -> None:
        self.reading = Reading()
        self._device = device
        self._deliver = deliver
        self._waiting: Callable[[], list[Frame]] = getattr(device, 'waiting', list)
        self._complain = complain
        self._ready = ready
        self._stop = threading.Event()
        self._opened = ExitStack()
        self._is_open = False
        self._told: dict[str, float] = {}
        self._limit = queue
        self._kept_back_s = kept_back_s
        self._queue: SimpleQueue[Frame | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name='reader', daemon=True)
        self._handing = threading.Thread(target=self._hand_on, name='reader_queue', daemon=True)

    @property
    def is_open(self) -> bool:
        """Whether the device could be opened."""
        return self._is_open

    def open(self) -> bool:
        """Try to open the device now; where its port is missing, the thread goes on trying."""
        try:
            self._opened.enter_context(self._device)
            self._is_open = True
        except DeviceError as err:
            self._note(f'{err}; trying again')
        return self._is_open

    def start(self) -> None:
        """Begin to read."""
        if self._limit:
            self._handing.start()
        self._thread.start()

    def close(self) -> None:
        """End the threads and close the device."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._handing.is_alive():
            self._queue.put(None)
            self._handing.join()
        self._opened.close()

    def counters(self) -> dict[str, int]:
        """Counts of the device itself, where it keeps any."""
        counted = getattr(self._device, 'counters', None)
        return dict(counted()) if counted is not None else {}

    def _run(self) -> None:
        """Open, wait for the listeners, read; after a failure again from the top."""
        pause = FIRST_RETRY_S
        while not self._is_open and not self._stop.wait(pause):
            pause = min(2 * pause, LONGEST_RETRY_S)
            self._open_again()
        self.reading.waiting = self._ready is not None
        while self._ready is not None and not self._ready():
            if self._stop.wait(0.01):
                return
        self.reading.waiting = False
        self._discard()
        while not self._stop.is_set():
            self._step()

    def _discard(self) -> None:
        """Read on until a frame has to be waited for."""
        end = time.monotonic() + MOST_DISCARDING_S
        took = 0.0
        with suppress(Exception):  # a failure is told by the reading that follows
            while took < self._kept_back_s and time.monotonic() < end and not self._stop.is_set():
                began = time.monotonic()
                self._device.read(0.0)
                took = time.monotonic() - began

    def _open_again(self) -> None:
        """Try to open; what fails is told."""
        try:
            self.open()
        except (TactileError, OSError, ValueError) as err:
            self._note(f'{err}; trying again')

    def _step(self) -> None:
        """What has come, or the reason why nothing has."""
        try:
            frames = [self._device.read(READ_TIMEOUT_S), *self._waiting()]
        except DeviceTimeout as err:
            self._note(str(err))
        except (TactileError, OSError) as err:
            self._fail(str(err))
        except Exception as err:  # also what no driver may do: the node goes on
            self._fail(f'{type(err).__name__}: {err}')
        else:
            self._take(frames)

    def _fail(self, sentence: str) -> None:
        """Count a failure, tell it, and pause."""
        self.reading.failures += 1
        self._note(sentence)
        self._stop.wait(FIRST_RETRY_S)

    def _take(self, frames: list[Frame]) -> None:
        """Hand frames on, or let them wait in the queue."""
        for frame in frames:
            self.reading.note(frame)
        self.reading.sentence = ''
        if not self._limit:
            self._pass_on(frames)
            return
        for frame in frames:
            if self._queue.qsize() >= self._limit:
                self._push_out()
            self._queue.put(frame)

    def _push_out(self) -> None:
        """Drop the oldest frame, unless it has just been taken."""
        with suppress(Empty):
            self._queue.get_nowait()
            self.reading.overruns += 1

    def _hand_on(self) -> None:
        """Empty the queue until there is nothing more to come."""
        while (frame := self._queue.get()) is not None:
            lost = self.reading.overruns
            self._pass_on([replace(frame, dropped=frame.dropped + lost) if lost else frame])

    def _pass_on(self, frames: list[Frame]) -> None:
        """Hand frames on; a failure there is told and costs them alone."""
        try:
            self._deliver(frames)
        except Exception as err:  # whatever listens must not end the sensor
            self.reading.failures += 1
            self._note(f'{type(err).__name__}: {err}')

    def _note(self, sentence: str) -> None:
        """Complain about each new reason, and about one that comes and goes now and then."""
        self.reading.sentence = sentence
        now = time.monotonic()
        if now - self._told.get(sentence, -REPEAT_S) >= REPEAT_S:
            self._told = {sentence: now}
            self._complain(sentence)
