"""Temperatures that a chip told some time ago, and how far they have gone since.

How fast temperatures move is told by the recording of a fit: the root mean square of their change
over each age (the structure function of Kolmogorov, 1941), and of how far they left the straight
line between the ends of an interval as long.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tactile_ros.types import Array, Bools, Integers, Signals

SECONDS_PER_NS = 1e-9
HELD_S = 4.0  # in which a chip that tells none still stands beside others that do
MOST_STREAMS, MOST_ROWS = 200, 20_000  # to learn from
UNEVEN = 1.5  # of an age: farther apart two rows do not tell it
ROUNDING = 1e-9
FEWEST = 3


@dataclass(frozen=True)
class AgedSignals(Signals):
    """Frames whose chips are as warm as they told last.

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


class LastTold:
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
    """What temperatures (s, t) are wrong by (degrees), of `wandering`; None: all are told now.

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


def wandering(signals: Signals, chip: Array, noise: float) -> Array:
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
