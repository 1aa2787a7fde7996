# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Paired comparison of estimates of the same frames: difference, interval and p-value.

Frames of a group (place, press cycle or session) err alike, so groups are drawn and swapped. The
interval is a bootstrap whose percentiles are widened for few groups (Hesterberg, The American
Statistician 69, 2015); the p-value is of a permutation test (sign flips), two-sided.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, stdtrit

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.figures import NAMES, Figure, Plot, rounded, span_of
from tactile_ros.evaluation.metrics import class_errors, target_errors
from tactile_ros.evaluation.recording_files import LoadedRecording
from tactile_ros.evaluation.replay import gathered, replay, with_known_rests, with_tare_rows
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors.regression import places_of
from tactile_ros.types import STATE_FIELDS, Array, ContactStates, Integers, Recording, groups_of
from tactile_ros.types.contracts import Cell

RESAMPLES = 9999
MOST_EXACT = 13  # groups, of which every swap is tried
MOST_CELLS = 4_000_000  # of a table of resamples and groups that is held at once
SAME = 1e-9  # of a figure, inside which two count as equal, as a replay and its live run
LEVEL = 0.05  # outside of the interval; p that says something
FOLDS = 5
SCALES = {'m': (1e3, 'mm'), '%': (100.0, '%')}  # as figures are shown
COLUMNS = (
    'compared', 'figure', 'first', 'second', 'difference', 'low', 'high', 'p', 'groups', 'frames',
)  # fmt: skip
NOTES = (
    'difference: second less first, below 0 where the second errs less; paired by frame',
    f'low, high: 95 % interval, bootstrap over held-out groups ({RESAMPLES} resamples)',
    'p: permutation test that swaps both estimates in whole groups; of each row alone',
)


@dataclass(frozen=True)
class Competitor:
    """Estimates of the frames of some recordings by one calibration, estimator or live run."""

    name: str
    recordings: tuple[Recording, ...]
    states: tuple[ContactStates, ...]  # labels are numbered as in the truth


@dataclass(frozen=True)
class Comparison:
    """Figures of two competitors for one target, in the same frames."""

    names: tuple[str, str]
    target: str  # of `metrics.TARGETS` or `metrics.CLASSES`
    measure: str  # 'mean', 'RMSE' or 'wrong'
    unit: str  # as shown: mm, N, N m, %
    first: float
    second: float
    low: float  # ends of the 95 % interval of the difference
    high: float
    p: float
    frames: int  # with both estimates
    single: tuple[int, int]  # frames that only the first, only the second estimates
    by_group: Array  # (g, 2) the same figure of both in each group
    resampled: Array  # (r,) differences

    @property
    def difference(self) -> float:
        """Second less first: below 0 where the second errs less."""
        return self.second - self.first

    @property
    def sentences(self) -> list[str]:
        """Limits of the comparison."""
        said, groups = [], len(self.by_group)
        if (least := 2.0 ** (1 - groups)) > LEVEL:
            said.append(f'{groups} groups: p cannot fall below {least:.2g}, the interval is rough')
        for name, count in zip(self.names, self.single, strict=True):
            said += [f'{count} frames that only {name} estimates are not compared'] * bool(count)
        return [f'{" and ".join(self.names)}, {self.target}: {text}' for text in said]


@dataclass(frozen=True)
class Costs:
    """Error of every frame with truth, shape (n,) or (n, 2) of a pair; NaN: no estimate."""

    measure: str
    unit: str
    cost: Array  # error; squared where the figure is an RMSE; 1 where a class is wrong
    groups: Integers  # (n,)


def costs_of(competitor: Competitor) -> dict[str, Costs]:
    """Errors of all that truth can judge, classes not in tares; groups of recordings differ."""
    parts: dict[str, list[Costs]] = {}
    for recording, states in zip(competitor.recordings, competitor.states, strict=True):
        for one in target_errors(recording, states):
            place = one.name == 'position'
            measure, cost = ('mean', one.size) if place else ('RMSE', one.size**2)
            parts.setdefault(one.name, []).append(Costs(measure, one.unit, cost, one.groups))
        groups = np.asarray(groups_of(recording)['group'], np.int64)
        for kind in class_errors(recording.truth, states):
            rows = recording.truth[kind.name].astype(np.int64) >= 0
            tare = np.broadcast_to(np.asarray(recording.tare, bool), rows.shape)[rows]
            cost = np.where((kind.said >= 0).any() & ~tare, kind.said != kind.true, np.nan)
            parts.setdefault(kind.name, []).append(Costs('wrong', '%', cost, groups[rows]))
    return {name: _joined(found) for name, found in parts.items()}


def _joined(parts: Sequence[Costs]) -> Costs:
    number = np.repeat(np.arange(len(parts)), [len(part.cost) for part in parts])
    pairs = np.column_stack([number, np.concatenate([part.groups for part in parts])])
    groups = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)
    return replace(parts[0], cost=np.concatenate([p.cost for p in parts]), groups=groups)


def compare(first: Competitor, second: Competitor, seed: int = 0) -> tuple[Comparison, ...]:
    """Compare two competitors on everything that both estimate and truth can judge.

    Raises ValueError if their frames or truth differ, or they have nothing in common.
    """
    refuse_unequal(first, second)
    one, other = costs_of(first), costs_of(second)
    found = []
    for target, costs in one.items():
        pair = replace(costs, cost=np.column_stack([costs.cost, other[target].cost]))
        if np.isfinite(pair.cost).all(axis=1).any():
            found.append(_comparison((first.name, second.name), target, pair, seed))
    if not found:
        msg = f'{first.name} and {second.name} estimate nothing in common that truth can judge'
        raise ValueError(msg)
    return tuple(found)


def refuse_unequal(first: Competitor, second: Competitor) -> None:
    """Raise ValueError where two competitors were not judged on the same frames and truth."""
    why = []
    if len(first.recordings) != len(second.recordings):
        why.append(f'{len(second.recordings)} recordings, not {len(first.recordings)}')
    for a, b in zip(first.recordings, second.recordings, strict=False):
        keys = sorted({*a.truth, *b.truth})
        if len(a) != len(b):
            why.append(f'{len(b)} frames, not {len(a)}')
        elif not _same(a.values, b.values):
            why.append('frames with other readings')
        elif other := [key for key in keys if not _same(a.truth.get(key), b.truth.get(key))]:
            why.append(f'another truth of {", ".join(other)}')
    if why:
        msg = f'{second.name} must have the frames and the truth of {first.name}; it has {why[0]}'
        raise ValueError(msg)


def _same(a: object, b: object) -> bool:
    one, other = np.asarray(a), np.asarray(b)
    floats = one.dtype.kind == other.dtype.kind == 'f'
    return (a is None) == (b is None) and np.array_equal(one, other, equal_nan=floats)


def _comparison(names: tuple[str, str], target: str, pair: Costs, seed: int) -> Comparison:
    known = np.isfinite(pair.cost)
    both, root = np.asarray(known.all(axis=1)), pair.measure == 'RMSE'
    _, group = np.unique(pair.groups[both], return_inverse=True)
    count = np.bincount(group).astype(np.float64)
    sums: Array = np.column_stack([np.bincount(group, cost) for cost in pair.cost[both].T])
    equal = np.isclose(sums[:, 0], sums[:, 1], rtol=SAME, atol=0.0)
    sums[equal, 1] = sums[equal, 0]
    scale, unit = SCALES.get(pair.unit, (1.0, pair.unit))
    rng = np.random.default_rng(seed)
    resampled = scale * _resampled(sums, count, root, rng)
    first, second = (scale * _figures(sums.sum(axis=0), count.sum(), root)).tolist()
    one, other = (known & ~both[:, None]).sum(axis=0).tolist()
    return Comparison(
        names, target, pair.measure, unit, first, second, *_interval(resampled, len(count)),
        swap_probability(sums, count, root, rng), int(both.sum()), (one, other),
        scale * _figures(sums, count[:, None], root), resampled,
    )  # fmt: skip


def _figures(sums: Array, count: Array | float, root: bool) -> Array:
    mean = np.maximum(sums, 0.0) / count  # a sum that was subtracted may be -1e-20
    return np.asarray(np.sqrt(mean) if root else mean)


def _parts(groups: int) -> Iterator[int]:
    part = max(1, MOST_CELLS // groups)
    return (min(part, RESAMPLES - begun) for begun in range(0, RESAMPLES, part))


def _resampled(sums: Array, count: Array, root: bool, rng: np.random.Generator) -> Array:
    groups, found = len(count), []
    for size in _parts(groups):
        drawn = rng.multinomial(groups, np.full(groups, 1 / groups), size).astype(np.float64)
        found.append(np.diff(_figures(drawn @ sums, (drawn @ count)[:, None], root))[:, 0])
    return np.concatenate(found)


def _interval(resampled: Array, groups: int) -> tuple[float, float]:
    if groups < 2:
        return float('nan'), float('nan')
    tail = ndtr(np.sqrt(groups / (groups - 1)) * stdtrit(groups - 1, LEVEL / 2))
    low, high = np.quantile(resampled, [tail, 1 - tail]).tolist()
    return low, high


def swap_probability(sums: Array, count: Array, root: bool, rng: np.random.Generator) -> float:
    """Probability of a difference as large if it made no difference which estimate is whose.

    Sums (g, 2) are the costs of both in each group, swapped as a whole, of `count` (g,) frames;
    with `root` figures are roots of mean costs.
    """
    groups, total, change = len(count), sums.sum(axis=0), sums[:, 1] - sums[:, 0]
    figures = _figures(total, count.sum(), root)
    least = abs(figures[1] - figures[0]) - SAME * figures.max()
    exact = groups <= MOST_EXACT
    tables = (rng.integers(0, 2, (size, groups)) for size in _parts(groups))
    if exact:
        tables = (table for table in [np.arange(2**groups)[:, None] >> np.arange(groups) & 1])
    reached, tried = (0, 0) if exact else (1, 1)  # as it is, is one of the swaps
    for swaps in tables:
        moved = swaps @ change
        swapped = _figures(total + np.column_stack([moved, -moved]), count.sum(), root)
        reached += int((np.abs(np.diff(swapped)) >= least).sum())
        tried += len(swaps)
    return reached / tried


def judge(name: str, pipeline: Pipeline, loaded: Sequence[LoadedRecording]) -> Competitor:
    """Estimates of a pipeline, as a replay makes them."""
    states = tuple(_replayed(pipeline, one) for one in loaded)
    return Competitor(name, tuple(map(_tared, loaded)), states)


def _tared(one: LoadedRecording) -> Recording:
    """Recording with the newest frame of every tare of its live run marked."""
    recording, stamps = one.recording, [b.stamp_ns or 0 for b in one.baselines if b.averaged]
    if recording.tare is not None or recording.stamp_ns is None:
        return recording
    return replace(recording, tare=np.isin(recording.stamp_ns, stamps))


def _replayed(pipeline: Pipeline, one: LoadedRecording) -> ContactStates:
    return _renumbered(replay(one, pipeline).states, one.label_names, pipeline.label_names)


def _renumbered(
    states: ContactStates, true_names: Sequence[str], names: Sequence[str]
) -> ContactStates:
    """States whose labels count as the truth does, where that came as text."""
    if not true_names:
        return states
    wrong = len(true_names)
    number = [*(true_names.index(n) if n in true_names else wrong for n in names), -1]
    said = np.where(states.label < len(names), states.label, -1)
    return replace(states, label=np.array(number)[said])


def live(name: str, loaded: Sequence[LoadedRecording]) -> Competitor:
    """Estimates of the live run of a bag; RecordingError where it has none."""
    found = []
    for one in loaded:
        if one.contacts is None:
            msg = f'{name} holds no contacts of a live run to compare'
            raise RecordingError(msg)
        samples, taxels = len(one.recording), one.recording.layout.shape[0]
        states = gathered([one.contacts.states], one.contacts.rows, samples, taxels)
        found.append(_renumbered(states, one.label_names, ()))
    return Competitor(name, tuple(map(_tared, loaded)), tuple(found))


def held_out(
    name: str, new: Callable[[], Pipeline], loaded: Sequence[LoadedRecording]
) -> Competitor:
    """Estimates of every fifth group by a pipeline that was fitted to the others, five times.

    Groups are places where they repeat, else press cycles or sessions; others are in every fit.
    """
    recordings = with_known_rests([with_tare_rows(one)[0] for one in loaded])
    folds = [_folds(one) for one in recordings]
    parts: list[list[ContactStates]] = [[] for _ in loaded]
    for number in range(FOLDS):
        pairs = zip(recordings, folds, strict=True)
        pipeline = new().fit(*(one.select(fold != number) for one, fold in pairs))
        for one, fold, part in zip(loaded, folds, parts, strict=True):
            states, rows = _replayed(pipeline, one), fold == number
            part.append(ContactStates(**{n: getattr(states, n)[rows] for n in STATE_FIELDS}))
    whole = tuple(
        gathered(
            part, np.concatenate([np.flatnonzero(fold == number) for number in range(FOLDS)]),
            len(fold), one.recording.layout.shape[0],
        )
        for one, fold, part in zip(loaded, folds, parts, strict=True)
    )  # fmt: skip
    return Competitor(name, tuple(map(_tared, loaded)), whole)


def _folds(recording: Recording) -> Integers:
    groups = np.asarray(groups_of(recording)['group'], np.int64)
    if 'position' in recording.truth:
        places = places_of(np.asarray(recording.truth['position'], np.float64)[:, :2])
        groups = groups if places is None else places
    return np.where(groups < 0, -1, np.unique(groups, return_inverse=True)[1].reshape(-1) % FOLDS)


def row_of(one: Comparison) -> tuple[Cell, ...]:
    """A comparison in a row of the table."""
    return (
        ' and '.join(one.names), f'{one.target} {one.measure} ({one.unit})', one.first, one.second,
        one.difference, one.low, one.high, one.p, len(one.by_group), one.frames,
    )  # fmt: skip


def paired_groups(found: Comparison) -> Figure:
    """Figure of both competitors in every group, and the bootstrap of their difference."""
    first, second = found.names
    words = NAMES.get(found.target, found.target.replace('_', ' '))
    what = f'{words} {found.measure} ({found.unit})'
    span = span_of(np.append(found.by_group.ravel(), 0.0))
    above = Plot(span, span, f'{what}: {first}', f'{what}: {second}', (360, 330),
                 description=f'{words} of {second} against {first} by group')  # fmt: skip
    above.line(np.array(span), np.array(span), 'rule')
    above.dots(found.by_group[:, 0], found.by_group[:, 1], 'c0')
    edges = np.linspace(*span_of(np.append(found.resampled, 0.0)), 41)
    share = 100 * np.histogram(found.resampled, edges)[0] / len(found.resampled)
    top = 1.15 * float(share.max())
    below = Plot((edges[0], edges[-1]), (0, top), f'{second} less {first} ({found.unit})',
                 'share of resamples (%)', (360, 190),
                 description=f'Bootstrap of the difference in {words}')  # fmt: skip
    below.band(np.array([found.low, found.high]), np.zeros(2), np.full(2, top), 'band ink')
    below.bars(edges, share, 'fill c0')
    below.rule(0.0, 'no difference')
    better, groups = int((np.diff(found.by_group) < 0).sum()), len(found.by_group)
    caption = (
        f'{second} less {first}: {rounded(found.difference)} {found.unit} (95 %: '
        f'{rounded(found.low)} to {rounded(found.high)}), p = {rounded(found.p, 2)}. Each dot is '
        f'one of {groups} groups; under the line {second} errs less ({better} groups).'
    )
    return Figure(f'{words.capitalize()}: {second} against {first}', caption, (above, below))
