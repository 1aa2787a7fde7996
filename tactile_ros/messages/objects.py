"""Recognised objects and surfaces as standard messages: poses and point clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.messages.fields import fill_vector

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.messages.fields import (
        PointCloudMessage,
        PointFieldMessage,
        PoseStampedMessage,
    )
    from tactile_ros.types import Array, ContactState

FLOAT32 = 7  # of sensor_msgs/PointField
BYTES = 4
AXES = ('x', 'y', 'z')


def fill_object_pose(message: PoseStampedMessage, state: ContactState) -> bool:
    """Write the pose of a recognised object into a PoseWithCovarianceStamped, header apart.

    Parameters
    ----------
    message : PoseWithCovarianceStamped
        Fresh; its covariance is of translation, then of rotation about fixed x, y, z.
    state : ContactState
        Of the frame.

    Returns
    -------
    bool
        Whether there is an object: without one there is nothing to publish.
    """
    pose = state.object_pose
    if not np.isfinite(pose).all():
        return False
    fill_vector(message.pose.pose.position, pose[:3, 3])
    turn = message.pose.pose.orientation
    turn.x, turn.y, turn.z, turn.w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    message.pose.covariance = np.array(state.object_pose_cov, np.float64).ravel()
    return True


def fill_surface(
    message: PointCloudMessage, points: Array, field: Callable[[], PointFieldMessage]
) -> None:
    """Write the surface of what is touched into a PointCloud2, header apart.

    Parameters
    ----------
    message : PointCloud2
        Fresh.
    points : ndarray, shape (t, 3)
        One for each taxel (m); NaN where nothing touches.
    field : callable
        Class of its fields.

    Notes
    -----
    Coordinates are 32 bits wide, as viewers expect them: 1 nm at 10 mm. The points keep the order
    of the taxels, those untouched included, so that the cloud is not dense.
    """
    message.height, message.width = 1, len(points)
    message.fields = [field() for _ in AXES]
    for i, (entry, name) in enumerate(zip(message.fields, AXES, strict=True)):
        entry.name, entry.offset, entry.datatype, entry.count = name, BYTES * i, FLOAT32, 1
    message.is_bigendian = False
    message.point_step = BYTES * len(AXES)
    message.row_step = message.point_step * len(points)
    message.is_dense = bool(np.isfinite(points).all())
    message.data = np.ascontiguousarray(points, '<f4').tobytes()
