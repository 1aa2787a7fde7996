"""Poses of objects and surfaces in standard messages, over the wire where they are built."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_ros import messages
from tactile_ros.types import ContactStates


def state(**known: np.ndarray) -> object:
    """One state."""
    rows = {name: np.asarray(value)[None] for name, value in known.items()}
    return ContactStates.assemble(1, 3, rows)[0]


def pose_message() -> SimpleNamespace:
    """A fresh PoseWithCovarianceStamped, as far as it is written."""
    pose = SimpleNamespace(position=SimpleNamespace(), orientation=SimpleNamespace())
    return SimpleNamespace(pose=SimpleNamespace(pose=pose, covariance=None))


def test_the_pose_of_an_object_with_its_covariance() -> None:
    turn = Rotation.from_euler('z', 2.0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.as_matrix(), (1e-3, -2e-3, 0.0)
    cov = np.arange(36.0).reshape(6, 6)
    message = pose_message()
    assert messages.fill_object_pose(message, state(object_pose=pose, object_pose_cov=cov))
    place, quaternion = message.pose.pose.position, message.pose.pose.orientation
    assert (place.x, place.y, place.z) == (1e-3, -2e-3, 0.0)
    found = Rotation.from_quat([quaternion.x, quaternion.y, quaternion.z, quaternion.w])
    np.testing.assert_allclose(found.as_matrix(), turn.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(message.pose.covariance, np.arange(36.0))


def test_without_an_object_there_is_no_pose() -> None:
    assert not messages.fill_object_pose(pose_message(), state())


POINTS = np.array([[1e-3, 2e-3, -3e-4], [np.nan] * 3, [0.0, -1e-2, 5e-3]])


def test_the_surface_is_read_back_point_by_point() -> None:
    message = SimpleNamespace()
    messages.fill_surface(message, POINTS, SimpleNamespace)
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 3, 12, 36)
    assert not message.is_dense
    names = [(f.name, '<f4') for f in message.fields]
    assert [f.offset for f in message.fields] == [0, 4, 8]
    got = np.frombuffer(message.data, names)
    for i, name in enumerate('xyz'):
        np.testing.assert_array_equal(got[name], POINTS[:, i].astype(np.float32))


def test_both_pass_the_middleware() -> None:
    sensor = pytest.importorskip('sensor_msgs.msg')
    geometry = pytest.importorskip('geometry_msgs.msg')
    wire = pytest.importorskip('rclpy.serialization')
    cloud = sensor.PointCloud2()
    messages.fill_surface(cloud, POINTS, sensor.PointField)
    got = wire.deserialize_message(wire.serialize_message(cloud), sensor.PointCloud2)
    assert bytes(got.data) == np.ascontiguousarray(POINTS, '<f4').tobytes()
    pose = geometry.PoseWithCovarianceStamped()
    told = state(object_pose=np.eye(4), object_pose_cov=np.full((6, 6), 0.5))
    assert messages.fill_object_pose(pose, told)
    got = wire.deserialize_message(
        wire.serialize_message(pose), geometry.PoseWithCovarianceStamped
    )
    assert got.pose.pose.orientation.w == 1.0
    assert (np.asarray(got.pose.covariance) == 0.5).all()
