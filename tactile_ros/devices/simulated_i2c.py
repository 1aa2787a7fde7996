# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Simulated I2C buses with MLX90393 chips and switches, for the real driver and its messages."""

from __future__ import annotations

import ctypes
import errno
import os
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.devices import mlx90393 as mlx
from tactile_ros.devices.chip_array import BITS_PER_BYTE, ChipArray, Mode
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings, Command, Status
from tactile_ros.devices.timestamps import Clock, LeadingClock, VirtualClock
from tactile_ros.devices.transport import I2cBus
from tactile_ros.types import Array, Closing, Layout

if TYPE_CHECKING:
    from tactile_ros.devices.transport import I2cMessage

READING = 0x0001  # I2C_M_RD
POWER_ON_NS = 1_600_000
# gain 1x, HALLCONF 0xC, everything else 0 but the offsets' and thermometer's words
FACTORY = {0x00: 0x007C, 0x02: 0x0000, 0x04: 0x0000, 0x05: 0x0000, 0x06: 0x0000}
BURST_STEP_S = 20e-3
NEVER_NS = 1 << 62
SIGNAL_STEP_S = 1e-3
HELD_S = 0.02  # so long the adapter holds a transfer on a stuck bus

BUS_FAULTS = ('stuck_bus', 'unplug')
CHIP_FAULTS = ('nack', 'brown_out', 'stuck_chip', 'saturation', 'wrap', 'stall')
RELIEF = 'none'
UNPLUGGED_NS = 1_000_000_000
SATURATED = 0.995  # of the range
WRAPPED = 1.25
MEASURING = (Command.START_SINGLE, Command.READ)


def _ignore(fault: str) -> None:
    """Count nothing."""


class SimulatedChip:
    """One MLX90393: registers, modes, conversions, status byte and faults.

    `sample` gives flux density (3,) (T) and temperature (degrees Celsius) at a time (ns); `rng`
    draws the noise, of standard deviation `noise` (3,) (T), the thermometer's reference and the
    oscillator, wrong by the share `tolerance` at most. `on_fault` receives the name of each fault
    that happens; `pending` counts those of `CHIP_FAULTS` that wait.
    """

    def __init__(
        self, sample: Callable[[int], tuple[Array, float]], rng: np.random.Generator, noise: Array,
        tolerance: float = 0.03, on_fault: Callable[[str], None] = _ignore,
    ) -> None:  # fmt: skip
        self.pending = dict.fromkeys(CHIP_FAULTS, 0)
        self._sample = sample
        self._rng = rng
        self._noise = noise
        self._on_fault = on_fault
        self._oscillator = 1 + tolerance * float(rng.uniform(-1, 1))
        tref = mlx.TYPICAL_TREF + int(rng.integers(-300, 300))
        self._stored = {**FACTORY, mlx.TREF_REGISTER: tref}
        self._answer = b''
        self.power_up(-POWER_ON_NS)

    def power_up(self, now_ns: int) -> None:
        """Start as after its supply came back; the chip answers 1.6 ms later."""
        self.registers = dict(self._stored)
        self._rescale()
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
        """True while it answers to its address."""
        return now_ns >= self._awake_ns

    def write(self, data: bytes, now_ns: int) -> None:
        """Take a command; its answer waits to be read."""
        opcode, low = data[0] & 0xF0, data[0] & 0x0F
        if opcode in MEASURING and self.registers != self._stored:
            if self._suffers('brown_out'):
                self.power_up(now_ns - POWER_ON_NS)
            elif self._began_ns < NEVER_NS and self._suffers('stall'):
                self._began_ns = NEVER_NS
        fine, body = True, b''
        if opcode in mlx.STARTS:
            fine = self._start(opcode, low, now_ns)
        elif opcode == Command.READ:
            fine, body = self._read(low, now_ns)
        elif opcode == Command.EXIT:
            self._mode, self._began_ns = 0, NEVER_NS
        elif opcode == Command.RESET:
            self.power_up(now_ns)
            return
        else:
            fine, body = self._access(opcode, data)
        status = self._mode | (0 if fine else Status.ERROR) | max(0, len(body) // 2 - 1)
        if self._was_reset:  # said once
            status |= Status.RESET
            self._was_reset = False
        self._answer = bytes((status,)) + body

    def read(self, count: int) -> bytes:
        """Bytes of the answer; beyond it the bus floats high."""
        taken, self._answer = self._answer[:count], self._answer[count:]
        return taken.ljust(count, b'\xff')

    def _suffers(self, fault: str) -> bool:
        """True where a fault befalls it now; it is counted then."""
        if not self.pending[fault]:
            return False
        self.pending[fault] -= 1
        self._on_fault(fault)
        return True

    def _access(self, opcode: int, data: bytes) -> tuple[bool, bytes]:
        """Registers, refused in burst mode; wake-on-change and memory are refused always."""
        free = not self._mode & Status.BURST
        if opcode == Command.READ_REGISTER and len(data) == 2:
            return free, self.registers.get(data[1] >> 2, 0).to_bytes(2, 'big')
        if opcode == Command.WRITE_REGISTER and len(data) == 4:
            if free:
                self.registers[data[3] >> 2] = data[1] << 8 | data[2]
                self._rescale()
            return free, b''
        return opcode == Command.NOP, b''

    def _start(self, opcode: int, axes: int, now_ns: int) -> bool:
        """Start measuring, once or without end; refused while it measures without end."""
        if self._mode & Status.BURST:
            return False
        self._mode = int(Status.SINGLE if opcode == Command.START_SINGLE else Status.BURST)
        self._axes = axes or 0xF
        self._began_ns, self._taken = now_ns, 0
        second, third = self.registers.get(0x01, 0), self.registers.get(0x02, 0)
        settings = (second, third, opcode, self._axes)
        if settings != self._timed:
            self._timed = settings
            osr2 = mlx.OSR2.get(third) if self._axes & 1 else None
            magnetic = (self._axes & 0xE).bit_count()
            osr, filtering = mlx.OSR.get(third), mlx.DIG_FILT.get(third)
            nominal_s = mlx.conversion_time(osr, filtering, magnetic, osr2)
            self._conversion_ns = round(nominal_s * self._oscillator * 1e9)
            pause_s = BURST_STEP_S * mlx.BURST_DATA_RATE.get(second)
            pause_ns = round(pause_s * 1e9) if self._mode & Status.BURST else 0
            self._period_ns = max(self._conversion_ns, pause_ns)
        return True

    def _read(self, axes: int, now_ns: int) -> tuple[bool, bytes]:
        """Data of the last measurement; refused while it is not ready or was read already."""
        done = 0
        if self._began_ns <= now_ns:
            done = (now_ns - self._began_ns) // self._period_ns
            done = min(done, 1) if self._mode & Status.SINGLE else done
        fresh = done > self._taken
        if fresh:
            self._taken = done
            end_ns = self._began_ns + done * self._period_ns
            if not self._suffers('stuck_chip'):
                self._data = self._convert(end_ns - self._conversion_ns // 2)
            if self._mode & Status.SINGLE:
                self._mode, self._began_ns = 0, NEVER_NS
        words = [self._data[2 * i : 2 * i + 2] for i in range(4) if (axes or 0xF) >> i & 1]
        return fresh, b''.join(words)

    def _convert(self, time_ns: int) -> bytes:
        """Measure t, x, y, z: noise, steps, the range that wraps, the code of the registers."""
        field, temperature_c = self._sample(time_ns)
        noise = self._rng.standard_normal(4)
        counts = np.empty(4)
        counts[0] = self._stored[mlx.TREF_REGISTER] + noise[0]
        counts[0] += (temperature_c - mlx.REFERENCE_C) * mlx.LSB_PER_DEGREE
        counts[1:] = (field + self._noise * noise[1:]) / self._lsb
        if self._suffers('saturation'):
            counts[1] = SATURATED * self._full_scale[0]
        elif self._suffers('wrap'):
            counts[1] += WRAPPED * self._full_scale[0]
        codes = np.rint(counts)
        codes[1:] += self._zero
        return (codes.astype(np.int64) & 0xFFFF).astype('>u2').tobytes()

    def _rescale(self) -> None:
        """Code of zero, step (T) and range (counts) of x, y, z by the registers."""
        third = self.registers.get(0x02, 0)
        resolution = mlx.RES_X.get(third), mlx.RES_Y.get(third), mlx.RES_Z.get(third)
        register = self.registers.get(0x00, 0)
        hallconf = 0xC if mlx.HALLCONF.get(register) else 0x0
        self._lsb = mlx.tesla_per_lsb(mlx.GAIN_SEL.get(register), resolution, hallconf)
        self._zero = mlx.CODE_OF_ZERO[list(resolution)].astype(np.float64)
        self._full_scale = mlx.FULL_SCALE_LSB[list(resolution)].astype(np.float64)


class SimulatedI2cBus:
    """A bus that stands in for `smbus2.SMBus`: `i2c_rdwr` on real messages.

    `clock` passes while bytes are on the wire, of a bus of `hertz` (Hz), with all `chips` and
    their switches (TCA9548A). `on_transfer` is called before each transfer, `on_fault` with the
    name of each fault.

    Notes
    -----
    Every byte takes 9 clocks, start, repeated start and stop one each. Chips with one address
    answer together and spoil each other's bits, as on wires.
    """

    def __init__(
        self, clock: Clock, chips: Mapping[ChipPlace, SimulatedChip], hertz: float = 400e3,
        on_transfer: Callable[[], None] = lambda: None,
        on_fault: Callable[[str], None] = _ignore,
    ) -> None:  # fmt: skip
        self._clock = clock
        self._chips = dict(chips)
        self._at: dict[int, list[tuple[ChipPlace, SimulatedChip]]] = {}
        for place, chip in chips.items():
            self._at.setdefault(place.address, []).append((place, chip))
        self._open = {p.mux: 0 for p in chips if p.mux is not None}  # channels, a bit each
        self._bit_s = 1 / hertz
        self._on_transfer = on_transfer
        self._on_fault = on_fault
        self.stuck = 0  # transfers that will find the bus stuck
        self.silent: dict[ChipPlace, int] = {}  # transfers that will not be acknowledged
        self.gone_until_ns = 0  # the adapter is unplugged until then
        self.busy_s = 0.0  # bytes were on the wire

    def close(self) -> None:
        """Let go; nothing is held."""

    def power_down(self, now_ns: int) -> None:
        """Take the supply of everything away and give it back."""
        self._open = dict.fromkeys(self._open, 0)
        for chip in self._chips.values():
            chip.power_up(now_ns)

    def i2c_rdwr(self, *messages: I2cMessage) -> None:
        """Carry messages in one transaction.

        OSError: ENODEV unplugged, ETIMEDOUT stuck, EREMOTEIO not acknowledged.
        """
        self._on_transfer()
        now_ns = self._clock.now_ns()
        if now_ns < self.gone_until_ns:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        if self.stuck:
            self.stuck -= 1
            self._on_fault('stuck_bus')
            self._clock.sleep(HELD_S)
            raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))
        bits = 1
        try:
            for message in messages:
                bits += 1 + BITS_PER_BYTE
                listeners = self._listeners(message.addr, now_ns + round(bits * self._bit_s * 1e9))
                if not listeners and message.addr not in self._open:
                    raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
                bits += BITS_PER_BYTE * message.len
                self._carry(message, listeners, now_ns + round(bits * self._bit_s * 1e9))
        finally:
            self.busy_s += bits * self._bit_s
            self._clock.sleep(bits * self._bit_s)

    def _listeners(self, address: int, now_ns: int) -> list[SimulatedChip]:
        """Chips that acknowledge an address now."""
        listeners: list[SimulatedChip] = []
        for place, chip in self._at.get(address, ()):
            mux, channel = place.mux, place.channel
            if mux is not None and channel is not None and not self._open[mux] >> channel & 1:
                continue
            if self.silent.get(place, 0):
                self.silent[place] -= 1
                self._on_fault('nack')
            elif chip.awake(now_ns):
                listeners.append(chip)
        return listeners

    def _carry(self, message: I2cMessage, listeners: list[SimulatedChip], now_ns: int) -> None:
        """Carry one message between the master and all that listen."""
        mux, data = self._open.get(message.addr), bytes(message)
        if not message.flags & READING:
            if mux is not None and data:
                self._open[message.addr] = data[-1]
            for chip in listeners:
                chip.write(data, now_ns)
            return
        answers = [chip.read(message.len) for chip in listeners]
        answers += [] if mux is None else [bytes((mux,)) * message.len]
        wires = np.bitwise_and.reduce([np.frombuffer(answer, np.uint8) for answer in answers])
        ctypes.memmove(message.buf, wires.tobytes(), message.len)


class ChipArrayTwin(Closing):
    """A twin of chips on buses that the real driver reads through the real messages of smbus2.

    Parameters
    ----------
    places, layout, settings, mode, rate_hz
        Of the driver, see `ChipArray`.
    signal, temperature_c : callable, callable or None
        Time since the start (s) -> flux density in chip axes (t, 3) (T); chip temperatures (t,)
        (degrees Celsius), None: 25. Asked for once a ms, for all chips.
    noise : float or array_like, shape (3,)
        Standard deviation of a reading (T).
    tolerance, hertz : float
        Largest share by which the chips' oscillators are wrong; clock of the buses (Hz).
    clock : Clock or None
        Of bus and chips; None: the machine's.
    seed : int
        Of noise, oscillators, references and of which chip suffers a fault.

    Notes
    -----
    Faults are counted in `injected` as they happen. nack: transfers that a chip does not
    acknowledge; stuck_bus: transfers; unplug: the adapter is gone for 1 s, and the chips lose
    their supply; brown_out: a chip resets before its next command; stuck_chip, saturation, wrap,
    stall: measurements that repeat the one before, lie at the end of the range or beyond it on x,
    or never end.
    """

    faults = BUS_FAULTS + CHIP_FAULTS
    unseen: tuple[str, ...] = ()

    def __init__(
        self, places: Sequence[ChipPlace], layout: Layout, signal: Callable[[float], Array],
        temperature_c: Callable[[float], Array] | None = None,
        settings: ChipSettings | None = None, mode: Mode = 'single', rate_hz: float | None = None,
        noise: npt.ArrayLike = 5e-6, tolerance: float = 0.03, hertz: float = 400e3,
        clock: Clock | None = None, seed: int = 0,
    ) -> None:  # fmt: skip
        self.injected = dict.fromkeys(self.faults, 0)
        virtual = isinstance(clock, VirtualClock)
        self._clock: Clock = LeadingClock(clock or Clock(), 0.0 if virtual else 1e-3)
        self._start_ns = self._clock.now_ns()
        self._places = list(places)
        self._signal = signal
        self._temperature_c = temperature_c
        self._driver = partial(
            ChipArray, places=places, layout=layout, settings=settings, mode=mode,
            rate_hz=rate_hz, clock=self._clock, bus_hz=hertz,
        )  # fmt: skip
        self._waiting: deque[tuple[str, int, int]] = deque()
        self._held: tuple[int, Array, Array] | None = None
        self._rng = np.random.default_rng(seed)
        spread = np.broadcast_to(np.asarray(noise, np.float64), (3,))
        self._chips = [
            SimulatedChip(
                lambda time_ns, i=i: self._sample(i, time_ns),  # type: ignore[misc]
                np.random.default_rng((seed, i)), spread, tolerance, self._count,
            )
            for i in range(len(self._places))
        ]  # fmt: skip
        on_bus = list(zip(self._places, self._chips, strict=True))
        self.buses = [
            SimulatedI2cBus(
                self._clock,
                {place: chip for place, chip in on_bus if place.bus == number},
                hertz, on_transfer=self._hand_out, on_fault=self._count,
            )
            for number in range(1 + max(place.bus for place in self._places))
        ]  # fmt: skip

    def device(self, clock_ns: Callable[[], int]) -> ChipArray:
        """The real driver on this twin's buses, stamped by `clock_ns`; not yet entered."""
        buses = [I2cBus(f'simulated-{i}', smbus=bus) for i, bus in enumerate(self.buses)]
        return self._driver(buses, clock_ns=clock_ns)

    def open(self) -> None:
        """Begin: the signal's time is 0 now."""
        self._start_ns = self._clock.now_ns()

    def close(self) -> None:
        """End; nothing is held."""

    def inject(self, fault: str, count: int = 1, chip: int | None = None) -> None:
        """Let the next `count` transfers or measurements suffer a fault; from any thread.

        `chip` suffers, or its bus; None: one by chance. An unknown fault or chip is a ValueError.
        """
        if fault not in self.faults:
            msg = f'fault must be one of {", ".join(self.faults)}; received {fault!r}'
            raise ValueError(msg)
        victim = int(self._rng.integers(len(self._chips))) if chip is None else chip
        if not 0 <= victim < len(self._chips):
            msg = f'chip must be 0 to {len(self._chips) - 1}; received {chip}'
            raise ValueError(msg)
        self._waiting.append((fault, count, victim))

    def relieve(self) -> None:
        """Withdraw the faults that wait, at the next transfer; an unplugging takes its course."""
        self._waiting.append((RELIEF, 0, 0))

    def _count(self, fault: str) -> None:
        self.injected[fault] += 1

    def _hand_out(self) -> None:
        """Hand out the faults that wait, in the thread that reads."""
        while self._waiting:
            fault, count, victim = self._waiting.popleft()
            place, chip = self._places[victim], self._chips[victim]
            bus = self.buses[place.bus]
            if fault == RELIEF:
                for one in self.buses:
                    one.stuck = 0
                    one.silent.clear()
                for other in self._chips:
                    other.pending = dict.fromkeys(CHIP_FAULTS, 0)
            elif fault == 'stuck_bus':
                bus.stuck += count
            elif fault == 'unplug':
                now_ns = self._clock.now_ns()
                bus.gone_until_ns = max(now_ns, bus.gone_until_ns) + count * UNPLUGGED_NS
                bus.power_down(bus.gone_until_ns)
                self.injected['unplug'] += count
            elif fault == 'nack':
                bus.silent[place] = bus.silent.get(place, 0) + count
            else:
                chip.pending[fault] += count

    def _sample(self, chip: int, time_ns: int) -> tuple[Array, float]:
        """Flux density, shape (3,) (T), and temperature (degrees Celsius) at a chip."""
        step = round((time_ns - self._start_ns) * 1e-9 / SIGNAL_STEP_S)
        if self._held is None or self._held[0] != step:
            t = step * SIGNAL_STEP_S
            field = np.asarray(self._signal(t), np.float64)
            temperature = np.full(len(self._chips), 25.0)
            if self._temperature_c is not None:
                temperature[:] = self._temperature_c(t)
            self._held = step, field, temperature
        _, field, temperature = self._held
        return field[chip], float(temperature[chip])
