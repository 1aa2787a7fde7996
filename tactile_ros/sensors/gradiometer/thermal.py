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
from tactile_ros.sensors.gradiometer.untold import told_ago
from tactile_ros.types import Array, Bools, Integers, Signals

LAGS = (4.0, 12.0, 36.0, 108.0)  # s: tried, where the config leaves it open
ANY_LAG = float(np.sqrt(np.mean(np.square(LAGS))))  # s: any of them, where nothing tells which
LONG = 2.0  # lags that a stream lasts
WEAKEST, STRONGEST = 0.7, 1.4
LEAST_RANGE = 3.0  # degrees
SAME = 1.0  # degrees between two frames of one stream
FOLLOWED = (-25.0, 95.0)  # degrees Celsius, beyond which the sensitivity's polynomial stands still
UNIT = 25.0  # degrees
FEWEST_SCATTERED = 50  # rows that tell the thermometer's noise
KINKED = 7.0  # medians of third differences: of an oven that begins to heat
BOW = 2 / 3  # mean of a bow over its height
THIRD = 20.0  # variance of third differences of noise of 1


class ThermalMemory:
    """Temperature of the disc in one stream: a first-order lag behind the chip's.

    It follows what the chip told: frames without a temperature lie on the line between those
    with one.

    Parameters
    ----------
    lag : float
        Time constant (s); 0: the disc is as warm as the chip.
    wander : ndarray, shape (3, m), or None
        Of `wandering`; None: temperatures never leave those lines.
    """

    def __init__(self, lag: float, wander: Array | None = None) -> None:
        self.history = History(np.array([lag])) if lag > 0 else None
        self.wander = np.zeros((3, 1)) if wander is None else wander
        self.first: Array | None = None
        self.last: tuple[int, float] | None = None
        self.since_ns = 0
        self.state = np.array([0.0, 1.0, 0.0])  # of the last frame with a temperature
        self.skipped, self.restarts = False, False  # since that frame
        self.amiss, self.amiss_ns = 0.0, 0

    @property
    def usually_behind(self) -> float:
        """How far chips go in a time constant (degrees): the disc, where no time is told."""
        lag = 0.0 if self.history is None else float(self.history.time_constants[0])
        return float(np.interp(lag, self.wander[0], self.wander[1]))

    def follow(self, stamps: Integers, restart: Bools, skipped: Bools, chip: Array) -> Array:
        """How far the disc is behind (s,), and the doubts of `lagging`, of frames with both."""
        assert self.history is not None
        rate = SECONDS_PER_NS / float(self.history.time_constants[0])
        before = stamps[0] if self.last is None else self.last[0]
        steps = np.maximum(rate * np.diff(stamps, prepend=before), 0.0)
        begins = self._begins(stamps, restart, skipped, chip)
        start = np.maximum.accumulate(np.where(begins, np.arange(len(chip)), -1))
        earlier = chip[:1] if self.first is None else self.first
        first = np.where(start >= 0, chip[np.maximum(start, 0)], earlier[0])
        since = np.where(start >= 0, stamps[np.maximum(start, 0)], self.since_ns)
        rise = (chip - first)[:, None]
        if len(chip) == 1:
            if begins[0]:
                self.history.reset()
            means = self.history.step(rise[0], int(stamps[0]))[None]
        else:
            means = self.history(rise, stamps, begins)
        self.first, self.since_ns = first[-1:], int(since[-1])
        doubt = _remaining(np.asarray(rate * (stamps - since)), steps)
        amiss = self._amiss(stamps, begins, skipped, steps)
        told = np.stack([(rise - means[:, 0])[:, 0], doubt, amiss], axis=1)
        self.state = told[-1]
        return told

    def _begins(self, stamps: Integers, restart: Bools, skipped: Bools, chip: Array) -> Bools:
        """Rows (s,) before which a new stream begins; a new baseline alone changes no warmth."""
        assert self.history is not None
        stamp_ns, last_chip = self.last or (int(stamps[0]), float(chip[0]))
        gap = SECONDS_PER_NS * np.diff(stamps, prepend=stamp_ns)
        soon = (gap > 0) & (skipped | (gap < float(self.history.time_constants[0])))
        alike: float | Array = SAME
        if np.count_nonzero(skipped):
            alike = SAME + skipped * 2 * np.interp(gap, self.wander[0], self.wander[1])
        same = np.abs(np.diff(chip, prepend=last_chip)) < alike
        begins: Bools = restart & ~(soon & same)
        begins[0] |= self.first is None
        self.last = int(stamps[-1]), float(chip[-1])
        return begins

    def _amiss(self, stamps: Integers, begins: Bools, skipped: Bools, steps: Array) -> Array:
        """Error (s,) (degrees) of the disc by temperatures that nobody told before these."""
        left = np.zeros(len(stamps))
        if self.amiss == 0 and not np.count_nonzero(skipped):
            return left
        assert self.history is not None
        lag, row = float(self.history.time_constants[0]), 0
        for event in (*np.flatnonzero(begins | skipped), len(stamps)):
            part = slice(row, min(event + 1, len(stamps)))
            since = np.maximum(SECONDS_PER_NS * (stamps[part] - self.amiss_ns), 0.0)
            left[part] = self.amiss * np.exp(-2 * since / lag)
            if event == len(stamps):
                break
            bow = BOW * np.interp(lag * steps[event], self.wander[0], self.wander[2])
            more = (bow * -np.expm1(-steps[event])) ** 2
            left[event] = 0.0 if begins[event] else left[event] + more
            self.amiss, self.amiss_ns, row = float(left[event]), int(stamps[event]), event
        return np.sqrt(left)


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


def lagging(
    signals: Signals, chip: Array, usual: float, memory: ThermalMemory, unsure: Array | None = None
) -> Array:
    """Temperature of the disc, and what the thermometer leaves of its errors in it.

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
    unsure : ndarray, shape (s,), or None
        What temperatures that are not told now are wrong by (degrees); None: all are told.

    Returns
    -------
    ndarray, shape (s, 3)
        Temperature from the usual one over 25 degrees; standard deviation of its error over that
        of the thermometer's noise (1), and by temperatures that were not told (degrees).
    """
    age = np.where(np.isfinite(chip), told_ago(signals), np.inf)
    chip = np.where(np.isfinite(chip), chip, usual)
    warm, own = (chip - usual) / UNIT, np.zeros(len(chip)) if unsure is None else unsure
    if signals.stamp_ns is None or memory.history is None or not len(chip):
        return np.stack([warm, np.ones(len(chip)), own], axis=1)
    if not memory.skipped and np.count_nonzero(age) == 0:  # as usual
        behind = memory.follow(signals.stamp_ns, signals.restart, age > 0, chip)
    else:
        behind = _bridging(signals, chip, age, own, memory)
    warm = np.where(np.isfinite(age), warm - behind[:, 0] / UNIT, warm)
    return np.column_stack([warm, behind[:, 1:]])


def _bridging(
    signals: Signals, chip: Array, age: Array, unsure: Array, memory: ThermalMemory
) -> Array:
    """As `ThermalMemory.follow`, where some frames (s,) tell no temperature: `age` is not 0."""
    assert signals.stamp_ns is not None
    assert memory.history is not None
    rows, states = np.flatnonzero(age == 0), memory.state[None]
    restarts = np.cumsum(np.concatenate([[memory.restarts], signals.restart]))
    if len(rows):
        skipped = np.diff(rows, prepend=-1 - memory.skipped) > 1
        restart = np.diff(restarts[rows + 1], prepend=0) > 0
        if signals.begins is not None:  # of another stream nothing was skipped
            skipped &= np.diff(np.cumsum(signals.begins)[rows], prepend=0) == 0
        told = memory.follow(signals.stamp_ns[rows], restart, skipped, chip[rows])
        states = np.concatenate([states, told])
    last = rows[-1] if len(rows) else -1
    memory.skipped = bool(last < len(age) - 1)
    memory.restarts = bool(restarts[-1] > (restarts[last + 1] if len(rows) else 0))
    behind, doubt, amiss = states[np.cumsum(age == 0)].T
    kept = np.exp(-age / float(memory.history.time_constants[0]))
    found = [behind * kept, doubt * kept + 1 - kept, np.hypot(amiss * kept, unsure * (1 - kept))]
    return np.stack(found, axis=1)


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
    """Degrees (s,) by which chips are warmer or colder than in the fit, of span (2,)."""
    chip = chip_temperature(signals)
    if chip is None or not np.isfinite(span).all():
        return np.zeros(len(signals.good))
    farther = np.maximum(span[0] - chip, chip - span[1])
    return np.asarray(np.maximum(np.nan_to_num(farther), 0.0))
