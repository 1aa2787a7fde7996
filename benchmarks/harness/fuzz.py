# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Fuzz tests: random and damaged bytes for the decoders of boards and the driver of chips."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.harness.fault_trials import usable
from tactile_ros.devices import framed_protocol, reskin_protocol
from tactile_ros.devices.chip_array import ChipArray
from tactile_ros.devices.framed_protocol import FramedDecoder, Payload
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings
from tactile_ros.devices.reskin_protocol import ReskinDecoder
from tactile_ros.devices.simulated_i2c import ChipArrayTwin, SimulatedI2cBus
from tactile_ros.devices.simulated_serial import BYTE_FAULTS, damage
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import DeviceTimeout
from tactile_ros.types import Layout

CHUNK, PIECE = 1000, 4096
CHIPS, FIELD = 4, (1e-3, 2e-3, -1e-3)
TOLERANCE = 100e-6  # above the noise of the twin, below any wrong reading that matters
PATIENCE_NS = 10 * 10**9


@dataclass
class Fuzzed:
    """What a decoder did with hostile strings.

    `wrong` frames that nobody sent were delivered; one string cost `lost` good frames at most,
    `held` bytes were held back at most, and the slowest feed took `slowest_s` of a processor.
    """

    strings: int = 0
    wrong: int = 0
    lost: int = 0
    held: int = 0
    slowest_s: float = 0.0


class FramedSubject:
    """The framed protocol's decoder under fuzz."""

    def __init__(self, payload: Payload) -> None:
        """See the class."""
        self._payload = payload
        self._decoder = FramedDecoder(payload)
        self._sequence = 0

    def frames(self, count: int, rng: np.random.Generator) -> tuple[list[bytes], list[bytes]]:
        """Frames on the wire, and what each is when it is decoded."""
        payload = self._payload
        low, high = (0, payload.full_count) if payload.one_converter else (-30_000, 30_000)
        counts = rng.integers(low, high, (count, payload.count, payload.channels))
        data = framed_protocol.encode(payload, counts, self._sequence, np.arange(count) * 1000)
        self._sequence += count
        expected = [row.tobytes() for row in counts.astype(np.float64)]
        return cut(data, framed_protocol.frame_bytes(payload)), expected

    def feed(self, data: bytes) -> list[bytes]:
        """What is decoded."""
        counts = self._decoder.feed(data).counts
        return [np.asarray(row, np.float64).tobytes() for row in counts]

    @property
    def held(self) -> int:
        """Bytes held back."""
        return self._decoder.pending


class BoardSubject:
    """The ReSkin decoder under fuzz."""

    def __init__(self, chips: int) -> None:
        """See the class."""
        self._chips = chips
        self._size = reskin_protocol.frame_bytes(chips)
        self._decoder = ReskinDecoder(chips)

    def frames(self, count: int, rng: np.random.Generator) -> tuple[list[bytes], list[bytes]]:
        """Frames on the wire, and what each is when it is decoded."""
        values = rng.integers(-2500, 2500, (count, self._chips, 3)) * 2.4e-6
        data = reskin_protocol.encode(values, np.full((count, self._chips), 25.0))
        frames = cut(data, self._size)
        return frames, frames

    def feed(self, data: bytes) -> list[bytes]:
        """What is decoded."""
        decoded = self._decoder.feed(data)
        return cut(reskin_protocol.encode(decoded.values, decoded.temperature_c), self._size)

    @property
    def held(self) -> int:
        """Bytes held back."""
        return len(self._decoder.pending)


def suffer_bytes(subject: FramedSubject | BoardSubject, count: int, seed: int) -> Fuzzed:
    """Good frames with at least so many hostile strings between them; what a decoder did."""
    rng = np.random.default_rng(seed)
    found = Fuzzed()
    frames, _ = subject.frames(8, rng)
    subject.feed(b''.join(frames))
    while found.strings < count:
        frames, expected = subject.frames(3 * CHUNK, rng)
        stream = [frame if i % 3 else _hostile(frame, rng) for i, frame in enumerate(frames)]
        got = set(_fed(subject, b''.join(stream), found))
        found.wrong += len(got.difference(expected))
        lost = [expected[i + 1] not in got for i in range(0, 3 * CHUNK, 3)]
        also = [expected[i + 2] not in got for i in range(0, 3 * CHUNK - 3, 3)] + [False]
        found.lost = max(found.lost, *(int(a) + int(b) for a, b in zip(lost, also, strict=True)))
        found.strings += CHUNK
    return found


def _fed(subject: FramedSubject | BoardSubject, stream: bytes, found: Fuzzed) -> Iterator[bytes]:
    """Frames of a stream that comes in pieces."""
    for piece in cut(stream, PIECE):
        began = time.thread_time()  # a machine that does other things is no hang
        got = subject.feed(piece)
        found.slowest_s = max(found.slowest_s, time.thread_time() - began)
        found.held = max(found.held, subject.held)
        yield from got


def _hostile(frame: bytes, rng: np.random.Generator) -> bytes:
    """Random bytes, a damaged frame, or a frame with bytes overwritten."""
    kind = int(rng.integers(3))
    if kind == 0:
        return rng.bytes(int(rng.integers(1, 2 * len(frame))))
    if kind == 1:
        return damage(frame, BYTE_FAULTS[int(rng.integers(len(BYTE_FAULTS)))], rng)
    hurt = bytearray(frame)
    count = int(rng.integers(1, 9))
    places = rng.integers(len(frame), size=count).tolist()
    for place, byte in zip(places, rng.bytes(count), strict=True):
        hurt[place] = byte
    return bytes(hurt)


def cut(data: bytes, size: int) -> list[bytes]:
    """Pieces of a length."""
    return [data[i : i + size] for i in range(0, len(data), size)]


@dataclass
class HostileChips:
    """What the driver made of hostile answers, with no bit that marks it.

    `beyond` readings lie outside of the range; `wrong` ones are not what the chip measured, where
    only status bytes were hostile. Then all chips could be used again within `recovery_s`.
    """

    strings: int = 0
    beyond: int = 0
    wrong: int = 0
    recovery_s: float = 0.0


class HostileBus:
    """A simulated bus; while `active`, `hostile` first bytes of answers of a length are random."""

    def __init__(
        self, bus: SimulatedI2cBus, length: int, hostile: int, rng: np.random.Generator
    ) -> None:
        """See the class."""
        self.active, self.strings = False, 0
        self._bus, self._length, self._hostile, self._rng = bus, length, hostile, rng
        self.close = bus.close

    def i2c_rdwr(self, *messages: object) -> None:
        """Exchange bytes."""
        self._bus.i2c_rdwr(*messages)
        answer = messages[-1]
        if self.active and answer.len == self._length and self._rng.random() < 0.5:
            self.strings += 1
            for i, byte in enumerate(self._rng.bytes(self._hostile)):
                answer.buf[i] = byte


def suffer_answers(
    strings: int, resolution: int, status_only: bool, rng: np.random.Generator
) -> HostileChips:
    """Let four chips answer with random bytes; `status_only`: codes stay what they measured.

    At a resolution of 3 random codes lie outside of the range, too.
    """
    settings = ChipSettings(resolution=(resolution,) * 3)
    places = [ChipPlace(0x0C + i) for i in range(CHIPS)]
    layout = Layout(np.zeros((CHIPS, 3)), ('Bx', 'By', 'Bz'), 'T')
    clock, field = VirtualClock(), np.tile(FIELD, (CHIPS, 1))
    twin = ChipArrayTwin(places, layout, lambda t: field, settings=settings, clock=clock, seed=1)
    length = settings.answer_bytes
    bus = HostileBus(twin.buses[0], length, 1 if status_only else length, rng)
    array = ChipArray(
        [I2cBus('hostile', smbus=bus)], places, layout, settings,
        clock_ns=clock.now_ns, clock=clock,
    )  # fmt: skip
    found = HostileChips()
    with twin, array:
        bus.active = True
        while bus.strings < strings:
            values = _usable(array)
            over = (np.abs(values) >= settings.full_scale).any(axis=1)
            found.beyond += int(np.count_nonzero(over))
            if status_only:
                off = (np.abs(values - FIELD) > TOLERANCE).any(axis=1)
                found.wrong += int(np.count_nonzero(off))
        bus.active = False
        begun_ns = clock.now_ns()
        while len(_usable(array)) < CHIPS and clock.now_ns() - begun_ns < PATIENCE_NS:
            pass
        found.recovery_s = (clock.now_ns() - begun_ns) * 1e-9
    found.strings = bus.strings
    return found


def _usable(array: ChipArray) -> np.ndarray:
    """Readings (n, 3) of the next frame that may be used; none where it does not come."""
    try:
        frame = array.read(0.1)
    except DeviceTimeout:
        return np.zeros((0, 3))
    return frame.values[usable(frame)]
