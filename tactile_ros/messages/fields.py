"""What this package asks of messages: attributes only, so rclpy and rosbags objects both fit."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array


class VectorMessage(Protocol):
    """geometry_msgs/Point or Vector3."""

    x: float
    y: float
    z: float


class QuaternionMessage(VectorMessage, Protocol):
    """geometry_msgs/Quaternion."""

    w: float


class StampMessage(Protocol):
    """builtin_interfaces/Time."""

    sec: int
    nanosec: int


class HeaderMessage(Protocol):
    """std_msgs/Header."""

    stamp: StampMessage
    frame_id: str


class FrameMessage(Protocol):
    """tactile_ros/TactileFrame."""

    header: HeaderMessage
    sequence: int
    device_time_ns: int
    dropped: int
    values: Sequence[float]
    temperature_c: Sequence[float]
    status: Sequence[int]
    valid: bool


class LayoutMessage(Protocol):
    """tactile_ros/TactileLayout."""

    header: HeaderMessage
    sensor: str
    serial: str
    unit: str
    channels: Sequence[str]
    positions: Sequence[VectorMessage]
    orientations: Sequence[QuaternionMessage]
    saturation: Sequence[float]
    rate_hz: float


class PatchMessage(Protocol):
    """tactile_ros/TactileContact."""

    id: int
    position: VectorMessage
    position_covariance: npt.NDArray[np.float64]


class WrenchMessage(Protocol):
    """geometry_msgs/Wrench."""

    force: VectorMessage
    torque: VectorMessage


class WrenchStampedMessage(Protocol):
    """geometry_msgs/WrenchStamped."""

    header: HeaderMessage
    wrench: WrenchMessage


class PoseMessage(Protocol):
    """geometry_msgs/Pose."""

    position: VectorMessage
    orientation: QuaternionMessage


class PoseWithCovarianceMessage(Protocol):
    """geometry_msgs/PoseWithCovariance."""

    pose: PoseMessage
    covariance: npt.NDArray[np.float64]


class PoseStampedMessage(Protocol):
    """geometry_msgs/PoseWithCovarianceStamped."""

    header: HeaderMessage
    pose: PoseWithCovarianceMessage


class PointFieldMessage(Protocol):
    """sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    count: int


class PointCloudMessage(Protocol):
    """sensor_msgs/PointCloud2."""

    header: HeaderMessage
    height: int
    width: int
    fields: Sequence[PointFieldMessage]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: bytes
    is_dense: bool


class ContactsMessage(Protocol):
    """tactile_ros/TactileContacts; fields of the table above are reached by their names."""

    header: HeaderMessage
    sequence: int
    contacts: Sequence[PatchMessage]
    wrench: WrenchMessage
    wrench_covariance: npt.NDArray[np.float64]
    label_name: str
    session: int
    repetition: int


def stamp_ns(header: HeaderMessage) -> int:
    """Time of a header (ns)."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def fill_header(header: HeaderMessage, stamp_ns: int | None, frame_id: str) -> None:
    """Write a time (ns; None: zero) and the name of a frame."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns or 0, 1_000_000_000)
    header.frame_id = frame_id


def packed(values: npt.ArrayLike) -> array[float]:
    """Numbers as rclpy takes them fastest."""
    return array('d', np.ascontiguousarray(values, np.float64).tobytes())


def packed_bits(values: npt.ArrayLike) -> array[int]:
    """Status bytes as rclpy takes them fastest."""
    return array('B', np.ascontiguousarray(values, np.uint8).tobytes())


def sized(name: str, values: npt.ArrayLike, lengths: tuple[int, ...]) -> Array:
    """Array of one message field, refused where its length is none of `lengths`."""
    got = np.asarray(values)
    if got.ndim != 1 or len(got) not in lengths:
        wanted = ' or '.join(str(n) for n in sorted(set(lengths)))
        msg = f'{name} must have {wanted} entries; received {got.shape}'
        raise ValueError(msg)
    return got


def vector(message: VectorMessage) -> tuple[float, float, float]:
    """Components of a point or vector."""
    return message.x, message.y, message.z


def fill_vector(message: VectorMessage, xyz: Array) -> None:
    """Write the components of a point or vector."""
    message.x, message.y, message.z = xyz.tolist()
