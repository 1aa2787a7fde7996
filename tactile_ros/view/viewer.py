# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Frames, states and grip to Foxglove: a live server, a file, or both.

Foxglove and its free sibling Lichtblick connect to the server; nothing is drawn here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.errors import TactileError, load_package
from tactile_ros.messages import Message
from tactile_ros.physics.magnetics import in_sensor_axes
from tactile_ros.types import Array, Closing, ContactState, Frame, Layout

if TYPE_CHECKING:
    from foxglove import messages

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


def sigma_of(cov: Array) -> Array:
    """Standard deviations (n,) of a covariance (n, n), NaN where they are unknown."""
    with np.errstate(invalid='ignore'):
        return np.asarray(np.sqrt(np.diagonal(cov)))


def shade(change: Array, most: float) -> Array:
    """Colours (t, 3), 0 to 1, of a change (t, c): cold to warm at `most`, grey not measured."""
    share = np.clip(np.linalg.norm(change, axis=1) / most, 0.0, 1.0)[:, None]
    return np.where(np.isnan(share), GREY[:3], COLD + share * (WARM - COLD))


class Scene:
    """Taxels, contacts and forces of one frame in the axes of its sensor, as Foxglove takes them.

    Taxels show their change (t, c) since they were untouched; that of `most` (unit of the layout)
    has the full colour.
    """

    def __init__(self, layout: Layout, change: Array, most: float, stamp_ns: int) -> None:
        from foxglove import messages

        self._messages, self._layout, self._change, self._most = messages, layout, change, most
        self._stamp = messages.Timestamp(*divmod(stamp_ns, 1_000_000_000))
        self._balls: list[messages.SpherePrimitive] = []
        self._arrows: list[messages.ArrowPrimitive] = []
        self._last = np.zeros(3)  # middle of the last ball

    def cloud(self) -> messages.PointCloud:
        """Taxels at their places with the change of every channel.

        `change` is its size, by which layouts colour taxels of any sensor; viewers without a
        layout take red, green, blue, which say the same as the scene: warm at the full change.
        """
        layout, change, kinds = self._layout, self._change, self._messages
        names = ['x', 'y', 'z', *(f'change_{channel}' for channel in layout.channels), 'change']
        size = np.linalg.norm(change, axis=1, keepdims=True)
        shades = np.rint(255 * np.column_stack([shade(change, self._most), np.ones(len(change))]))
        row = np.dtype([*((name, '<f8') for name in names), *((name, 'u1') for name in COLOURS)])
        table = np.zeros(len(change), row)
        columns = [*np.hstack([layout.positions, change, size]).T, *shades.T]
        for name, column in zip((*names, *COLOURS), columns, strict=True):
            table[name] = column
        number = kinds.PackedElementFieldNumericType
        fields = [
            kinds.PackedElementField(
                name=name, offset=at, type=number.Uint8 if name in COLOURS else number.Float64
            )
            for name, (_, at, *_) in (row.fields or {}).items()
        ]
        return self._messages.PointCloud(
            timestamp=self._stamp, frame_id=layout.frame_id, point_stride=row.itemsize,
            fields=fields, data=table.tobytes(),
        )  # fmt: skip

    def update(self, state: ContactState) -> messages.SceneUpdate:
        """Everything at once, in the place of what was shown before."""
        self._add_taxels()
        self._add_contacts(state)
        self._add_forces(state)
        words = [
            f'{name} {int(getattr(state, name))}'
            for name in ('label', 'cell')
            if getattr(state, name) >= 0
        ]
        text = self._messages.TextPrimitive(
            pose=self._pose(self._last + np.array([0.0, 0.0, 2 * WORDS])), billboard=True,
            font_size=WORDS, color=self._colour((0.5, 0.5, 0.5, 1.0)),
            text=', '.join(words + ['slips'] * int(state.slip == 1)),
        )  # fmt: skip
        entity = self._messages.SceneEntity(
            timestamp=self._stamp, frame_id=self._layout.frame_id, id='sensor',
            spheres=self._balls, arrows=self._arrows,
            texts=[text] if words or state.slip == 1 else [],
        )  # fmt: skip
        return self._messages.SceneUpdate(entities=[entity])

    def _add_taxels(self) -> None:
        layout, change, most = self._layout, self._change, self._most
        apart = np.linalg.norm(layout.positions[:, None] - layout.positions[None], axis=-1)
        pitch = float(apart[apart > 0].min()) if (apart > 0).any() else 4e-3
        for place, shades in zip(layout.positions, shade(change, most).tolist(), strict=True):
            self._ball(place, np.full(3, 0.175 * pitch), (*shades, 0.9))
        if layout.unit == 'T' and len(layout.channels) == 3:
            length = ARROW * max(float(np.ptp(layout.positions, axis=0).max()), 2 * pitch) / most
            turned = in_sensor_axes(change, layout.rotations)
            for i in np.flatnonzero(np.isfinite(turned).all(axis=1)):
                self._arrow(layout.positions[i], turned[i] * length, GREY)

    def _add_contacts(self, state: ContactState) -> None:
        """Contacts of two sigmas, such that they can be seen."""
        patches = [(one.position, one.position_cov) for one in state.contacts]
        for place, cov in patches or [(state.position, state.position_cov)]:
            if state.in_contact != 0 and np.isfinite(place[:2]).all():
                sigma = np.nan_to_num(sigma_of(cov), nan=LEAST_SIGMA)
                half_axes = 2 * np.clip(sigma, LEAST_SIGMA, MOST_SIGMA)
                self._ball(np.nan_to_num(place), half_axes, CONTACT)

    def _add_forces(self, state: ContactState) -> None:
        """Forces of the contacts, or the whole one at the contact."""
        patches = [(p.position, p.force) for p in state.contacts if np.isfinite(p.force).any()]
        colour = SLIPPING if state.slip == 1 else FORCE
        for place, force in patches or [(state.position, state.force)]:
            along = METRES_PER_NEWTON * np.nan_to_num(force)
            self._arrow(np.nan_to_num(place), along, colour)

    def _ball(self, middle: Array, half_axes: Array, colour: Rgba) -> None:
        pose, size = self._pose(middle), self._vector(2 * half_axes)
        kind, self._last = self._messages.SpherePrimitive, middle
        self._balls.append(kind(pose=pose, size=size, color=self._colour(colour)))

    def _arrow(self, start: Array, along: Array, colour: Rgba) -> None:
        length = float(np.linalg.norm(along))
        if length > 0:
            arrow = self._messages.ArrowPrimitive(
                pose=self._pose(start, along / length), color=self._colour(colour),
                shaft_length=(1 - HEAD_PART) * length, shaft_diameter=SHAFT,
                head_length=HEAD_PART * length, head_diameter=HEAD,
            )  # fmt: skip
            self._arrows.append(arrow)

    def _vector(self, values: Array) -> messages.Vector3:
        x, y, z = values.tolist()
        return self._messages.Vector3(x=x, y=y, z=z)

    def _colour(self, rgba: Rgba) -> messages.Color:
        red, green, blue, alpha = rgba
        return self._messages.Color(r=red, g=green, b=blue, a=alpha)

    def _pose(self, place: Array, along: Array | None = None) -> messages.Pose:
        """A pose in the sensor frame; arrows are drawn along its x axis, here a unit vector."""
        turn = Rotation.identity()
        if along is not None:
            level = float(np.hypot(along[0], along[1]))
            angles = [np.arctan2(along[1], along[0]), -np.arctan2(along[2], level)]
            turn = Rotation.from_euler('ZY', angles)
        x, y, z, w = turn.as_quat().tolist()
        orientation = self._messages.Quaternion(x=x, y=y, z=z, w=w)
        return self._messages.Pose(position=self._vector(place), orientation=orientation)


def state_scalars(state: ContactState) -> Scalars:
    """Every number of a state that a plot may show, by name: force_x, force_x_sigma, slip, ...

    SI units; None: not estimated.
    """
    scalars: Scalars = {'valid': int(state.valid)}
    for name in ('force', 'torque', 'position', 'stray_field'):
        for axis, value in zip('xyz', getattr(state, name), strict=True):
            scalars[f'{name}_{axis}'] = _finite(value)
    for name, cov in (('force', state.force_cov), ('position', state.position_cov)):
        for axis, value in zip('xyz', sigma_of(cov), strict=True):
            scalars[f'{name}_{axis}_sigma'] = _finite(value)
    for name in ('yaw', 'slip_probability', 'cell_probability', 'label_probability'):
        scalars[name] = _finite(getattr(state, name))
    for name in ('in_contact', 'slip', 'cell', 'label', 'status'):
        scalars[name] = int(getattr(state, name))
    return scalars


def grip_scalars(grip: Message) -> Scalars:
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
        need = 'tactile view needs foxglove-sdk'
        self._kinds = load_package('foxglove.channels', need, 'foxglove-sdk')
        self._foxglove = foxglove = load_package('foxglove', need, 'foxglove-sdk')
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
        scene = Scene(layout, frame.values - rest, most, stamp_ns)
        self._log(f'{name}/taxels', scene.cloud(), stamp_ns, 'PointCloud')
        self._log(f'{name}/scene', scene.update(state), stamp_ns, 'SceneUpdate')
        self._log(f'{name}/state', state_scalars(state), stamp_ns)

    def grip(self, name: str, grip: Message, stamp_ns: int) -> None:
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
