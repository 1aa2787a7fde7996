# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""When frames were taken: clocks, stamps by arrival, stamps by a board's own clock."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

WRAP_US = 2**32
NS_PER_US = 1000
OSCILLATOR_SHARE = 0.01  # oscillators of microcontrollers agree with the host's to this share
QUARTZ_SHARE = 2e-4  # and quartz to this one
# frames that came together over so long were kept back: their age is unknown
KEPT_BACK_NS = 20_000_000
CLOCK_RESET_NS = 1_000_000_000
LONG_GAP = 3  # periods
SHORTEST_STALL_NS = 20_000_000
TOLERANCE_NS = 50_000_000
# so long, and in so many reads, bytes are late before the host's clock counts as stepped
WINDOW_NS = 1_000_000_000
WINDOW_READS = 10


class Clock:
    """The machine's own monotonic clock; others stand in for it."""

    def now_ns(self) -> int:
        """Time now (ns)."""
        return time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        time.sleep(max(0.0, seconds))


class VirtualClock(Clock):
    """A clock that moves when somebody sleeps.

    Examples
    --------
    >>> clock = VirtualClock()
    >>> clock.sleep(1.5e-3)
    >>> clock.now_ns()
    1500000
    """

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Time now (ns), which only `sleep` moves."""
        return self._now_ns

    def sleep(self, seconds: float) -> None:
        """Move the time on at once; negative durations move nothing."""
        self._now_ns += max(0, round(seconds * 1e9))


class LeadingClock(Clock):
    """A clock that runs at most `lead_s` ahead of another, so that many short waits cost one.

    A machine wakes some 0.06 ms late: a simulated bus that waited for each byte would be too slow.
    """

    def __init__(self, clock: Clock, lead_s: float = 1e-3) -> None:
        self._clock = clock
        self._lead_ns = round(lead_s * 1e9)
        self._ahead_ns = clock.now_ns()

    def now_ns(self) -> int:
        """Time now (ns); never less than the other clock's."""
        return max(self._ahead_ns, self._clock.now_ns())

    def sleep(self, seconds: float) -> None:
        """Move ahead; wait on the other clock once the lead is used up."""
        self._ahead_ns = self.now_ns() + max(0, round(seconds * 1e9))
        lead_ns = self._ahead_ns - self._clock.now_ns()
        if lead_ns > self._lead_ns:
            self._clock.sleep(lead_ns * 1e-9)


class ArrivalTime:
    """Stamps of frames by their arrival, a period (`period_ns`) apart: for boards without clock.

    `suspected` counts frames that are missing by the spacing of stamps; a pause looks the same.
    """

    def __init__(self, period_ns: int) -> None:
        self.suspected = 0
        self._period_ns = period_ns
        self._last_ns: int | None = None
        self._usual_ns = 0.0

    def counters(self) -> dict[str, int]:
        """Counts by name."""
        return {'suspected': self.suspected}

    def restart(self) -> None:
        """Forget the usual spacing, as after a reconnection."""
        self._usual_ns = 0.0

    def follow(self, lost: Sequence[int], now_ns: int) -> list[int]:
        """Stamps of the frames of one read, `lost` before each, the last whole at `now_ns`.

        A period apart, or closer where less time passed; always increasing, unless the clock went
        back by more than a second.
        """
        before_ns, spacing, frames = self._last_ns, self._period_ns, sum(lost) + len(lost)
        end_ns = now_ns
        if before_ns is not None and now_ns >= before_ns - CLOCK_RESET_NS:
            spacing = max(1, min(spacing, (now_ns - before_ns) // frames))
            end_ns = max(now_ns, before_ns + spacing * frames)
        stamps = [end_ns]
        for gap in reversed(lost[1:]):
            stamps.append(stamps[-1] - spacing * (1 + gap))
        stamps.reverse()
        if before_ns is not None:
            self._suspect((stamps[0] - before_ns) / (1 + lost[0]))
        self._last_ns = end_ns
        return stamps

    def _suspect(self, gap_ns: float) -> None:
        # frames that were kept back come at once: their spacing is not the board's
        usual_ns = max(self._usual_ns or gap_ns, self._period_ns / 2)
        if gap_ns > LONG_GAP * usual_ns:
            self.suspected += round(gap_ns / usual_ns) - 1
        self._usual_ns = usual_ns + 0.05 * (min(gap_ns, LONG_GAP * usual_ns) - usual_ns)


class Moments(NamedTuple):
    """Times of frames by the board's clock and by the host's.

    `repeated`: the board says that this is the sample of the frame before.
    """

    device_ns: list[int]
    stamp_ns: list[int]
    repeated: list[bool]


class DeviceTime:
    """A board's 32 bit microsecond clock, unwrapped and tied to the host's.

    `period_ns` is the nominal period of frames; 0: unknown.

    `clock_jumps` counts how often it went back, or ahead of the time that passed here, `stalls`
    how often nothing was measured for more than three periods and 20 ms, `clock_steps` how often
    the host's clock stepped by more than 50 ms.

    Notes
    -----
    Bytes come late, never early: the host's time less the board's is lowest for the promptest
    frame. A stamp is the board's time plus that lowest offset, which creeps up by 1 % to follow
    oscillators that differ: bursts and a late reader do not shift stamps.

    A read of several frames over more than 20 ms comes from a reader that is behind: it neither
    ties anew, nor creeps by more than 0.02 %.

    A host clock that went back by more than 50 ms starts anew, and so do stamps. One that stepped
    ahead makes all bytes late: where the promptest of a second and 10 reads is more than 50 ms
    late, it is the new tie; more than a second counts at once.

    Where the board's clock jumps, or its port was away, the unwrapped time goes on by the time
    that passed on the host, which also distinguishes a jump from a stall, to 50 ms.
    """

    def __init__(self, period_ns: int) -> None:
        self.clock_jumps = 0
        self.stalls = 0
        self.clock_steps = 0
        self._period_ns = period_ns
        self._raw_us: int | None = None
        self._device_ns = 0
        self._offset_ns: int | None = None
        self._now_ns = 0
        self._stamp_ns: int | None = None
        self._begin_window(0)

    def counters(self) -> dict[str, int]:
        """Counts by name."""
        return {name: vars(self)[name] for name in ('clock_jumps', 'clock_steps', 'stalls')}

    def restart(self) -> None:
        """Expect another origin of the board's clock, as after a reconnection."""
        self._raw_us = None
        self._offset_ns = None

    def follow(self, time_us: list[int], lost: Sequence[int], now_ns: int) -> Moments:
        """Times of the frames of one read, of which there is at least one.

        `time_us` is the board's clock at each, wrapping at 2^32; `lost` are known lost before
        each; the last was whole at `now_ns`, less its time on the wire.
        """
        before_ns = self._device_ns
        device_ns: list[int] = []
        repeated: list[bool] = []
        for raw_us, gap in zip(time_us, lost, strict=True):
            repeated.append(raw_us == self._raw_us)
            self._device_ns += self._step(raw_us, gap, now_ns)
            self._raw_us = raw_us
            device_ns.append(self._device_ns)
        behind = len(time_us) > 1 and self._device_ns - device_ns[0] > KEPT_BACK_NS
        offset_ns = self._tie(now_ns, self._device_ns - before_ns, behind)
        self._now_ns = now_ns
        stamps = []
        for one_ns in device_ns:
            before = self._stamp_ns
            stamp_ns = one_ns + offset_ns
            self._stamp_ns = stamp_ns if before is None else max(stamp_ns, before + 1)
            stamps.append(self._stamp_ns)
        # 0 would say that there is no clock
        return Moments([max(1, one_ns) for one_ns in device_ns], stamps, repeated)

    def _step(self, raw_us: int, lost: int, now_ns: int) -> int:
        """Time since the frame before (ns), which a reader that was held up had not read yet."""
        before_ns = self._now_ns if self._offset_ns is None else self._device_ns + self._offset_ns
        elapsed_ns = max(0, now_ns - before_ns)
        if self._raw_us is None:
            return elapsed_ns if self._device_ns else raw_us * NS_PER_US
        step_us = (raw_us - self._raw_us) % WRAP_US
        step_ns = step_us * NS_PER_US
        usual_ns = self._period_ns * (lost + 1)
        allowed_ns = max(SHORTEST_STALL_NS, LONG_GAP * usual_ns) + usual_ns
        if step_ns <= (allowed_ns if self._period_ns else CLOCK_RESET_NS):
            return step_ns
        if step_us < WRAP_US // 2 and step_ns <= elapsed_ns + TOLERANCE_NS:
            self.stalls += 1
            return step_ns
        self.clock_jumps += 1
        self._offset_ns = None
        return elapsed_ns or usual_ns

    def _tie(self, now_ns: int, passed_ns: int, behind: bool) -> int:
        """Host's time less the board's."""
        offset_ns = now_ns - self._device_ns
        went_back = now_ns < self._now_ns - TOLERANCE_NS
        if went_back:
            self._stamp_ns = None
        if self._offset_ns is None:
            self._begin_window(now_ns)
            self.clock_steps += went_back
        elif behind and offset_ns >= self._offset_ns:
            self._begin_window(now_ns)
            offset_ns = min(offset_ns, self._offset_ns + int(QUARTZ_SHARE * passed_ns))
        elif went_back or abs(offset_ns - self._offset_ns) > CLOCK_RESET_NS:
            self._begin_window(now_ns)
            self.clock_steps += 1
        else:
            lowest_ns = self._lowest_of_window(offset_ns, now_ns)
            if lowest_ns is not None and lowest_ns > self._offset_ns + TOLERANCE_NS:
                self._offset_ns = lowest_ns
                self.clock_steps += 1
            offset_ns = min(offset_ns, self._offset_ns + int(OSCILLATOR_SHARE * passed_ns))
        self._offset_ns = offset_ns
        return offset_ns

    def _begin_window(self, now_ns: int) -> None:
        self._window_ns = now_ns
        self._lowest_ns: int | None = None
        self._reads = 0

    def _lowest_of_window(self, offset_ns: int, now_ns: int) -> int | None:
        """Lowest offset (ns) of a second, where a second ends with this read."""
        lowest_ns = offset_ns if self._lowest_ns is None else min(self._lowest_ns, offset_ns)
        self._lowest_ns = lowest_ns
        self._reads += 1
        if now_ns - self._window_ns < WINDOW_NS or self._reads < WINDOW_READS:
            return None
        self._begin_window(now_ns)
        return lowest_ns
