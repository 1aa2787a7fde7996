"""Scenes and taxels as messages of Foxglove."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.view.scene import warmth

if TYPE_CHECKING:
    from foxglove import messages

    from tactile_ros.types import Array, Layout
    from tactile_ros.view.scene import Arrow, Ball, Rgba, Scene

SECOND_NS = 1_000_000_000
COLOURS = ('red', 'green', 'blue', 'alpha')
SHAFT, HEAD = 6e-4, 1.5e-3  # m, diameters of an arrow
HEAD_PART = 0.25  # of an arrow's length
WORDS = 3e-3  # m, height of letters


def stamp(stamp_ns: int) -> messages.Timestamp:
    """A time."""
    from foxglove import messages

    seconds, rest = divmod(stamp_ns, SECOND_NS)
    return messages.Timestamp(sec=seconds, nsec=rest)


def cloud(layout: Layout, change: Array, most: float, stamp_ns: int) -> messages.PointCloud:
    """Taxels at their places with the change of every channel (t, c) since they were untouched.

    `change` is its size, by which layouts colour taxels of any sensor; viewers without a layout
    take red, green, blue, which say the same as the scene: warm at the change `most`.
    """
    from foxglove import messages

    names = ['x', 'y', 'z', *(f'change_{channel}' for channel in layout.channels), 'change']
    size = np.linalg.norm(change, axis=1, keepdims=True)
    kinds = messages.PackedElementFieldNumericType
    row = np.dtype([*((name, '<f8') for name in names), *((name, 'u1') for name in COLOURS)])
    table = np.zeros(len(change), row)
    for name, column in zip(names, np.hstack([layout.positions, change, size]).T, strict=True):
        table[name] = column
    shades = np.column_stack([warmth(change, most), np.ones(len(change))])
    for name, column in zip(COLOURS, np.rint(255 * shades).T, strict=True):
        table[name] = column
    offsets = {name: at for name, (_, at, *_) in (row.fields or {}).items()}
    return messages.PointCloud(
        timestamp=stamp(stamp_ns),
        frame_id=layout.frame_id,
        point_stride=row.itemsize,
        fields=[
            messages.PackedElementField(
                name=name, offset=at, type=kinds.Uint8 if name in COLOURS else kinds.Float64
            )
            for name, at in offsets.items()
        ],
        data=table.tobytes(),
    )


def update(scene: Scene, frame_id: str, stamp_ns: int) -> messages.SceneUpdate:
    """A scene that takes the place of the one before."""
    from foxglove import messages

    words = [
        messages.TextPrimitive(
            pose=_pose(scene.balls[-1].middle + np.array([0.0, 0.0, 2 * WORDS])),
            billboard=True, font_size=WORDS, color=_colour((0.5, 0.5, 0.5, 1.0)), text=scene.words,
        )
    ] if scene.words and scene.balls else []  # fmt: skip
    entity = messages.SceneEntity(
        timestamp=stamp(stamp_ns),
        frame_id=frame_id,
        id='sensor',
        spheres=[_ball(ball) for ball in scene.balls],
        arrows=[arrow for one in scene.arrows if (arrow := _arrow(one)) is not None],
        texts=words,
    )
    return messages.SceneUpdate(entities=[entity])


def _pose(place: Array, turn: Array | None = None) -> messages.Pose:
    """A pose; without a turn (x, y, z, w) that of the sensor."""
    from foxglove import messages

    x, y, z = place.tolist()
    a, b, c, d = (0.0, 0.0, 0.0, 1.0) if turn is None else turn.tolist()
    return messages.Pose(
        position=messages.Vector3(x=x, y=y, z=z),
        orientation=messages.Quaternion(x=a, y=b, z=c, w=d),
    )


def _colour(rgba: Rgba) -> messages.Color:
    from foxglove import messages

    red, green, blue, alpha = rgba
    return messages.Color(r=red, g=green, b=blue, a=alpha)


def _ball(ball: Ball) -> messages.SpherePrimitive:
    from foxglove import messages

    x, y, z = (2 * ball.half_axes).tolist()
    return messages.SpherePrimitive(
        pose=_pose(ball.middle), size=messages.Vector3(x=x, y=y, z=z), color=_colour(ball.colour)
    )


def _arrow(arrow: Arrow) -> messages.ArrowPrimitive | None:
    """An arrow; None where it has no length."""
    from foxglove import messages

    length = float(np.linalg.norm(arrow.along))
    if not length > 0:
        return None
    return messages.ArrowPrimitive(
        pose=_pose(arrow.start, _turn(arrow.along / length)),
        shaft_length=(1 - HEAD_PART) * length,
        shaft_diameter=SHAFT,
        head_length=HEAD_PART * length,
        head_diameter=HEAD,
        color=_colour(arrow.colour),
    )


def _turn(along: Array) -> Array:
    """Quaternion (x, y, z, w) from the x axis, along which arrows are drawn, to a unit vector."""
    axis = np.cross([1.0, 0.0, 0.0], along)
    sine, cosine = float(np.linalg.norm(axis)), float(along[0])
    if sine < 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0] if cosine > 0 else [0.0, 0.0, 1.0, 0.0])
    turn = Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine))
    return np.asarray(turn.as_quat())
