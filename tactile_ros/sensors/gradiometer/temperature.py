"""Temperatures of chips and disc along a stream, and readings at rest over them.

A Hall element reads s(T) (B + o) + d T + e T^2: what the sensitivity does not scale, of an offset
too, drifts with the chip in each channel's own way (the beta of [3], one for each pixel). A
baseline was read at temperatures that nobody noted: both, the chip's and the disc's, are told by
the baseline itself.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.estimators.disc_model import UniformField
from tactile_ros.physics.temperature import hall_sensitivity
from tactile_ros.types import Array, Bools, Integers, Signals

if TYPE_CHECKING:
    from tactile_ros.types import Array, Signals

SECONDS_PER_NS = 1e-9
HELD_S = 4.0  # in which a chip that tells none still stands beside others that do
MOST_STREAMS, MOST_ROWS = 200, 20_000  # to learn from
UNEVEN = 1.5  # of an age: farther apart two rows do not tell it
ROUNDING = 1e-9
FEWEST = 3


@dataclass(frozen=True)
class AgedSignals(Signals):
    """Frames whose chips are as warm as they told last.

    How fast temperatures move is told by the recording of a fit: the root mean square of their
    change over each age (the structure function of Kolmogorov, 1941), and of how far they left the
    straight line between the ends of an interval as long.

    Attributes
    ----------
    age : ndarray, shape (s, t)
        For how long each temperature has stood (s): 0 told now, infinite never.
    """

    age: Array | None = None


def aged(signals: Signals, temperature_c: Array, age: Array) -> AgedSignals:
    """The same frames with other temperatures, both (s, t), and their age."""
    known = {field.name: getattr(signals, field.name) for field in fields(Signals)}
    return AgedSignals(**{**known, 'temperature_c': temperature_c}, age=age)


class HeldTemperature:
    """Temperatures that the chips of one stream told last."""

    def __init__(self) -> None:
        self._chips: tuple[Array, Integers, Bools] | None = None

    def __call__(self, signals: Signals) -> Signals:
        """The same, where chips tell no temperature with the one that they told last.

        Beside others that tell theirs a chip stands for four seconds.
        """
        chips, stamps = signals.temperature_c, signals.stamp_ns
        if chips is None and self._chips is not None:  # what told before tells no more
            chips = np.full(signals.values.shape[:2], np.nan)
        if chips is None or not len(chips):
            return signals
        every = np.isfinite(chips)
        if np.count_nonzero(every) == chips.size:  # as usual
            if stamps is not None:
                self._chips = chips[-1], np.full(chips.shape[1], stamps[-1]), every[-1]
            return signals
        if stamps is None:
            return aged(signals, chips, np.where(every, 0.0, np.inf))
        begins = np.zeros(len(chips), bool) if signals.begins is None else signals.begins
        told, age = self._held(chips, every, stamps, begins)
        newest = age.min(axis=1, where=age >= 0, initial=np.inf)[:, None]
        stands = np.isfinite(age) & (age >= 0) & (age <= newest + HELD_S)
        return aged(signals, np.where(stands, told, np.nan), np.where(stands, age, np.inf))

    def _held(
        self, chips: Array, every: Bools, stamps: Integers, begins: Bools
    ) -> tuple[Array, Array]:
        """What chips told last (s, t) in their stream, and how long ago (s); infinite: never."""
        width = chips.shape[1]
        first = (np.full(width, np.nan), np.full(width, stamps[0]), np.zeros(width, bool))
        last = self._chips or first
        chips = np.concatenate([last[0][None], chips])
        times = np.concatenate([last[1][None], np.repeat(stamps[:, None], width, axis=1)])
        every = np.concatenate([last[2][None], every])
        index = np.arange(len(chips))[:, None]
        row = np.maximum.accumulate(np.where(every, index, 0), axis=0)
        start = np.maximum.accumulate(np.where(begins, index[1:, 0], 0))[:, None]
        known = np.take_along_axis(every, row, 0)
        known[1:] &= row[1:] >= start
        told, times = np.take_along_axis(chips, row, 0), np.take_along_axis(times, row, 0)
        self._chips = told[-1], times[-1], known[-1]
        age = SECONDS_PER_NS * (stamps[:, None] - times[1:])
        return told[1:], np.where(known[1:], age, np.inf)


def told_ago(signals: Signals) -> Array:
    """For how long (s,) (s) the latest temperature has stood; 0 told now, infinite never."""
    if not isinstance(signals, AgedSignals) or signals.age is None:
        return np.zeros(len(signals.good))
    return np.asarray(signals.age.min(axis=1))


def lately_told(signals: Signals) -> Bools:
    """Rows (s,) whose temperatures are told as lately as those of most, or never were."""
    age = told_ago(signals)
    known = age[signals.good & np.isfinite(age)]
    return np.asarray(~np.isfinite(age) | (age <= (np.median(known) if len(known) else np.inf)))


def unsure_chips(signals: Signals, wander: Array) -> Array | None:
    """Sigma of temperatures (s, t) (degrees), of `temperature_wander`; None: all are told now.

    One that was never told is as that of the other chips, or as any of the fit.
    """
    if signals.temperature_c is None:
        return np.full(signals.values.shape[:2], wander[1, -1] / np.sqrt(2))
    if not isinstance(signals, AgedSignals) or signals.age is None:
        return None
    known = np.isfinite(signals.age)
    gone = np.where(known, np.interp(signals.age, wander[0], wander[1]), 0.0)
    count = known.sum(axis=1)
    others = np.where(
        count > 0, gone.sum(axis=1) / np.maximum(count, 1), wander[1, -1] / np.sqrt(2)
    )
    return np.where(known, gone, others[:, None])


def temperature_wander(signals: Signals, chip: Array, noise: float) -> Array:
    """How far temperatures go, of streams.

    Parameters
    ----------
    signals : Signals
        Of the fit.
    chip : ndarray, shape (s,)
        Temperatures as they were told (degrees), NaN where none was.
    noise : float
        Of the thermometer (degrees).

    Returns
    -------
    ndarray, shape (3, m)
        Ages (s), from 0 on; root mean square changes over them, to which what is held is wrong,
        and departures from the middle of a straight line (degrees). The last change is that
        between any two temperatures; at once, where no stream tells more.
    """
    told = np.isfinite(chip)
    most = np.sqrt(2) * float(chip[told].std()) if told.any() else 0.0
    known = np.zeros((3, 1))
    if signals.stamp_ns is not None and told.any():
        begins = signals.restart if signals.begins is None else signals.begins
        stream = np.cumsum(begins | (np.diff(signals.stamp_ns, prepend=0) <= 0))[told]
        second = SECONDS_PER_NS * (signals.stamp_ns - signals.stamp_ns[0])[told]
        parts = np.split(np.arange(len(stream)), np.flatnonzero(np.diff(stream)) + 1)
        parts = [part for part in parts if len(part) >= FEWEST]
        parts = parts[:: -(-len(parts) // MOST_STREAMS)] if parts else parts
        runs = [(second[part], chip[told][part]) for part in parts]
        known = np.column_stack([known, *_changes(runs, noise)])
    known = np.maximum.accumulate(np.minimum(known, [[np.inf], [most], [most]]), axis=1)
    age, change, _ = known[:, -1]
    end = age * most / change if change > 0 else ROUNDING
    return np.column_stack([known, [max(end, age + ROUNDING), most, most]])


def _changes(runs: list[tuple[Array, Array]], noise: float) -> list[Array]:
    """Ages (s), changes and departures (degrees) over octaves of age, (3,) each."""
    if not runs:
        return []
    age, found = min(float(np.median(np.diff(time))) for time, _ in runs), []
    while age <= 0.5 * max(float(time[-1] - time[0]) for time, _ in runs):
        over = [_over(age, *run) for run in runs]
        change = _size(np.concatenate([one[0] for one in over]), 2.0 * noise**2)
        bow = _size(np.concatenate([one[1] for one in over]), 1.5 * noise**2)
        if np.isfinite(change):
            found.append(np.array([age, change, np.nan_to_num(bow)]))
        age *= 2
    return found


def _size(moved: Array, noise: float) -> float:
    """Root mean square, less that of a noise of this variance; NaN of none."""
    return float(np.sqrt(max((moved**2).mean() - noise, 0.0))) if len(moved) else np.nan


def _over(age: float, time: Array, chip: Array) -> tuple[Array, Array]:
    """Changes of a stream's temperatures over an age, and departures in its middle."""
    late = np.linspace(0, len(time) - 1, min(len(time), MOST_ROWS)).astype(int)
    soon, mid = (
        np.searchsorted(time, time[late] - share * age * (1 - ROUNDING), 'right') - 1
        for share in (1.0, 0.5)
    )
    kept = (soon >= 0) & (time[late] - time[soon] <= UNEVEN * age)
    late, soon, mid = late[kept], soon[kept], mid[kept]
    change = chip[late] - chip[soon]
    inside = (mid > soon) & (mid < late)
    share = (time[mid] - time[soon]) / (time[late] - time[soon])
    return change, (chip[mid] - chip[soon] - share * change)[inside]


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

    [3]: the Hall sensitivity follows p0 + p1 dT + p2 dT^2 of the chip's temperature. The baseline
    was read at another temperature, which nothing reports: it is told by how much stronger the
    disc at rest was then than in the fit. Gap, stiffness and remanence follow the magnet, whose
    temperature follows the chip's with a delay: a slow state, of the config's time constant or of
    the one with which the disc's model explains a recording best.

    It follows what the chip told: frames without a temperature lie on the line between those
    with one.

    Parameters
    ----------
    lag : float
        Time constant (s); 0: the disc is as warm as the chip.
    wander : ndarray, shape (3, m), or None
        Of `temperature_wander`; None: temperatures never leave those lines.
    """

    def __init__(self, lag: float, wander: Array | None = None) -> None:
        self.history = FadingMemory(np.array([lag])) if lag > 0 else None
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


PAST = np.array([0.3, 3.0])  # s, of an elastomer that creeps


class StreamMemory:
    """Memory of one stream.

    Parameters
    ----------
    lag : float
        Time constant with which the disc follows the chip's temperature (s).
    wander : ndarray, shape (3, m), or None
        Of `temperature_wander`; None: temperatures stay as they were while none is told.
    lag_is_told : bool
        Whether anything tells that time constant.
    """

    def __init__(
        self, lag: float, wander: Array | None = None, *, lag_is_told: bool = True
    ) -> None:
        self.thermal = ThermalMemory(lag, wander)
        self.slower = None if lag_is_told else ThermalMemory(ANY_LAG, wander)
        self.places = FadingMemory(PAST)
        self._last = HeldTemperature()

    def with_temperatures(self, signals: Signals) -> Signals:
        """The same, where chips told no temperature with the ones that they told last."""
        return self._last(signals)

    def past(self, signals: Signals, now: Array) -> Array:
        """Fading means (s, 2 d) of what is now (s, d), since the stream began at rest."""
        stamps, rows = signals.stamp_ns, len(now)
        if stamps is None:
            return np.tile(now, len(PAST))
        if rows == 1:
            if signals.restart[0]:
                self.places.reset()
            return self.places.step(now[0], int(stamps[0])).reshape(1, -1)
        return self.places(now, stamps, signals.restart).reshape(rows, len(PAST) * now.shape[1])


AMISS = 3e-4  # of the field at rest: what its model may be wrong by
RANGE, LAGS_BY = 2.0, 0.2  # units of temperature: of chips, and by which a disc lags
ROUNDS = 3


class WarmRest:
    """FieldChange at rest over temperatures.

    Parameters
    ----------
    axes : ndarray, shape (n, 3)
        Direction of each channel; 0 for dead ones.
    coefficients : ndarray, shape (3,)
        p0, p1, p2 of the sensitivity.
    usual : float
        Temperature from which all others count (degrees Celsius).

    Attributes
    ----------
    offset_ : ndarray, shape (2, n)
        Drift of readings over a unit of the chip's temperature, and over its square (T).
    unsure_ : ndarray, shape (2 m, 2 m)
        Covariance of that drift, of differences (T2); learned by `WarmFit`.
    """

    level_: Array  # (n,) field at rest at the usual temperature (T)
    warmer_: Array  # (n,) its change over a unit of the disc's temperature (T)
    gain_: Array  # (n, 2) of both temperatures from readings (units / T)
    unsure_: Array
    _last: tuple[Array, Array] | None = None  # a stream has one baseline for many frames

    def __init__(self, axes: Array, coefficients: Array, usual: float) -> None:
        self.axes, self.coefficients, self.usual = axes, coefficients, usual
        self.offset_ = np.zeros((2, len(axes)))

    def fit(self, base: Array, chip: Array, disc: Array, warmer: Array) -> WarmRest:
        """Learn the field at rest.

        Parameters
        ----------
        base : ndarray, shape (s, n)
            Baselines of resting rows (T).
        chip, disc : ndarray, shape (s,)
            Temperatures of those rows (units from the usual one); rows of one baseline were
            read with it.
        warmer : ndarray, shape (n,)
            What a unit of the disc's temperature changes (T).
        """
        _, which, count = np.unique(base, axis=0, return_inverse=True, return_counts=True)
        which = np.asarray(which).reshape(-1)
        chip, disc = (np.bincount(which, one)[which] / count[which] for one in (chip, disc))
        field = self.field(base, chip)
        self.level_ = (field - disc[:, None] * warmer).mean(axis=0)
        self.warmer_, self._last = warmer, None
        self._learn_gain()
        return self

    def _learn_gain(self) -> None:
        """Both temperatures from what a uniform field does not change, by least squares."""
        passed = UniformField(self.axes, 1e-6).differences
        step = 0.04
        slope = np.stack([
            (self._read(np.array([[step, 0.0]])) - self._read(np.array([[-step, 0.0]])))[0],
            (self._read(np.array([[0.0, step]])) - self._read(np.array([[0.0, -step]])))[0],
        ], axis=1) / (2 * step)  # fmt: skip
        sigma = AMISS * float(np.sqrt((self.level_**2).mean())) + 1e-9
        seen = passed.T @ slope / sigma
        tied = np.array([[1.0, -1.0], [-1.0, 1.0]]) / LAGS_BY**2
        prior = tied + np.diag([1 / RANGE**2, 0.0])
        self.gain_ = (np.linalg.solve(seen.T @ seen + prior, seen.T) @ passed.T / sigma).T

    def _strength(self, chip: Array) -> Array:
        """Sensitivity at chip temperatures (s,), shape (s, 1)."""
        return sensitivity(self.usual + UNIT * chip, self.coefficients)[:, None]

    def _read(self, warm: Array) -> Array:
        """FieldChange at rest (s, n) at temperatures (s, 2) of chip and disc."""
        chip, disc = warm[:, :1], warm[:, 1:]
        field = self.level_ + disc * self.warmer_
        return np.asarray(self._strength(warm[:, 0]) * field + self.drift(chip[:, 0]))

    def drift(self, chip: Array) -> Array:
        """Drift of readings (s, n) (T) at chip temperatures (s,)."""
        # a channel at a time: the same bits alone and among others
        linear, square = self.offset_
        return np.asarray(chip[:, None] * linear + (chip * chip)[:, None] * square)

    def field(self, read: Array, chip: Array) -> Array:
        """Field (s, n) of readings (s, n) at chip temperatures (s,)."""
        return np.asarray((read - self.drift(chip)) / self._strength(chip))

    def temperatures(self, base: Array) -> Array:
        """Temperatures (s, 2) of chip and disc when baselines (s, n) were read."""
        if self._last is not None and (base == self._last[0]).all():
            return np.repeat(self._last[1], len(base), axis=0)
        new = np.ones(len(base), bool)
        new[1:] = (base[1:] != base[:-1]).any(axis=1)
        read = base[new]
        warm = np.zeros((len(read), 2))
        for _ in range(ROUNDS):
            error = np.nan_to_num(read - self._read(warm))
            # a row at a time: the same bits alone and among others
            move = np.matmul(error[:, None], self.gain_)[:, 0]
            warm = np.clip(warm + move, -RANGE, RANGE)
        told = np.asarray(warm[np.cumsum(new) - 1])
        if len(base):
            self._last = base[-1:].copy(), told[-1:].copy()
        return told

    def usual_rest(self, base: Array, warm: Array) -> Array:
        """Field (s, n) that the rest of baselines (s, n) would have at the usual temperature."""
        return self.field(base, warm[:, 0]) - warm[:, 1:] * self.warmer_

    def drifts(self, chip: Array, warm: Array) -> Array:
        """How changes follow both drifts at chip temperatures (s,), tared at `warm`: (s, 2)."""
        now, then = (_powers(one) / self._strength(one) for one in (chip, warm[:, 0]))
        return np.asarray(now - then)


def _powers(chip: Array) -> Array:
    """Temperatures and their squares, shape (s, 2)."""
    return np.stack([chip, chip * chip], axis=1)
