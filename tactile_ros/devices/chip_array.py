"""Many MLX90393 on I2C buses and behind switches, read as one sensor."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal, TypeVar, cast, get_args

import numpy as np

from tactile_ros.devices.fault_flags import ChipFaultDetector
from tactile_ros.devices.mlx90393 import (
    EXIT_WAIT_S,
    RESET_WAIT_S,
    Chip,
    ChipPlace,
    ChipSettings,
    CommandRefused,
    Decoder,
    Status,
    Switches,
    refuse_conflicts,
)
from tactile_ros.errors import DeviceError, DeviceTimeout, NotAcknowledged
from tactile_ros.types import Bools, Closing, Frame, Layout, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings
    from tactile_ros.devices.transport import I2cBus

BITS_PER_BYTE = 9
COMMAND_BYTES = STATUS_BYTES = MASK_BYTES = 1


class _SwitchWrites:
    """A bus that only counts what is written to its switches."""

    def __init__(self) -> None:
        self.count = 0

    def transfer(self, address: int, data: bytes, count: int) -> bytes:
        """Count a write."""
        self.count += 1
        return bytes(count)


def exchange_bits(written: int, answered: int = 0) -> int:
    """Clocks of one exchange: so many bytes written, then so many answered."""
    parts = (written, answered) if answered else (written,)
    return 1 + sum(1 + BITS_PER_BYTE * (1 + count) for count in parts)


def switch_bits(places: Sequence[ChipPlace]) -> list[int]:
    """Clocks of the switches before each chip, one a place, when all are visited in turn."""
    buses = {place.bus: _SwitchWrites() for place in places}
    switches = {
        number: Switches(
            cast('I2cBus', bus),
            sorted({p.mux for p in places if p.bus == number and p.mux is not None}),
        )
        for number, bus in buses.items()
    }
    bits: list[int] = []
    for place in (*places, *places):
        before = buses[place.bus].count
        switches[place.bus].select(place.mux, place.channel)
        bits.append((buses[place.bus].count - before) * exchange_bits(MASK_BYTES))
    return bits[len(places) :]


def carried_hz(
    places: Sequence[ChipPlace], settings: ChipSettings, burst: bool, bus_hz: float
) -> float:
    """Most frames a second that chips and buses carry, read by one thread.

    Parameters
    ----------
    places : sequence of ChipPlace
        Where the chips are, in the order in which they are read.
    settings : ChipSettings
        Of all chips; they take the nominal time for a measurement.
    burst : bool
        Whether chips measure without end; otherwise all are started, then all are read.
    bus_hz : float
        Clock of the buses (Hz).

    Returns
    -------
    float
        Frames per second.
    """
    switching = switch_bits(places)
    reading = exchange_bits(COMMAND_BYTES, settings.answer_bytes)
    if burst:
        wire_s = (sum(switching) + len(places) * reading) / bus_hz
        return 1 / max(wire_s, settings.conversion_s)
    now_s, ready_s = 0.0, []
    for bits in switching:
        now_s += (bits + exchange_bits(COMMAND_BYTES, STATUS_BYTES)) / bus_hz
        ready_s.append(now_s + settings.conversion_s)
    for bits, ready in zip(switching, ready_s, strict=True):
        now_s = max(now_s + bits / bus_hz, ready) + reading / bus_hz
    return 1 / now_s


def check_bus_capacity(
    places: Sequence[ChipPlace],
    settings: ChipSettings,
    burst: bool,
    rate_hz: float,
    bus_hz: float,
) -> None:
    """Refuse a rate that chips and buses cannot carry.

    Parameters
    ----------
    places, settings, burst, bus_hz
        As in `carried_hz`.
    rate_hz : float
        Frames a second; not a number: as many as there are.

    Raises
    ------
    ValueError
        If it is more; names both rates and what the second follows from.
    """
    carried = carried_hz(places, settings, burst, bus_hz)
    if not rate_hz > carried:
        return
    behind = sum(place.mux is not None for place in places)
    switched = f', {behind} of them behind switches' if behind else ''
    faster = 'the conversion' if burst else "the conversion, read in mode 'burst'"
    msg = (
        f'{len(places)} chips{switched} at {rate_hz:g} Hz must fit their I2C bus: in mode '
        f'{"burst" if burst else "single"} a bus of {bus_hz / 1e3:g} kHz and conversions of '
        f'{1e3 * settings.conversion_s:.3g} ms carry {carried:.4g} Hz; lower the rate, shorten '
        f'{faster}, or raise bus_clock where bus and adapter allow it'
    )
    raise ValueError(msg)


T = TypeVar('T')

FIRST_RETRY_S = 0.02
LONGEST_RETRY_S = 0.2


@dataclass
class ArrayCounts:
    """What the driver has seen.

    Attributes
    ----------
    resets : int
        Times that a running chip said it had been reset (its supply broke down).
    reconfigured : int
        Times that a chip was set up again.
    nacks : int
        Transfers that nothing answered.
    not_ready : int
        Reads that came before their measurement was ready.
    refused : int
        Commands that a chip refused, and registers that did not keep what was written.
    stalls : int
        Measurements that did not become ready in time.
    bus_errors : int
        Failures of a whole bus.
    dropped : int
        Frames in which no chip could be read.
    """

    resets: int = 0
    reconfigured: int = 0
    nacks: int = 0
    not_ready: int = 0
    refused: int = 0
    stalls: int = 0
    bus_errors: int = 0
    dropped: int = 0


class ChipCare:
    """Keeps chips running: exchanges that may fail, and chips that come back.

    Parameters
    ----------
    chips : sequence of Chip
        Of all buses.
    burst : bool
        Whether chips are started in burst mode when they are set up.
    wait_ns : int
        Time from the start of a measurement to its reading (ns).
    monotonic_ns, sleep : callable
        Time (ns), and what lets it pass (s).

    Attributes
    ----------
    counts : ArrayCounts
        What was seen.
    failure : str
        The last one, in a sentence.
    """

    def __init__(
        self,
        chips: Sequence[Chip],
        burst: bool,
        wait_ns: int,
        monotonic_ns: Callable[[], int],
        sleep: Callable[[float], None],
    ) -> None:
        """See the class."""
        self.counts = ArrayCounts()
        self.failure = ''
        self._chips = chips
        self._burst = burst
        self._wait_ns = wait_ns
        self._monotonic_ns = monotonic_ns
        self._sleep = sleep

    def begin(self) -> None:
        """Set all chips up, as after opening."""
        for chip in self._chips:
            chip.lost, chip.losses, chip.pause_s = True, 0, 0.0
            chip.retry_ns = self._monotonic_ns()
            chip.switches.forget()
        self.bring_back()

    def end(self) -> None:
        """Stop all chips that still answer."""
        for chip in self._chips:
            if not chip.lost and self._burst:
                self.attempt(chip, chip.exit)
            chip.lost = True

    def attempt(self, chip: Chip, action: Callable[[], T]) -> T | None:
        """Do something with a chip; None where it fails, which is counted and remembered."""
        try:
            return action()
        except NotAcknowledged as err:
            self.failure = str(err)
            self.counts.nacks += 1
            chip.switches.forget()
            # the answer that was lost may have told of a reset
            self.lose(chip)
        except CommandRefused as err:
            self.failure = str(err)
            self.counts.refused += 1
            self.lose(chip)
        except DeviceError as err:
            self.failure = str(err)
            self._lose_bus(chip.bus)
        return None

    def lose(self, chip: Chip, at_once: bool = True) -> None:
        """Note that a chip has to be set up again: at once, and after growing pauses then."""
        chip.losses += 1
        pause = min(max(2 * chip.pause_s, FIRST_RETRY_S), LONGEST_RETRY_S)
        if at_once and chip.losses == 1:
            pause = 0.0
        chip.lost, chip.pause_s = True, pause
        chip.retry_ns = self._monotonic_ns() + round(pause * 1e9)

    def _lose_bus(self, bus: I2cBus) -> None:
        """Note that all chips of a bus have to be set up again."""
        self.counts.bus_errors += 1
        for chip in self._chips:
            if chip.bus is bus:
                chip.switches.forget()
                self.lose(chip, at_once=False)

    def refused(self, chip: Chip, status: int) -> bool:
        """Whether a chip that should start does not; it is set up again then."""
        if self.was_reset(chip, status):
            return True
        if status & Status.ERROR:
            self.failure = f'chip {chip.place} refuses to measure (status {status:#04x})'
            self.counts.refused += 1
            self.lose(chip)
        return bool(status & Status.ERROR)

    def was_reset(self, chip: Chip, status: int) -> bool:
        """Whether a chip lost its settings; it gets them back before the next frame."""
        if status & Status.RESET:
            self.failure = f'chip {chip.place} was reset: its supply broke down'
            self.counts.resets += 1
            self.lose(chip)
        return bool(status & Status.RESET)

    def stalled(self, chip: Chip) -> None:
        """Note that a measurement did not become ready in time."""
        self.failure = f'chip {chip.place} does not finish measuring'
        self.counts.stalls += 1
        self.lose(chip)

    def bring_back(self) -> None:
        """Set up the lost chips whose time has come, all together."""
        now_ns = self._monotonic_ns()
        lost = [chip for chip in self._chips if chip.lost and chip.retry_ns <= now_ns]
        if not lost:
            return
        lost = self._each(lost, _open_bus)
        lost = self._each(lost, Chip.exit, EXIT_WAIT_S)
        lost = self._each(lost, Chip.reset, RESET_WAIT_S)
        self._each(lost, self._set_up)

    def _each(
        self, chips: list[Chip], action: Callable[[Chip], object], wait_s: float = 0.0
    ) -> list[Chip]:
        """Do something with every chip, then wait; the chips with which it went well."""
        begun_ns = self._monotonic_ns()
        done = []
        for chip in chips:
            # a bus that failed for one chip is not tried for the next
            if chip.retry_ns > begun_ns:
                continue
            if self.attempt(chip, lambda chip=chip: (action(chip),)) is not None:  # type: ignore[misc]
                done.append(chip)
        if done:
            self._sleep(wait_s)
        return done

    def _set_up(self, chip: Chip) -> None:
        """Configure a chip that was just reset, start it in burst mode, and take it back."""
        again = chip.configured
        chip.configure()
        if self._burst:
            chip.start_burst()
        self.counts.reconfigured += again
        chip.lost = False
        chip.ready_ns = self._monotonic_ns() + self._wait_ns


def _open_bus(chip: Chip) -> None:
    """Open the bus of a chip, where it is not."""
    chip.bus.open()


Mode = Literal['single', 'burst']
POLLS_PER_CONVERSION = 8
CLOCK_RESET_NS = 1_000_000_000


class ChipArray(Closing):
    """The chips as a `Device`: a context manager whose `read` gives frames.

    Parameters
    ----------
    buses : sequence of I2cBus
        Not opened yet; this driver opens and closes them.
    places : sequence of ChipPlace
        Where the chips are reached, in the order of the layout's taxels.
    layout : Layout
        Of the sensor; 3 channels.
    settings : ChipSettings
        Of all chips.
    mode : 'single' or 'burst'
        single: all chips are started, then all are read, so that they measure at nearly the same
        time. burst: chips measure without end, each at its own pace; the fastest.
    rate_hz : float or None
        Frames per second, held by waiting; None or NaN: as fast as bus and chips allow.
    clock_ns : callable
        Gives the stamps (ns).
    monotonic_ns, sleep : callable
        Time for all waiting (ns), and what lets it pass (s).
    stuck_after, saturation_margin, jump : int, float, float
        See `ChipFaultDetector`.
    conversion_margin : float
        Share of the nominal conversion time that is waited in addition, for slow oscillators.
    bus_hz : float
        Clock of the buses (Hz), by which `rate_hz` is judged; 0: unknown, not judged.

    Raises
    ------
    ValueError
        If buses, places, layout and mode do not fit together, or the buses cannot carry the rate.

    Notes
    -----
    Stamps are the middle of the measurement: the clock, less what has passed since. In burst mode
    the age of a reading is known to half a conversion; its mean is taken.
    """

    def __init__(
        self,
        buses: Sequence[I2cBus],
        places: Sequence[ChipPlace],
        layout: Layout,
        settings: ChipSettings | None = None,
        mode: Mode = 'single',
        rate_hz: float | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
        stuck_after: int = 10,
        saturation_margin: float = 0.02,
        jump: float = 0.5,
        conversion_margin: float = 0.05,
        bus_hz: float = 0.0,
    ) -> None:
        """See the class."""
        settings = ChipSettings() if settings is None else settings
        _refuse_misfits(buses, places, layout, mode)
        if bus_hz > 0 and rate_hz is not None:
            check_bus_capacity(places, settings, mode == 'burst', rate_hz, bus_hz)
        self._layout = layout
        self._settings = settings
        self._burst = mode == 'burst'
        self._period_ns = round(1e9 / rate_hz) if rate_hz and rate_hz > 0 else 0
        self._clock_ns = clock_ns
        self._monotonic_ns = monotonic_ns
        self._sleep = sleep
        self._conversion_ns = round(settings.conversion_s * 1e9)
        self._wait_ns = round(self._conversion_ns * (1 + conversion_margin))
        self._buses = tuple(buses)
        self._chips = _make_chips(buses, places, settings)
        self._decoder = Decoder(settings, np.zeros(len(places)))
        self._faults = ChipFaultDetector(
            len(places), settings.full_scale, saturation_margin, jump, stuck_after
        )
        self._answers = bytearray(settings.answer_bytes * len(places))
        self._opened = False
        self._sequence = 0
        self._last_stamp_ns: int | None = None
        self._next_ns = 0
        self._care = ChipCare(self._chips, self._burst, self._wait_ns, monotonic_ns, sleep)
        self.counts = self._care.counts

    @property
    def layout(self) -> Layout:
        """Where the chips are."""
        return self._layout

    @property
    def missing(self) -> tuple[ChipPlace, ...]:
        """Chips that do not take part now."""
        return tuple(chip.place for chip in self._chips if chip.lost)

    def counters(self) -> dict[str, int]:
        """What was counted since the driver was made, and how many chips are missing now."""
        return {**asdict(self.counts), 'missing': len(self.missing)}

    def open(self) -> None:
        """Open the buses, reset and configure the chips, and measure once.

        Raises
        ------
        DeviceError
            If a bus is missing or forbidden, or no chip at all answers, twice; chips that are
            missing among others have ERROR in every frame and are looked for again.
        """
        try:
            for bus in self._buses:
                bus.open()
        except DeviceError:
            self.close()
            raise
        self._faults.forget()
        self._last_stamp_ns = None
        self._care.begin()
        if all(chip.lost for chip in self._chips):
            # one transfer that failed is no missing sensor
            self._wait_until(max(chip.retry_ns for chip in self._chips))
            self._care.bring_back()
        if all(chip.lost for chip in self._chips):
            self.close()
            raise DeviceError(self._care.failure)
        # not handed out: what the first real frame is compared with
        sequence = self._sequence
        self._measure()
        self._sequence = sequence
        self._opened = True
        self._next_ns = self._monotonic_ns()

    def __enter__(self) -> ChipArray:
        """Open."""
        self.open()
        return self

    def close(self) -> None:
        """Stop the chips and let the buses go."""
        self._opened = False
        self._care.end()
        for bus in self._buses:
            bus.close()

    def read(self, timeout: float) -> Frame:
        """Measure with all chips.

        Parameters
        ----------
        timeout : float
            Longest wait (s) for chips and buses that fail; a frame that has begun is finished.

        Returns
        -------
        Frame
            Chips that could not be read are NaN with ERROR.

        Raises
        ------
        DeviceTimeout
            If no chip could be read in time; says why. The next calls try again.
        DeviceError
            If it is not open.
        """
        if not self._opened:
            msg = f'chips on {", ".join(bus.path for bus in self._buses)} are not open'
            raise DeviceError(msg)
        deadline_ns = self._monotonic_ns() + round(timeout * 1e9)
        self._wait_until(self._next_ns)
        self._next_ns = max(self._next_ns + self._period_ns, self._monotonic_ns())
        while True:
            self._care.bring_back()
            frame = self._measure()
            if frame is not None:
                return frame
            self._sequence += 1
            self.counts.dropped += 1
            remaining = (deadline_ns - self._monotonic_ns()) * 1e-9
            if remaining <= 0:
                msg = f'{self._care.failure}; trying again'
                raise DeviceTimeout(msg)
            self._sleep(min(FIRST_RETRY_S, remaining))

    def _wait_until(self, time_ns: int) -> None:
        """Let time pass up to an instant."""
        remaining_ns = time_ns - self._monotonic_ns()
        if remaining_ns > 0:
            self._sleep(remaining_ns * 1e-9)

    def _measure(self) -> Frame | None:
        """One frame; None when no chip could be read."""
        if not self._burst:
            for chip in self._chips:
                self._start(chip)
        size = self._settings.answer_bytes
        good = np.zeros(len(self._chips), bool)
        for i, chip in enumerate(self._chips):
            answer = None if chip.lost or chip.ready_ns == 0 else self._fetch(chip)
            if answer is not None:
                self._answers[i * size : (i + 1) * size] = answer
                good[i] = True
        return self._frame(good) if good.any() else None

    def _start(self, chip: Chip) -> None:
        """Start one measurement of a chip."""
        chip.ready_ns = 0
        if chip.lost:
            return
        status = self._care.attempt(chip, chip.start_single)
        if status is not None and not self._care.refused(chip, status):
            chip.started_ns = self._monotonic_ns()
            chip.ready_ns = chip.started_ns + self._wait_ns

    def _fetch(self, chip: Chip) -> bytes | None:
        """Answer of a chip when its measurement is ready, polled for one more conversion."""
        self._wait_until(chip.ready_ns)
        while True:
            asked_ns = self._monotonic_ns()
            answer = self._care.attempt(chip, chip.read)
            if answer is None or self._care.was_reset(chip, answer[0]):
                return None
            if not answer[0] & Status.ERROR:
                self._note(chip, asked_ns)
                return answer
            self.counts.not_ready += 1
            if self._monotonic_ns() >= chip.ready_ns + self._conversion_ns:
                self._care.stalled(chip)
                return None
            self._sleep(self._conversion_ns * 1e-9 / POLLS_PER_CONVERSION)

    def _note(self, chip: Chip, asked_ns: int) -> None:
        """Remember when a chip was read, and so when it was measured."""
        chip.losses, chip.pause_s = 0, 0.0
        chip.fresh = asked_ns - chip.read_ns >= self._conversion_ns
        chip.read_ns = asked_ns
        if self._burst:
            # a conversion may have begun just before the last reading
            chip.started_ns = asked_ns - self._conversion_ns * 3 // 2
            chip.ready_ns = asked_ns + self._wait_ns

    def _frame(self, good: Bools) -> Frame:
        """What was read, as numbers with flags and a stamp."""
        stamp_ns = self._stamp_ns(good)
        self._decoder.set_tref(tuple(chip.tref for chip in self._chips))
        _, codes = self._decoder.words(self._answers)
        values, temperature_c = self._decoder.values(codes)
        fresh = np.array([chip.fresh for chip in self._chips])
        status = self._faults.status(codes, values, good, fresh)
        if not good.all():
            status[~good] = TaxelStatus.ERROR
            values[~good] = np.nan
            if temperature_c is not None:
                temperature_c[~good] = np.nan
        sequence, self._sequence = self._sequence, self._sequence + 1
        return Frame(
            stamp_ns, sequence, values, temperature_c, status, dropped=self.counts.dropped
        )

    def _stamp_ns(self, good: Bools) -> int:
        """Middle of the measurements on the clock of stamps; always later than the last."""
        started = [chip.started_ns for chip, ok in zip(self._chips, good, strict=True) if ok]
        middle_ns = (min(started) + max(started) + self._conversion_ns) // 2
        stamp_ns = self._clock_ns() - (self._monotonic_ns() - middle_ns)
        last_ns = self._last_stamp_ns
        if last_ns is not None and last_ns - CLOCK_RESET_NS < stamp_ns <= last_ns:
            stamp_ns = last_ns + 1
        self._last_stamp_ns = stamp_ns
        return stamp_ns


def _refuse_misfits(
    buses: Sequence[I2cBus], places: Sequence[ChipPlace], layout: Layout, mode: str
) -> None:
    """Refuse a layout or places that do not fit together."""
    if layout.shape != (len(places), 3) or not places:
        msg = (
            f'layout of ChipArray must have {len(places)} taxels, one for each chip, and 3 '
            f'channels; received {layout.shape}'
        )
        raise ValueError(msg)
    if max(place.bus for place in places) >= len(buses):
        msg = f'places of ChipArray must name one of {len(buses)} buses; received {places}'
        raise ValueError(msg)
    if mode not in get_args(Mode):
        msg = f'mode of ChipArray must be one of {", ".join(get_args(Mode))}; received {mode!r}'
        raise ValueError(msg)
    refuse_conflicts(places)


def _make_chips(
    buses: Sequence[I2cBus], places: Sequence[ChipPlace], settings: ChipSettings
) -> list[Chip]:
    """Chips with the switches of their buses."""
    switches = []
    for number, bus in enumerate(buses):
        muxes = {p.mux for p in places if p.bus == number and p.mux is not None}
        switches.append(Switches(bus, sorted(muxes)))
    return [Chip(p, buses[p.bus], switches[p.bus], settings) for p in places]
