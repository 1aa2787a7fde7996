"""Temperature of pixels and magnet: sensitivity, the baseline's own, and what lags behind.

[3]: the Hall sensitivity follows p0 + p1 dT + p2 dT^2 of the chip's temperature. The baseline was
read at another temperature, which nothing reports: it is told by how much stronger the disc at
rest was then than in the fit. Gap, stiffness and remanence follow the magnet, whose temperature
follows the chip's with a delay: a slow state, of the config's time constant or of the one with
which the disc's model explains a recording best.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.conditioning.history import SECONDS_PER_NS, History
from tactile_ros.physics.temperature import hall_sensitivity
from tactile_ros.signals import Signals
from tactile_ros.types import Array, Bools

LAGS = (4.0, 12.0, 36.0, 108.0)  # s: tried, where the config leaves it open
LONG = 2.0  # lags that a stream lasts
WEAKEST, STRONGEST = 0.7, 1.4
LEAST_RANGE = 3.0  # degrees
SAME = 1.0  # degrees between two frames of one stream
FOLLOWED = (-25.0, 95.0)  # degrees Celsius, beyond which the sensitivity's polynomial stands still
UNIT = 25.0  # degrees
FEWEST_SCATTERED = 50  # rows that tell the thermometer's noise
KINKED = 7.0  # medians of third differences: of an oven that begins to heat
THIRD = 20.0  # variance of third differences of noise of 1


class ThermalMemory:
    """Temperature of the disc in one stream: a first-order lag behind the chip's.

    Parameters
    ----------
    lag : float
        Time constant (s); 0: the disc is as warm as the chip.
    """

    def __init__(self, lag: float) -> None:
        self.history = History(np.array([lag])) if lag > 0 else None
        self.first: Array | None = None
        self.last: tuple[int, float] | None = None
        self.since_ns = 0

    def begins(self, signals: Signals, chip: Array) -> Bools:
        """Rows (s,) before which a new stream begins; a new baseline alone changes no warmth."""
        assert signals.stamp_ns is not None
        assert self.history is not None
        stamp_ns, last_chip = self.last or (int(signals.stamp_ns[0]), float(chip[0]))
        gap = SECONDS_PER_NS * np.diff(signals.stamp_ns, prepend=stamp_ns)
        soon = (gap > 0) & (gap < float(self.history.time_constants[0]))
        same = np.abs(np.diff(chip, prepend=last_chip)) < SAME
        begins: Bools = signals.restart & ~(soon & same)
        begins[0] |= self.first is None
        self.last = int(signals.stamp_ns[-1]), float(chip[-1])
        return begins


def chip_temperature(signals: Signals) -> Array | None:
    """Mean temperature of the chips, shape (s,) (degrees Celsius); NaN unknown; None: no row."""
    if signals.temperature_c is None:
        return None
    chips = signals.temperature_c
    known = np.isfinite(chips)
    if np.count_nonzero(known) == known.size > 0:  # as usual
        return np.asarray(np.add.reduce(chips, axis=1) / chips.shape[1])
    count = known.sum(axis=1)
    total = np.where(known, chips, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def sensitivity(temperature_c: Array, coefficients: Array) -> Array:
    """Hall sensitivity at temperatures, of any shape; 1 where it is unknown."""
    return hall_sensitivity(temperature_c, coefficients, FOLLOWED)


def lagging(signals: Signals, chip: Array, usual: float, memory: ThermalMemory) -> Array:
    """Temperature of the disc and what the thermometer's noise leaves of itself in it.

    Parameters
    ----------
    signals : Signals
        Conditioned frames.
    chip : ndarray, shape (s,)
        Temperature of the chip; NaN: the usual one.
    usual : float
        Of the fit (degrees Celsius).
    memory : ThermalMemory
        Of the stream, which begins in equilibrium; moves on.

    Returns
    -------
    ndarray, shape (s, 2)
        Temperature from the usual one over 25 degrees; standard deviation of its error over that
        of the thermometer's noise (1).
    """
    chip = np.where(np.isfinite(chip), chip, usual)
    warm = (chip - usual)[:, None] / UNIT
    if signals.stamp_ns is None or memory.history is None or not len(chip):
        return np.concatenate([warm, np.ones_like(warm)], axis=1)
    stamps, before = signals.stamp_ns, memory.last
    begins = memory.begins(signals, chip)
    start = np.maximum.accumulate(np.where(begins, np.arange(len(chip)), -1))
    earlier = chip[:1] if memory.first is None else memory.first
    first = np.where(start >= 0, chip[np.maximum(start, 0)], earlier[0])
    since = np.where(start >= 0, stamps[np.maximum(start, 0)], memory.since_ns)
    rise = (chip - first)[:, None]
    if len(chip) == 1:
        if begins[0]:
            memory.history.reset()
        means = memory.history.step(rise[0], int(stamps[0]))[None]
    else:
        means = memory.history(rise, stamps, begins)
    memory.first, memory.since_ns = first[-1:], int(since[-1])
    rate = SECONDS_PER_NS / float(memory.history.time_constants[0])
    steps = rate * np.diff(stamps, prepend=stamps[0] if before is None else before[0])
    doubt = _remaining(np.asarray(rate * (stamps - since)), np.maximum(steps, 0.0))
    return np.column_stack([warm[:, 0] - (rise - means[:, 0])[:, 0] / UNIT, doubt])


def _remaining(age: Array, step: Array) -> Array:
    """Deviation of a fading mean of noise of 1, begun at noise of 1, `age` time constants ago."""
    steady = np.tanh(0.5 * step)
    return np.asarray(np.sqrt(steady + (1 - steady) * np.exp(-2 * age)))


def thermometer_noise(signals: Signals, chip: Array) -> float:
    """Noise of the chip's thermometer (degrees), told by how it scatters in a stream; 0: unknown.

    Third differences leave what changes slowly aside, and those of a kink are left out.
    """
    if signals.stamp_ns is None or len(chip) < FEWEST_SCATTERED:
        return 0.0
    inside = ~(signals.restart[3:] | signals.restart[2:-1] | signals.restart[1:-2])
    third = np.diff(chip, 3)[inside]
    third = np.abs(third[np.isfinite(third)])
    if len(third) < FEWEST_SCATTERED:
        return 0.0
    usual = float(np.median(third))
    if usual > 0:  # not so where it counts in steps wider than its noise
        third = third[third < KINKED * usual]
    return float(np.sqrt((third**2).mean() / THIRD))


def lags_told(signals: Signals) -> Array:
    """Time constants (m,) (s) of which streams are long enough to tell them from an offset."""
    if signals.stamp_ns is None or not len(signals.stamp_ns):
        return np.zeros(0)
    stream = np.cumsum(signals.restart)
    stamps = 1e-9 * (signals.stamp_ns - signals.stamp_ns[0])
    longest = max(float(np.ptp(stamps[stream == name])) for name in np.unique(stream))
    return np.array([lag for lag in LAGS if LONG * lag <= longest])


def beyond(signals: Signals, span: Array) -> Array:
    """Degrees (s,) by which chips are warmer or colder than in the fit, of span (2,).

    A chip that tells no temperature may be as far from the usual one as those of the fit were.
    """
    if not np.isfinite(span).all():
        return np.zeros(len(signals.good))
    half = 0.5 * float(span[1] - span[0])
    unknown = half if half > LEAST_RANGE else 0.0
    chip = chip_temperature(signals)
    if chip is None:
        return np.full(len(signals.good), unknown)
    farther = np.maximum(span[0] - chip, chip - span[1]) - LEAST_RANGE
    return np.asarray(np.where(np.isnan(chip), unknown, np.maximum(farther, 0.0)))
