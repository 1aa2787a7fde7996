"""ROS parameters from the fields of dataclasses: one place for defaults, ranges and sentences.

A field's metadata says `help`, `unit`, `range` (lo, hi), `choices`, `read_only` (only when the
node starts) and `live` (also while it runs; all others are read at configure). Arrays are
flattened row by row. A value that is not known (None) is NaN for a number, empty for an array.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)

from tactile_ros.enrolment import Allowed

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.node import Node
    from rclpy.parameter import Parameter


@dataclass(frozen=True)
class NodeOptions:
    """Parameters of every node."""

    autostart: bool = field(
        default=True, metadata={'help': 'configure and activate at start', 'read_only': True}
    )


@dataclass(frozen=True)
class OneSensorOptions(NodeOptions):
    """Parameters of every node of one sensor."""

    sensor: str = field(
        default='reskin_board', metadata={'help': 'key of the sensor', 'read_only': True}
    )


@dataclass(frozen=True)
class SensorOptions(OneSensorOptions):
    """Parameters of sensor_node besides those of the sensor's config and connection."""

    frame_id: str = field(
        default='tactile_sensor', metadata={'help': 'name of the sensor frame in tf'}
    )
    serial: str = field(default='', metadata={'help': 'which board; goes into layout'})
    listeners: int = field(
        default=0,
        metadata={
            'help': 'read nothing before so many subscriptions to frame are there',
            'range': (0, 100),
        },
    )
    queue: int = field(
        default=100,
        metadata={
            'help': 'frames that may wait to be published; in a full queue the oldest is dropped '
            'and counted',
            'range': (1, 100_000),
        },
    )
    discard_stale: bool = field(
        default=True,
        metadata={
            'help': 'discard what the port kept back before reading begins, since its age is '
            'unknown; false where every byte counts, as of a recording that is played'
        },
    )
    magnetic_field: bool = field(
        default=False,
        metadata={
            'help': 'offer magnetic_field/chip_<i> of all chips; otherwise of those subscribed to'
        },
    )
    image: bool = field(
        default=False,
        metadata={'help': 'offer image of a matrix; otherwise where it is subscribed to'},
    )
    simulated: bool = field(
        default=False,
        metadata={'help': 'a simulated twin answers the bytes of the sensor; no hardware'},
    )
    seed: int = field(
        default=0,
        metadata={'help': 'of the twin: its signal, noise and faults', 'range': (0, 2**31 - 1)},
    )
    scene: str = field(
        default='presses',
        metadata={
            'help': 'what a twin plays: presses, or a lesson with something new in it',
            'choices': ('presses', 'lesson'),
        },
    )
    fault: str = field(
        default='',
        metadata={
            'help': 'fault that the twin suffers each time this is set: name or name:count; none '
            'withdraws those that wait',
            'live': True,
        },
    )


@dataclass(frozen=True)
class ContactOptions(OneSensorOptions):
    """Parameters of contact_node besides those of the sensor's config."""

    calibration: str = field(
        default='', metadata={'help': 'calibration file (.npz); empty: not calibrated'}
    )
    tare_frames: int = field(
        default=10,
        metadata={'help': 'frames that a tare averages', 'range': (1, 10_000), 'live': True},
    )
    allow_tare_in_contact: bool = field(
        default=False,
        metadata={'help': 'take a tare also while something seems to touch', 'live': True},
    )
    unknown_as: str = field(
        default='zero',
        metadata={
            'help': 'what wrench says for components that are not estimated',
            'choices': ('zero', 'nan'),
            'live': True,
        },
    )
    most_lost: float = field(
        default=Allowed.lost,
        metadata={
            'help': 'share of the presses of known classes that a new one may take at most',
            'range': (0.0, 1.0),
        },
    )
    most_lost_there: float = field(
        default=Allowed.lost_there,
        metadata={
            'help': 'share of the other classes that a new one may take where it was pressed, a '
            '95 % bound',
            'range': (0.0, 1.0),
        },
    )
    listeners: int = field(
        default=0,
        metadata={
            'help': 'process nothing before so many subscriptions to contacts are there',
            'range': (0, 100),
        },
    )


@dataclass(frozen=True)
class GripOptions(NodeOptions):
    """Parameters of grip_node besides those of the law and of the hand's driver."""

    hand: str = field(
        default='allegro_v5',
        metadata={
            'help': 'name of a hand in config/hands, or a .yaml that describes one',
            'read_only': True,
        },
    )
    fingers: tuple[str, ...] = field(
        default=(),
        metadata={'help': 'sensors that take part: <finger>/contacts; empty: all of the hand'},
    )
    enabled: bool = field(
        default=True, metadata={'help': 'commands may be sent once active, as by ~/enable'}
    )
    use_robot_description: bool = field(
        default=True,
        metadata={
            'help': 'take limits, and pads whose frame is a link, from robot_description where it '
            'comes and names the joints of the hand'
        },
    )
    wait_for_robot_description: bool = field(
        default=False, metadata={'help': 'nothing is sent before it has come'}
    )


T = TypeVar('T')
# what ROS holds: a scalar, an array, or None
Value = Any
KINDS = {'bool': bool, 'int': int, 'float': float, 'str': str}
# of arrays whose default is None
TAILS = {'rotations': (3, 3), 'positions': (3,)}
WORDS = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a text'}


def _type_text(field: Field[Any]) -> str:
    """Annotation of a field as text."""
    return field.type if isinstance(field.type, str) else getattr(field.type, '__name__', '')


@dataclass(frozen=True)
class Entry:
    """One dataclass field as a ROS parameter.

    Attributes
    ----------
    name : str
        Of the field and of the parameter.
    kind : type
        bool, int, float or str; of the elements where it is an array.
    array, optional : bool
        Flattened; may be unknown.
    tail : tuple of int
        Trailing shape of the array.
    """

    name: str
    kind: type
    array: bool
    optional: bool
    tail: tuple[int, ...]
    default: object
    metadata: Mapping[str, Any]

    @classmethod
    def of(cls, field: Field[Any], value: object) -> Entry | None:
        """Entry of a field; None where a field is no number, text or array of numbers."""
        text = _type_text(field)
        array = 'Array' in text or 'tuple' in text.lower()
        name = 'float' if array else text.split('|')[0].strip()
        kind = str if 'str' in text and array else KINDS.get(name)
        if kind is None:
            return None
        tail = np.shape(value)[1:] if value is not None else TAILS.get(field.name, ())
        return cls(field.name, kind, array, 'None' in text, tail, value, field.metadata)

    @property
    def ros_default(self) -> Value:
        """Default as ROS holds it."""
        if self.array:
            return [] if self.default is None else np.ravel(self.default).tolist()
        if self.default is None:
            return '' if self.kind is str else float('nan')
        return self.kind(self.default)

    def descriptor(self) -> ParameterDescriptor:
        """Description, unit, range and whether it may change."""
        when = 'read at start' if self.metadata.get('read_only') else 'read at configure'
        when = 'may change any time' if self.metadata.get('live') else when
        unit = self.metadata.get('unit')
        choices = self.metadata.get('choices')
        parts = [self.metadata.get('help', self.name), f'unit {unit}' if unit else '']
        parts += [f'one of {", ".join(choices)}' if choices else '', when]
        described = ParameterDescriptor(
            description='; '.join(part for part in parts if part),
            read_only=bool(self.metadata.get('read_only')),
            # so that 100 is taken where 100.0 is meant, and [] where numbers may follow
            dynamic_typing=True,
        )
        bounds = self.metadata.get('range')
        if bounds is None or self.array or self.optional:
            return described
        lo, hi = bounds
        if self.kind is float:
            span = FloatingPointRange(from_value=float(lo), to_value=float(hi))
            described.floating_point_range = [span]
        elif self.kind is int:
            described.integer_range = [IntegerRange(from_value=int(lo), to_value=int(hi))]
        return described

    def check(self, value: Value) -> object:
        """The field's value for a ROS value.

        Raises
        ------
        ValueError
            With one sentence that names the parameter, what it must be, and what was received.
        """
        if self.array:
            return self._check_array([] if value is None else value)
        fits = isinstance(value, self.kind) and not (self.kind is int and value is True)
        if self.kind in (int, float) and isinstance(value, bool):
            fits = False
        elif self.kind is float and isinstance(value, int):
            value, fits = float(value), True
        if not fits:
            msg = f'{self.name} must be {WORDS[self.kind]}; received {value!r}'
            raise ValueError(msg)
        if self.optional and (value == '' or value != value):  # noqa: PLR0124
            return None
        self._check_bounds(value)
        return value

    def _check_bounds(self, value: Value) -> None:
        """Range and choices of a scalar, range of every element of an array."""
        choices = self.metadata.get('choices')
        if choices and value not in choices:
            msg = f'{self.name} must be one of {", ".join(choices)}; received {value!r}'
            raise ValueError(msg)
        bounds = self.metadata.get('range')
        if bounds is None or self.kind is str:
            return
        lo, hi = bounds
        if not (lo <= np.min(value) and np.max(value) <= hi):
            unit = f' {self.metadata["unit"]}' if self.metadata.get('unit') else ''
            msg = f'{self.name} must lie in {lo} to {hi}{unit}; received {value}'
            raise ValueError(msg)

    def _check_array(self, value: Value) -> object:
        """Numbers (or texts) in the shape of the field."""
        if self.kind is str:
            return tuple(str(x) for x in value)
        try:
            numbers = np.asarray(value, np.float64).ravel()
            shaped = numbers.reshape(-1, *self.tail) if self.tail else numbers
        except (TypeError, ValueError) as err:
            rows = f'a multiple of {int(np.prod(self.tail))} ' if self.tail else ''
            msg = f'{self.name} must be {rows}numbers; received {value!r}'
            raise ValueError(msg) from err
        if not numbers.size:
            return None if self.optional else self.default
        self._check_bounds(numbers)
        return shaped if isinstance(self.default, (np.ndarray, type(None))) else tuple(shaped)


class Schema(Generic[T]):
    """Parameters of one dataclass on one node."""

    def __init__(self, defaults: T) -> None:
        self.defaults = defaults
        found = [Entry.of(f, getattr(defaults, f.name)) for f in fields(defaults)]  # type: ignore[arg-type]
        self.entries = {entry.name: entry for entry in found if entry is not None}

    def declare(self, node: Node) -> None:
        """Declare every field; rclpy refuses a name that another dataclass has already."""
        for name, entry in self.entries.items():
            node.declare_parameter(name, entry.ros_default, entry.descriptor())

    def read(self, node: Node) -> T:
        """Dataclass of the node's parameters.

        Raises
        ------
        ValueError
            With the sentence for the first value that cannot be.
        """
        values = {name: node.get_parameter(name).value for name in self.entries}
        return self.build(values)

    def build(self, values: dict[str, Value]) -> T:
        """Dataclass with ROS values, checked by the ranges and by the dataclass itself."""
        checked = {name: self.entries[name].check(value) for name, value in values.items()}
        return replace(self.defaults, **checked)  # type: ignore[type-var]


def refuse_or_accept(
    node: Node, schemas: Sequence[Schema[object]], parameters: Sequence[Parameter], running: bool
) -> SetParametersResult:
    """Validate a change of parameters, without any effect.

    Parameters
    ----------
    node : Node
        Whose other parameters stay.
    schemas : sequence of Schema
        What the node declared.
    parameters : sequence of Parameter
        The wanted values.
    running : bool
        The node is configured: only live parameters may change.

    Returns
    -------
    SetParametersResult
        With one sentence when it is refused.
    """
    wanted = {p.name: p.value for p in parameters}
    try:
        for schema in schemas:
            concerned = {n: wanted[n] for n in wanted if n in schema.entries}
            _try(node, schema, concerned, running)
    except ValueError as err:
        return SetParametersResult(successful=False, reason=str(err))
    return SetParametersResult(successful=True)


def _try(node: Node, schema: Schema[object], wanted: dict[str, Value], running: bool) -> None:
    """Build the dataclass with the wanted values; ValueError says what cannot be."""
    fixed = sorted(n for n in wanted if not schema.entries[n].metadata.get('live'))
    if running and fixed:
        msg = f'{fixed[0]} is read at configure: deactivate and clean up first'
        raise ValueError(msg)
    if wanted:
        now = {name: node.get_parameter(name).value for name in schema.entries}
        schema.build({**now, **wanted})
