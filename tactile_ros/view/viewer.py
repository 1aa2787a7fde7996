# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Frames, states and grip to Foxglove: a live server, a file, or both.

Foxglove and its free sibling Lichtblick connect to the server; nothing is drawn here.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.errors import MissingPackageError, TactileError
from tactile_ros.types import Array, Closing

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from foxglove import messages

    from tactile_ros.types import ContactState, Frame, Layout

Rgba = tuple[float, float, float, float]
Scalars = dict[str, 'float | int | str | None']
GREY: Rgba = (0.6, 0.6, 0.6, 0.5)
COLD, WARM = np.array([0.23, 0.42, 0.75]), np.array([0.97, 0.45, 0.13])
CONTACT: Rgba = (0.97, 0.45, 0.13, 0.55)
FORCE: Rgba = (0.13, 0.45, 0.95, 0.95)
SLIPPING: Rgba = (0.9, 0.1, 0.25, 0.95)
COLOURS = ('red', 'green', 'blue', 'alpha')
METRES_PER_NEWTON = 5e-3
LEAST_SIGMA, MOST_SIGMA = 3e-4, 5e-3  # m, of a contact's ball
ARROW = 0.35  # length of the largest change of field, as a part of the skin
SHAFT, HEAD, HEAD_PART = 6e-4, 1.5e-3, 0.25  # diameters of an arrow (m), part of its length
WORDS = 3e-3  # m, height of letters
HOST = '127.0.0.1'  # this machine alone
FADE, LEAST = 0.999, 1e-12  # of the change that has the full colour: from frame to frame, at least


@dataclass(frozen=True)
class Ball:
    """An ellipsoid: middle (3,) and half axes (3,) in metres."""

    middle: Array
    half_axes: Array
    colour: Rgba


@dataclass(frozen=True)
class Arrow:
    """From a place (3,) along a vector (3,), in metres."""

    start: Array
    along: Array
    colour: Rgba


@dataclass(frozen=True)
class Scene:
    """Everything that is shown of one frame, in the sensor frame."""

    balls: list[Ball]
    arrows: list[Arrow]
    words: str


def scene_of(layout: Layout, frame: Frame, rest: Array, state: ContactState, most: float) -> Scene:
    """Taxels with what they feel since `rest` (t, c), contacts with two sigmas, and forces.

    A change of `most` (unit of the layout) has the full colour.
    """
    change = frame.values - rest
    apart = np.linalg.norm(layout.positions[:, None] - layout.positions[None], axis=-1)
    pitch = float(apart[apart > 0].min()) if (apart > 0).any() else 4e-3
    balls = [
        Ball(place, np.full(3, 0.175 * pitch), (red, green, blue, 0.9))
        for place, (red, green, blue) in zip(
            layout.positions, shade(change, most).tolist(), strict=True
        )
    ]
    arrows = []
    if layout.unit == 'T' and len(layout.channels) == 3:
        length = ARROW * max(float(np.ptp(layout.positions, axis=0).max()), 2 * pitch) / most
        turned = change if layout.rotations is None else np.einsum(
            'tij,tj->ti', layout.rotations, change
        )  # fmt: skip
        arrows = [
            Arrow(place, along * length, GREY)
            for place, along in zip(layout.positions, turned, strict=True)
            if np.isfinite(along).all()
        ]
    words = [f'{name} {int(getattr(state, name))}' for name in ('label', 'cell')
             if getattr(state, name) >= 0] + ['slips'] * int(state.slip == 1)  # fmt: skip
    return Scene([*balls, *_contacts(state)], [*arrows, *_forces(state)], ', '.join(words))


def shade(change: Array, most: float) -> Array:
    """Colours (t, 3), 0 to 1, of a change (t, c): cold to warm at `most`, grey not measured."""
    share = np.clip(np.linalg.norm(change, axis=1) / most, 0.0, 1.0)[:, None]
    return np.where(np.isnan(share), GREY[:3], COLD + share * (WARM - COLD))


def _contacts(state: ContactState) -> list[Ball]:
    """Contacts of two sigmas, such that they can be seen."""
    if state.in_contact == 0:
        return []
    balls = []
    patches = [(one.position, one.position_cov) for one in state.contacts]
    for place, cov in patches or [(state.position, state.position_cov)]:
        if np.isfinite(place[:2]).all():
            sigma = np.nan_to_num(_sigma(cov), nan=LEAST_SIGMA)
            half_axes = 2 * np.clip(sigma, LEAST_SIGMA, MOST_SIGMA)
            balls.append(Ball(np.nan_to_num(place), half_axes, CONTACT))
    return balls


def _sigma(cov: Array) -> Array:
    with np.errstate(invalid='ignore'):
        return np.asarray(np.sqrt(np.diagonal(cov)))


def _forces(state: ContactState) -> list[Arrow]:
    """Forces of the contacts, or the whole one at the contact."""
    patches = [(one.position, one.force) for one in state.contacts if np.isfinite(one.force).any()]
    return [
        Arrow(
            np.nan_to_num(place),
            METRES_PER_NEWTON * np.nan_to_num(force),
            SLIPPING if state.slip == 1 else FORCE,
        )
        for place, force in patches or [(state.position, state.force)]
        if np.nan_to_num(force).any()
    ]


def cloud(layout: Layout, change: Array, most: float, stamp_ns: int) -> messages.PointCloud:
    """Taxels at their places with the change of every channel (t, c) since they were untouched.

    `change` is its size, by which layouts colour taxels of any sensor; viewers without a layout
    take red, green, blue, which say the same as the scene: warm at the change `most`.
    """
    from foxglove import messages

    names = ['x', 'y', 'z', *(f'change_{channel}' for channel in layout.channels), 'change']
    size = np.linalg.norm(change, axis=1, keepdims=True)
    shades = np.rint(255 * np.column_stack([shade(change, most), np.ones(len(change))]))
    row = np.dtype([*((name, '<f8') for name in names), *((name, 'u1') for name in COLOURS)])
    table = np.zeros(len(change), row)
    columns = [*np.hstack([layout.positions, change, size]).T, *shades.T]
    for name, column in zip((*names, *COLOURS), columns, strict=True):
        table[name] = column
    kinds = messages.PackedElementFieldNumericType
    return messages.PointCloud(
        timestamp=_stamp(stamp_ns),
        frame_id=layout.frame_id,
        point_stride=row.itemsize,
        fields=[
            messages.PackedElementField(
                name=name, offset=at, type=kinds.Uint8 if name in COLOURS else kinds.Float64
            )
            for name, (_, at, *_) in (row.fields or {}).items()
        ],
        data=table.tobytes(),
    )


def update(scene: Scene, frame_id: str, stamp_ns: int) -> messages.SceneUpdate:
    """A scene that takes the place of the one before."""
    from foxglove import messages

    spheres = [
        messages.SpherePrimitive(
            pose=_pose(ball.middle), size=_vector(2 * ball.half_axes), color=_colour(ball.colour)
        )
        for ball in scene.balls
    ]
    arrows = []
    for arrow in scene.arrows:
        length = float(np.linalg.norm(arrow.along))
        if length > 0:
            arrows.append(
                messages.ArrowPrimitive(
                    pose=_pose(arrow.start, arrow.along / length),
                    shaft_length=(1 - HEAD_PART) * length,
                    shaft_diameter=SHAFT,
                    head_length=HEAD_PART * length,
                    head_diameter=HEAD,
                    color=_colour(arrow.colour),
                )
            )
    texts = [
        messages.TextPrimitive(
            pose=_pose(scene.balls[-1].middle + np.array([0.0, 0.0, 2 * WORDS])),
            billboard=True, font_size=WORDS, color=_colour((0.5, 0.5, 0.5, 1.0)), text=scene.words,
        )
    ] if scene.words and scene.balls else []  # fmt: skip
    entity = messages.SceneEntity(
        timestamp=_stamp(stamp_ns), frame_id=frame_id, id='sensor', spheres=spheres,
        arrows=arrows, texts=texts,
    )  # fmt: skip
    return messages.SceneUpdate(entities=[entity])


def _stamp(stamp_ns: int) -> messages.Timestamp:
    from foxglove import messages

    seconds, rest = divmod(stamp_ns, 1_000_000_000)
    return messages.Timestamp(sec=seconds, nsec=rest)


def _vector(values: Array) -> messages.Vector3:
    from foxglove import messages

    x, y, z = values.tolist()
    return messages.Vector3(x=x, y=y, z=z)


def _colour(rgba: Rgba) -> messages.Color:
    from foxglove import messages

    red, green, blue, alpha = rgba
    return messages.Color(r=red, g=green, b=blue, a=alpha)


def _pose(place: Array, along: Array | None = None) -> messages.Pose:
    """A pose in the sensor frame; arrows are drawn along its x axis, here a unit vector."""
    from foxglove import messages

    turn = Rotation.identity()
    if along is not None:
        level = float(np.hypot(along[0], along[1]))
        angles = [np.arctan2(along[1], along[0]), -np.arctan2(along[2], level)]
        turn = Rotation.from_euler('ZY', angles)
    x, y, z, w = turn.as_quat().tolist()
    return messages.Pose(
        position=_vector(place), orientation=messages.Quaternion(x=x, y=y, z=z, w=w)
    )


class GripMessage(Protocol):
    """Fields of a GripState message that are shown."""

    phase: int
    fingers: Sequence[str]
    target_force: Sequence[float]
    force: Sequence[float]
    friction: Sequence[float]
    slip_margin: Sequence[float]
    limited: bool
    refusal: str
    input_age: float


def state_scalars(state: ContactState) -> Scalars:
    """Every number of a state that a plot may show, by name: force_x, force_x_sigma, slip, ...

    SI units; None: not estimated.
    """
    scalars: Scalars = {'valid': int(state.valid)}
    for name in ('force', 'torque', 'position', 'stray_field'):
        for axis, value in zip('xyz', getattr(state, name), strict=True):
            scalars[f'{name}_{axis}'] = _finite(value)
    for name, cov in (('force', state.force_cov), ('position', state.position_cov)):
        for axis, value in zip('xyz', _sigma(cov), strict=True):
            scalars[f'{name}_{axis}_sigma'] = _finite(value)
    for name in ('yaw', 'slip_probability', 'cell_probability', 'label_probability'):
        scalars[name] = _finite(getattr(state, name))
    for name in ('in_contact', 'slip', 'cell', 'label', 'status'):
        scalars[name] = int(getattr(state, name))
    return scalars


def grip_scalars(grip: GripMessage) -> Scalars:
    """Every number of a GripState by finger, its phase and why nothing was sent."""
    scalars: Scalars = {
        'phase': int(grip.phase), 'limited': int(grip.limited), 'refusal': str(grip.refusal),
        'input_age': _finite(grip.input_age),
    }  # fmt: skip
    for name in ('target_force', 'force', 'friction', 'slip_margin'):
        for finger, value in zip(grip.fingers, getattr(grip, name), strict=False):
            scalars[f'{finger}_{name}'] = _finite(value)
    return scalars


def json_schema(message: Mapping[str, object]) -> dict[str, object]:
    """JSON schema of such messages: which entries are numbers, which are text."""
    kinds = {
        name: {'type': 'string' if isinstance(value, str) else 'number'}
        for name, value in message.items()
    }
    return {'type': 'object', 'title': 'tactile_ros', 'properties': kinds}


def _finite(value: float) -> float | None:
    """A number, or None for NaN: json has none."""
    return float(value) if np.isfinite(value) else None


class Seen:
    """The untouched readings and the largest change of one sensor, as they were seen."""

    def __init__(self) -> None:
        self._rest: Array | None = None
        self._most = LEAST

    def scale(self, frame: Frame, state: ContactState) -> tuple[Array, float]:
        """Untouched readings (t, c), and the change that has the full colour."""
        values = frame.values
        if self._rest is None:
            self._rest = np.array(values)
        elif state.in_contact == 0:
            self._rest = np.where(np.isfinite(values), values, self._rest)
        change = np.linalg.norm(values - self._rest, axis=1)
        largest = float(np.nan_to_num(change).max(initial=0.0))
        self._most = max(FADE * self._most, largest, LEAST)
        return self._rest, self._most


class Viewer(Closing):
    """Show what sensors say, by a server at a port (0: any; None: no server) and in a file (MCAP).

    Raises MissingPackageError if foxglove-sdk is not installed, TactileError if the port is taken
    or the file exists.
    """

    def __init__(self, port: int | None, file: Path | None = None) -> None:
        try:
            import foxglove
            from foxglove import channels
        except ImportError as error:
            msg = 'tactile view needs foxglove-sdk: pip install foxglove-sdk'
            raise MissingPackageError(msg) from error
        self._foxglove, self._kinds = foxglove, channels
        self._context, self._held = foxglove.Context(), ExitStack()
        self._logs: dict[str, Callable[..., None]] = {}
        self._seen: dict[str, Seen] = {}
        self.address = ''  # where viewers connect; empty without a server
        try:
            if file is not None:
                self._held.enter_context(foxglove.open_mcap(str(file), context=self._context))
            if port is not None:
                server = foxglove.start_server(
                    name='tactile_ros', host=HOST, port=port, context=self._context
                )
                self._held.callback(server.stop)
                self.address = f'ws://{HOST}:{server.port}'
        except (OSError, RuntimeError) as error:
            self._held.close()
            msg = f'nothing can be shown at port {port} or in {file}: {error}'
            raise TactileError(msg) from error

    def close(self) -> None:
        """Close the server and the file."""
        self._held.close()

    def show(self, name: str, layout: Layout, frame: Frame, state: ContactState) -> None:
        """Show one frame of the sensor `name` ('' where there is but one)."""
        rest, most = self._seen.setdefault(name, Seen()).scale(frame, state)
        stamp_ns = frame.stamp_ns or 0
        scene = scene_of(layout, frame, rest, state, most)
        points = cloud(layout, frame.values - rest, most, stamp_ns)
        self._log(f'{name}/taxels', points, stamp_ns, 'PointCloud')
        shown = update(scene, layout.frame_id, stamp_ns)
        self._log(f'{name}/scene', shown, stamp_ns, 'SceneUpdate')
        self._log(f'{name}/state', state_scalars(state), stamp_ns)

    def grip(self, name: str, grip: GripMessage, stamp_ns: int) -> None:
        """Show the state of a grip."""
        self._log(f'{name}/grip', grip_scalars(grip), stamp_ns)

    def _log(self, topic: str, message: object, stamp_ns: int, kind: str = '') -> None:
        """One message of a kind of Foxglove, or json, on a channel made when first needed."""
        topic = topic if topic.startswith('/') else f'/{topic}'
        if topic not in self._logs:
            if kind:
                channel = getattr(self._kinds, f'{kind}Channel')(topic, context=self._context)
            else:
                schema = json_schema(message if isinstance(message, dict) else {})
                channel = self._foxglove.Channel(topic, schema=schema, context=self._context)
            self._logs[topic] = channel.log
        self._logs[topic](message, log_time=stamp_ns or None)
