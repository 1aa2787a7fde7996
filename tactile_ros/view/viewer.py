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
    from foxglove.websocket import WebSocketServer

    from tactile_ros.types import Array, ContactState, Frame, Layout

Rgba = tuple[float, float, float, float]
GREY: Rgba = (0.6, 0.6, 0.6, 0.5)
COLD, WARM = np.array([0.23, 0.42, 0.75]), np.array([0.97, 0.45, 0.13])
CONTACT: Rgba = (0.97, 0.45, 0.13, 0.55)
FORCE: Rgba = (0.13, 0.45, 0.95, 0.95)
SLIPPING: Rgba = (0.9, 0.1, 0.25, 0.95)
METRES_PER_NEWTON = 5e-3
LEAST_SIGMA, MOST_SIGMA = 3e-4, 5e-3  # m, of a contact's ball
ARROW = 0.35  # length of the largest change of field, as a part of the skin


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
    """Everything that is shown of one frame."""

    balls: list[Ball]
    arrows: list[Arrow]
    words: str


def scene_of(layout: Layout, frame: Frame, rest: Array, state: ContactState, most: float) -> Scene:
    """Taxels with what they feel, contacts with two sigmas, and forces.

    Parameters
    ----------
    layout : Layout
        Of t taxels.
    frame : Frame
        The readings.
    rest : ndarray, shape (t, c)
        Readings of the untouched skin (unit of the layout).
    state : ContactState
        Of the frame; what is not estimated is not shown.
    most : float
        Change that has the full colour (unit of the layout).

    Returns
    -------
    Scene
        In the sensor frame.
    """
    change = frame.values - rest
    balls = [*_taxels(layout, change, most), *_contacts(state)]
    return Scene(balls, [*_fields(layout, change, most), *_forces(state)], _words(state))


def size_of(layout: Layout) -> float:
    """Half the usual distance between taxels (m)."""
    apart = np.linalg.norm(layout.positions[:, None] - layout.positions[None], axis=-1)
    apart = apart[apart > 0]
    return 0.5 * float(apart.min()) if apart.size else 2e-3


def _taxels(layout: Layout, change: Array, most: float) -> list[Ball]:
    """A ball for each taxel, warmer the more it feels; grey where nothing is known."""
    half = np.full(3, 0.35 * size_of(layout))
    return [
        Ball(place, half, (red, green, blue, 0.9))
        for place, (red, green, blue) in zip(
            layout.positions, warmth(change, most).tolist(), strict=True
        )
    ]


def warmth(change: Array, most: float) -> Array:
    """Colours (t, 3), 0 to 1, of a change (t, c): from cold to warm at `most`, grey unknown."""
    share = np.clip(np.linalg.norm(change, axis=1) / most, 0.0, 1.0)[:, None]
    return np.where(np.isnan(share), GREY[:3], COLD + share * (WARM - COLD))


def _fields(layout: Layout, change: Array, most: float) -> list[Arrow]:
    """The change of field at chips with three axes, turned into the sensor's."""
    if layout.unit != 'T' or len(layout.channels) != 3:
        return []
    turned = change
    if layout.rotations is not None:
        turned = np.einsum('tij,tj->ti', layout.rotations, change)
    reach = ARROW * max(float(np.ptp(layout.positions, axis=0).max()), 4 * size_of(layout))
    return [
        Arrow(place, along * reach / most, GREY)
        for place, along in zip(layout.positions, turned, strict=True)
        if np.isfinite(along).all()
    ]


def _contacts(state: ContactState) -> list[Ball]:
    """Contacts of two sigmas."""
    if state.in_contact == 0:
        return []
    told = [(c.position, c.position_cov) for c in state.contacts]
    told = told or [(state.position, state.position_cov)]
    return [
        Ball(np.nan_to_num(place), _half_axes(cov), CONTACT)
        for place, cov in told
        if np.isfinite(place[:2]).all()
    ]


def _half_axes(cov: Array) -> Array:
    """Two sigmas along x, y, z (m), such that they can be seen."""
    with np.errstate(invalid='ignore'):
        sigma = np.sqrt(np.diagonal(cov))
    half: Array = 2 * np.clip(np.nan_to_num(sigma, nan=LEAST_SIGMA), LEAST_SIGMA, MOST_SIGMA)
    return half


def _forces(state: ContactState) -> list[Arrow]:
    """Forces of the contacts, or the whole one at the contact."""
    colour = SLIPPING if state.slip == 1 else FORCE
    told = [(c.position, c.force) for c in state.contacts if np.isfinite(c.force).any()]
    told = told or [(state.position, state.force)]
    return [
        Arrow(np.nan_to_num(place), METRES_PER_NEWTON * np.nan_to_num(force), colour)
        for place, force in told
        if np.nan_to_num(force).any()
    ]


def _words(state: ContactState) -> str:
    """What is recognised, in a word or two."""
    said = [f'label {int(state.label)}'] if state.label >= 0 else []
    said += [f'cell {int(state.cell)}'] if state.cell >= 0 else []
    said += ['slips'] if state.slip == 1 else []
    return ', '.join(said)


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


Scalars = dict[str, 'float | int | None']
VECTORS = ('force', 'torque', 'position', 'stray_field')
SCALARS = ('yaw', 'slip_probability', 'cell_probability', 'label_probability')
CHOICES = ('in_contact', 'slip', 'cell', 'label', 'status')
AXES = 'xyz'


class GripMessage(Protocol):
    """What is read of a GripState message."""

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
    """Every number of a state that a plot may show.

    Parameters
    ----------
    state : ContactState
        Of a frame; SI units.

    Returns
    -------
    dict of str to number or None
        force_x, force_x_sigma, ..., in_contact, slip, ...; None: not estimated.
    """
    found: Scalars = {}
    for name in VECTORS:
        for axis, value in zip(AXES, getattr(state, name), strict=True):
            found[f'{name}_{axis}'] = _known(value)
    for name in ('force', 'position'):
        with np.errstate(invalid='ignore'):
            sigma: Array = np.sqrt(np.diagonal(getattr(state, f'{name}_cov')))
        for axis, value in zip(AXES, sigma, strict=True):
            found[f'{name}_{axis}_sigma'] = _known(value)
    found |= {name: _known(getattr(state, name)) for name in SCALARS}
    found |= {name: int(getattr(state, name)) for name in CHOICES}
    found['valid'] = int(state.valid)
    return found


def grip_scalars(grip: GripMessage) -> dict[str, float | int | str | None]:
    """Every number of a GripState by finger, its phase and why nothing was sent."""
    found: dict[str, float | int | str | None] = {
        'phase': int(grip.phase),
        'limited': int(grip.limited),
        'refusal': str(grip.refusal),
        'input_age': _known(grip.input_age),
    }
    for name in ('target_force', 'force', 'friction', 'slip_margin'):
        for finger, value in zip(grip.fingers, getattr(grip, name), strict=False):
            found[f'{finger}_{name}'] = _known(value)
    return found


def json_schema(message: Mapping[str, object]) -> dict[str, object]:
    """What viewers must know of such messages: which entries are numbers, which are text."""
    kinds = {
        name: {'type': 'string' if isinstance(value, str) else 'number'}
        for name, value in message.items()
    }
    return {'type': 'object', 'title': 'tactile_ros', 'properties': kinds}


def _known(value: float | Array) -> float | None:
    """A number, or None for NaN: json has none."""
    number = float(value)
    return number if np.isfinite(number) else None


HOST = '127.0.0.1'  # this machine alone
FADE = 0.999  # of the full colour, from one frame to the next
LEAST = 1e-12  # change that has the full colour at least (unit of the layout)


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
    """Show what one or more sensors say.

    Parameters
    ----------
    port : int or None
        Of the server; 0: any free one; None: no server.
    file : Path or None
        MCAP file that Foxglove opens later.

    Raises
    ------
    MissingPackageError
        If foxglove-sdk is not installed.
    TactileError
        If the port is taken or the file exists.
    """

    def __init__(self, port: int | None, file: Path | None = None) -> None:
        try:
            import foxglove
            from foxglove import channels
        except ImportError as error:
            msg = 'tactile view needs foxglove-sdk: pip install foxglove-sdk'
            raise MissingPackageError(msg) from error
        self._foxglove, self._kinds = foxglove, channels
        self._held = ExitStack()
        self._context = foxglove.Context()
        self._channels: dict[str, Callable[..., None]] = {}
        self._seen: dict[str, Seen] = {}
        try:
            if file is not None:
                self._held.enter_context(foxglove.open_mcap(str(file), context=self._context))
            self._server = None if port is None else self._serve(port)
        except (OSError, RuntimeError) as error:
            self._held.close()
            msg = f'nothing can be shown at port {port} or in {file}: {error}'
            raise TactileError(msg) from error

    def _serve(self, port: int) -> WebSocketServer:
        server = self._foxglove.start_server(
            name='tactile_ros', host=HOST, port=port, context=self._context
        )
        self._held.callback(server.stop)
        return server

    def close(self) -> None:
        """Close the server and the file."""
        self._held.close()

    @property
    def address(self) -> str:
        """Where viewers connect; empty without a server."""
        return '' if self._server is None else f'ws://{HOST}:{self._server.port}'

    def show(self, name: str, layout: Layout, frame: Frame, state: ContactState) -> None:
        """Show one frame of the sensor `name` ('' where there is but one)."""
        seen = self._seen.setdefault(name, Seen())
        rest, most = seen.scale(frame, state)
        stamp = frame.stamp_ns or 0
        points = cloud(layout, frame.values - rest, most, stamp)
        shown = update(scene_of(layout, frame, rest, state, most), layout.frame_id, stamp)
        self._log('PointCloud', f'{name}/taxels', points, stamp)
        self._log('SceneUpdate', f'{name}/scene', shown, stamp)
        self._log('', f'{name}/state', state_scalars(state), stamp)

    def grip(self, name: str, grip: GripMessage, stamp_ns: int) -> None:
        """Show the state of a grip."""
        self._log('', f'{name}/grip', grip_scalars(grip), stamp_ns)

    def _log(self, kind: str, topic: str, message: object, stamp_ns: int) -> None:
        """One message on its channel, which is made when it is first needed."""
        topic = topic if topic.startswith('/') else f'/{topic}'
        if topic not in self._channels:
            self._channels[topic] = self._channel(kind, topic, message)
        self._channels[topic](message, log_time=stamp_ns or None)

    def _channel(self, kind: str, topic: str, message: object) -> Callable[..., None]:
        """Where to log messages of one of Foxglove's kinds, or json."""
        if kind:
            made = getattr(self._kinds, f'{kind}Channel')(topic, context=self._context)
        else:
            schema = json_schema(message if isinstance(message, dict) else {})
            made = self._foxglove.Channel(topic, schema=schema, context=self._context)
        log: Callable[..., None] = made.log
        return log
