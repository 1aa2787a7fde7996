"""Recognised objects and surfaces as standard messages: poses and point clouds."""

from __future__ import annotations

from array import array
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, Protocol, cast

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tactile_ros.types import STATE_FIELDS, Frame, Layout, field_shape

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Array, ContactState


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


def is_valid(frame: Frame) -> bool:
    """Every reading of the frame is finite and no taxel has a status bit."""
    flagged = frame.status is not None and bool(np.any(frame.status))
    return not flagged and bool(np.isfinite(frame.values).all())


def fill_frame(message: FrameMessage, frame: Frame, frame_id: str) -> None:
    """Write one reading into a fresh TactileFrame."""
    fill_header(message.header, frame.stamp_ns, frame_id)
    message.sequence = frame.sequence
    message.device_time_ns = frame.device_time_ns
    message.dropped = frame.dropped
    message.values = packed(frame.values)
    if frame.temperature_c is not None:
        message.temperature_c = packed(frame.temperature_c)
    if frame.status is not None and np.any(frame.status):
        message.status = packed_bits(frame.status)
    message.valid = is_valid(frame)


def fill_baseline(message: FrameMessage, baseline: Frame, frame_id: str) -> None:
    """Write a baseline into a fresh TactileFrame: no clock reads it, `device_time_ns` counts."""
    fill_frame(message, baseline, frame_id)
    message.device_time_ns = baseline.averaged


def read_baseline(message: FrameMessage, shape: tuple[int, int]) -> Frame:
    """Frame of a message of the topic `baseline`, with the number of frames it is the mean of."""
    frame = read_frame(message, shape)
    return replace(frame, device_time_ns=0, averaged=frame.device_time_ns)


def read_frame(message: FrameMessage, shape: tuple[int, int]) -> Frame:
    """Frame of a TactileFrame.

    Parameters
    ----------
    message : TactileFrame
        Of rclpy or rosbags.
    shape : tuple of int
        Taxels and channels (t, c), from the layout.

    Returns
    -------
    Frame
        float64 values; empty fields are None.

    Raises
    ------
    ValueError
        If a field's length does not fit the shape.
    """
    taxels, channels = shape
    values = sized(f'values of a TactileFrame of {shape}', message.values, (taxels * channels,))
    chips = sized('temperature_c of TactileFrame', message.temperature_c, (0, taxels))
    bits = sized('status of TactileFrame', message.status, (0, taxels))
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
    message: LayoutMessage,
    layout: Layout,
    point: Callable[[], VectorMessage],
    quaternion: Callable[[], QuaternionMessage],
) -> None:
    """Write a layout into a fresh TactileLayout, with the classes of its points and rotations.

    Raises
    ------
    ValueError
        If the rotations are none (a mirrored chip, say).
    """
    fill_header(message.header, None, layout.frame_id)
    message.sensor, message.serial, message.unit = layout.sensor, layout.serial, layout.unit
    message.channels = list(layout.channels)
    message.positions = [point() for _ in layout.positions]
    for place, xyz in zip(message.positions, layout.positions, strict=True):
        fill_vector(place, xyz)
    message.orientations = [quaternion() for _ in layout.positions]
    for turn, xyzw in zip(message.orientations, _quaternions(layout), strict=True):
        turn.x, turn.y, turn.z, turn.w = xyzw.tolist()
    message.saturation = packed(np.asarray(layout.saturation))
    message.rate_hz = float(layout.rate_hz)


def _quaternions(layout: Layout) -> Array:
    """Rotations chip axes -> sensor axes as x, y, z, w, shape (t, 4)."""
    if layout.rotations is None:
        return np.tile([0.0, 0.0, 0.0, 1.0], (len(layout.positions), 1))
    turns = Rotation.from_matrix(layout.rotations)
    if not np.allclose(turns.as_matrix(), layout.rotations, atol=1e-6):
        msg = 'rotations of Layout must be proper rotations (orthonormal, right-handed)'
        raise ValueError(msg)
    quaternions: Array = turns.as_quat()
    return quaternions


def read_layout(message: LayoutMessage) -> Layout:
    """Layout of a TactileLayout; rotations are None where every chip is aligned.

    Raises
    ------
    ValueError
        If lengths do not fit one another or an orientation is no rotation.
    """
    positions = np.array([vector(p) for p in message.positions], np.float64).reshape(-1, 3)
    turns = np.array([(q.x, q.y, q.z, q.w) for q in message.orientations], np.float64)
    if len(turns) not in (0, len(positions)):
        msg = f'TactileLayout has {len(positions)} positions but {len(turns)} orientations'
        raise ValueError(msg)
    if len(turns) and not (np.abs(np.linalg.norm(turns, axis=1) - 1) < 1e-6).all():
        msg = 'orientations of TactileLayout must be unit quaternions'
        raise ValueError(msg)
    aligned = not len(turns) or bool((turns == [0.0, 0.0, 0.0, 1.0]).all())
    channels = tuple(str(name) for name in message.channels)
    limits = sized('saturation of TactileLayout', message.saturation, (0, len(channels)))
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
_VECTORS = ('force', 'torque', 'stray_field')
_TAXELS = ('taxel_force', 'deformation', 'taxel_status')
_SCALARS = tuple(name for name, (shape, _, _) in STATE_FIELDS.items() if not shape)
_PATCH_VECTORS = ('contacts_position', 'contacts_normal', 'contacts_force')
_PATCH_COVARIANCES = ('contacts_position_cov', 'contacts_force_cov')
_WRENCH_BLOCKS = {'force_cov': slice(0, 3), 'torque_cov': slice(3, 6)}


def fill_contacts(
    message: ContactsMessage, state: ContactState, patch: Callable[[], PatchMessage]
) -> None:
    """Write a state (or a row of truth) into a fresh TactileContacts, header and sequence apart.

    The position of the state is that of the first patch. Where it is not (truth without patches,
    the origin of a recognised object), one more entry of id -1 at the end holds it.
    """
    for name in _SCALARS:
        setattr(message, name, np.asarray(getattr(state, name)).item())
    for name in _TAXELS:
        _fill_taxels(message, name, getattr(state, name))
    for name in _VECTORS:
        fill_vector(_place(message, FIELD_NAMES.get(name, name)), getattr(state, name))
    covariance = np.full((6, 6), np.nan)
    for name, block in _WRENCH_BLOCKS.items():
        covariance[block, block] = getattr(state, name)
    message.wrench_covariance = covariance.ravel()
    message.contacts = _patches(state, patch)
    message.session = message.repetition = -1


def _place(message: object, path: str) -> VectorMessage:
    """Vector inside a message by its dotted path."""
    for name in path.split('.'):
        message = getattr(message, name)
    return cast('VectorMessage', message)


def _fill_taxels(message: ContactsMessage, name: str, values: npt.NDArray[np.generic]) -> None:
    """Write a per-taxel array; nothing known is written as nothing."""
    if values.dtype == np.uint8:
        setattr(message, name, packed_bits(values) if values.any() else packed_bits(()))
    else:
        setattr(message, name, packed(values if np.isfinite(values).any() else ()))


def _patches(state: ContactState, patch: Callable[[], PatchMessage]) -> list[PatchMessage]:
    """Patches of a state, and what it says about position where the first does not say it."""
    found = []
    for k in np.flatnonzero(state.contacts_id >= 0):
        entry = patch()
        entry.id = int(state.contacts_id[k])
        for name in _PATCH_VECTORS:
            fill_vector(_place(entry, FIELD_NAMES[name]), getattr(state, name)[k])
        for name in _PATCH_COVARIANCES:
            setattr(entry, FIELD_NAMES[name], np.array(getattr(state, name)[k]).ravel())
        found.append(entry)
    if not _is_told(state, bool(found)):
        found.append(_lone_position(state, patch()))
    return found


def _is_told(state: ContactState, by_patch: bool) -> bool:
    """The first patch, or the absence of patches, says the position of the state."""
    if not by_patch:
        return not np.isfinite(state.position).any()
    return np.array_equal(
        state.contacts_position[0], state.position, equal_nan=True
    ) and np.array_equal(state.contacts_position_cov[0], state.position_cov, equal_nan=True)


def _lone_position(state: ContactState, entry: PatchMessage) -> PatchMessage:
    """Entry of id -1: a position that is no patch."""
    entry.id = -1
    fill_vector(entry.position, state.position)
    entry.position_covariance = np.array(state.position_cov).ravel()
    for name in ('contacts_normal', 'contacts_force'):
        fill_vector(_place(entry, FIELD_NAMES[name]), np.full(3, np.nan))
    setattr(entry, FIELD_NAMES['contacts_force_cov'], np.full(9, np.nan))
    return entry


def read_contacts(
    messages: Sequence[ContactsMessage], taxels: int
) -> dict[str, npt.NDArray[np.generic]]:
    """Arrays of s TactileContacts under the names of `STATE_FIELDS`, of results and truth alike.

    Parameters
    ----------
    messages : sequence of TactileContacts
        Of rclpy or rosbags, in their order.
    taxels : int
        Count t, for empty per-taxel fields.

    Returns
    -------
    dict of str to ndarray, shape (s, ...)
        Every state attribute (object_pose is not in the message: NaN), and `stamp_ns`,
        `sequence`, `session`, `repetition`, `label_name`, each of shape (s,).

    Raises
    ------
    ValueError
        If a field's length does not fit.
    """
    samples = len(messages)
    patches = max([1, *(sum(p.id >= 0 for p in m.contacts) for m in messages)])
    arrays: dict[str, npt.NDArray[np.generic]] = {
        name: np.full((samples, *field_shape(name, taxels, patches)), fill, dtype)
        for name, (_, dtype, fill) in STATE_FIELDS.items()
    }
    for row, message in enumerate(messages):
        _read_row({name: values[row : row + 1] for name, values in arrays.items()}, message)
    for name in ('sequence', 'session', 'repetition'):
        arrays[name] = np.array([getattr(m, name) for m in messages], np.int64)
    arrays['stamp_ns'] = np.array([stamp_ns(m.header) for m in messages], np.int64)
    arrays['label_name'] = np.array([m.label_name for m in messages], np.str_)
    return arrays


def _read_row(row: dict[str, npt.NDArray[np.generic]], message: ContactsMessage) -> None:
    """Write one message into its row, shape (1, ...), of every array."""
    for name in _SCALARS:
        row[name][0] = getattr(message, name)
    for name in _TAXELS:
        taxels = row[name].shape[1]
        values = sized(f'{name} of TactileContacts', getattr(message, name), (0, taxels))
        if len(values):
            row[name][0] = values
    for name in _VECTORS:
        row[name][0] = vector(_place(message, FIELD_NAMES.get(name, name)))
    covariance = sized('wrench_covariance', message.wrench_covariance, (36,)).reshape(6, 6)
    for name, block in _WRENCH_BLOCKS.items():
        row[name][0] = covariance[block, block]
    _read_patches(row, [p for p in message.contacts if p.id >= 0])
    for entry in (message.contacts[0], message.contacts[-1]) if message.contacts else ():
        if entry is message.contacts[0] or entry.id < 0:
            row['position'][0] = vector(entry.position)
            row['position_cov'][0] = np.reshape(entry.position_covariance, (3, 3))


def _read_patches(
    row: dict[str, npt.NDArray[np.generic]], patches: Sequence[PatchMessage]
) -> None:
    """Write the patches of one message into its row."""
    for k, entry in enumerate(patches):
        row['contacts_id'][0, k] = entry.id
        for name in _PATCH_VECTORS:
            row[name][0, k] = vector(_place(entry, FIELD_NAMES[name]))
        for name in _PATCH_COVARIANCES:
            values = sized(name, getattr(entry, FIELD_NAMES[name]), (9,))
            row[name][0, k] = values.reshape(3, 3)


def fill_wrench(
    message: WrenchStampedMessage, state: ContactState, unknown_as: UnknownAs = 'zero'
) -> None:
    """Write force and torque at the sensor origin, header apart; unknown is zero or NaN."""
    unknown = 0.0 if unknown_as == 'zero' else np.nan
    for part, values in (
        (message.wrench.force, state.force),
        (message.wrench.torque, state.torque),
    ):
        fill_vector(part, np.where(np.isfinite(values), values, unknown))


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
