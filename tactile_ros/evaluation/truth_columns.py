"""Truth that came as standard messages, many serialised messages at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.evaluation.cdr_columns import Columns, read_columns, text_at
from tactile_ros.evaluation.message_columns import stamps_of, vectors_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Array, Integers


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
