"""When frames were taken: clocks, and a board's own clock unwrapped and tied to the host's."""

from __future__ import annotations

import time
from typing import NamedTuple, Protocol


class Clock(Protocol):
    """What tells the time and lets it pass."""

    def now_ns(self) -> int:
        """Time now (ns)."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        ...


class SystemClock:
    """The machine's own monotonic clock."""

    def now_ns(self) -> int:
        """Time now (ns)."""
        return time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        time.sleep(max(0.0, seconds))


class VirtualClock:
    """A clock that moves when somebody sleeps or lets time pass.

    Parameters
    ----------
    start_ns : int
        Its first reading (ns).

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
        """Time now (ns)."""
        return self._now_ns

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        self._now_ns += max(0, round(seconds * 1e9))


class LeadingClock:
    """A clock that may run a little ahead of another, so that many short waits cost one.

    Parameters
    ----------
    clock : Clock
        The clock that is followed.
    lead_s : float
        How far ahead it may run (s); beyond that it waits for the other.

    Notes
    -----
    A machine wakes from a wait of 0.1 ms some 0.06 ms late; a simulated bus that waited for each
    of its bytes would be slower than the real one.
    """

    def __init__(self, clock: Clock, lead_s: float = 1e-3) -> None:
        """See the class."""
        self._clock = clock
        self._lead_ns = round(lead_s * 1e9)
        self._ahead_ns = clock.now_ns()

    def now_ns(self) -> int:
        """Time now (ns); never less than the other clock's."""
        return max(self._ahead_ns, self._clock.now_ns())

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        self._ahead_ns = self.now_ns() + max(0, round(seconds * 1e9))
        lead_ns = self._ahead_ns - self._clock.now_ns()
        if lead_ns > self._lead_ns:
            self._clock.sleep(lead_ns * 1e-9)


WRAP_US = 2**32
NS_PER_US = 1000
# oscillators of microcontrollers agree with the host's to this share
CREEP = 0.01
# and quartz to this one
QUARTZ = 2e-4
# frames that came together over so long were kept back: their age is unknown
KEPT_BACK_NS = 20_000_000
CLOCK_RESET_NS = 1_000_000_000
LONG_GAP = 3
SHORTEST_STALL_NS = 20_000_000
TOLERANCE_NS = 50_000_000
# so long, and in so many reads, bytes must be late before the host's clock is said to have stepped
WINDOW_NS = 1_000_000_000
WINDOW_READS = 10


class Moments(NamedTuple):
    """When frames were taken.

    Attributes
    ----------
    device_ns : list of int
        The board's clock, unwrapped: never falls.
    stamp_ns : list of int
        The host's clock: always increases.
    repeated : list of bool
        Whether the board says that this is the sample of the frame before.
    """

    device_ns: list[int]
    stamp_ns: list[int]
    repeated: list[bool]


class DeviceTime:
    """Follows a 32 bit microsecond clock and ties it to the host's.

    Parameters
    ----------
    period_ns : int
        Nominal period of frames (ns); 0: unknown.

    Attributes
    ----------
    clock_jumps : int
        Times the board's clock went back, or went ahead of the time that passed here.
    stalls : int
        Times the board measured nothing for more than three periods and 20 ms.
    clock_steps : int
        Times the host's clock stepped by more than 50 ms.

    Notes
    -----
    Bytes come late, never early, so the host's time less the board's is lowest for the promptest
    frame. A stamp is the board's time plus that lowest difference, which creeps up by 1 % to
    follow oscillators that differ. So bursts and a late reader do not shift stamps.

    A read of several frames over more than 20 ms comes from a reader that is behind, for all that
    one sees as late as the port's buffer is long. It can show that others were late, not that the
    host's clock stepped: it neither ties anew, nor creeps by more than 0.02 %. So a reader that
    never catches up loses frames, which are counted, and stamps those it has with their time.

    A host clock that went back by more than 50 ms starts anew, and so do stamps. One that stepped
    ahead makes all bytes late: where the promptest of a second and 10 reads is more than 50 ms
    late, it is the new tie; more than a second is believed at once.

    Where the board's clock jumps, or its port was away, the unwrapped time goes on by the time
    that passed on the host. A jump is told from a stall by the time that passed here, with a
    tolerance of 50 ms.
    """

    def __init__(self, period_ns: int) -> None:
        """See the class."""
        self.clock_jumps = 0
        self.stalls = 0
        self.clock_steps = 0
        self._period_ns = period_ns
        self._raw_us: int | None = None
        self._device_ns = 0
        self._offset_ns: int | None = None
        self._now_ns = 0
        self._stamp_ns: int | None = None
        self._prompt = _Promptest()

    def restart(self) -> None:
        """Expect another origin of the board's clock, as after a reconnection."""
        self._raw_us = None
        self._offset_ns = None

    def follow(self, time_us: list[int], lost: list[int], now_ns: int) -> Moments:
        """Times of the frames of one read.

        Parameters
        ----------
        time_us : list of int
            The board's clock at s frames (microseconds), wrapping at 2^32; s at least 1.
        lost : list of int
            Frames known lost before each.
        now_ns : int
            When the last frame was whole (ns), less its time on the wire.

        Returns
        -------
        Moments
            s of each.
        """
        elapsed_ns = max(0, now_ns - self._now_ns)
        before_ns = self._device_ns
        device_ns: list[int] = []
        repeated: list[bool] = []
        for raw_us, gap in zip(time_us, lost, strict=True):
            repeated.append(raw_us == self._raw_us)
            self._device_ns += self._step(raw_us, gap, elapsed_ns)
            self._raw_us = raw_us
            device_ns.append(self._device_ns)
        passed_ns = self._device_ns - before_ns
        behind = len(time_us) > 1 and self._device_ns - device_ns[0] > KEPT_BACK_NS
        offset_ns = self._tie(now_ns, passed_ns, behind)
        self._now_ns = now_ns
        stamps = self._stamps(device_ns, offset_ns)
        # 0 would say that there is no clock
        return Moments([max(1, time_ns) for time_ns in device_ns], stamps, repeated)

    def _step(self, raw_us: int, lost: int, elapsed_ns: int) -> int:
        """Time since the frame before (ns)."""
        if self._raw_us is None:
            return elapsed_ns if self._device_ns else raw_us * NS_PER_US
        step_us = (raw_us - self._raw_us) % WRAP_US
        step_ns = step_us * NS_PER_US
        usual_ns = self._period_ns * (lost + 1)
        allowed_ns = max(SHORTEST_STALL_NS, LONG_GAP * usual_ns) + usual_ns
        if not self._period_ns:
            allowed_ns = CLOCK_RESET_NS
        if step_ns <= allowed_ns:
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
            self._prompt.begin(now_ns)
            self.clock_steps += went_back
        elif behind and offset_ns >= self._offset_ns:
            self._prompt.begin(now_ns)
            offset_ns = min(offset_ns, self._offset_ns + int(QUARTZ * passed_ns))
        elif went_back or abs(offset_ns - self._offset_ns) > CLOCK_RESET_NS:
            self._prompt.begin(now_ns)
            self.clock_steps += 1
        else:
            lowest_ns = self._prompt.lowest(offset_ns, now_ns)
            if lowest_ns is not None and lowest_ns > self._offset_ns + TOLERANCE_NS:
                self._offset_ns = lowest_ns
                self.clock_steps += 1
            creep_ns = int(CREEP * passed_ns)
            offset_ns = min(offset_ns, self._offset_ns + creep_ns)
        self._offset_ns = offset_ns
        return offset_ns

    def _stamps(self, device_ns: list[int], offset_ns: int) -> list[int]:
        """The host's times, each later than the one before."""
        stamps = []
        for time_ns in device_ns:
            stamp_ns = time_ns + offset_ns
            if self._stamp_ns is not None:
                stamp_ns = max(stamp_ns, self._stamp_ns + 1)
            self._stamp_ns = stamp_ns
            stamps.append(stamp_ns)
        return stamps


class _Promptest:
    """Lowest difference of the clocks over each second."""

    def __init__(self) -> None:
        """See the class."""
        self.begin(0)

    def begin(self, now_ns: int) -> None:
        """Begin a second."""
        self._begun_ns = now_ns
        self._lowest_ns: int | None = None
        self._reads = 0

    def lowest(self, offset_ns: int, now_ns: int) -> int | None:
        """Take the difference of one read; the lowest (ns) where a second ends with it."""
        lowest_ns = offset_ns if self._lowest_ns is None else min(self._lowest_ns, offset_ns)
        self._lowest_ns = lowest_ns
        self._reads += 1
        if now_ns - self._begun_ns < WINDOW_NS or self._reads < WINDOW_READS:
            return None
        self.begin(now_ns)
        return lowest_ns
