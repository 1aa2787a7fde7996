"""Playing a recording into a port, each step answered by the graph; without ROS."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.packets import encode, readings, words
from tactile_ros.devices.player import Player
from tactile_ros.devices.simulated import SimulatedSerialPort
from tactile_ros.errors import DeviceError, DeviceTimeout, TactileError
from tactile_ros.types import STATE_FIELDS, ContactStates

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tactile_ros.nodes.ledger import Ledger
    from tactile_ros.types import Array, Bools, Recording

WARM_ROWS = 4
# T; makes every warm-up row another one, far below the noise of a chip
WARM_STEP = 1e-7
RETRY_S = 1.0
LOST_S = 2.0
MOST_LOST = 5


class Stopped(TactileError):
    """Playing was told to stop."""


@dataclass(frozen=True)
class Score:
    """What is played and how.

    Attributes
    ----------
    recording : Recording
        Rows, tare rows, truth.
    port : str
        Path at which the simulated port appears.
    speed_up : float
        Recorded time over played time.
    rate_hz : float
        Of rows that have no stamps (Hz).
    window : int
        Rows on their way at most.
    patience_s : float
        Longest wait for the graph (s).
    """

    recording: Recording
    port: str
    speed_up: float = 1.0
    rate_hz: float = 400.0
    window: int = 16
    patience_s: float = 30.0


@dataclass
class Tally:
    """How it went.

    Attributes
    ----------
    rows, lost : int
        Played; not come back.
    seconds, recorded_s : float
        Time of playing, and of the recording (s).
    tares, refused : int
        Tares done and refused.
    refusal : str
        Why the last one was refused.
    """

    rows: int = 0
    lost: int = 0
    seconds: float = 0.0
    recorded_s: float = 0.0
    tares: int = 0
    refused: int = 0
    refusal: str = ''

    def __str__(self) -> str:
        """One line."""
        faster = self.recorded_s / self.seconds if self.seconds else 0.0
        speed = f', {faster:.3g} times the recorded speed' if faster else ''
        return (
            f'played {self.rows} rows in {self.seconds:.2f} s{speed}; {self.lost} lost; '
            f'{self.tares} tares done, {self.refused} refused'
        )


def truth_states(recording: Recording) -> ContactStates:
    """Truth of every row as states: tare rows are untouched, what is not told is unknown."""
    known = {name: x for name, x in recording.truth.items() if name in STATE_FIELDS}
    if recording.tare is not None:
        told = known.get('in_contact', np.full(len(recording), -1, np.int64)).astype(np.int64)
        known['in_contact'] = np.where(recording.tare & (told < 0), 0, told)
    return ContactStates.assemble(len(recording), recording.layout.shape[0], known)


def runs(tare: Bools) -> list[tuple[int, int, bool]]:
    """First and last row (excluded) of the runs of resting and of other rows, in their order."""
    edges = np.flatnonzero(np.diff(tare.astype(np.int8))) + 1
    bounds = [0, *edges.tolist(), len(tare)]
    return [(a, b, bool(tare[a])) for a, b in pairwise(bounds) if a < b]


def as_received(data: bytes) -> Array:
    """Values of one frame's bytes, shape (t, 3), as the driver reads them."""
    values: Array = readings(words(np.frombuffer(data, np.uint8)[None]))[0][0]
    return values


def _unread(port: SimulatedSerialPort) -> str:
    """Why nothing can be played yet; empty where a driver has opened the port."""
    try:
        port.wait_for_reader(0.1)
    except DeviceTimeout:
        return 'nobody opens the simulated port: is sensor_node there?'
    return ''


@dataclass
class WatchedPort:
    """A port that notes every row in the ledger and keeps few of them on their way."""

    port: SimulatedSerialPort
    ledger: Ledger
    window: int
    stopped: Callable[[], bool]
    rows: Iterator[int] = field(default_factory=lambda: iter(()))

    def send(self, data: bytes) -> None:
        """Send one row once there is room for it."""
        oldest = self.ledger.sent - self.window
        if not self.ledger.wait(oldest, LOST_S, self.stopped):
            if self.stopped():
                raise Stopped
            self.ledger.give_up()
        self.ledger.send(next(self.rows), as_received(data))
        self.port.send(data)


class Performance:
    """Play a score in a thread of its own until its end or until stopped.

    Parameters
    ----------
    score : Score
        What is played.
    ledger : Ledger
        Told by the listener which frames came back.
    tare : callable or None
        Takes a tare within some seconds and returns whether it was done and the answer; called
        after every run of resting rows. None: rests are streamed, and nothing else.
    missing : callable
        What the graph still lacks before the start, in words; empty: nothing.
    """

    def __init__(
        self,
        score: Score,
        ledger: Ledger,
        tare: Callable[[float], tuple[bool, str]] | None,
        missing: Callable[[], str],
    ) -> None:
        self.tally = Tally()
        self._score = score
        self._ledger = ledger
        self._tare = tare
        self._missing = missing
        self._stop = threading.Event()
        self._lost_in_a_row = 0

    def stop(self) -> None:
        """End playing soon."""
        self._stop.set()
        self._ledger.wake()

    def is_stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stop.is_set()

    def play(self, loop: bool, on_end: Callable[[Tally], None]) -> None:
        """Offer the port, wait for the graph, warm up, play; again and again where `loop`.

        Raises
        ------
        DeviceError
            If the graph does not answer, with what is missing.
        Stopped
            If it was told to stop.
        """
        score = self._score
        link = Path(score.port)
        with SimulatedSerialPort() as port:
            link.parent.mkdir(parents=True, exist_ok=True)
            link.unlink(missing_ok=True)
            link.symlink_to(port.port)
            try:
                self._await(lambda: _unread(port))
                self._await(self._missing)
                self._warm_up(port)
                watched = WatchedPort(port, self._ledger, score.window, self.is_stopped)
                player = Player(watched, score.speed_up, 1.0 / score.rate_hz)
                self._once(player, watched, on_end)
                while loop:
                    self._once(player, watched, on_end)
            finally:
                link.unlink(missing_ok=True)

    def _await(self, missing: Callable[[], str]) -> None:
        """Wait until nothing is missing."""
        deadline = time.monotonic() + self._score.patience_s
        while missing():
            if self._stop.wait(0.02):
                raise Stopped
            if time.monotonic() > deadline:
                raise DeviceError(missing())

    def _warm_up(self, port: SimulatedSerialPort) -> None:
        """Send resting rows, all different, until the last comes back: the driver locked on."""
        tare = self._score.recording.tare
        first = 0 if tare is None or not tare.any() else int(np.argmax(tare))
        row = self._score.recording.values[first].copy()
        deadline = time.monotonic() + self._score.patience_s
        while True:
            for _ in range(WARM_ROWS):
                row[0, 0] += WARM_STEP
                data = encode(row)
                self._ledger.send(-1, as_received(data))
                port.send(data)
            if self._ledger.wait(self._ledger.sent - 1, RETRY_S, self.is_stopped):
                break
            if self.is_stopped():
                raise Stopped
            if time.monotonic() > deadline:
                msg = f'no frame came back from {self._score.port}: are all nodes active?'
                raise DeviceError(msg)
        self._ledger.lost = 0

    def _once(self, player: Player, watched: WatchedPort, on_end: Callable[[Tally], None]) -> None:
        """The whole recording, run by run."""
        recording = self._score.recording
        begin = time.monotonic()
        tare = np.zeros(len(recording), bool) if recording.tare is None else recording.tare
        for first, last, resting in runs(tare):
            watched.rows = iter(range(first, last))
            stamps = None if recording.stamp_ns is None else recording.stamp_ns[first:last]
            player.play(recording.values[first:last], stamps)
            if resting and self._tare is not None:
                self._settle()
                self._take_tare(self._tare)
        self._settle()
        self.tally.rows += len(recording)
        self.tally.lost = self._ledger.lost
        self.tally.seconds += time.monotonic() - begin
        if recording.stamp_ns is not None:
            self.tally.recorded_s += float(np.maximum(np.diff(recording.stamp_ns), 0).sum()) * 1e-9
        on_end(self.tally)

    def _settle(self) -> None:
        """Wait until everything sent went through."""
        if self._ledger.wait(self._ledger.sent - 1, LOST_S, self.is_stopped):
            self._lost_in_a_row = 0
            return
        if self.is_stopped():
            raise Stopped
        self._ledger.give_up()
        self._lost_in_a_row += 1
        if self._lost_in_a_row >= MOST_LOST:
            msg = f'{MOST_LOST} readings in a row did not come back: is the graph alive?'
            raise DeviceError(msg)

    def _take_tare(self, tare: Callable[[float], tuple[bool, str]]) -> None:
        """Take the tare and count the answer."""
        done, message = tare(self._score.patience_s)
        if self.is_stopped():
            raise Stopped
        if done:
            self.tally.tares += 1
        else:
            self.tally.refused += 1
            self.tally.refusal = message
