"""One thread that reads a device and hands its frames on, through whatever the port does."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import DeviceError, DeviceTimeout, TactileError
from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Device, Frame

READ_TIMEOUT_S = 0.25
FIRST_RETRY_S = 0.1
LONGEST_RETRY_S = 0.5
# the same complaint is not told again before
REPEAT_S = 10.0


@dataclass
class Reading:
    """What the reader has seen, for diagnostics.

    Attributes
    ----------
    frames : int
        Handed on.
    failures : int
        Errors of the device or of what came after it.
    sentence : str
        Why nothing comes now; empty while frames come.
    last : Frame or None
        The latest frame.
    flagged : int
        Taxel readings with a status bit.
    """

    frames: int = 0
    failures: int = 0
    sentence: str = 'no frame yet'
    last: Frame | None = None
    flagged: int = 0

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
        Takes every frame, in the reader's thread: the port's own buffer is the queue.
    complain : callable
        Takes a sentence whenever the reason why nothing comes changes.
    ready : callable or None
        Nothing is read before it returns True: whoever must see the first frame is there.
    """

    def __init__(
        self,
        device: Device,
        deliver: Callable[[Frame], None],
        complain: Callable[[str], None],
        ready: Callable[[], bool] | None = None,
    ) -> None:
        self.reading = Reading()
        self._device = device
        self._deliver = deliver
        self._complain = complain
        self._ready = ready
        self._stop = threading.Event()
        self._opened = ExitStack()
        self._is_open = False
        self._told: dict[str, float] = {}
        self._thread = threading.Thread(target=self._run, name='reader', daemon=True)

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
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the device."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
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
            self.open()
        while self._ready is not None and not self._ready():
            if self._stop.wait(0.01):
                return
        while not self._stop.is_set():
            self._step()

    def _step(self) -> None:
        """One frame, or the reason why there is none."""
        try:
            frame = self._device.read(READ_TIMEOUT_S)
        except DeviceTimeout as err:
            self._note(str(err))
            return
        except (TactileError, OSError) as err:
            self.reading.failures += 1
            self._note(str(err))
            self._stop.wait(FIRST_RETRY_S)
            return
        self._take(frame)

    def _take(self, frame: Frame) -> None:
        """Hand a frame on; a failure there is told and costs that frame alone."""
        reading = self.reading
        reading.frames += 1
        reading.last = frame
        if frame.status is not None:
            reading.flagged += int(np.count_nonzero(frame.status))
        try:
            self._deliver(frame)
        except Exception as err:  # whatever listens must not end the sensor
            reading.failures += 1
            self._note(f'{type(err).__name__}: {err}')
        else:
            reading.sentence = ''

    def _note(self, sentence: str) -> None:
        """Complain about each new reason, and about one that comes and goes now and then."""
        self.reading.sentence = sentence
        now = time.monotonic()
        if now - self._told.get(sentence, -REPEAT_S) >= REPEAT_S:
            self._told = {sentence: now}
            self._complain(sentence)
