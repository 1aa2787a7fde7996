# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A sensor's real driver over its twin, through a fault: what was lost, for how long, what lied.

The signal tells its time, so that every frame can be compared with what was there when it was
taken. Time is virtual; where a driver waits for a port in real time, that is added.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from tactile_ros.conditioning.faults import UNUSABLE
from tactile_ros.devices.simulated_serial import AWAY_S, STALL_S, SerialTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.errors import DeviceTimeout
from tactile_ros.sensors import SensorSpec
from tactile_ros.types import Array, Bools, Closing, Frame, Layout, TaxelStatus

RATE_HZ = 80.0
START_NS = 10**12
SIGNAL_S = 15.0
# resting level, span of the signal and tolerance by unit; the coarsest steps are 2.5 uT and 1/1023
SIZES = {'T': (0.3e-3, 1.6e-3, 10e-6), '1': (0.2, 0.6, 3e-3)}
BLOCK, MOST_NUMBERS = 16, 1024  # frames, and numbers in them, that wait in a port
DRAIN_S, PATIENCE_S, LONGEST_S = 0.004, 5.0, 10.0
LONG = {'unplug': AWAY_S, 'stall': STALL_S}  # s; such a fault comes again when it is over
MARKS = {
    'saturation': TaxelStatus.SATURATED,
    'wrap': TaxelStatus.WRAPPED,
    'stuck_chip': TaxelStatus.STUCK | TaxelStatus.STALE,
}
STORM, STORMS = 5, {'stuck_chip': 30, 'unplug': 2, 'stall': 2}  # frames or transfers
COUNTERS = {
    'nack': ('nacks',), 'brown_out': ('resets',), 'stuck_bus': ('bus_errors',),
    'stall': ('stalls', 'suspected'), 'unplug': ('reconnects', 'bus_errors'),
    'clock_jump': ('clock_jumps',),
}  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """Outcome of one fault.

    It was `counted` by the driver, or as frames with a mark (saturation, wrap, stuck_chip).
    `recovery_s` is the longest time between two frames of which every taxel may be used; `wrong`
    readings are not what was there without a bit, or STALE and not the reading before.
    """

    fault: str
    injected: int
    counted: int
    recovery_s: float
    wrong: int
    frames: int


class Road(Closing):
    """A sensor's driver over its twin at 80 Hz on a virtual clock; a context manager.

    `connection` holds fields that are not the default; `noise` is that of a reading (unit of the
    layout). A serial board sends `block` frames before the driver reads.
    """

    def __init__(
        self, spec: SensorSpec, connection: Mapping[str, object] | None = None, seed: int = 0,
        noise: float = 0.0,
    ) -> None:  # fmt: skip
        """See the class."""
        config = replace(spec.config(), noise=noise, rate_hz=RATE_HZ)
        self.layout, self.noise = spec.layout(config), noise
        self.waited_s = 0.0  # real time that the driver took to find its port again
        self.usual_block = max(1, min(BLOCK, MOST_NUMBERS // int(np.prod(self.layout.shape))))
        self.block = self.usual_block
        self.clock = VirtualClock(START_NS)
        self.signal = telling(self.layout, seed)
        self.twin = spec.simulate(
            config, spec.connection(**(connection or {})), self.signal, seed, self.clock
        )
        self._held = ExitStack()
        self._begun_ns = START_NS
        self._seen = -1.0

    def __enter__(self) -> Road:
        """Start the twin, open the driver."""
        with ExitStack() as stack:
            self._begun_ns = self.clock.now_ns()
            stack.enter_context(self.twin)
            self.device = stack.enter_context(self.twin.device(self.clock.now_ns))
            self._held = stack.pop_all()
        return self

    def close(self) -> None:
        """Close the driver, end the twin."""
        self._held.close()

    def counters(self) -> dict[str, int]:
        """What the driver counts."""
        return self.device.counters()

    def run(self, seconds: float) -> list[Frame]:
        """Frames of the next so many seconds of virtual time."""
        end_ns = self.clock.now_ns() + round(seconds * 1e9)
        frames: list[Frame] = []
        while self.clock.now_ns() < end_ns:
            if isinstance(self.twin, SerialTwin):
                self.twin.play(self.block)
                frames += self._drain()
            else:
                frames += self._read(0.1)
        return frames

    def _read(self, timeout: float) -> list[Frame]:
        """The next frame, none where it does not come."""
        try:
            return [self.device.read(timeout)]
        except DeviceTimeout:
            return []

    def _drain(self) -> list[Frame]:
        """All that has come; a port that is there again is waited for."""
        frames: list[Frame] = []
        begun = time.monotonic()
        while time.monotonic() - begun < PATIENCE_S:
            waits = self.twin.awaited
            got = self._read(DRAIN_S)
            frames += got
            if waits:
                self.waited_s += DRAIN_S
            elif not got:
                break
        return frames

    def times(self, frames: list[Frame], counted: bool = False) -> Array:
        """When each frame was taken, shape (s,) (s): by its readings, or stamps of chips on I2C.

        `counted`: by sequence from the first on, where readings that repeat tell no time.
        """
        found = np.empty(len(frames))
        for i, frame in enumerate(frames):
            if not isinstance(self.twin, SerialTwin):
                found[i] = ((frame.stamp_ns or 0) - self._begun_ns) * 1e-9
            elif counted and i:
                found[i] = found[0] + (frame.sequence - frames[0].sequence) / RATE_HZ
            else:
                found[i] = self._matched_time(frame)
        if counted and len(found):
            self._seen = float(found[-1])
        return found

    def _matched_time(self, frame: Frame) -> float:
        """Period of the twin whose signal is nearest to most readings, not before the last."""
        first = 0 if self._seen < 0 else round(self._seen * RATE_HZ)
        last = round((self.clock.now_ns() - self._begun_ns) * 1e-9 * RATE_HZ)
        periods = np.arange(first, max(first, last) + 1)
        truth = np.array([self.signal(k / RATE_HZ) for k in periods])
        off = np.abs(truth - frame.values)[:, usable(frame)]
        if off.size:
            near = np.median(off.reshape(len(off), -1), axis=1)
            self._seen = float(periods[int(near.argmin())] / RATE_HZ)
        return self._seen

    def wrong(self, frame: Frame, t: float, before: Frame | None = None) -> int:
        """Taxels that no bit marks and are not what was there, or STALE and not as before."""
        tolerance = SIZES[self.layout.unit][2] + 5 * self.noise
        near = (np.abs(frame.values - self.signal(t)) <= tolerance).all(axis=1)
        if frame.status is not None and before is not None:
            stale = (frame.status & TaxelStatus.STALE) > 0
            near = np.where(stale, (frame.values == before.values).all(axis=1), near)
        return int(np.count_nonzero(usable(frame) & ~near))


def noise_beside(fault: str, layout: Layout) -> float:
    """Noise of a reading (unit of the layout) where it tells a stuck taxel from a live one; 0."""
    return {'T': 5e-6, '1': 2e-3}[layout.unit] if fault == 'stuck_chip' else 0.0


def ways(spec: SensorSpec) -> list[dict[str, object]]:
    """Fields of the connection for every way in which a sensor can be connected and read."""
    if not hasattr(spec.connection(), 'transport'):
        return [{}]
    return [
        {'transport': 'i2c', 'mode': 'single'},
        {'transport': 'i2c', 'mode': 'burst'},
        {'transport': 'serial'},
    ]


def telling(layout: Layout, seed: int) -> Callable[[float], Array]:
    """Signal that tells its time: ramps of all channels, each with its own level and slope."""
    level, span, _ = SIZES[layout.unit]
    rng = np.random.default_rng(seed)
    slope = span * rng.uniform(0.5, 1.0, layout.shape) / SIGNAL_S
    start = level * rng.uniform(0.8, 1.2, layout.shape)
    return lambda t: np.asarray(start + slope * min(t, SIGNAL_S))


def usable(frame: Frame) -> Bools:
    """Taxels, shape (t,), that are measured and not marked."""
    measured = np.isfinite(frame.values).all(axis=1)
    if frame.status is not None:
        measured &= (frame.status & UNUSABLE) == 0
    return np.asarray(measured, np.bool_)


def suffer(road: Road, fault: str, count: int = 1, settle_s: float = 1.0) -> Trial:
    """Let an entered road suffer a fault, and see what the driver makes of it.

    `count` frames or transfers are hit, one after the other; stall and unplug come again when
    they are over. `settle_s` of virtual time pass before and after.
    """
    # judged by the time of arrival
    road.block = 1 if fault == 'stall' else road.usual_block
    frames = road.run(settle_s)
    before, counted = road.twin.injected[fault], road.counters()
    waited = road.waited_s
    for part in [1] * count if fault in LONG else [count]:
        road.twin.inject(fault, part)
        frames += road.run(settle_s + LONG.get(fault, 0.0))
    deadline_ns = road.clock.now_ns() + round(LONGEST_S * 1e9)
    while road.twin.injected[fault] < before + count and road.clock.now_ns() < deadline_ns:
        frames += road.run(settle_s)
    frames += road.run(settle_s)
    times = road.times(frames, counted=fault == 'stuck_chip')
    good = np.array([bool(usable(frame).all()) for frame in frames], bool)
    gaps = np.diff(times[good]) if good.sum() > 1 else np.array([np.inf])
    away = (road.waited_s - waited) / (count if fault == 'unplug' else 1)
    return Trial(
        fault, road.twin.injected[fault] - before,
        _counted(fault, frames, counted, road.counters()), float(gaps.max()) + away,
        sum(map(road.wrong, frames, times, [None, *frames[:-1]])), len(frames),
    )  # fmt: skip


def _counted(
    fault: str, frames: list[Frame], before: Mapping[str, int], after: Mapping[str, int]
) -> int:
    """What the driver's own counter, or the marks in its frames, say of a fault."""
    if fault in MARKS:
        each = (frame.status for frame in frames if frame.status is not None)
        return sum(bool((status & MARKS[fault]).any()) for status in each)
    names = COUNTERS.get(fault, ('dropped',))
    name = next((name for name in names if name in after), 'dropped')
    return after.get(name, 0) - before.get(name, 0)
