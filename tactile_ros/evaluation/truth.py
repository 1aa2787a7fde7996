"""Reference values (truth) beside the frames: by sequence or stamp, or by the nearest time."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag import BagContent, MessageBuffer, read_bag
from tactile_ros.evaluation.cdr_columns import (
    CONTACTS,
    FRAME,
    Columns,
    Rows,
    read_columns,
    read_contacts,
    read_rows,
    stamps_of,
    text_at,
    vectors_of,
)
from tactile_ros.types import TRUTH_KEYS, Array, Integers, admit_name

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from tactile_ros.evaluation.bag import Taker
    from tactile_ros.types import Bools, Recording

DEFAULT_TRUTH = ('truth/contacts', 'truth/object_pose')
STRING = 'std_msgs/msg/String'
UNFOUND, ELSEWHERE = -1, -2  # in place of a row
KEPT_NS = 2_000_000_000  # of log time that truth waits for frames that are heard after it


@dataclass(frozen=True)
class Association:
    """How truth is brought together with frames.

    Attributes
    ----------
    tolerance_ns : int or None
        Largest distance in time; None: half a step of frames or truth, whichever is longer.
    delays : dict of str to int
        By how much the stamps of a topic are later than the frames that they belong to (ns).
    remarks : dict of str to str
        Where a delay comes from and its uncertainty, in a few words.
    """

    tolerance_ns: int | None = None
    delays: Mapping[str, int] = field(default_factory=dict)
    remarks: Mapping[str, str] = field(default_factory=dict)


def ends_as(topic: str, name: str) -> bool:
    """Whether a topic is the named one, absolute or relative to some namespace."""
    return topic == name or (not name.startswith('/') and topic.endswith(f'/{name}'))


def unknown(values: npt.NDArray[np.generic]) -> Bools:
    """Where truth is NaN or -1."""
    return np.isnan(values) if values.dtype.kind == 'f' else np.asarray(values == -1)


def half_step(times: Integers) -> int:
    """Half the usual distance of times (ns); half a second where there is none."""
    steps = np.diff(np.sort(times))
    steps = steps[steps > 0]
    return int(np.median(steps)) // 2 if len(steps) else 500_000_000


def nearest(times: Integers, asked: Integers, tolerance: int) -> Integers:
    """Index of the time nearest to each asked one, -1 where none is within the tolerance.

    Parameters
    ----------
    times, asked : ndarray, shape (n,), (m,)
        Times in any order (ns).
    tolerance : int
        Largest distance (ns).

    Returns
    -------
    ndarray, shape (m,)
        Indices into `times`; the earlier one where two are equally near.
    """
    if not len(times):
        return np.full(len(asked), -1, np.int64)
    order = np.argsort(times, kind='stable')
    ordered = times[order]
    right = np.clip(np.searchsorted(ordered, asked), 0, len(ordered) - 1)
    left = np.maximum(right - 1, 0)
    closer = np.abs(asked - ordered[left]) <= np.abs(ordered[right] - asked)
    best = np.where(closer, left, right)
    distance = np.abs(ordered[best] - asked)
    return np.where(distance <= tolerance, order[best], -1).astype(np.int64)


def nearest_truth(
    truth: Columns, times: Integers, frames: Integers, tolerance: int
) -> tuple[Columns, Bools]:
    """Truth (n, ...) of times (n,) nearest to each frame (s,) (ns); which of it is near any."""
    rows = nearest(times, frames, tolerance)
    columns: Columns = {}
    for key, values in truth.items():
        near = rows.reshape(-1, *[1] * (values.ndim - 1)) >= 0
        columns[key] = np.where(near, values[rows], np.nan)
    return columns, nearest(frames, times, tolerance) >= 0


def contacts_truth(
    arrays: Columns,
    recording: Recording,
    index: Mapping[tuple[int, int], int],
    tolerance: int,
    around: Integers,
) -> tuple[Columns, Bools]:
    """Truth that came as TactileContacts.

    Parameters
    ----------
    arrays : dict of str to ndarray, shape (n, ...)
        As `read_contacts` gives them.
    recording : Recording
        Of s frames.
    index : dict
        Row of a frame by its stamp (ns) and sequence; ELSEWHERE: of one that is not in the
        recording, but of the same stream.
    tolerance : int
        Largest distance in time (ns).
    around : ndarray, shape (m,)
        Stamps of such frames (ns): what is nearest to one of them is not of the recording.

    Returns
    -------
    truth : dict of str to ndarray, shape (s, ...)
        Keys of which something is known; NaN or -1 elsewhere.
    used : ndarray, shape (n,)
        Messages that belong to a frame.

    Notes
    -----
    A message belongs to the frame of its stamp and sequence; without a stamp to that of its
    sequence; else to the frame nearest in time.
    """
    assert recording.stamp_ns is not None
    stamps = arrays['stamp_ns'].astype(np.int64)
    sequence = arrays['sequence'].astype(np.int64)
    keys = zip(stamps.tolist(), sequence.tolist(), strict=True)
    rows = np.array([index.get(key, UNFOUND) for key in keys], np.int64)
    by_sequence = {key[1]: row for key, row in index.items()}
    unstamped = (rows == UNFOUND) & (stamps == 0)
    rows[unstamped] = [by_sequence.get(k, UNFOUND) for k in sequence[unstamped].tolist()]
    timed = (rows == UNFOUND) & (stamps != 0)
    near = nearest(np.concatenate([recording.stamp_ns, around]), stamps[timed], tolerance)
    rows[timed] = np.where(near < len(recording), near, ELSEWHERE)
    kept = rows >= 0
    truth: Columns = {}
    for key in TRUTH_KEYS:
        if key in arrays and not unknown(arrays[key][kept]).all():
            column = arrays[key]
            fill = np.nan if column.dtype.kind == 'f' else -1
            truth[key] = np.full((len(recording), *column.shape[1:]), fill, column.dtype)
            truth[key][rows[kept]] = column[kept]
    return truth, kept


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
    """Force and torque of WrenchStamped, with its time."""
    truth: Columns = {name: vectors_of(columns, f'wrench.{name}') for name in ('force', 'torque')}
    return {'stamp_ns': stamps_of(columns), **truth}


def _pose(columns: Columns) -> Columns:
    """Position and pose of PoseStamped, with or without covariance, with its time."""
    path = 'pose.pose' if 'pose.pose.position.x' in columns else 'pose'
    position = vectors_of(columns, f'{path}.position')
    turn = np.stack([columns[f'{path}.orientation.{axis}'] for axis in 'xyzw'], axis=1)
    matrix = np.full((len(position), 4, 4), np.nan)
    matrix[:, :3, 3] = position
    matrix[:, 3] = 0.0, 0.0, 0.0, 1.0
    measured = np.isfinite(turn).all(axis=1) & (np.linalg.norm(turn, axis=1) > 0)
    if measured.any():
        matrix[measured, :3, :3] = Rotation.from_quat(turn[measured]).as_matrix()
    return {'stamp_ns': stamps_of(columns), 'position': position, 'object_pose': matrix}


STANDARD: dict[str, Callable[[Columns], Columns]] = {
    'geometry_msgs/msg/WrenchStamped': _wrench,
    'geometry_msgs/msg/PoseStamped': _pose,
    'geometry_msgs/msg/PoseWithCovarianceStamped': _pose,
}
TRUTH_TYPES = (*STANDARD, STRING, CONTACTS)


def read_standard(messages: Sequence[bytes], type_name: str) -> Rows:
    """Truth by key, and `stamp_ns`, of serialised messages of one of the types of `STANDARD`."""
    return read_rows(messages, type_name, STANDARD[type_name])


def read_texts(messages: Sequence[bytes]) -> tuple[Integers, list[str]]:
    """Places among all, and texts, of serialised std_msgs/String that can be read."""
    groups, _ = read_columns(messages, STRING)
    texts = {
        int(row): text_at(group.columns['data'], i)
        for group in groups
        for i, row in enumerate(group.rows)
    }
    rows = sorted(texts)
    return np.array(rows, np.int64), [texts[row] for row in rows]


class TruthTopics:
    """Topics that tell the truth about one sensor, associated with its frames piece by piece."""

    def __init__(self, association: Association) -> None:
        self.association = association
        self.names: tuple[str, ...] = ()
        self.lost: Counter[str] = Counter()
        self._tolerances: dict[str, int] = {}
        self._buffers: dict[str, MessageBuffer] = {}

    @property
    def sentences(self) -> dict[str, str]:
        """How each topic was brought together with frames."""
        sentences = {}
        for topic, buffer in self._buffers.items():
            asked = self.association.tolerance_ns
            within = self._tolerances.get(topic) if asked is None else asked
            if buffer.type_name == STRING:
                sentences[topic] = 'holds from when it was heard until the next'
            elif within is not None:
                delay = self.association.delays.get(topic, 0)
                late = f'{delay * 1e-6:.3g} ms late{self.association.remarks.get(topic, "")}'
                sentences[topic] = f'within {within * 1e-6:.3g} ms, {late}'
        return sentences

    def taker(self, topic: str, type_name: str) -> Taker:
        """Who takes the messages of a topic."""
        return self._buffers.setdefault(topic, MessageBuffer(type_name)).append

    def beside(
        self,
        recording: Recording,
        index: Mapping[tuple[int, int], int],
        around: Integers,
        last_ns: int,
        until: int,
    ) -> Columns:
        """Truth beside the frames of a piece; a later topic fills what an earlier left unknown.

        Parameters
        ----------
        recording : Recording
            Of s frames, the last of which was heard at `last_ns`.
        index, around
            As of `contacts_truth`: frames shortly before and after the piece, too.
        last_ns, until : int
            Log times (ns); what is heard after `until` is not looked at.
        """
        merged: Columns = {}
        assert recording.stamp_ns is not None
        frames = recording.stamp_ns
        near = np.concatenate([frames, around])
        for topic, buffer in self._buffers.items():
            count = buffer.heard_by(until)
            if buffer.type_name == STRING:
                part = self._labels(topic, buffer, count, frames)
            else:
                if buffer.type_name == CONTACTS:
                    taxels = recording.layout.shape[0]
                    rows = read_contacts(buffer.data[:count], taxels, TRUTH_KEYS)
                else:
                    rows = read_standard(buffer.data[:count], buffer.type_name)
                self._leave_out(topic, buffer, rows.rows, count)
                if not len(rows.rows):
                    continue
                if buffer.type_name == CONTACTS:
                    tolerance = self._tolerance(topic, near, near)
                    part, used = contacts_truth(rows.arrays, recording, index, tolerance, around)
                else:
                    times = rows.arrays.pop('stamp_ns').astype(np.int64)
                    times -= self.association.delays.get(topic, 0)
                    tolerance = self._tolerance(topic, times, near)
                    part, used = nearest_truth(rows.arrays, times, frames, tolerance)
                buffer.used.update(np.flatnonzero(used).tolist())
                # at the end of the bag nothing waits any longer
                late = until if until > last_ns + KEPT_NS else last_ns - KEPT_NS
                self.lost[f'messages of {topic} belong to no frame'] += buffer.forget_before(late)
            for key, value in part.items():
                earlier = merged.get(key, value)
                merged[key] = np.where(unknown(earlier), value, earlier)
        return merged

    def _leave_out(self, topic: str, buffer: MessageBuffer, rows: Integers, count: int) -> None:
        """Forget messages that cannot be read or do not fit."""
        if len(rows) < count:
            self.lost[f'messages of {topic} are damaged or do not fit'] += count - len(rows)
            buffer.keep(rows.tolist(), count)

    def _tolerance(self, topic: str, times: Integers, frames: Integers) -> int:
        """Largest distance in time (ns): as asked, else half a step of the first piece."""
        if self.association.tolerance_ns is not None:
            return self.association.tolerance_ns
        if topic not in self._tolerances and len(times) > 1:
            self._tolerances[topic] = max(half_step(times), half_step(frames))
        return self._tolerances.get(topic, half_step(frames))

    def _labels(self, topic: str, buffer: MessageBuffer, count: int, frames: Integers) -> Columns:
        """Names that hold until the next one; the last one before the next piece is kept."""
        rows, texts = read_texts(buffer.data[:count])
        self._leave_out(topic, buffer, rows, count)
        times = np.array(buffer.logs[: len(rows)], np.int64)
        if not len(times):
            return {}
        part, self.names = held_labels(texts, times, frames, self.names)
        buffer.take(max(int(np.searchsorted(times, frames[-1], side='right')) - 1, 0))
        return part


# Delay of a signal behind another: each stretch of the recording gives one estimate, the peak of
# the normalised cross-correlation; their median is the answer, and their scatter its uncertainty,
# so that a few stretches in which nothing or something else happened do no harm.

MOST_NS = 500_000_000
STRETCH_NS = 4_000_000_000
LEAST_STEP_NS = 1_000_000
LEAST_CORRELATION = 0.5
FEWEST = 3
FINEST = 0.2  # steps: how far off a peak between two steps may be in every stretch alike
QUIET = 0.1  # of the usual scatter: a stretch in which nothing happens
MAD, MEDIAN = 1.4826, 1.2533  # scatter of a normal variable from its median; of a median
MOST_FRAMES = 12_000
MOST_TRUTH = 200_000


@dataclass(frozen=True)
class Delay:
    """How much later one signal is.

    Attributes
    ----------
    delay_ns, std_ns : float
        Of the median of the stretches.
    correlation : float
        Median of the peaks, 0..1.
    stretches : int
        That count in the median.
    """

    delay_ns: float
    std_ns: float
    correlation: float
    stretches: int

    @property
    def significant(self) -> bool:
        """Whether the delay stands out of its uncertainty."""
        return abs(self.delay_ns) > 3 * self.std_ns


def estimate_delay(
    times: Integers, signal: Array, late_times: Integers, late_signal: Array
) -> Delay | None:
    """Delay of a signal behind another, up to half a second either way.

    Parameters
    ----------
    times, late_times : ndarray, shape (n,), (m,)
        When each was read (ns), increasing.
    signal, late_signal : ndarray, shape (n,), (m,)
        Of any unit, and of either sign to one another.

    Returns
    -------
    Delay or None
        None where fewer than three stretches of four seconds correlate.

    Notes
    -----
    What the skin itself lags behind (its creep) is part of the answer.
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
        match = np.abs(windows @ centred) / spread
    match = np.where(np.isfinite(match), match, 0.0)
    top = int(match.argmax())
    if top in (0, len(match) - 1):
        return float(top), 0.0
    left, middle, right = match[top - 1 : top + 2]
    bend = left - 2 * middle + right
    return top + (0.5 * (left - right) / bend if bend < 0 else 0.0), float(middle)


def truth_delays(path: Path, truth_topics: Sequence[str]) -> dict[str, Delay | None]:
    """Delay of every topic of standard messages that tell the truth; None: not known.

    Truth that names its frame (TactileContacts with the frame's stamp or sequence) has none.

    Parameters
    ----------
    path : Path
        Of a bag; at most its first 12 000 frames are read.
    truth_topics : sequence of str
        As of `recording_files.load`.
    """
    frames: dict[str, MessageBuffer] = {}
    truth: dict[str, MessageBuffer] = {}
    content = BagContent()

    def may_be_late(topic: str, kind: str) -> bool:
        return kind in STANDARD and any(ends_as(topic, name) for name in truth_topics)

    def taker(topic: str, kind: str) -> Taker | None:
        if topic.endswith('/frame') and kind == FRAME:
            return frames.setdefault(topic, MessageBuffer(kind)).append
        if may_be_late(topic, kind):
            return truth.setdefault(topic, MessageBuffer(kind)).append
        return None

    for _ in read_bag(path, content, taker):
        topics = content.announced.items()
        if topics and not any(may_be_late(*item) for item in topics):
            return {}
        heard, measured = (
            max((len(buffer.logs) for buffer in group.values()), default=0)
            for group in (frames, truth)
        )
        if heard >= MOST_FRAMES or measured >= MOST_TRUTH:
            break
    return {topic: _delay(topic, buffer, frames) for topic, buffer in truth.items()}


def _delay(topic: str, buffer: MessageBuffer, frames: dict[str, MessageBuffer]) -> Delay | None:
    """Delay of one topic behind the frames of its sensor."""
    near = [t for t in frames if topic.startswith(t.removesuffix('frame'))] or list(frames)
    late = read_standard(buffer.data, buffer.type_name)
    if not near or not len(late.rows):
        return None
    own = frames[max(near, key=len)]
    groups, _ = read_columns(own.data, FRAME)
    widest = max((group.columns['values'].shape[1] for group in groups), default=0)
    groups = [group for group in groups if group.columns['values'].shape[1] == widest]
    if not groups:
        return None
    values = np.concatenate([group.columns['values'] for group in groups])
    times = np.concatenate([stamps_of(group.columns) for group in groups])
    logs = np.array(own.logs)[np.concatenate([group.rows for group in groups])]
    away = np.sqrt((np.nan_to_num(values - np.nanmedian(values, axis=0)) ** 2).sum(axis=1))
    level = _level(late.arrays)
    measured = np.isfinite(level)
    if not measured.any():
        return None
    late_times = late.arrays['stamp_ns'].astype(np.int64)[measured]
    heard = np.array(buffer.logs)[late.rows][measured]
    # clocks that were never set to one another differ by what the recorder heard of them
    apart = int(np.median(late_times - heard)) - int(np.median(times - logs))
    order, late_order = np.argsort(times, kind='stable'), np.argsort(late_times, kind='stable')
    delay = estimate_delay(
        times[order], away[order], late_times[late_order] - apart, level[measured][late_order]
    )
    if delay is None:
        return None
    return Delay(delay.delay_ns + apart, delay.std_ns, delay.correlation, delay.stretches)


def _level(truth: Columns) -> Array:
    """One number for each message: the size of a force, or the height of a probe."""
    if 'force' in truth:
        force = np.asarray(truth['force'], np.float64)
        return np.asarray(np.sqrt(np.nansum(force**2, axis=1)))
    return np.asarray(truth['position'], np.float64)[:, 2]


def associate(
    path: Path, truth_topics: Sequence[str], tolerance_ns: int | None, delay_ns: int | None
) -> Association:
    """How truth goes with the frames of a bag: as asked, else with the delays of the signals.

    Parameters
    ----------
    path : Path
        Of the bag.
    truth_topics : sequence of str
        As of `recording_files.load`.
    tolerance_ns, delay_ns : int or None
        None: half a step; estimated.
    """
    delays, remarks = {}, {}
    for topic, delay in truth_delays(path, truth_topics).items():
        if delay_ns is not None:
            delays[topic], remarks[topic] = delay_ns, ' as was said'
        elif delay is None:
            remarks[topic] = ' (assumed: the signals do not tell)'
        else:
            delays[topic] = round(delay.delay_ns) if delay.significant else 0
            remarks[topic] = (
                f' (estimated: {delay.delay_ns * 1e-6:.3g} +- {delay.std_ns * 1e-6:.2g} ms from '
                f'{delay.stretches} stretches, correlation {delay.correlation:.2f})'
            )
    return Association(tolerance_ns, delays, remarks)
