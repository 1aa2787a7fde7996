"""What was true, beside the frames: by sequence or stamp, or by the nearest time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tactile_ros.errors import RecordingError
from tactile_ros.messages import stamp_ns
from tactile_ros.types import TRUTH_KEYS, admit_name

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from tactile_ros.evaluation.bag_messages import Heard
    from tactile_ros.messages import HeaderMessage
    from tactile_ros.types import Array, Bools, Integers, Recording

DEFAULT_TRUTH = ('truth/contacts', 'truth/object_pose')
UNFOUND, ELSEWHERE = -1, -2  # in place of a row
Columns = dict[str, npt.NDArray[np.generic]]


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
    read = READERS[heard[0].type_name]
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


def _wrench(message: object) -> dict[str, Array]:
    """Force and torque of a WrenchStamped."""
    wrench = message.wrench  # type: ignore[attr-defined]
    return {'force': _vector(wrench.force), 'torque': _vector(wrench.torque)}


def _pose(message: object) -> dict[str, Array]:
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


READERS: dict[str, Callable[[object], dict[str, Array]]] = {
    'geometry_msgs/msg/WrenchStamped': _wrench,
    'geometry_msgs/msg/PoseStamped': _pose,
    'geometry_msgs/msg/PoseWithCovarianceStamped': _pose,
}


def is_truth_type(type_name: str) -> bool:
    """Whether truth can come as this type."""
    return type_name in (*READERS, 'std_msgs/msg/String', 'tactile_ros/msg/TactileContacts')
