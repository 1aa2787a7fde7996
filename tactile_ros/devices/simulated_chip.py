"""Simulated MLX90393: the state machine of one chip behind its bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.mlx90393 import (
    BURST_DATA_RATE,
    CODE_OF_ZERO,
    DIG_FILT,
    FULL_SCALE_LSB,
    GAIN_SEL,
    HALLCONF,
    LSB_PER_DEGREE,
    OSR,
    OSR2,
    REFERENCE_C,
    RES_X,
    RES_Y,
    RES_Z,
    TCMP_EN,
    TREF_REGISTER,
    TYPICAL_TREF,
    Command,
    Status,
    conversion_time,
    tesla_per_lsb,
)
from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Callable

POWER_ON_NS = 1_600_000
# gain 1x, HALLCONF 0xC, everything else 0 but the offsets' and thermometer's words
FACTORY = {0x00: 0x007C, 0x02: 0x0000, 0x04: 0x0000, 0x05: 0x0000, 0x06: 0x0000}
BURST_STEP_S = 20e-3
NEVER_NS = 1 << 62


class SimulatedChip:
    """One chip: registers, modes, conversions and status byte.

    Parameters
    ----------
    sample : callable
        Time (ns) -> flux density, shape (3,) (T), and temperature (degrees Celsius) at the chip.
    rng : numpy.random.Generator
        Of its noise, its oscillator and its thermometer's reference.
    noise : ndarray, shape (3,)
        Standard deviation of x, y, z (T).
    tolerance : float
        Largest share by which its oscillator is wrong.
    """

    def __init__(
        self,
        sample: Callable[[int], tuple[Array, float]],
        rng: np.random.Generator,
        noise: Array,
        tolerance: float = 0.03,
    ) -> None:
        """See the class."""
        self._sample = sample
        self._rng = rng
        self._noise = noise
        self._oscillator = 1 + tolerance * float(rng.uniform(-1, 1))
        self._stored = {**FACTORY, TREF_REGISTER: TYPICAL_TREF + int(rng.integers(-300, 300))}
        self._answer = b''
        self.power_up(-POWER_ON_NS)

    def power_up(self, now_ns: int) -> None:
        """Start as after its supply came back; the chip answers 1.6 ms later."""
        self.registers = dict(self._stored)
        self._scale = self._scaling()
        self._mode = 0
        self._axes = 0
        self._began_ns = NEVER_NS
        self._taken = 0
        self._timed = (0, 0, 0, 0)
        self._conversion_ns = self._period_ns = 0
        self._was_reset = True
        self._awake_ns = now_ns + POWER_ON_NS
        self._data = bytes(8)

    def awake(self, now_ns: int) -> bool:
        """Whether it answers to its address."""
        return now_ns >= self._awake_ns

    @property
    def conversion_ns(self) -> int:
        """Time of one measurement with its own oscillator (ns)."""
        register = self.registers.get(0x02, 0)
        axes = (self._axes & 0xE).bit_count()
        osr2 = OSR2.get(register) if self._axes & 1 else None
        nominal = conversion_time(OSR.get(register), DIG_FILT.get(register), axes, osr2)
        return round(nominal * self._oscillator * 1e9)

    def stall(self) -> None:
        """Never finish the measurement that runs."""
        self._began_ns = NEVER_NS

    @property
    def configured(self) -> bool:
        """Whether its registers are others than at the factory."""
        return self.registers != self._stored

    @property
    def measuring(self) -> bool:
        """Whether a measurement was begun and not read yet."""
        return self._began_ns < NEVER_NS

    def write(self, data: bytes, now_ns: int) -> None:
        """Take a command; its answer waits to be read."""
        opcode, low = data[0] & 0xF0, data[0] & 0x0F
        body = b''
        fine = True
        if opcode in (Command.START_BURST, Command.START_SINGLE):
            fine = self._start(opcode, low, now_ns)
        elif opcode == Command.READ:
            fine, body = self._read(low, now_ns)
        elif opcode == Command.READ_REGISTER and len(data) == 2:
            fine, body = self._read_register(data[1] >> 2)
        elif opcode == Command.WRITE_REGISTER and len(data) == 4:
            fine = self._write_register(data[3] >> 2, data[1] << 8 | data[2])
        elif opcode == Command.EXIT:
            self._mode, self._began_ns = 0, NEVER_NS
        elif opcode == Command.RESET:
            self.power_up(now_ns)
            return
        elif opcode in (Command.RECALL, Command.STORE):
            fine = self._memory(opcode)
        else:
            # wake-on-change is not simulated; unknown commands are acknowledged and refused
            fine = opcode == Command.NOP
        self._answer = bytes((self._status(fine, len(body)),)) + body

    def read(self, count: int) -> bytes:
        """Bytes of the answer; beyond it the bus floats high."""
        taken, self._answer = self._answer[:count], self._answer[count:]
        return taken.ljust(count, b'\xff')

    def _status(self, fine: bool, count: int) -> int:
        """Status byte; RESET is told once."""
        status = self._mode | (0 if fine else Status.ERROR)
        if self._was_reset:
            status |= Status.RESET
            self._was_reset = False
        return status | max(0, count // 2 - 1)

    def _start(self, opcode: int, axes: int, now_ns: int) -> bool:
        """Start measuring, once or without end; refused while it measures without end."""
        if self._mode & Status.BURST:
            return False
        self._mode = int(Status.SINGLE if opcode == Command.START_SINGLE else Status.BURST)
        self._axes = axes or 0xF
        self._began_ns, self._taken = now_ns, 0
        settings = (self.registers.get(0x01, 0), self.registers.get(0x02, 0), opcode, self._axes)
        if settings != self._timed:
            self._timed = settings
            self._conversion_ns, self._period_ns = self.conversion_ns, self._period()
        return True

    def _read(self, axes: int, now_ns: int) -> tuple[bool, bytes]:
        """Data of the last measurement; refused while it is not ready or was read already."""
        size = 2 * (axes or 0xF).bit_count()
        done = self._done(now_ns)
        if done <= self._taken:
            return False, self._chosen(axes, size)
        self._taken = done
        end_ns = self._began_ns + done * self._period_ns
        self._data = self._convert(end_ns - self._conversion_ns // 2)
        if self._mode & Status.SINGLE:
            self._mode, self._began_ns = 0, NEVER_NS
        return True, self._chosen(axes, size)

    def _period(self) -> int:
        """Time from one measurement to the next (ns)."""
        pause_s = BURST_STEP_S * BURST_DATA_RATE.get(self.registers.get(0x01, 0))
        if not self._mode & Status.BURST:
            pause_s = 0.0
        return max(self.conversion_ns, round(pause_s * 1e9))

    def _done(self, now_ns: int) -> int:
        """Measurements that are finished since the start."""
        if not self.measuring or now_ns < self._began_ns:
            return 0
        count = (now_ns - self._began_ns) // self._period_ns
        return min(count, 1) if self._mode & Status.SINGLE else count

    def _chosen(self, axes: int, size: int) -> bytes:
        """Words of the axes that were asked for, of t, x, y, z."""
        if axes in (0, 0xF):
            return self._data
        words = [self._data[2 * i : 2 * i + 2] for i in range(4) if (axes or 0xF) >> i & 1]
        return b''.join(words)[:size]

    def _convert(self, time_ns: int) -> bytes:
        """Measure: noise, steps, the range that wraps, and the code of the registers."""
        field, temperature_c = self._sample(time_ns)
        zero, lsb, _ = self._scale
        counts = np.empty(4)
        noise = self._rng.standard_normal(4)
        counts[0] = self._stored[TREF_REGISTER] + noise[0]
        counts[0] += (temperature_c - REFERENCE_C) * LSB_PER_DEGREE
        counts[1:] = (field + self._noise * noise[1:]) / lsb
        codes = np.rint(self._distorted(counts))
        codes[1:] += zero
        return (codes.astype(np.int64) & 0xFFFF).astype('>u2').tobytes()

    def _distorted(self, counts: Array) -> Array:
        """Counts of t, x, y, z as they are; a chip that fails changes them."""
        return counts

    @property
    def full_scale(self) -> Array:
        """Counts at which x, y, z wrap, shape (3,)."""
        return self._scale[2]

    def _scaling(self) -> tuple[Array, Array, Array]:
        """Code of zero, step (T) and range of x, y, z by the registers."""
        third = self.registers.get(0x02, 0)
        resolution = RES_X.get(third), RES_Y.get(third), RES_Z.get(third)
        register = self.registers.get(0x00, 0)
        hallconf = 0xC if HALLCONF.get(register) else 0x0
        lsb = tesla_per_lsb(GAIN_SEL.get(register), resolution, hallconf)
        zero = CODE_OF_ZERO[list(resolution)].astype(np.float64)
        if TCMP_EN.get(self.registers.get(0x01, 0)):
            zero = np.full(3, 32768.0)
        return zero, lsb, FULL_SCALE_LSB[list(resolution)].astype(np.float64)

    def _read_register(self, register: int) -> tuple[bool, bytes]:
        """Word of a register; refused in burst mode."""
        word = self.registers.get(register, 0)
        return not self._mode & Status.BURST, word.to_bytes(2, 'big')

    def _write_register(self, register: int, word: int) -> bool:
        """Replace a word; refused in burst mode."""
        if self._mode & Status.BURST:
            return False
        self.registers[register] = word
        self._scale = self._scaling()
        return True

    def _memory(self, opcode: int) -> bool:
        """Store the registers where they survive, or recall them; refused in burst mode."""
        if self._mode & Status.BURST:
            return False
        if opcode == Command.STORE:
            self._stored = dict(self.registers)
        else:
            self.registers = dict(self._stored)
            self._scale = self._scaling()
        return True
