"""TactileFrame <-> Frame and TactileLayout <-> Layout."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.messages.fields import (
    fill_header,
    fill_vector,
    packed,
    packed_bits,
    sized,
    stamp_ns,
    vector,
)
from tactile_ros.types import Frame, Layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.messages.fields import (
        FrameMessage,
        LayoutMessage,
        QuaternionMessage,
        VectorMessage,
    )
    from tactile_ros.types import Array


def is_valid(frame: Frame) -> bool:
    """Every reading of the frame is finite and no taxel has a status bit."""
    flagged = frame.status is not None and bool(np.any(frame.status))
    return not flagged and bool(np.isfinite(frame.values).all())


def fill_frame(message: FrameMessage, frame: Frame, frame_id: str) -> None:
    """Write one reading (or a baseline) into a fresh TactileFrame."""
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
