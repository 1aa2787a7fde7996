# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Many MLX90393 on I2C buses and behind switches, read as one sensor."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Literal, TypeVar, get_args

import numpy as np

from tactile_ros.devices.fault_flags import ChipFaultDetector, measured_temperature
from tactile_ros.devices.mlx90393 import (
    EXIT_WAIT_S,
    RESET_WAIT_S,
    Chip,
    ChipPlace,
    ChipSettings,
    Command,
    CommandRefused,
    Decoder,
    Status,
    Switches,
    refuse_conflicts,
)
from tactile_ros.devices.timestamps import CLOCK_RESET_NS, Clock
from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import DeviceError, DeviceTimeout, NotAcknowledged
from tactile_ros.types import Bools, Closing, Device, Frame, Layout, TaxelStatus

T = TypeVar('T')
Mode = Literal['single', 'burst']

FIRST_RETRY_S = 0.02
LONGEST_RETRY_S = 0.2
POLLS_PER_CONVERSION = 8
BITS_PER_BYTE = 9  # with the acknowledgement
MARGIN = 0.05  # of the nominal conversion, waited in addition for slow oscillators
COUNTERS = {
    'resets': 'running chips that said they had been reset (their supply broke down)',
    'reconfigured': 'chips that were set up again',
    'nacks': 'transfers that nothing answered',
    'not_ready': 'reads that came before their measurement was ready',
    'refused': 'commands that a chip refused, registers that did not keep what was written',
    'stalls': 'measurements that did not become ready in time',
    'bus_errors': 'failures of a whole bus',
    'dropped': 'frames in which no chip could be read',
    'temperatures_refused': 'frames of which every chip says a temperature that none can have',
}


class ChipArray(Closing, Device):
    """The chips as a `Device`.

    Parameters
    ----------
    buses, places : sequence of I2cBus, of ChipPlace
        Not opened yet, this driver opens and closes them; in the order of the layout's taxels.
    mode : 'single' or 'burst'
        single: all chips are started, then all are read, so that they measure at nearly the same
        time. burst: chips measure without end, each at its own pace; the fastest.
    rate_hz : float or None
        Frames per second, held by waiting; None or NaN: as fast as bus and chips allow.
    clock_ns, clock : callable, Clock
        Gives the stamps (ns); of all waiting.
    bus_hz : float
        Clock of the buses (Hz), by which `rate_hz` is judged; 0: not judged.

    Notes
    -----
    A ValueError refuses misfits and a rate that the buses cannot carry. Stamps are the middle of
    the measurement: in burst mode the age of a reading is uncertain by half a conversion; its mean
    is taken.
    """

    def __init__(
        self, buses: Sequence[I2cBus], places: Sequence[ChipPlace], layout: Layout,
        settings: ChipSettings | None = None, mode: Mode = 'single', rate_hz: float | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns, clock: Clock | None = None,
        bus_hz: float = 0.0,
    ) -> None:  # fmt: skip
        settings = ChipSettings() if settings is None else settings
        _refuse_misfits(buses, places, layout, mode)
        self._burst = mode == 'burst'
        if bus_hz > 0 and rate_hz is not None:
            check_bus_capacity(places, settings, self._burst, rate_hz, bus_hz)
        self.layout = layout
        self._settings = settings
        self._period_ns = round(1e9 / rate_hz) if rate_hz and rate_hz > 0 else 0
        self._clock_ns = clock_ns
        self._clock = clock = Clock() if clock is None else clock
        self._conversion_ns = round(settings.conversion_s * 1e9)
        self._wait_ns = round(self._conversion_ns * (1 + MARGIN))
        self._buses = tuple(buses)
        switches = [
            Switches(bus, [place for place in places if place.bus == number])
            for number, bus in enumerate(buses)
        ]
        self._chips = [Chip(p, buses[p.bus], switches[p.bus], settings) for p in places]
        self._counts = dict.fromkeys(COUNTERS, 0)
        self._failure = ''  # the last one, in a sentence
        self._decoder = Decoder(settings, np.zeros(len(places)))
        self._faults = ChipFaultDetector(len(places), settings.full_scale)
        self._answers = bytearray(settings.answer_bytes * len(places))
        self._opened = False
        self._sequence = 0
        self._last_stamp_ns: int | None = None
        self._next_ns = 0

    @property
    def missing(self) -> tuple[ChipPlace, ...]:
        """Chips that do not take part now."""
        return tuple(chip.place for chip in self._chips if chip.lost)

    def counters(self) -> dict[str, int]:
        """Counts since the driver was made, by `COUNTERS`, and how many chips are missing now."""
        return {**self._counts, 'missing': len(self.missing)}

    def open(self) -> None:
        """Open the buses, reset and configure the chips, and measure once.

        A DeviceError says that a bus is missing or forbidden, or that no chip at all answers,
        twice; chips missing among others have ERROR and are looked for again.
        """
        try:
            for bus in self._buses:
                bus.open()
        except DeviceError:
            self.close()
            raise
        self._faults.forget()
        self._last_stamp_ns = None
        for chip in self._chips:
            chip.lost, chip.losses, chip.pause_s = True, 0, 0.0
            chip.retry_ns = self._clock.now_ns()
            chip.switches.forget()
        self._bring_back()
        if all(chip.lost for chip in self._chips):
            # one transfer that failed is no missing sensor
            self._wait_until(max(chip.retry_ns for chip in self._chips))
            self._bring_back()
        if all(chip.lost for chip in self._chips):
            self.close()
            raise DeviceError(self._failure)
        # not handed out: the first real frame is compared with it
        sequence = self._sequence
        self._measure()
        self._sequence = sequence
        self._opened = True
        self._next_ns = self._clock.now_ns()

    def close(self) -> None:
        """Stop the chips and let the buses go."""
        self._opened = False
        for chip in self._chips:
            if not chip.lost and self._burst:
                self._attempt(chip, lambda chip: chip.command(Command.EXIT))
            chip.lost = True
        for bus in self._buses:
            bus.close()

    def read(self, timeout: float) -> Frame:
        """Measure with all chips; those that could not be read are NaN with ERROR.

        A DeviceTimeout says why no chip could be read within `timeout` (s), a DeviceError that it
        is not open.
        """
        if not self._opened:
            msg = f'chips on {", ".join(bus.path for bus in self._buses)} are not open'
            raise DeviceError(msg)
        deadline_ns = self._clock.now_ns() + round(timeout * 1e9)
        self._wait_until(self._next_ns)
        self._next_ns = max(self._next_ns + self._period_ns, self._clock.now_ns())
        while True:
            self._bring_back()
            frame = self._measure()
            if frame is not None:
                return frame
            self._sequence += 1
            self._counts['dropped'] += 1
            remaining = (deadline_ns - self._clock.now_ns()) * 1e-9
            if remaining <= 0:
                msg = f'{self._failure}; trying again'
                raise DeviceTimeout(msg)
            self._clock.sleep(min(FIRST_RETRY_S, remaining))

    def _wait_until(self, time_ns: int) -> None:
        remaining_ns = time_ns - self._clock.now_ns()
        if remaining_ns > 0:
            self._clock.sleep(remaining_ns * 1e-9)

    def _attempt(self, chip: Chip, action: Callable[[Chip], T]) -> T | None:
        """Do something with a chip; None where it fails, which is counted and remembered."""
        try:
            return action(chip)
        except NotAcknowledged as err:
            chip.switches.forget()
            # the answer that was lost may have shown a reset
            self._fail(chip, 'nacks', str(err))
        except CommandRefused as err:
            self._fail(chip, 'refused', str(err))
        except DeviceError as err:
            self._failure = str(err)
            self._counts['bus_errors'] += 1
            for other in self._chips:
                if other.bus is chip.bus:
                    other.switches.forget()
                    self._lose(other, at_once=False)
        return None

    def _fail(self, chip: Chip, counter: str, failure: str) -> None:
        """Count a failure of one chip, which has to be set up again."""
        self._failure = failure
        self._counts[counter] += 1
        self._lose(chip)

    def _lose(self, chip: Chip, at_once: bool = True) -> None:
        """Set a chip up again: at once, and after growing pauses then."""
        chip.losses += 1
        pause_s = min(max(2 * chip.pause_s, FIRST_RETRY_S), LONGEST_RETRY_S)
        chip.pause_s = 0.0 if at_once and chip.losses == 1 else pause_s
        chip.lost, chip.retry_ns = True, self._clock.now_ns() + round(chip.pause_s * 1e9)

    def _was_reset(self, chip: Chip, status: int) -> bool:
        """True for a chip that lost its settings; it gets them back before the next frame."""
        if status & Status.RESET:
            self._fail(chip, 'resets', f'chip {chip.place} was reset: its supply broke down')
        return bool(status & Status.RESET)

    def _bring_back(self) -> None:
        """Set up the lost chips whose time has come, all together."""
        now_ns = self._clock.now_ns()
        lost = [chip for chip in self._chips if chip.lost and chip.retry_ns <= now_ns]
        if lost:
            lost = self._each(lost, lambda chip: chip.bus.open())
            lost = self._each(lost, lambda chip: chip.command(Command.EXIT), EXIT_WAIT_S)
            lost = self._each(lost, Chip.reset, RESET_WAIT_S)
            self._each(lost, self._set_up)

    def _each(
        self, chips: list[Chip], action: Callable[[Chip], object], wait_s: float = 0.0
    ) -> list[Chip]:
        """Do something with every chip, then wait; the chips with which it went well."""
        begun_ns = self._clock.now_ns()
        done = []
        for chip in chips:
            # a bus that failed for one chip is not tried for the next
            if chip.retry_ns <= begun_ns:
                losses = chip.losses
                self._attempt(chip, action)
                done += [chip] * (chip.losses == losses)
        if done:
            self._clock.sleep(wait_s)
        return done

    def _set_up(self, chip: Chip) -> None:
        again = chip.configured
        chip.configure()
        if self._burst:
            chip.command(Command.START_BURST)
        self._counts['reconfigured'] += again
        chip.lost = False
        chip.ready_ns = self._clock.now_ns() + self._wait_ns

    def _measure(self) -> Frame | None:
        """Measure one frame; None when no chip could be read."""
        if not self._burst:
            for chip in self._chips:
                self._start(chip)
        size = self._settings.answer_bytes
        measured = np.zeros(len(self._chips), bool)
        for i, chip in enumerate(self._chips):
            answer = None if chip.lost or chip.ready_ns == 0 else self._fetch(chip)
            if answer is not None:
                self._answers[i * size : (i + 1) * size] = answer
                measured[i] = True
        return self._frame(measured) if measured.any() else None

    def _start(self, chip: Chip) -> None:
        chip.ready_ns = 0
        if chip.lost:
            return
        status = self._attempt(chip, lambda chip: chip.command(Command.START_SINGLE))
        if status is None or self._was_reset(chip, status):
            return
        if status & Status.ERROR:
            failure = f'chip {chip.place} refuses to measure (status {status:#04x})'
            self._fail(chip, 'refused', failure)
            return
        chip.started_ns = self._clock.now_ns()
        chip.ready_ns = chip.started_ns + self._wait_ns

    def _fetch(self, chip: Chip) -> bytes | None:
        """Answer of a chip when its measurement is ready, polled for one more conversion."""
        self._wait_until(chip.ready_ns)
        while True:
            asked_ns = self._clock.now_ns()
            answer = self._attempt(chip, Chip.read)
            if answer is None or self._was_reset(chip, answer[0]):
                return None
            if not answer[0] & Status.ERROR:
                break
            self._counts['not_ready'] += 1
            if self._clock.now_ns() >= chip.ready_ns + self._conversion_ns:
                failure = f'chip {chip.place} does not finish measuring'
                self._fail(chip, 'stalls', failure)
                return None
            self._clock.sleep(self._conversion_ns * 1e-9 / POLLS_PER_CONVERSION)
        chip.losses, chip.pause_s = 0, 0.0
        chip.fresh = asked_ns - chip.read_ns >= self._conversion_ns
        chip.read_ns = asked_ns
        if self._burst:
            # a conversion may have begun just before the last reading
            chip.started_ns = asked_ns - self._conversion_ns * 3 // 2
            chip.ready_ns = asked_ns + self._wait_ns
        return answer

    def _frame(self, measured: Bools) -> Frame:
        stamp_ns = self._stamp_ns(measured)
        self._decoder.set_tref(tuple(chip.tref for chip in self._chips))
        _, codes = self._decoder.words(self._answers)
        values, temperature_c = self._decoder.values(codes)
        if temperature_c is not None:
            temperature_c, refused = measured_temperature(temperature_c)
            self._counts['temperatures_refused'] += refused
        fresh = np.array([chip.fresh for chip in self._chips])
        status = self._faults.status(codes, values, measured, fresh)
        if not measured.all():
            status[~measured] = TaxelStatus.ERROR
            values[~measured] = np.nan
            if temperature_c is not None:
                temperature_c[~measured] = np.nan
        sequence, self._sequence = self._sequence, self._sequence + 1
        dropped = self._counts['dropped']
        return Frame(stamp_ns, sequence, values, temperature_c, status, dropped=dropped)

    def _stamp_ns(self, measured: Bools) -> int:
        """Middle of the measurements on the clock of stamps; always later than the last."""
        started = [chip.started_ns for chip, ok in zip(self._chips, measured, strict=True) if ok]
        middle_ns = (min(started) + max(started) + self._conversion_ns) // 2
        stamp_ns = self._clock_ns() - (self._clock.now_ns() - middle_ns)
        last_ns = self._last_stamp_ns
        if last_ns is not None and last_ns - CLOCK_RESET_NS < stamp_ns <= last_ns:
            stamp_ns = last_ns + 1
        self._last_stamp_ns = stamp_ns
        return stamp_ns


def _refuse_misfits(
    buses: Sequence[I2cBus], places: Sequence[ChipPlace], layout: Layout, mode: str
) -> None:
    msg = ''
    if layout.shape != (len(places), 3) or not places:
        msg = (
            f'layout of ChipArray must have {len(places)} taxels, one for each chip, and 3 '
            f'channels; received {layout.shape}'
        )
    elif max(place.bus for place in places) >= len(buses):
        msg = f'places of ChipArray must name one of {len(buses)} buses; received {places}'
    elif mode not in get_args(Mode):
        msg = f'mode of ChipArray must be one of {", ".join(get_args(Mode))}; received {mode!r}'
    if msg:
        raise ValueError(msg)
    refuse_conflicts(places)


def exchange_bits(written: int, answered: int = 0) -> int:
    """Clocks of one exchange: 9 a byte, one each for start, repeated start and stop."""
    parts = (written, answered) if answered else (written,)
    return 1 + sum(1 + BITS_PER_BYTE * (1 + count) for count in parts)


def switch_bits(places: Sequence[ChipPlace]) -> list[int]:
    """Clocks of the switches before each chip, one a place, when all are visited in turn."""
    bits: list[int] = []
    opened: dict[int, ChipPlace] = {}
    for place in (*places, *places):
        before, writes = opened.get(place.bus, place), 0
        if place.mux is not None:
            opened[place.bus] = place
            # another switch is closed first
            writes = 2 if before.mux != place.mux else int(before.channel != place.channel)
        bits.append(writes * exchange_bits(1))
    return bits[len(places) :]


def carried_hz(
    places: Sequence[ChipPlace], settings: ChipSettings, burst: bool, bus_hz: float
) -> float:
    """Most frames a second that chips, in the order of reading, and a bus of `bus_hz` carry.

    By the clocks of every exchange and nominal conversions: only what can never be is refused.
    """
    switching = np.array(switch_bits(places)) / bus_hz
    reading = exchange_bits(1, settings.answer_bytes) / bus_hz
    if burst:
        wire_s = float(switching.sum()) + len(places) * reading
        return 1 / max(wire_s, settings.conversion_s)
    ready = np.cumsum(switching + exchange_bits(1, 1) / bus_hz) + settings.conversion_s
    now_s = float(ready[-1]) - settings.conversion_s
    for switched_s, ready_s in zip(switching.tolist(), ready.tolist(), strict=True):
        now_s = max(now_s + switched_s, ready_s) + reading
    return 1 / now_s


def check_bus_capacity(
    places: Sequence[ChipPlace], settings: ChipSettings, burst: bool, rate_hz: float, bus_hz: float
) -> None:
    """Refuse a rate above `carried_hz`, naming both; a rate that is NaN is not checked."""
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
