"""Many MLX90393 on I2C buses and behind switches, read as one sensor."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from tactile_ros.devices.bus_capacity import check_bus_capacity
from tactile_ros.devices.chip import Chip
from tactile_ros.devices.chip_care import FIRST_RETRY_S, ChipCare
from tactile_ros.devices.mlx90393 import ChipSettings, Decoder, Status
from tactile_ros.devices.mux import ChipPlace, Switches, refuse_conflicts
from tactile_ros.devices.reading_watch import ReadingWatch
from tactile_ros.devices.reconnecting import Opened
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Bools, Frame, Layout, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.devices.transport import I2cBus

Mode = Literal['single', 'burst']
POLLS_PER_CONVERSION = 8
CLOCK_RESET_NS = 1_000_000_000


class ChipArray(Opened):
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
        See `ReadingWatch`.
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
        self._watch = ReadingWatch(
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
        self._watch.forget()
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
        status = self._watch.judge(codes, values, good, fresh)
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
