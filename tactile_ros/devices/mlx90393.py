"""MLX90393 magnetometer as its datasheet describes it: commands, registers, timing and scaling."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bytes

Words = npt.NDArray[np.uint16]

RESET_WAIT_S = 2e-3  # power-on reset takes 1.6 ms at most
EXIT_WAIT_S = 1e-3
ADDRESSES = range(0x08, 0x78)
DEFAULT_ADDRESS = 0x0C
TREF_REGISTER = 0x24
OFFSET_REGISTERS = (0x04, 0x05, 0x06)
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
    START_WAKE = 0x20
    START_SINGLE = 0x30
    READ = 0x40
    READ_REGISTER = 0x50
    WRITE_REGISTER = 0x60
    EXIT = 0x80
    RECALL = 0xD0
    STORE = 0xE0
    RESET = 0xF0


class Status(IntEnum):
    """Bits of the byte that answers every command; the two lowest count answer bytes."""

    BURST = 0x80
    WAKE = 0x40
    SINGLE = 0x20
    ERROR = 0x10  # command refused, or data read before they were ready
    CORRECTED = 0x08
    RESET = 0x04


class RegisterField(NamedTuple):
    """Bits of a register: where they are and how many."""

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


HALLCONF = RegisterField(0x00, 0, 4)
GAIN_SEL = RegisterField(0x00, 4, 3)
BURST_DATA_RATE = RegisterField(0x01, 0, 6)
TCMP_EN = RegisterField(0x01, 10, 1)
OSR = RegisterField(0x02, 0, 2)
DIG_FILT = RegisterField(0x02, 2, 3)
RES_X = RegisterField(0x02, 5, 2)
RES_Y = RegisterField(0x02, 7, 2)
RES_Z = RegisterField(0x02, 9, 2)
OSR2 = RegisterField(0x02, 11, 2)


@dataclass(frozen=True)
class ChipSettings:
    """How a chip measures.

    Attributes
    ----------
    gain : int
        GAIN_SEL 0..7; 0 ('5x') has the coarsest step and the largest range, 7 ('1x') the finest.
    resolution : tuple of int
        RES of x, y, z, 0..3: every step doubles step and range.
    digital_filter, oversampling : int
        DIG_FILT 0..7 and OSR 0..3: less noise for more time.
    temperature : bool
        Whether the temperature is read with every sample.
    temperature_oversampling : int
        OSR2 0..3.
    hallconf : int
        Plate configuration, 0xC (factory) or 0.
    temperature_compensation : bool
        TCMP_EN: the chip corrects its own sensitivity; resolutions 0 and 1 only.
    forbidden : tuple of (int, int)
        Pairs of filter and oversampling that are refused at HALLCONF 0xC. The published list comes
        from users' reports: change it where a datasheet says otherwise.

    Raises
    ------
    ValueError
        If a value is out of range or a combination is forbidden.
    """

    gain: int = 1
    resolution: tuple[int, int, int] = (2, 2, 2)
    digital_filter: int = 2
    oversampling: int = 0
    temperature: bool = True
    temperature_oversampling: int = 0
    hallconf: int = 0xC
    temperature_compensation: bool = False
    forbidden: tuple[tuple[int, int], ...] = FORBIDDEN_FILTERS

    def __post_init__(self) -> None:
        """Refuse what the chip cannot do; warn of what it does badly."""
        _between('gain', self.gain, range(8))
        _between('digital_filter', self.digital_filter, range(8))
        _between('oversampling', self.oversampling, range(4))
        _between('temperature_oversampling', self.temperature_oversampling, range(4))
        _between('hallconf', self.hallconf, tuple(TESLA_PER_LSB))
        if len(self.resolution) != 3:
            msg = f'resolution of ChipSettings must name x, y and z; received {self.resolution}'
            raise ValueError(msg)
        for value in self.resolution:
            _between('resolution', value, range(4))
        if self.temperature_compensation and max(self.resolution) > 1:
            msg = (
                'resolution of ChipSettings must be 0 or 1 with temperature compensation; '
                f'received {self.resolution}'
            )
            raise ValueError(msg)
        self._check_filter()

    def _check_filter(self) -> None:
        """Refuse or warn of fast filters."""
        pair = (self.digital_filter, self.oversampling)
        if self.hallconf == 0xC and pair in self.forbidden:
            msg = (
                'digital_filter and oversampling of ChipSettings must not be '
                f'{" or ".join(map(str, self.forbidden))} at HALLCONF 0xC; received {pair}'
            )
            raise ValueError(msg)
        if self.digital_filter < 2:
            msg = f'digital_filter below 2 is known to give wrong readings; {pair[0]} was chosen'
            warnings.warn(msg, stacklevel=4)

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
        osr2 = self.temperature_oversampling if self.temperature else None
        return conversion_time(self.oversampling, self.digital_filter, 3, osr2)

    @property
    def full_scale(self) -> Array:
        """Field of x, y, z at which the code wraps, shape (3,) (T)."""
        lsb = tesla_per_lsb(self.gain, self.resolution, self.hallconf)
        return np.asarray(lsb * FULL_SCALE_LSB[list(self.resolution)], np.float64)

    @property
    def fields(self) -> tuple[tuple[RegisterField, int], ...]:
        """What has to stand in the registers; all other bits are the factory's."""
        plain = (
            (HALLCONF, self.hallconf),
            (GAIN_SEL, self.gain),
            (BURST_DATA_RATE, 0),
            (TCMP_EN, int(self.temperature_compensation)),
            (OSR, self.oversampling),
            (DIG_FILT, self.digital_filter),
            *zip((RES_X, RES_Y, RES_Z), self.resolution, strict=True),
            (OSR2, self.temperature_oversampling),
        )
        if not self.temperature_compensation:
            return plain
        # codes are centred on 0x8000 then, and so are the offsets
        return plain + tuple((RegisterField(i, 0, 16), 0x8000) for i in OFFSET_REGISTERS)


def _between(name: str, value: int, allowed: range | tuple[int, ...]) -> None:
    """Refuse a setting that the chip does not have."""
    if value not in allowed:
        choice = f'{allowed[0]} to {allowed[-1]}' if isinstance(allowed, range) else str(allowed)
        msg = f'{name} of ChipSettings must be {choice}; received {value}'
        raise ValueError(msg)


def conversion_time(
    oversampling: int,
    digital_filter: int,
    magnetic_axes: int = 3,
    temperature_oversampling: int | None = None,
) -> float:
    """Nominal time of one measurement.

    Parameters
    ----------
    oversampling, digital_filter : int
        OSR and DIG_FILT.
    magnetic_axes : int
        How many of x, y, z are measured.
    temperature_oversampling : int or None
        OSR2; None: the temperature is not measured.

    Returns
    -------
    float
        Time (s); oscillators differ by a few percent.

    Notes
    -----
    Reproduces the datasheet's table of x, y, z conversions within 0.01 ms.
    """
    axis = 0.067 + 0.064 * (1 << oversampling) * (2 + (1 << digital_filter))
    total = 0.49 + magnetic_axes * axis
    if temperature_oversampling is not None:
        total += 0.067 + 0.192 * (1 << temperature_oversampling)
    return total * 1e-3


def tesla_per_lsb(gain: int, resolution: tuple[int, int, int], hallconf: int = 0xC) -> Array:
    """Step of x, y, z, shape (3,) (T), of GAIN_SEL, resolutions and HALLCONF."""
    step = np.array(TESLA_PER_LSB[hallconf]) * GAINS[gain]
    return np.asarray(step * 2.0 ** np.asarray(resolution), np.float64)


def codes_of_zero(settings: ChipSettings) -> tuple[Words, Array]:
    """What turns codes into counts: added modulo 2^16, then subtracted; shapes (3,).

    Resolutions 0 and 1 are two's complement, 2 and 3 and compensated codes are offset.
    """
    zero = CODE_OF_ZERO[list(settings.resolution)]
    if settings.temperature_compensation:
        zero = np.full(3, 0x8000)
    added = np.where(zero == 0, 0x8000, 0).astype(np.uint16)
    return added, np.where(zero == 0, 0x8000, zero).astype(np.float64)


def register_read(register: int) -> bytes:
    """Command that reads a register; three bytes answer."""
    return bytes((Command.READ_REGISTER, register << 2))


def register_write(register: int, word: int) -> bytes:
    """Command that writes a register; one byte answers."""
    return bytes((Command.WRITE_REGISTER, word >> 8, word & 0xFF, register << 2))


class Decoder:
    """Answers of many chips to READ, as numbers.

    Parameters
    ----------
    settings : ChipSettings
        The same for all chips.
    tref : array_like, shape (t,)
        Reference word of every chip's thermometer, from register 0x24.
    """

    def __init__(self, settings: ChipSettings, tref: npt.ArrayLike) -> None:
        """See the class."""
        self._size = settings.answer_bytes
        self._temperature = settings.temperature
        self._first = first = self._size // 2 - 3
        self._added = np.zeros(first + 3, np.uint16)
        self._subtracted = np.empty((np.size(tref), first + 3))
        self._step = np.full(first + 3, 1 / LSB_PER_DEGREE)
        self._added[first:], self._subtracted[:, first:] = codes_of_zero(settings)
        self.set_tref(tref)
        self._step[first:] = tesla_per_lsb(settings.gain, settings.resolution, settings.hallconf)

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
        """Flux density, shape (t, 3) (T), and temperature, shape (t,) (degrees Celsius) or None.

        Parameters
        ----------
        codes : ndarray, shape (t, 4) or (t, 3)
            From `words`: t, x, y, z, or x, y, z.
        """
        table: Array = (codes + self._added).astype(np.float64)
        table -= self._subtracted
        table *= self._step
        if self._temperature:
            return table[:, 1:], table[:, 0]
        return table, None
