"""Simulated twin of an array of MLX90393: buses, switches, chips and what can befall them."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.chip_array import ChipArray, Mode
from tactile_ros.devices.clock import Clock, LeadingClock, SystemClock, VirtualClock
from tactile_ros.devices.mlx90393 import Command
from tactile_ros.devices.simulated_chip import POWER_ON_NS, SimulatedChip
from tactile_ros.devices.simulated_i2c import SimulatedI2cBus
from tactile_ros.devices.transport import I2cBus
from tactile_ros.types import Array, Layout

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import TracebackType

    from tactile_ros.devices.mlx90393 import ChipSettings
    from tactile_ros.devices.mux import ChipPlace

BUS_FAULTS = ('stuck_bus', 'unplug')
RELIEF = 'none'
CHIP_FAULTS = ('nack', 'brown_out', 'stuck_chip', 'saturation', 'wrap', 'stall')
UNPLUGGED_NS = 1_000_000_000
SATURATED = 0.995
WRAPPED = 1.25
MEASURING = (Command.START_SINGLE, Command.READ)


class ChipArrayTwin:
    """A twin that the real driver reads through the real messages of smbus2.

    Parameters
    ----------
    places : sequence of ChipPlace
        Where the chips are.
    layout : Layout
        Of the sensor.
    signal : callable
        Time since the start (s) -> flux density in chip axes, shape (t, 3) (T).
    temperature_c : callable or None
        Time (s) -> chip temperatures, shape (t,) (degrees Celsius); None: 25.
    settings, mode, rate_hz
        Of the driver, see `ChipArray`.
    noise : float or array_like, shape (3,)
        Standard deviation of a reading (T).
    tolerance : float
        Largest share by which the chips' oscillators are wrong.
    hertz : float
        Clock of the buses (Hz).
    signal_step_s : float
        The signal is asked for at multiples of this (s), once for all chips.
    clock : Clock or None
        What bus and chips run on; None: the machine's.
    seed : int
        Of noise, oscillators, references and of which chip suffers a fault.

    Attributes
    ----------
    injected : dict
        How often each fault has happened.
    buses : list of SimulatedI2cBus
        The buses.

    Notes
    -----
    Faults are counted as they happen. nack: transfers that a chip does not acknowledge; stuck_bus:
    transfers; unplug: the adapter is gone for 1 s, and the chips lose their supply; brown_out: a
    chip resets before its next command; stuck_chip, saturation, wrap, stall: measurements that
    repeat the one before, lie at the end of the range or beyond it on x, or never end.
    """

    faults = BUS_FAULTS + CHIP_FAULTS

    def __init__(
        self,
        places: Sequence[ChipPlace],
        layout: Layout,
        signal: Callable[[float], Array],
        temperature_c: Callable[[float], Array] | None = None,
        settings: ChipSettings | None = None,
        mode: Mode = 'single',
        rate_hz: float | None = None,
        noise: npt.ArrayLike = 5e-6,
        tolerance: float = 0.03,
        hertz: float = 400e3,
        signal_step_s: float = 1e-3,
        clock: Clock | None = None,
        seed: int = 0,
    ) -> None:
        """See the class."""
        self.injected = dict.fromkeys(self.faults, 0)
        virtual = isinstance(clock, VirtualClock)
        self._clock: Clock = LeadingClock(clock or SystemClock(), 0.0 if virtual else 1e-3)
        self._start_ns = self._clock.now_ns()
        self._places = list(places)
        self._layout = layout
        self._signal = signal
        self._temperature_c = temperature_c
        self._settings = settings
        self._mode: Mode = mode
        self._rate_hz = rate_hz
        self._hertz = hertz
        self._step_s = signal_step_s
        self._waiting: deque[tuple[str, int, int]] = deque()
        self._held: tuple[int, Array, Array] | None = None
        self._rng = np.random.default_rng(seed)
        spread = np.broadcast_to(np.asarray(noise, np.float64), (3,))
        self._chips = [
            SuffererChip(self, i, np.random.default_rng((seed, i)), spread, tolerance)
            for i in range(len(self._places))
        ]
        count = 1 + max(place.bus for place in self._places)
        self.buses = [self._bus(number, hertz) for number in range(count)]

    def _bus(self, number: int, hertz: float) -> SimulatedI2cBus:
        """One bus with its chips."""
        chips = {
            place: chip
            for place, chip in zip(self._places, self._chips, strict=True)
            if place.bus == number
        }
        return SimulatedI2cBus(
            self._clock, chips, hertz, on_transfer=self._befall, on_fault=self.count
        )

    def device(self, clock_ns: Callable[[], int]) -> ChipArray:
        """The real driver on this twin's buses, stamped by `clock_ns`; not yet entered."""
        buses = [I2cBus(f'simulated-{i}', smbus=bus) for i, bus in enumerate(self.buses)]
        return ChipArray(
            buses,
            self._places,
            self._layout,
            self._settings,
            self._mode,
            self._rate_hz,
            bus_hz=self._hertz,
            clock_ns=clock_ns,
            monotonic_ns=self._clock.now_ns,
            sleep=self._clock.sleep,
        )

    def __enter__(self) -> ChipArrayTwin:
        """Begin: the signal's time is 0 now."""
        self._start_ns = self._clock.now_ns()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End; nothing is held."""

    def count(self, fault: str) -> None:
        """Note that a fault has happened."""
        self.injected[fault] += 1

    def inject(self, fault: str, count: int = 1, chip: int | None = None) -> None:
        """Let the next `count` transfers or measurements suffer a fault; from any thread.

        Parameters
        ----------
        fault : str
            One of `faults`.
        count : int
            How many.
        chip : int or None
            Which suffers, or whose bus; None: one by chance.

        Raises
        ------
        ValueError
            If the fault or the chip is unknown.
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

    def _befall(self) -> None:
        """Hand out the faults that wait, in the thread that reads."""
        while self._waiting:
            fault, count, victim = self._waiting.popleft()
            if fault == RELIEF:
                self._withdraw()
                continue
            place = self._places[victim]
            bus = self.buses[place.bus]
            if fault == 'stuck_bus':
                bus.stuck += count
            elif fault == 'unplug':
                self._unplug(bus, count)
            elif fault == 'nack':
                bus.silent[place] = bus.silent.get(place, 0) + count
            else:
                self._chips[victim].pending[fault] += count

    def _withdraw(self) -> None:
        """Forget what was handed out and has not happened."""
        for bus in self.buses:
            bus.stuck = 0
            bus.silent.clear()
        for chip in self._chips:
            chip.pending = dict.fromkeys(CHIP_FAULTS, 0)

    def _unplug(self, bus: SimulatedI2cBus, count: int) -> None:
        """Take the adapter away for a second each, and the supply with it."""
        now_ns = self._clock.now_ns()
        bus.gone_until_ns = max(now_ns, bus.gone_until_ns) + count * UNPLUGGED_NS
        bus.power_down(bus.gone_until_ns)
        self.injected['unplug'] += count

    def sample(self, chip: int, time_ns: int) -> tuple[Array, float]:
        """Flux density, shape (3,) (T), and temperature (degrees Celsius) at a chip."""
        step = round((time_ns - self._start_ns) * 1e-9 / self._step_s)
        if self._held is None or self._held[0] != step:
            t = step * self._step_s
            field = np.asarray(self._signal(t), np.float64)
            warmth = np.full(len(self._chips), 25.0)
            if self._temperature_c is not None:
                warmth[:] = self._temperature_c(t)
            self._held = step, field, warmth
        _, field, warmth = self._held
        return field[chip], float(warmth[chip])


class SuffererChip(SimulatedChip):
    """A simulated chip whose measurements and supply can fail.

    Attributes
    ----------
    pending : dict
        Faults that wait for its next commands, by name.
    """

    def __init__(
        self,
        twin: ChipArrayTwin,
        number: int,
        rng: np.random.Generator,
        noise: Array,
        tolerance: float,
    ) -> None:
        """See the class."""
        self.pending = dict.fromkeys(CHIP_FAULTS, 0)
        self._twin = twin
        super().__init__(lambda time_ns: twin.sample(number, time_ns), rng, noise, tolerance)

    def _suffers(self, fault: str) -> bool:
        """Whether a fault befalls it now; it is counted then."""
        if not self.pending[fault]:
            return False
        self.pending[fault] -= 1
        self._twin.count(fault)
        return True

    def write(self, data: bytes, now_ns: int) -> None:
        """Take a command, after the supply failed where it has to."""
        running = self.configured and data[0] & 0xF0 in MEASURING
        if running and self._suffers('brown_out'):
            self.power_up(now_ns - POWER_ON_NS)
        if running and self.measuring and self._suffers('stall'):
            self.stall()
        super().write(data, now_ns)

    def _convert(self, time_ns: int) -> bytes:
        """Measure, or repeat what was measured last."""
        if self._suffers('stuck_chip'):
            return self._data
        return super()._convert(time_ns)

    def _distorted(self, counts: Array) -> Array:
        """Counts of t, x, y, z with x at the end of the range or beyond it."""
        if self._suffers('saturation'):
            counts[1] = SATURATED * self.full_scale[0]
        elif self._suffers('wrap'):
            counts[1] += WRAPPED * self.full_scale[0]
        return counts
