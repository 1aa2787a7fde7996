# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Messages <-> types by attribute: the same code reads and fills objects of rclpy and of rosbags.

NaN and -1 (unknown) stay NaN and -1 in contacts; standard messages may say zero instead.
"""

from __future__ import annotations

from array import array
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tactile_ros.types import STATE_FIELDS, Frame, Layout, field_shape

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Array, Columns, ContactState

Message: TypeAlias = Any  # generated classes of rclpy and of rosbags carry no types
UnknownAs = Literal['zero', 'nan']
# state attribute -> field of TactileContacts, wherever the two names differ
FIELD_NAMES = {
    'force': 'wrench.force',
    'torque': 'wrench.torque',
    'force_cov': 'wrench_covariance',
    'torque_cov': 'wrench_covariance',
    'contacts_id': 'id',
    'contacts_position': 'position',
    'contacts_normal': 'normal',
    'contacts_force': 'force',
    'contacts_position_cov': 'position_covariance',
    'contacts_force_cov': 'force_covariance',
}
VECTORS = ('force', 'torque', 'stray_field')
TAXELS = ('taxel_force', 'deformation', 'taxel_status')
SCALARS = tuple(name for name, (shape, _, _) in STATE_FIELDS.items() if not shape)
PATCH_VECTORS = ('contacts_position', 'contacts_normal', 'contacts_force')
PATCH_COVARIANCES = ('contacts_position_cov', 'contacts_force_cov')
WRENCH_BLOCKS = {'force_cov': slice(0, 3), 'torque_cov': slice(3, 6)}
FLOAT32, FLOAT32_BYTES = 7, 4  # of sensor_msgs/PointField


def stamp_ns(header: Message) -> int:
    """Time of a header (ns)."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def fill_header(header: Message, stamp_ns: int | None, frame_id: str) -> None:
    """Write a time (ns; None: zero) and the name of a frame."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns or 0, 1_000_000_000)
    header.frame_id = frame_id


def packed(values: npt.ArrayLike) -> array[float]:
    """Numbers as rclpy takes them fastest."""
    return array('d', np.ascontiguousarray(values, np.float64).tobytes())


def packed_bits(values: npt.ArrayLike) -> array[int]:
    """Status bytes as rclpy takes them fastest."""
    return array('B', np.ascontiguousarray(values, np.uint8).tobytes())


def sized(name: str, values: npt.ArrayLike, *lengths: int) -> Array:
    """Array of one message field, refused where its length is none of `lengths`."""
    got = np.asarray(values)
    if got.ndim != 1 or len(got) not in lengths:
        wanted = ' or '.join(str(n) for n in sorted(set(lengths)))
        msg = f'{name} must have {wanted} entries; received {got.shape}'
        raise ValueError(msg)
    return got


def vector(message: Message) -> tuple[float, float, float]:
    """Components of a point or vector."""
    return message.x, message.y, message.z


def fill_vector(message: Message, xyz: Array) -> None:
    """Write the components of a point or vector."""
    message.x, message.y, message.z = xyz.tolist()


def _place(message: Message, name: str) -> Message:
    for part in FIELD_NAMES.get(name, name).split('.'):
        message = getattr(message, part)
    return message


def fill_frame(message: Message, frame: Frame, frame_id: str) -> None:
    """Write one reading into a fresh TactileFrame; valid: all is finite and no bit is set."""
    fill_header(message.header, frame.stamp_ns, frame_id)
    message.sequence = frame.sequence
    message.device_time_ns = frame.device_time_ns
    message.dropped = frame.dropped
    message.values = packed(frame.values)
    if frame.temperature_c is not None:
        message.temperature_c = packed(frame.temperature_c)
    flagged = frame.status is not None and bool(np.any(frame.status))
    if frame.status is not None and flagged:
        message.status = packed_bits(frame.status)
    message.valid = not flagged and bool(np.isfinite(frame.values).all())


def fill_baseline(message: Message, baseline: Frame, frame_id: str) -> None:
    """Write a baseline into a fresh TactileFrame: no clock reads it, `device_time_ns` counts."""
    fill_frame(message, baseline, frame_id)
    message.device_time_ns = baseline.averaged


def read_baseline(message: Message, shape: tuple[int, int]) -> Frame:
    """Frame of a message of the topic `baseline`, with the number of frames it is the mean of."""
    frame = read_frame(message, shape)
    return replace(frame, device_time_ns=0, averaged=frame.device_time_ns)


def read_frame(message: Message, shape: tuple[int, int]) -> Frame:
    """Frame of a TactileFrame; ValueError if a field's length does not fit the shape (t, c)."""
    taxels, channels = shape
    values = sized(f'values of a TactileFrame of {shape}', message.values, taxels * channels)
    chips = sized('temperature_c of TactileFrame', message.temperature_c, 0, taxels)
    bits = sized('status of TactileFrame', message.status, 0, taxels)
    return Frame(
        stamp_ns=stamp_ns(message.header),
        sequence=int(message.sequence),
        values=values.reshape(shape).astype(np.float64),
        temperature_c=chips.astype(np.float64) if len(chips) else None,
        status=bits.astype(np.uint8) if len(bits) else None,
        device_time_ns=int(message.device_time_ns),
        dropped=int(message.dropped),
    )


def fill_layout(
    message: Message,
    layout: Layout,
    point: Callable[[], Message],
    quaternion: Callable[[], Message],
) -> None:
    """Write a layout into a fresh TactileLayout; ValueError if its rotations are none."""
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(layout.positions), 1))
    if layout.rotations is not None:
        rotation = Rotation.from_matrix(layout.rotations)
        if not np.allclose(rotation.as_matrix(), layout.rotations, atol=1e-6):
            msg = 'rotations of Layout must be proper rotations (orthonormal, right-handed)'
            raise ValueError(msg)
        turns = rotation.as_quat()
    fill_header(message.header, None, layout.frame_id)
    message.sensor, message.serial, message.unit = layout.sensor, layout.serial, layout.unit
    message.channels = list(layout.channels)
    message.positions = [point() for _ in turns]
    message.orientations = [quaternion() for _ in turns]
    for place, turn, xyz, xyzw in zip(
        message.positions, message.orientations, layout.positions, turns, strict=True
    ):
        fill_vector(place, xyz)
        turn.x, turn.y, turn.z, turn.w = xyzw.tolist()
    message.saturation = packed(np.asarray(layout.saturation))
    message.rate_hz = float(layout.rate_hz)


def read_layout(message: Message) -> Layout:
    """Layout of a TactileLayout; ValueError if lengths do not fit or a turn is no rotation."""
    positions = np.array([vector(p) for p in message.positions], np.float64).reshape(-1, 3)
    turns = np.array([(*vector(q), q.w) for q in message.orientations], np.float64)
    if len(turns) not in (0, len(positions)):
        msg = f'TactileLayout has {len(positions)} positions but {len(turns)} orientations'
        raise ValueError(msg)
    if len(turns) and not (np.abs(np.linalg.norm(turns, axis=1) - 1) < 1e-6).all():
        msg = 'orientations of TactileLayout must be unit quaternions'
        raise ValueError(msg)
    aligned = not len(turns) or bool((turns == [0.0, 0.0, 0.0, 1.0]).all())
    channels = tuple(str(name) for name in message.channels)
    limits = sized('saturation of TactileLayout', message.saturation, 0, len(channels))
    return Layout(
        positions=positions,
        channels=channels,
        unit=str(message.unit),
        rotations=None if aligned else Rotation.from_quat(turns).as_matrix(),
        saturation=limits.astype(np.float64) if len(limits) else None,
        rate_hz=float(message.rate_hz),
        frame_id=str(message.header.frame_id),
        sensor=str(message.sensor),
        serial=str(message.serial),
    )


def fill_contacts(message: Message, state: ContactState, patch: Callable[[], Message]) -> None:
    """Write a state (or a row of truth) into a fresh TactileContacts, header and sequence apart.

    The position of the state is that of the first patch. Where it is not (truth without patches,
    the origin of a recognised object), one more entry of id -1 at the end holds it.
    """
    for name in SCALARS:
        setattr(message, name, np.asarray(getattr(state, name)).item())
    for name in TAXELS:
        values = getattr(state, name)
        if values.dtype == np.uint8:
            setattr(message, name, packed_bits(values if values.any() else ()))
        else:
            setattr(message, name, packed(values if np.isfinite(values).any() else ()))
    for name in VECTORS:
        fill_vector(_place(message, name), getattr(state, name))
    covariance = np.full((6, 6), np.nan)
    for name, block in WRENCH_BLOCKS.items():
        covariance[block, block] = getattr(state, name)
    message.wrench_covariance = covariance.ravel()
    rows = np.flatnonzero(state.contacts_id >= 0)
    message.contacts = [_patch(state, int(k), patch()) for k in rows]
    if not _first_patch_is_position(state, len(rows) > 0):
        message.contacts.append(_lone_position(state, patch()))
    message.session = message.repetition = -1


def _patch(state: ContactState, k: int, entry: Message) -> Message:
    entry.id = int(state.contacts_id[k])
    for name in PATCH_VECTORS:
        fill_vector(_place(entry, name), getattr(state, name)[k])
    for name in PATCH_COVARIANCES:
        setattr(entry, FIELD_NAMES[name], np.array(getattr(state, name)[k]).ravel())
    return entry


def _first_patch_is_position(state: ContactState, patches: bool) -> bool:
    """The first patch, or the absence of patches, says the position of the state."""
    if not patches:
        return not np.isfinite(state.position).any()
    return all(
        np.array_equal(getattr(state, f'contacts_{name}')[0], getattr(state, name), equal_nan=True)
        for name in ('position', 'position_cov')
    )


def _lone_position(state: ContactState, entry: Message) -> Message:
    """Entry of id -1: a position that is no patch."""
    entry.id = -1
    fill_vector(entry.position, state.position)
    entry.position_covariance = np.array(state.position_cov).ravel()
    for part in (entry.normal, entry.force):
        fill_vector(part, np.full(3, np.nan))
    entry.force_covariance = np.full(9, np.nan)
    return entry


def read_contacts(messages: Sequence[Message], taxels: int) -> Columns:
    """Arrays of s TactileContacts under the names of `STATE_FIELDS`, of results and truth alike.

    Beside every state attribute, shape (s, ...) (object_pose is not in the message: NaN), there
    are `stamp_ns`, `sequence`, `session`, `repetition` and `label_name`, shape (s,). Raises
    ValueError if a field's length does not fit.
    """
    samples = len(messages)
    patches = max([1, *(sum(p.id >= 0 for p in m.contacts) for m in messages)])
    arrays: Columns = {
        name: np.full((samples, *field_shape(name, taxels, patches)), fill, dtype)
        for name, (_, dtype, fill) in STATE_FIELDS.items()
    }
    for row, message in enumerate(messages):
        _read_contacts(arrays, row, message)
    for name in ('sequence', 'session', 'repetition'):
        arrays[name] = np.array([getattr(m, name) for m in messages], np.int64)
    arrays['stamp_ns'] = np.array([stamp_ns(m.header) for m in messages], np.int64)
    arrays['label_name'] = np.array([m.label_name for m in messages], np.str_)
    return arrays


def _read_contacts(arrays: Columns, row: int, message: Message) -> None:
    for name in SCALARS:
        arrays[name][row] = getattr(message, name)
    for name in TAXELS:
        taxels = arrays[name].shape[1]
        values = sized(f'{name} of TactileContacts', getattr(message, name), 0, taxels)
        if len(values):
            arrays[name][row] = values
    for name in VECTORS:
        arrays[name][row] = vector(_place(message, name))
    covariance = sized('wrench_covariance', message.wrench_covariance, 36).reshape(6, 6)
    for name, block in WRENCH_BLOCKS.items():
        arrays[name][row] = covariance[block, block]
    for k, entry in enumerate(p for p in message.contacts if p.id >= 0):
        arrays['contacts_id'][row, k] = entry.id
        for name in PATCH_VECTORS:
            arrays[name][row, k] = vector(_place(entry, name))
        for name in PATCH_COVARIANCES:
            values = sized(name, getattr(entry, FIELD_NAMES[name]), 9)
            arrays[name][row, k] = values.reshape(3, 3)
    for entry in (*message.contacts[:1], *(p for p in message.contacts[-1:] if p.id < 0)):
        arrays['position'][row] = vector(entry.position)
        arrays['position_cov'][row] = np.reshape(entry.position_covariance, (3, 3))


def fill_wrench(message: Message, state: ContactState, unknown_as: UnknownAs = 'zero') -> None:
    """Write force and torque into a WrenchStamped, header apart; unknown is zero or NaN."""
    unknown = 0.0 if unknown_as == 'zero' else np.nan
    for name in ('force', 'torque'):
        values = getattr(state, name)
        part = getattr(message.wrench, name)
        fill_vector(part, np.where(np.isfinite(values), values, unknown))


def fill_object_pose(message: Message, state: ContactState) -> bool:
    """Write the pose of an object into a PoseWithCovarianceStamped; False: there is none."""
    pose = state.object_pose
    if not np.isfinite(pose).all():
        return False
    fill_vector(message.pose.pose.position, pose[:3, 3])
    turn = message.pose.pose.orientation
    turn.x, turn.y, turn.z, turn.w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    message.pose.covariance = np.array(state.object_pose_cov, np.float64).ravel()
    return True


def fill_surface(message: Message, points: Array, field: Callable[[], Message]) -> None:
    """Write the touched surface, points (t, 3) (m), NaN untouched, into a PointCloud2.

    Coordinates are 32 bits wide, as viewers expect them. The points keep the order of the taxels.
    """
    message.height, message.width = 1, len(points)
    message.fields = [field() for _ in 'xyz']
    for i, entry in enumerate(message.fields):
        entry.name, entry.offset = 'xyz'[i], FLOAT32_BYTES * i
        entry.datatype, entry.count = FLOAT32, 1
    message.is_bigendian = False
    message.point_step = FLOAT32_BYTES * 3
    message.row_step = message.point_step * len(points)
    message.is_dense = bool(np.isfinite(points).all())
    message.data = np.ascontiguousarray(points, '<f4').tobytes()
