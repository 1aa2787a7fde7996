# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Reference values (truth) beside the frames: by sequence or stamp, or by the nearest time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import cast

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import cdr_columns
from tactile_ros.types import TRUTH_KEYS, Array, Bools, Columns, Integers, admit_name
from tactile_ros.types.contact import blank_column, stack_columns

DEFAULT_TRUTH = ('truth/contacts', 'truth/object_pose')
# of the delay between the clocks of frames and truth
MOST_NS = 500_000_000
STRETCH_NS = 4_000_000_000
LEAST_STEP_NS = 1_000_000
LEAST_CORRELATION = 0.5
FEWEST = 3
FINEST = 0.2  # steps: how far off a peak between two steps may be in every stretch alike
QUIET = 0.1  # of the usual scatter: a stretch in which nothing happens
MAD, MEDIAN = 1.4826, 1.2533  # scatter of a normal variable from its median; of a median
MOST_FRAMES = 12_000


@dataclass(frozen=True)
class Association:
    """Rules by which truth is brought together with frames in time.

    `delay_ns` is by how much stamps of other instruments are later than those of their frames.
    """

    tolerance_ns: int | None = None  # None: half a step of frames or truth, the longer one
    delay_ns: int | None = 0  # None: as the signals say
    remark: str = ''  # origin of the delay, in a few words


@dataclass(frozen=True)
class FrameTimes:
    """Stamp (ns), sequence, stream and log time (ns) of s frames, and how much each deviates.

    `deviation` (s,) is the norm of a reading less the usual one (unit of the readings).
    """

    stamp_ns: Integers
    sequence: Integers
    stream: Integers
    log_ns: Integers
    deviation: Array

    @classmethod
    def join(cls, parts: Sequence[FrameTimes]) -> FrameTimes:
        """Frames of all parts, one after another."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*(np.concatenate(column) for column in columns))

    def __len__(self) -> int:
        return len(self.stamp_ns)


def ends_as(topic: str, name: str) -> bool:
    """Tell whether a topic is the named one, absolute or relative to some namespace."""
    return topic == name or (not name.startswith('/') and topic.endswith(f'/{name}'))


def is_unknown(values: npt.NDArray[np.generic]) -> Bools:
    """Rows of truth that are NaN or -1."""
    return np.isnan(values) if values.dtype.kind == 'f' else np.asarray(values == -1)


def half_step(times: Integers) -> int:
    """Half the usual distance of times (ns); half a second where there is none."""
    steps = np.diff(np.sort(times))
    steps = steps[steps > 0]
    return int(np.median(steps)) // 2 if len(steps) else 500_000_000


def nearest(times: Integers, asked: Integers, tolerance: int) -> Integers:
    """Index of the time (n,) nearest to each asked one (m,), -1: none is within the tolerance."""
    rows = nearest_of_key(np.zeros_like(times), times, np.zeros_like(asked), asked)
    there = rows >= 0
    there[there] = np.abs(times[rows[there]] - asked[there]) <= tolerance
    return np.where(there, rows, -1)


def nearest_of_key(
    keys: Integers, times: Integers, asked_keys: Integers, asked_times: Integers
) -> Integers:
    """Index (m,) of the row with the asked key whose time is nearest; -1: no row has the key.

    Rows may be in any order; of two that are equally near it is the earlier.
    """
    count = len(keys)
    if not count:
        return np.full(len(asked_keys), -1, np.int64)
    order = np.lexsort((times, keys))
    merged = np.lexsort((
        np.append(np.ones(count, np.int8), np.zeros(len(asked_keys), np.int8)),
        np.append(times, asked_times), np.append(keys, asked_keys),
    ))  # fmt: skip
    before = np.empty(len(merged), np.int64)
    before[merged] = np.cumsum(merged < count)
    after = before[count:]
    left, right = (order[np.clip(at, 0, count - 1)] for at in (after - 1, after))
    beyond = keys[left] != asked_keys
    nearer = asked_times - times[left] > np.abs(times[right] - asked_times)
    best = np.where(beyond | ((keys[right] == asked_keys) & nearer), right, left)
    return np.where(keys[best] == asked_keys, best, -1)


def held_labels(
    texts: Sequence[str], times: Integers, frames: Integers, names: tuple[str, ...]
) -> tuple[Columns, tuple[str, ...]]:
    """Labels of frames (s,) from n texts and when each was heard (ns), until the next one.

    Returns the truth, -1 where a text is empty, and the names in which `label` counts.
    Raises RecordingError where a text can be no name.
    """
    try:
        labels = [admit_name('label of a recording', text) for text in texts]
    except ValueError as err:
        raise RecordingError(str(err)) from err
    names = tuple(dict.fromkeys([*names, *filter(None, labels)]))
    index = np.array([names.index(label) if label else -1 for label in labels], np.int64)
    order = np.argsort(times, kind='stable')
    last = np.searchsorted(times[order], frames, side='right') - 1
    return {'label': np.where(last >= 0, index[order][last], -1)}, names


def _wrench(columns: Columns) -> Columns:
    names = ('force', 'torque')
    truth = {name: cdr_columns.vectors_of(columns, f'wrench.{name}') for name in names}
    return {'stamp_ns': cdr_columns.stamps_of(columns), **truth}


def _pose(columns: Columns) -> Columns:
    path = 'pose.pose' if 'pose.pose.position.x' in columns else 'pose'
    position = cdr_columns.vectors_of(columns, f'{path}.position')
    turn = cdr_columns.vectors_of(columns, f'{path}.orientation', 'xyzw')
    matrix = np.full((len(position), 4, 4), np.nan)
    matrix[:, :3, 3] = position
    matrix[:, 3] = 0.0, 0.0, 0.0, 1.0
    measured = np.isfinite(turn).all(axis=1) & (np.linalg.norm(turn, axis=1) > 0)
    if measured.any():
        matrix[measured, :3, :3] = Rotation.from_quat(turn[measured]).as_matrix()
    stamps = cdr_columns.stamps_of(columns)
    return {'stamp_ns': stamps, 'position': position, 'object_pose': matrix}


STANDARD: dict[str, Callable[[Columns], Columns]] = {
    'geometry_msgs/msg/WrenchStamped': _wrench,
    'geometry_msgs/msg/PoseStamped': _pose,
    'geometry_msgs/msg/PoseWithCovarianceStamped': _pose,
}
TRUTH_TYPES = (*STANDARD, cdr_columns.STRING, cdr_columns.CONTACTS)


class TruthTopic:
    """Messages of one topic that tell the truth about one sensor.

    `sentence` says how they were brought together with frames; empty: not yet.
    """

    def __init__(self, topic: str, type_name: str) -> None:
        self.topic, self.type_name, self.sentence = topic, type_name, ''
        self.has_delay = type_name in STANDARD  # its instrument has a clock of its own
        self.damaged = 0
        self._waiting: tuple[list[int], list[bytes]] = ([], [])
        self._logs: list[Integers] = []
        self._parts: list[Columns] = []
        self._texts: list[str] = []

    def extend(self, logs: Sequence[int], messages: Sequence[bytes]) -> None:
        """Take more messages in: log times (ns) and CDR."""
        self._waiting[0].extend(logs)
        self._waiting[1].extend(messages)

    def decode(self, taxels: int, wanted: Container[str]) -> None:
        """Decode the messages that wait, for a sensor of so many taxels, and keep wanted keys."""
        (logs, messages), self._waiting = self._waiting, ([], [])
        if not logs:
            return
        part: Columns = {}
        if self.type_name == cdr_columns.STRING:
            rows, texts = cdr_columns.read_texts(messages)
            self._texts += texts
        else:
            keys = [key for key in TRUTH_KEYS if key in wanted]
            found = (
                cdr_columns.read_contacts(messages, taxels, keys)
                if self.type_name == cdr_columns.CONTACTS
                else cdr_columns.read_rows(messages, self.type_name, STANDARD[self.type_name])
            )
            rows = found.rows
            part = {
                key: column
                for key, column in found.arrays.items()
                if key in ('stamp_ns', 'sequence')
                or (key in wanted and not is_unknown(column).all())
            }
        self.damaged += len(messages) - len(rows)
        if len(rows):
            self._logs.append(np.array(logs, np.int64)[rows])
            self._parts.append(part)

    def associate(
        self, frames: FrameTimes, association: Association, names: tuple[str, ...]
    ) -> tuple[Columns, tuple[str, ...], int]:
        """Truth beside s frames, the names of its labels, and how many messages have no frame."""
        if not self._logs:
            return {}, names, 0
        logs = np.concatenate(self._logs)
        if self.type_name == cdr_columns.STRING:
            self.sentence = 'holds from its arrival until the next'
            return (*held_labels(self._texts, logs, frames.stamp_ns, names), 0)
        arrays = stack_columns(self._parts, [len(part) for part in self._logs])
        stamps = cast('Integers', arrays.pop('stamp_ns')).astype(np.int64)
        delay, remark, tolerance = 0, '', association.tolerance_ns
        if self.type_name == cdr_columns.CONTACTS:
            tolerance = half_step(frames.stamp_ns) if tolerance is None else tolerance
            rows = self._rows_of_frames(
                frames, stamps, arrays.pop('sequence').astype(np.int64), logs, tolerance
            )
            used = rows >= 0
            source = np.full(len(frames), -1, np.int64)
            source[rows[used]] = np.flatnonzero(used)
        else:
            delay, remark = _delay(association, frames, stamps, logs, arrays)
            if tolerance is None:
                tolerance = max(half_step(stamps), half_step(frames.stamp_ns))
            source = nearest(stamps - delay, frames.stamp_ns, tolerance)
            used = nearest(frames.stamp_ns, stamps - delay, tolerance) >= 0
        late = f'{delay * 1e-6:.3g} ms late{remark}'
        self.sentence = f'within {tolerance * 1e-6:.3g} ms, {late}'
        truth: Columns = {}
        for key, column in arrays.items():
            if not is_unknown(column[source[source >= 0]]).all():
                truth[key] = blank_column(key, column, len(frames))
                truth[key][source >= 0] = column[source[source >= 0]]
        return truth, names, int((~used).sum())

    def _rows_of_frames(
        self,
        frames: FrameTimes,
        stamps: Integers,
        sequence: Integers,
        logs: Integers,
        tolerance: int,
    ) -> Integers:
        """Frame (n,) of each of n contacts, -1: none.

        That of its stamp and sequence; without a stamp that of its sequence, heard nearest to it;
        else the nearest in time.
        """
        rows = nearest_of_key(frames.sequence, frames.stamp_ns, sequence, stamps)
        rows[frames.stamp_ns[rows] != stamps] = -1
        bare = stamps == 0
        rows[bare] = nearest_of_key(frames.sequence, frames.log_ns, sequence[bare], logs[bare])
        timed = (rows < 0) & ~bare
        rows[timed] = nearest(frames.stamp_ns, stamps[timed], tolerance)
        return rows


def merged(
    topics: Iterable[TruthTopic], frames: FrameTimes, association: Association
) -> tuple[Columns, tuple[str, ...], Counter[str]]:
    """Truth of all topics beside frames; a later topic fills what an earlier left unknown.

    Returns the truth, the names of labels, and counts of lost messages by sentence.
    """
    truth: Columns = {}
    names: tuple[str, ...] = ()
    lost: Counter[str] = Counter()
    for topic in topics:
        part, names, left_over = topic.associate(frames, association, names)
        lost[f'messages of {topic.topic} are damaged or do not fit'] += topic.damaged
        lost[f'messages of {topic.topic} belong to no frame'] += left_over
        for key, value in part.items():
            earlier = truth.get(key, value)
            truth[key] = np.where(is_unknown(earlier), value, earlier)
    return truth, names, +lost


@dataclass(frozen=True)
class Delay:
    """Median delay (ns) of some stretches with its deviation, and their median correlation.

    Each stretch gives the peak of its normalised cross-correlation; their scatter tells the rest.
    """

    delay_ns: float
    std_ns: float
    correlation: float
    stretches: int


def estimate_delay(
    times: Integers, signal: Array, late_times: Integers, late_signal: Array
) -> Delay | None:
    """Delay of a signal (m,) behind another (n,), up to half a second either way.

    Times (ns) increase; signals may be of any unit and sign. None where fewer than three
    stretches of four seconds correlate. The creep of the skin is part of the answer.
    """
    if min(len(times), len(late_times)) < 2:
        return None
    steps = [float(np.median(np.diff(t))) for t in (times, late_times)]
    step = max(min(steps), LEAST_STEP_NS)
    begin = max(int(times[0]), int(late_times[0]) + MOST_NS)
    end = min(int(times[-1]), int(late_times[-1]) - MOST_NS)
    most, length = round(MOST_NS / step), round(STRETCH_NS / step)
    count = int((end - begin) // step)
    if count < FEWEST * length:
        return None
    grid = np.arange(-most, count + most) * step
    one = np.interp(grid[most:-most], times - begin, signal)
    other = np.interp(grid, late_times - begin, late_signal)
    usual = float(np.std(one)), float(np.std(other))
    peaks = []
    for first in range(0, count - length + 1, length):
        part, late = one[first : first + length], other[first : first + length + 2 * most]
        if part.std() > QUIET * usual[0] and late.std() > QUIET * usual[1]:
            peaks.append(_peak(part, late))
    good = np.array([(lag, top) for lag, top in peaks if top >= LEAST_CORRELATION])
    if len(good) < FEWEST:
        return None
    lag = float(np.median(good[:, 0]))
    scatter = MAD * float(np.median(np.abs(good[:, 0] - lag)))
    std = max(scatter, FINEST) * MEDIAN / np.sqrt(len(good))
    return Delay((lag - most) * step, float(std) * step, float(np.median(good[:, 1])), len(good))


def _peak(part: Array, late: Array) -> tuple[float, float]:
    """Place (steps, by a parabola) and height of the largest correlation; height 0 at an edge."""
    windows = sliding_window_view(late, len(part))
    centred = part - part.mean()
    spread = windows.std(axis=1) * part.std() * len(part)
    with np.errstate(invalid='ignore', divide='ignore'):
        match = np.nan_to_num(np.abs(windows @ centred) / spread, nan=0.0, posinf=0.0)
    top = int(match.argmax())
    if top in (0, len(match) - 1):
        return float(top), 0.0
    left, middle, right = match[top - 1 : top + 2]
    bend = left - 2 * middle + right
    return top + (0.5 * (left - right) / bend if bend < 0 else 0.0), float(middle)


def _delay(
    association: Association, frames: FrameTimes, stamps: Integers, logs: Integers, truth: Columns
) -> tuple[int, str]:
    if association.delay_ns is not None:
        return association.delay_ns, association.remark
    found = _delay_of_signals(frames, stamps, logs, truth)
    if found is None:
        return 0, ' (assumed: the signals do not show it)'
    significant = abs(found.delay_ns) > 3 * found.std_ns
    return round(found.delay_ns) if significant else 0, (
        f' (estimated: {found.delay_ns * 1e-6:.3g} +- {found.std_ns * 1e-6:.2g} ms from '
        f'{found.stretches} stretches, correlation {found.correlation:.2f})'
    )


def _delay_of_signals(
    frames: FrameTimes, stamps: Integers, logs: Integers, truth: Columns
) -> Delay | None:
    """Delay of the size of a force, or of the height of a probe, behind the first readings."""
    level = np.full(len(stamps), np.nan)
    if 'force' in truth:
        level = np.sqrt(np.nansum(np.asarray(truth['force'], np.float64) ** 2, axis=1))
    elif 'position' in truth:
        level = np.asarray(truth['position'], np.float64)[:, 2]
    times, heard = frames.stamp_ns[:MOST_FRAMES], frames.log_ns[:MOST_FRAMES]
    away = frames.deviation[:MOST_FRAMES]
    until = heard.max(initial=0) + MOST_NS
    measured = np.isfinite(level) & (logs <= until)
    if not measured.any():
        return None
    late = stamps[measured]
    # clocks that were never set to one another differ by what the recorder heard of them
    apart = int(np.median(late - logs[measured])) - int(np.median(times - heard))
    order, late_order = np.argsort(times, kind='stable'), np.argsort(late, kind='stable')
    delay = estimate_delay(
        times[order], away[order], late[late_order] - apart, level[measured][late_order]
    )
    if delay is None:
        return None
    return Delay(delay.delay_ns + apart, *astuple(delay)[1:])
