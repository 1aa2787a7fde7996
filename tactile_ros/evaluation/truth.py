"""By how much one signal is later than another, with how well that is known. Pure.

The delay of truth on a clock or a bus of its own is told by the signals themselves: where the
skin feels, the load cell reads. Each stretch of the recording gives one estimate, the peak of the
normalised cross-correlation; their median is the answer, and their scatter its uncertainty, so
that a few stretches in which nothing or something else happened do no harm.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.cdr_columns import Columns, read_columns, text_at
from tactile_ros.evaluation.message_columns import read_contact_rows, stamps_of, vectors_of
from tactile_ros.evaluation.topics import CONTACTS, STRING
from tactile_ros.evaluation.waiting import Waiting
from tactile_ros.messages import stamp_ns
from tactile_ros.types import TRUTH_KEYS, Array, Integers, admit_name

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tactile_ros.evaluation.bag_messages import Heard
    from tactile_ros.evaluation.bag_reader import Taker
    from tactile_ros.messages import HeaderMessage
    from tactile_ros.types import Array, Bools, Integers, Recording


class Told(NamedTuple):
    """What n messages say: their places among all, times (ns), truth by key, and the damaged."""

    rows: Integers
    times: Integers
    truth: Columns
    damaged: int


def read_told(messages: Sequence[bytes], type_name: str) -> Told:
    """Truth of serialised messages of one of the types of `READERS`."""
    groups, damaged = read_columns(messages, type_name)
    if not groups:
        return Told(np.zeros(0, np.int64), np.zeros(0, np.int64), {}, damaged)
    rows = np.concatenate([group.rows for group in groups])
    times = np.concatenate([stamps_of(group.columns) for group in groups])
    parts = [READERS[type_name](group.columns) for group in groups]
    order = np.argsort(rows, kind='stable')
    truth: Columns = {
        key: np.concatenate([part[key] for part in parts])[order] for key in parts[0]
    }
    return Told(rows[order], times[order], truth, damaged)


def read_texts(messages: Sequence[bytes]) -> tuple[Integers, list[str], int]:
    """Texts of serialised std_msgs/String: places among all, texts, and the damaged."""
    groups, damaged = read_columns(messages, 'std_msgs/msg/String')
    found = {
        int(row): text_at(group.columns['data'], i)
        for group in groups
        for i, row in enumerate(group.rows)
    }
    rows = np.array(sorted(found), np.int64)
    return rows, [found[row] for row in rows.tolist()], damaged


def _wrench(columns: Columns) -> dict[str, Array]:
    """Force and torque of WrenchStamped."""
    return {name: vectors_of(columns, f'wrench.{name}') for name in ('force', 'torque')}


def _pose(columns: Columns) -> dict[str, Array]:
    """Position and pose of PoseStamped, with or without covariance."""
    path = 'pose.pose' if 'pose.pose.position.x' in columns else 'pose'
    place = vectors_of(columns, f'{path}.position')
    turn = np.stack([columns[f'{path}.orientation.{axis}'] for axis in 'xyzw'], axis=1)
    matrix = np.full((len(place), 4, 4), np.nan)
    matrix[:, :3, 3] = place
    matrix[:, 3] = 0.0, 0.0, 0.0, 1.0
    known = np.isfinite(turn).all(axis=1) & (np.linalg.norm(turn, axis=1) > 0)
    if known.any():
        matrix[known, :3, :3] = Rotation.from_quat(turn[known]).as_matrix()
    return {'position': place, 'object_pose': matrix}


READERS: dict[str, Callable[[Columns], dict[str, Array]]] = {
    'geometry_msgs/msg/WrenchStamped': _wrench,
    'geometry_msgs/msg/PoseStamped': _pose,
    'geometry_msgs/msg/PoseWithCovarianceStamped': _pose,
}


DEFAULT_TRUTH = ('truth/contacts', 'truth/object_pose')
UNFOUND, ELSEWHERE = -1, -2  # in place of a row


@dataclass(frozen=True)
class Association:
    """How truth is brought together with frames.

    Attributes
    ----------
    tolerance_ns : int or None
        Largest distance in time; None: half a step of frames or truth, whichever is longer.
    delays : dict of str to int
        By how much the stamps of a topic are later than the frames that they belong to (ns).
    known : dict of str to str
        How well a delay is known, in a few words.
    """

    tolerance_ns: int | None = None
    delays: Mapping[str, int] = field(default_factory=dict)
    known: Mapping[str, str] = field(default_factory=dict)


def unknown(values: npt.NDArray[np.generic]) -> Bools:
    """Where truth is NaN or -1."""
    return np.isnan(values) if values.dtype.kind == 'f' else np.asarray(values == -1)


def contacts_truth(
    arrays: Columns,
    recording: Recording,
    index: dict[tuple[int, int], int],
    tolerance: int | None = None,
    around: Integers | None = None,
) -> tuple[Columns, Bools]:
    """Truth that came as TactileContacts.

    Parameters
    ----------
    arrays : dict of str to ndarray, shape (n, ...)
        As `messages.read_contacts` gives them.
    recording : Recording
        Of s frames.
    index : dict
        Row of a frame by its stamp (ns) and sequence; ELSEWHERE: of one that is not in the
        recording, but of the same stream.
    tolerance : int or None
        Largest distance in time (ns); None: half a frame.
    around : ndarray, shape (m,), or None
        Stamps of such frames (ns): what is nearest to one of them is not of the recording.

    Returns
    -------
    truth : dict of str to ndarray, shape (s, ...)
        Keys of which something is known; NaN or -1 elsewhere.
    found : ndarray, shape (n,)
        Messages that belong to a frame.

    Notes
    -----
    A message belongs to the frame of its stamp and sequence; without a stamp to that of its
    sequence; else to the frame nearest in time.
    """
    stamps = arrays['stamp_ns'].astype(np.int64)
    sequence = arrays['sequence'].astype(np.int64)
    keys = zip(stamps.tolist(), sequence.tolist(), strict=True)
    rows = np.array([index.get(key, UNFOUND) for key in keys], np.int64)
    by_sequence = {key[1]: row for key, row in index.items()}
    unstamped = (rows == UNFOUND) & (stamps == 0)
    rows[unstamped] = [by_sequence.get(k, UNFOUND) for k in sequence[unstamped].tolist()]
    timed = (rows == UNFOUND) & (stamps != 0)
    if timed.any() and recording.stamp_ns is not None:
        if tolerance is None:
            tolerance = half_step(recording.stamp_ns)
        frames = recording.stamp_ns
        frames = frames if around is None else np.concatenate([frames, around])
        near = nearest(frames, stamps[timed], tolerance)
        rows[timed] = np.where(near < len(recording), near, ELSEWHERE)
    kept = rows >= 0
    truth: Columns = {}
    for key in TRUTH_KEYS:
        if key in arrays and _known(arrays[key][kept]):
            truth[key] = _blank(arrays[key], len(recording))
            truth[key][rows[kept]] = arrays[key][kept]
    return truth, kept


def _known(values: npt.NDArray[np.generic]) -> bool:
    """Whether anything is told."""
    return bool(np.isfinite(values).any() if values.dtype.kind == 'f' else (values != -1).any())


def _blank(like: npt.NDArray[np.generic], samples: int) -> npt.NDArray[np.generic]:
    """An unknown column."""
    fill = np.nan if like.dtype.kind == 'f' else -1
    return np.full((samples, *like.shape[1:]), fill, like.dtype)


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


def other_truth(
    heard: list[Heard], recording: Recording, names: tuple[str, ...]
) -> tuple[Columns, tuple[str, ...], int]:
    """Truth that came as standard messages: nearest in time, text until the next one.

    Parameters
    ----------
    heard : list of Heard
        Of one topic.
    recording : Recording
        Of s frames.
    names : tuple of str
        Names of labels so far.

    Returns
    -------
    truth : dict of str to ndarray, shape (s, ...)
        NaN or -1 where unknown.
    names : tuple of str
        Names of labels; `label` counts in them.
    lost : int
        Messages near no frame.
    """
    if recording.stamp_ns is None or not heard:
        return {}, names, len(heard)
    if heard[0].type_name == 'std_msgs/msg/String':
        truth, names = _labels(heard, recording.stamp_ns, names)
        return truth, names, 0
    read = TRUTH_TOPICS_READERS[heard[0].type_name]
    times = np.array([stamp_ns(_header(h)) for h in heard], np.int64)
    parts = [read(h.message) for h in heard]
    told = {key: np.stack([part[key] for part in parts]) for key in parts[0]}
    columns, found = nearest_truth(told, times, recording.stamp_ns)
    return columns, names, int((~found).sum())


def nearest_truth(
    told: Mapping[str, npt.NDArray[np.generic]],
    times: Integers,
    frames: Integers,
    tolerance: int | None = None,
) -> tuple[Columns, Bools]:
    """What was told nearest in time to each frame.

    Parameters
    ----------
    told : dict of str to ndarray, shape (n, ...)
        Truth by key.
    times : ndarray, shape (n,)
        When it was true (ns, of the frames' clock).
    frames : ndarray, shape (s,)
        Acquisition times (ns).
    tolerance : int or None
        Largest distance (ns); None: half a step of frames or truth, whichever is longer.

    Returns
    -------
    truth : dict of str to ndarray, shape (s, ...)
        NaN where nothing is near.
    found : ndarray, shape (n,)
        What is near some frame.
    """
    if tolerance is None:
        tolerance = max(half_step(times), half_step(frames))
    rows = nearest(times, frames, tolerance)
    columns: Columns = {}
    for key, values in told.items():
        near = rows.reshape(-1, *[1] * (values.ndim - 1)) >= 0
        columns[key] = np.where(near, values[rows], np.nan)
    return columns, nearest(frames, times, tolerance) >= 0


def _header(heard: Heard) -> HeaderMessage:
    return cast('HeaderMessage', heard.message.header)  # type: ignore[attr-defined]


def _labels(
    heard: list[Heard], frames: Integers, names: tuple[str, ...]
) -> tuple[Columns, tuple[str, ...]]:
    """Names that hold from when they were heard until the next; an empty one is unknown."""
    told = [str(h.message.data) for h in heard]  # type: ignore[attr-defined]
    times = np.array([h.log_ns for h in heard], np.int64)
    return held_labels(told, times, frames, names)


def held_labels(
    told: list[str], times: Integers, frames: Integers, names: tuple[str, ...]
) -> tuple[Columns, tuple[str, ...]]:
    """Labels of frames (s,) from n names and when each was heard (ns), as `other_truth`."""
    told = [_label(name) for name in told]
    names = tuple(dict.fromkeys([*names, *filter(None, told)]))
    index = np.array([names.index(name) if name else -1 for name in told], np.int64)
    order = np.argsort(times, kind='stable')
    last = np.searchsorted(times[order], frames, side='right') - 1
    return {'label': np.where(last >= 0, index[order][last], -1)}, names


def _label(name: str) -> str:
    """A label that fits the pattern of names."""
    try:
        return admit_name('label of a recording', name)
    except ValueError as err:
        raise RecordingError(str(err)) from err


def _vector(xyz: object) -> Array:
    return np.array([getattr(xyz, axis) for axis in 'xyz'], np.float64)


def _truth_topics_wrench(message: object) -> dict[str, Array]:
    """Force and torque of a WrenchStamped."""
    wrench = message.wrench  # type: ignore[attr-defined]
    return {'force': _vector(wrench.force), 'torque': _vector(wrench.torque)}


def _truth_topics_pose(message: object) -> dict[str, Array]:
    """Position and pose of a PoseStamped, with or without covariance."""
    pose = message.pose  # type: ignore[attr-defined]
    pose = getattr(pose, 'pose', pose)
    turn = pose.orientation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w], np.float64)
    matrix = np.full((4, 4), np.nan)
    matrix[:3, 3] = _vector(pose.position)
    matrix[3] = 0.0, 0.0, 0.0, 1.0
    if np.isfinite(quaternion).all() and np.linalg.norm(quaternion) > 0:
        matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    return {'position': matrix[:3, 3], 'object_pose': matrix}


TRUTH_TOPICS_READERS: dict[str, Callable[[object], dict[str, Array]]] = {
    'geometry_msgs/msg/WrenchStamped': _truth_topics_wrench,
    'geometry_msgs/msg/PoseStamped': _truth_topics_pose,
    'geometry_msgs/msg/PoseWithCovarianceStamped': _truth_topics_pose,
}


def is_truth_type(type_name: str) -> bool:
    """Whether truth can come as this type."""
    return type_name in (
        *TRUTH_TOPICS_READERS,
        'std_msgs/msg/String',
        'tactile_ros/msg/TactileContacts',
    )


Index = dict[tuple[int, int], int]
TRUTH = frozenset(TRUTH_KEYS)
KEPT_NS = 2_000_000_000  # of log time that truth waits for frames that are heard after it


class TruthPieces:
    """Gathers what is true about one sensor.

    Parameters
    ----------
    association : Association
        Tolerance, and delays by topic.
    """

    def __init__(self, association: Association) -> None:
        self.association = association
        self.names: tuple[str, ...] = ()
        self.lost: Counter[str] = Counter()
        self.tolerances: dict[str, int] = {}
        self._queues: dict[str, Waiting] = {}

    @property
    def sentences(self) -> dict[str, str]:
        """How each topic was brought together with frames."""
        found = {}
        for topic, queue in self._queues.items():
            if queue.type_name == STRING:
                found[topic] = 'holds from when it was heard until the next'
                continue
            asked = self.association.tolerance_ns
            within = self.tolerances.get(topic) if asked is None else asked
            if within is not None:
                delay = self.association.delays.get(topic, 0)
                known = self.association.known.get(topic, '')
                late = f'{delay * 1e-6:.3g} ms late{known}'
                found[topic] = f'within {within * 1e-6:.3g} ms, {late}'
        return found

    def taker(self, topic: str, type_name: str) -> Taker:
        """Who takes the messages of a topic."""
        return self._queues.setdefault(topic, Waiting(type_name)).append

    def of(
        self, recording: Recording, index: Index, around: Integers, last_ns: int, until: int
    ) -> Columns:
        """Truth beside the frames of a piece; a later topic fills what an earlier left unknown.

        Parameters
        ----------
        recording : Recording
            Of s frames, the last of which was heard at `last_ns`.
        index : dict
            Row of a frame by stamp and sequence.
        around : ndarray, shape (m,)
            Stamps of frames shortly before and after the piece (ns).
        last_ns, until : int
            Log times (ns); what is heard after `until` is not looked at.
        """
        merged: Columns = {}
        assert recording.stamp_ns is not None
        for topic, queue in self._queues.items():
            count = queue.heard_by(until)
            if queue.type_name == STRING:
                part = self._labels(topic, queue, count, recording.stamp_ns)
            else:
                part, used = self._nearest(topic, queue, count, recording, index, around)
                queue.use(np.flatnonzero(used).tolist())
                # at the end of the bag nothing waits any longer
                late = until if until > last_ns + KEPT_NS else last_ns - KEPT_NS
                self.lost[f'messages of {topic} belong to no frame'] += queue.forget_before(late)
            for key, value in part.items():
                known = merged.get(key, value)
                merged[key] = np.where(unknown(known), value, known)
        return merged

    def _nearest(
        self,
        topic: str,
        queue: Waiting,
        count: int,
        recording: Recording,
        index: Index,
        around: Integers,
    ) -> tuple[Columns, Bools]:
        """Truth by stamp and sequence, or by the nearest time; which messages were of use."""
        assert recording.stamp_ns is not None
        frames = recording.stamp_ns
        near = np.concatenate([frames, around])
        if queue.type_name == CONTACTS:
            found = read_contact_rows(queue.data[:count], recording.layout.shape[0], TRUTH)
            self._leave_out(topic, queue, found.rows, count)
            tolerance = self._tolerance(topic, near, near)
            return contacts_truth(found.arrays, recording, index, tolerance, around)
        told = read_told(queue.data[:count], queue.type_name)
        self._leave_out(topic, queue, told.rows, count)
        times = told.times - self.association.delays.get(topic, 0)
        return nearest_truth(told.truth, times, frames, self._tolerance(topic, times, near))

    def _leave_out(self, topic: str, queue: Waiting, rows: Integers, count: int) -> None:
        """Forget messages that cannot be read or do not fit."""
        if len(rows) < count:
            self.lost[f'messages of {topic} are damaged or do not fit'] += count - len(rows)
            queue.keep(rows.tolist(), count)

    def _tolerance(self, topic: str, times: Integers, frames: Integers) -> int:
        """Largest distance in time (ns): as asked, else half a step of the first piece."""
        if self.association.tolerance_ns is not None:
            return self.association.tolerance_ns
        if topic not in self.tolerances and len(times) > 1:
            self.tolerances[topic] = max(half_step(times), half_step(frames))
        return self.tolerances.get(topic, half_step(frames))

    def _labels(self, topic: str, queue: Waiting, count: int, frames: Integers) -> Columns:
        """Names that hold until the next one; the last one before the next piece is kept."""
        rows, texts, _ = read_texts(queue.data[:count])
        self._leave_out(topic, queue, rows, count)
        times = np.array(queue.logs[: len(rows)], np.int64)
        if not len(times):
            return {}
        part, self.names = held_labels(texts, times, frames, self.names)
        past = int(np.searchsorted(times, frames[-1], side='right')) - 1
        queue.take(max(past, 0))
        return part


MOST_NS = 500_000_000
STRETCH_NS = 4_000_000_000
LEAST_STEP_NS = 1_000_000
LEAST_CORRELATION = 0.5
FEWEST = 3
FINEST = 0.2  # steps: how far off a peak between two steps may be in every stretch alike
QUIET = 0.1  # of the usual scatter: a stretch in which nothing happens
MAD, MEDIAN = 1.4826, 1.2533  # scatter of a normal variable from its median; of a median


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
        That told it.
    """

    delay_ns: float
    std_ns: float
    correlation: float
    stretches: int

    @property
    def told(self) -> bool:
        """Whether there is a delay that stands out of its uncertainty."""
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
        None where fewer than three stretches of four seconds tell it.

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
    reach, length = round(MOST_NS / step), round(STRETCH_NS / step)
    count = int((end - begin) // step)
    if count < FEWEST * length:
        return None
    grid = np.arange(-reach, count + reach) * step
    one = np.interp(grid[reach:-reach], times - begin, signal)
    other = np.interp(grid, late_times - begin, late_signal)
    usual = float(np.std(one)), float(np.std(other))
    found = []
    for first in range(0, count - length + 1, length):
        part, late = one[first : first + length], other[first : first + length + 2 * reach]
        if part.std() > QUIET * usual[0] and late.std() > QUIET * usual[1]:
            found.append(_peak(part, late))
    good = np.array([(lag, top) for lag, top in found if top >= LEAST_CORRELATION])
    if len(good) < FEWEST:
        return None
    lag = float(np.median(good[:, 0]))
    scatter = MAD * float(np.median(np.abs(good[:, 0] - lag)))
    std = max(scatter, FINEST) * MEDIAN / np.sqrt(len(good))
    return Delay((lag - reach) * step, float(std) * step, float(np.median(good[:, 1])), len(good))


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
