# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""MLX90393 magnetometer: commands, registers, timing and scaling of its datasheet; one chip."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import DeviceError
from tactile_ros.types import Array, Bytes
from tactile_ros.types.config_fields import admit, switch, whole, whole_numbers

Words = npt.NDArray[np.uint16]

RESET_WAIT_S = 2e-3  # power-on reset takes 1.6 ms at most
EXIT_WAIT_S = 1e-3
ADDRESSES = range(0x08, 0x78)
DEFAULT_ADDRESS = 0x0C
MUX_ADDRESSES = range(0x70, 0x78)
CHANNELS = range(8)
TREF_REGISTER = 0x24
GAINS = np.array([5.0, 4.0, 3.0, 2.5, 2.0, 5 / 3, 4 / 3, 1.0])  # of GAIN_SEL 0..7
# T/LSB of x, y, z at GAIN_SEL 7 and resolution 0, by HALLCONF
TESLA_PER_LSB = {0x0: (0.1573e-6, 0.1573e-6, 0.2534e-6), 0xC: (0.1502e-6, 0.1502e-6, 0.242e-6)}
FULL_SCALE_LSB = np.array([0x8000, 0x8000, 0x8000, 0x4000])  # by resolution
CODE_OF_ZERO = np.array([0x0000, 0x0000, 0x8000, 0x4000])  # by resolution
LSB_PER_DEGREE = 45.2
REFERENCE_C = 35.0
TYPICAL_TREF = 46696
# (digital filter, oversampling) that convert wrongly at HALLCONF 0xC
FORBIDDEN_FILTERS = ((0, 0), (0, 1), (1, 0))


class Command(IntEnum):
    """First byte of what is written; START, READ and the like are joined with axes."""

    NOP = 0x00
    START_BURST = 0x10
    START_SINGLE = 0x30
    READ = 0x40
    READ_REGISTER = 0x50
    WRITE_REGISTER = 0x60
    EXIT = 0x80
    RESET = 0xF0


STARTS = (Command.START_BURST, Command.START_SINGLE)


class Status(IntEnum):
    """Bits of the byte that answers every command; the two lowest count answer bytes."""

    BURST = 0x80
    SINGLE = 0x20
    ERROR = 0x10  # command refused, or data read before they were ready
    RESET = 0x04


class RegisterField(NamedTuple):
    """Bits of a register: place and count."""

    register: int
    shift: int
    width: int

    @property
    def mask(self) -> int:
        """Bits of the field in its register."""
        return ((1 << self.width) - 1) << self.shift

    def get(self, word: int) -> int:
        """Value of the field in a register's word."""
        return (word & self.mask) >> self.shift

    def put(self, word: int, value: int) -> int:
        """Word with the field replaced and all other bits kept."""
        return (word & ~self.mask) | (value << self.shift & self.mask)


HALLCONF, GAIN_SEL = RegisterField(0x00, 0, 4), RegisterField(0x00, 4, 3)
BURST_DATA_RATE, TCMP_EN = RegisterField(0x01, 0, 6), RegisterField(0x01, 10, 1)
OSR, DIG_FILT, OSR2 = (RegisterField(0x02, *bits) for bits in ((0, 2), (2, 3), (11, 2)))
RES_X, RES_Y, RES_Z = (RegisterField(0x02, shift, 2) for shift in (5, 7, 9))


@dataclass(frozen=True)
class ChipSettings:
    """Settings of a chip; ValueError where a value or a combination is forbidden."""

    gain: int = whole(1, 'GAIN_SEL; 0 has the largest range, 7 the finest step', 0, 7)
    resolution: tuple[int, ...] = whole_numbers(
        (2, 2, 2), 'RES of x, y, z: each doubles step and range', 0, 3, (3,)
    )
    digital_filter: int = whole(2, 'DIG_FILT; more is slower and has less noise', 0, 7)
    oversampling: int = whole(0, 'OSR; more is slower and has less noise', 0, 3)
    temperature: bool = switch(True, 'read the temperature with every sample')
    hallconf: int = whole(0xC, 'HALLCONF, 12 (factory) or 0', 0, 0xC)

    def __post_init__(self) -> None:
        """Refuse what the chip cannot do; warn of what it does badly."""
        admit(self)
        pair, owner = (self.digital_filter, self.oversampling), type(self).__name__
        msg = ''
        if self.hallconf not in TESLA_PER_LSB:
            msg = f'hallconf of {owner} must be 0 or 12; received {self.hallconf}'
        elif self.hallconf == 0xC and pair in FORBIDDEN_FILTERS:
            msg = (
                f'digital_filter and oversampling of {owner} must not be '
                f'{" or ".join(map(str, FORBIDDEN_FILTERS))} at HALLCONF 0xC; received {pair}'
            )
        if msg:
            raise ValueError(msg)
        if self.digital_filter < 2:
            msg = f'digital_filter below 2 is known to give wrong readings; {pair[0]} was chosen'
            warnings.warn(msg, stacklevel=3)

    @property
    def axes(self) -> int:
        """The zyxt nibble of commands."""
        return 0xF if self.temperature else 0xE

    @property
    def answer_bytes(self) -> int:
        """Bytes that answer a READ: status and two for each quantity."""
        return 9 if self.temperature else 7

    @property
    def conversion_s(self) -> float:
        """Nominal time of one measurement (s)."""
        osr2 = 0 if self.temperature else None
        return conversion_time(self.oversampling, self.digital_filter, 3, osr2)

    @property
    def tesla_per_count(self) -> Array:
        """Step of x, y, z, shape (3,) (T)."""
        return tesla_per_lsb(self.gain, self.resolution, self.hallconf)

    @property
    def full_scale(self) -> Array:
        """Field of x, y, z at which the code wraps, shape (3,) (T)."""
        full: Array = self.tesla_per_count * FULL_SCALE_LSB[list(self.resolution)]
        return full

    @property
    def fields(self) -> tuple[tuple[RegisterField, int], ...]:
        """Values that the registers need; all other bits are the factory's."""
        return (
            (HALLCONF, self.hallconf), (GAIN_SEL, self.gain), (BURST_DATA_RATE, 0), (TCMP_EN, 0),
            (OSR, self.oversampling), (DIG_FILT, self.digital_filter),
            *zip((RES_X, RES_Y, RES_Z), self.resolution, strict=True), (OSR2, 0),
        )  # fmt: skip


def conversion_time(
    oversampling: int, digital_filter: int, magnetic_axes: int = 3,
    temperature_oversampling: int | None = None,
) -> float:  # fmt: skip
    """Nominal time of one measurement (s), within 0.01 ms of the datasheet's table.

    `temperature_oversampling` (OSR2) is None where the temperature is not measured.
    """
    axis = 0.067 + 0.064 * (1 << oversampling) * (2 + (1 << digital_filter))
    total = 0.49 + magnetic_axes * axis
    if temperature_oversampling is not None:
        total += 0.067 + 0.192 * (1 << temperature_oversampling)
    return total * 1e-3


def tesla_per_lsb(gain: int, resolution: tuple[int, ...], hallconf: int = 0xC) -> Array:
    """Step of x, y, z, shape (3,) (T), of GAIN_SEL, resolutions and HALLCONF."""
    step = np.array(TESLA_PER_LSB[hallconf]) * GAINS[gain]
    return np.asarray(step * 2.0 ** np.asarray(resolution), np.float64)


class Decoder:
    """Answers of many chips to READ, as numbers; `tref` (t,) are thermometers' reference words."""

    def __init__(self, settings: ChipSettings, tref: npt.ArrayLike) -> None:
        self._size = settings.answer_bytes
        self._first = first = int(settings.temperature)
        # resolutions 0 and 1 are two's complement, 2 and 3 are offset
        zero = CODE_OF_ZERO[list(settings.resolution)]
        self._added = np.zeros(first + 3, np.uint16)  # modulo 2^16
        self._added[first:] = np.where(zero == 0, 0x8000, 0)
        self._subtracted = np.empty((np.size(tref), first + 3))
        self._subtracted[:, first:] = np.where(zero == 0, 0x8000, zero)
        self.set_tref(tref)
        self._step = np.full(first + 3, 1 / LSB_PER_DEGREE)
        self._step[first:] = settings.tesla_per_count

    def set_tref(self, tref: npt.ArrayLike) -> None:
        """Replace the reference words, shape (t,), as when a chip was exchanged."""
        reference = np.asarray(tref, np.float64)
        self._subtracted[:, : self._first] = reference[:, None] - REFERENCE_C * LSB_PER_DEGREE

    def words(self, answers: bytes | bytearray) -> tuple[Bytes, Words]:
        """Status bytes, shape (t,), and codes, shape (t, 4) or (t, 3), of joined answers."""
        rows = np.frombuffer(answers, np.uint8).reshape(-1, self._size)
        codes = np.ascontiguousarray(rows[:, 1:]).view('>u2').astype(np.uint16)
        return rows[:, 0], codes

    def values(self, codes: Words) -> tuple[Array, Array | None]:
        """Flux density (t, 3) (T), and temperature (t,) (degrees Celsius) or None, of codes."""
        table: Array = (codes + self._added).astype(np.float64)
        table -= self._subtracted
        table *= self._step
        if self._first:
            return table[:, 1:], table[:, 0]
        return table, None


@dataclass(frozen=True)
class ChipPlace:
    """Address of a chip: its own, its bus's number, the switch and channel it is behind."""

    address: int = DEFAULT_ADDRESS
    bus: int = 0
    mux: int | None = None
    channel: int | None = None

    def __post_init__(self) -> None:
        """Refuse places that cannot be."""
        direct = self.mux is None and self.channel is None
        msg = ''
        if self.address not in ADDRESSES:
            msg = f'address of ChipPlace must be 0x08 to 0x77; received {self.address:#04x}'
        elif self.bus < 0:
            msg = f'bus of ChipPlace must be 0 or more; received {self.bus}'
        elif not direct and (self.mux not in MUX_ADDRESSES or self.channel not in CHANNELS):
            msg = (
                'mux and channel of ChipPlace must be 0x70 to 0x77 and 0 to 7, or both None; '
                f'received {self.mux} and {self.channel}'
            )
        if msg:
            raise ValueError(msg)

    def __str__(self) -> str:
        """Name the place in a sentence."""
        where = f'{self.address:#04x} on bus {self.bus}'
        if self.mux is None:
            return where
        return f'{where} behind channel {self.channel} of {self.mux:#04x}'


def refuse_conflicts(places: Sequence[ChipPlace]) -> None:
    """Refuse places of which two would answer at once: a ValueError."""
    direct = [(place.bus, place.address) for place in places if place.mux is None]
    switches = {(place.bus, place.mux) for place in places}
    for i, place in enumerate(places):
        wire = (place.bus, place.address)
        if place in places[:i] or wire in switches or (place.mux is not None and wire in direct):
            msg = f'places of chips must differ; two would answer as {place}'
            raise ValueError(msg)


class Switches:
    """The switches of one bus, for chips at `places`: writes only what changes."""

    def __init__(self, bus: I2cBus, places: Sequence[ChipPlace] = ()) -> None:
        self._bus = bus
        muxes = sorted({place.mux for place in places if place.mux is not None})
        self._open: dict[int, int | None] = dict.fromkeys(muxes)  # None: unknown

    def forget(self) -> None:
        """Assume nothing of what is open, as after a failure."""
        self._open = dict.fromkeys(self._open)

    def select(self, place: ChipPlace) -> None:
        """Open the channel of a chip and close those of other switches."""
        mux, channel = place.mux, place.channel
        if mux is None or channel is None or self._open.get(mux) == 1 << channel:
            return
        for other, mask in self._open.items():
            if other != mux and mask != 0:
                self._write(other, 0)
        self._write(mux, 1 << channel)

    def _write(self, mux: int, mask: int) -> None:
        self._open[mux] = None  # unknown until that succeeded
        self._bus.transfer(mux, bytes((mask,)), 0)
        self._open[mux] = mask


class CommandRefused(DeviceError):
    """A chip answers, but does not do what its datasheet says."""


class Chip:
    """One chip on its bus, and what a driver remembers of it."""

    def __init__(
        self, place: ChipPlace, bus: I2cBus, switches: Switches, settings: ChipSettings
    ) -> None:
        self.place = place
        self.bus = bus
        self.switches = switches
        self.tref = 0  # its thermometer's reference word
        self.lost = True  # it has to be reset before it is read again
        self.configured = False
        self.losses = 0  # since it was last read
        self.retry_ns = 0
        self.pause_s = 0.0  # before it is tried again
        self.started_ns = 0  # when its measurement began
        self.ready_ns = 0  # when the next one is ready
        self.read_ns = 0  # when the last one was asked for
        self.fresh = True  # it had time for a new measurement between the last two readings
        self._settings = settings
        self._read = bytes((Command.READ | settings.axes,))

    def exchange(self, command: bytes, count: int) -> bytes:
        """Exchange bytes with the chip, through its switch."""
        self.switches.select(self.place)
        return self.bus.transfer(self.place.address, command, count)

    def command(self, command: Command) -> int:
        """Let it START measuring, EXIT whatever it does, or nothing; the status that answers."""
        axes = self._settings.axes if command in STARTS else 0
        return self.exchange(bytes((command | axes,)), 1)[0]

    def read(self) -> bytes:
        """Status and data of the last measurement."""
        return self.exchange(self._read, self._settings.answer_bytes)

    def reset(self) -> None:
        """Reset it; 2 ms have to pass then. The status is left for `configure` to see."""
        self.exchange(bytes((Command.RESET,)), 0)

    def configure(self) -> None:
        """Write the settings into a chip that was just reset, verify them and read TREF.

        A CommandRefused says that it was not reset, refuses a command or does not keep what was
        written.
        """
        status = self.command(Command.NOP)
        if not status & Status.RESET:
            msg = f'chip {self.place} was not reset (status {status:#04x}): is it an MLX90393?'
            raise CommandRefused(msg)
        fields = self._settings.fields
        before = {register: self._read_register(register) for register in
                  dict.fromkeys(field.register for field, _ in fields)}  # fmt: skip
        wanted = dict(before)
        for field, value in fields:
            wanted[field.register] = field.put(wanted[field.register], value)
        for register, word in wanted.items():
            if word != before[register]:
                self._write_register(register, word)
        self.tref = self._read_register(TREF_REGISTER)
        self.configured = True

    def _read_register(self, register: int) -> int:
        command = bytes((Command.READ_REGISTER, register << 2))
        status, high, low = self.exchange(command, 3)
        self._check(status, f'read register {register:#04x}')
        return high << 8 | low

    def _write_register(self, register: int, word: int) -> None:
        """Write a register and read it back."""
        command = bytes((Command.WRITE_REGISTER, word >> 8, word & 0xFF, register << 2))
        (status,) = self.exchange(command, 1)
        self._check(status, f'write register {register:#04x}')
        kept = self._read_register(register)
        if kept != word:
            msg = (
                f'chip {self.place} keeps {kept:#06x} in register {register:#04x}, not {word:#06x}'
            )
            raise CommandRefused(msg)

    def _check(self, status: int, what: str) -> None:
        """Raise where a command was rejected or the chip has reset in between."""
        if status & (Status.ERROR | Status.RESET):
            msg = f'chip {self.place} did not {what} (status {status:#04x})'
            raise CommandRefused(msg)
