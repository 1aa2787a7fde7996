# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""ROS parameters from the fields of dataclasses: one place for defaults, ranges and sentences.

A field's metadata says `help`, `unit`, `range` (lo, hi), `choices`, `read_only` (only when the
node starts) and `live` (also while it runs; all others are read at configure). The dataclass
itself refuses values. What is not known (None) is NaN for a number, empty for an array.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import Field, dataclass, field, fields, replace
from math import inf
from typing import Any, Generic, TypeVar

import numpy as np
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from tactile_ros.enrolment import Allowed
from tactile_ros.types.config_fields import admit

T = TypeVar('T')
Value = Any  # what ROS holds: a scalar, an array, or None
KINDS = {'bool': bool, 'int': int, 'float': float, 'str': str}


def parameter(default: T, text: str, **metadata: object) -> T:
    """Field of a node's options."""
    return field(default=default, metadata={'help': text, **metadata})


@dataclass(frozen=True)
class Options:
    """Parameters that are held to their ranges."""

    def __post_init__(self) -> None:
        admit(self)


@dataclass(frozen=True)
class NodeOptions(Options):
    """Parameters of every node."""

    autostart: bool = parameter(True, 'configure and activate at start', read_only=True)


@dataclass(frozen=True)
class SensorOptions(NodeOptions):
    """Parameters of sensor_node besides those of the sensor's config and connection."""

    sensor: str = parameter('reskin_board', 'key of the sensor', read_only=True)
    frame_id: str = parameter(
        '', 'name of the sensor frame in tf; empty: tactile_sensor, or after the namespace'
    )
    frame_prefix: str = parameter('', 'before that name, as robot_state_publisher has it')
    serial: str = parameter('', 'which board; goes into layout')
    listeners: int = parameter(
        0, 'read nothing before so many subscriptions to frame are there', range=(0, 100)
    )
    queue: int = parameter(
        100,
        'frames that may wait to be published; in a full queue the oldest is dropped and counted',
        range=(1, 100_000),
    )
    discard_stale: bool = parameter(
        True,
        'discard what the port kept back before reading begins, since its age is unknown; false '
        'where every byte counts, as of a recording that is played',
    )
    magnetic_field: bool = parameter(
        False, 'offer magnetic_field/chip_<i> of all chips; otherwise of those subscribed to'
    )
    image: bool = parameter(False, 'offer image of a matrix; otherwise where it is subscribed to')
    simulated: bool = parameter(
        False, 'a simulated twin answers the bytes of the sensor; no hardware'
    )
    seed: int = parameter(0, 'of the twin: its signal, noise and faults', range=(0, 2**31 - 1))
    scene: str = parameter(
        'presses',
        'what a twin plays: presses, or those of a new class',
        choices=('presses', 'new_class'),
    )
    fault: str = parameter(
        '',
        'fault that the twin suffers each time this is set: name or name:count; none withdraws '
        'those that wait',
        live=True,
    )


@dataclass(frozen=True)
class ContactOptions(NodeOptions):
    """Parameters of contact_node besides those of the sensor's config."""

    sensor: str = parameter('reskin_board', 'key of the sensor', read_only=True)
    calibration: str = parameter('', 'calibration file (.npz); empty: not calibrated')
    tare_frames: int = parameter(10, 'frames that a tare averages', range=(1, 10_000), live=True)
    allow_tare_in_contact: bool = parameter(
        False, 'take a tare also while something seems to touch', live=True
    )
    unknown_as: str = parameter(
        'zero',
        'what wrench says for components that are not estimated',
        choices=('zero', 'nan'),
        live=True,
    )
    most_lost: float = parameter(
        Allowed.lost,
        'share of the presses of known classes that a new one may take at most',
        range=(0.0, 1.0),
    )
    most_lost_there: float = parameter(
        Allowed.lost_there,
        'share of the other classes that a new one may take where it was pressed, a 95 % bound',
        range=(0.0, 1.0),
    )
    listeners: int = parameter(
        0, 'process nothing before so many subscriptions to contacts are there', range=(0, 100)
    )


@dataclass(frozen=True)
class GripOptions(NodeOptions):
    """Parameters of grip_node besides those of the law and of the hand's driver."""

    hand: str = parameter(
        'allegro_v5',
        'name of a hand in config/hands, or a .yaml that describes one',
        read_only=True,
    )
    fingers: tuple[str, ...] = parameter(
        (), 'sensors that take part: <finger>/contacts; empty: all of the hand'
    )
    enabled: bool = parameter(True, 'commands may be sent once active, as by ~/enable')
    use_robot_description: bool = parameter(
        True,
        'take limits, and pads whose frame is a link, from robot_description where it comes and '
        'names the joints of the hand',
    )
    wait_for_robot_description: bool = parameter(False, 'nothing is sent before it has come')


@dataclass(frozen=True)
class StackOptions(Options):
    """Parameters that say what runs in the process of a stack; its nodes have their own."""

    hand: str = parameter('', 'hand whose sensors and grip run here; empty: one sensor alone')
    fingers: tuple[str, ...] = parameter((), 'sensors of the hand that take part; empty: all')
    sensor: str = parameter('reskin_board', 'key of the sensors')
    source: str = parameter(
        'hardware', 'where frames come from', choices=('hardware', 'recorded', 'simulated')
    )
    ports: tuple[str, ...] = parameter((), 'serial ports in the order of the fingers')
    calibrations: str = parameter('', 'folder with <finger>.npz')
    seed: int = parameter(0, 'of the twins, counted up by finger')
    frame_prefix: str = parameter('', 'before the names of sensor frames in tf')
    priority: int = parameter(
        0,
        'real-time priority of the process (SCHED_FIFO), where the system grants it; 0: none',
        range=(0, 99),
    )


@dataclass(frozen=True)
class MockHandOptions(NodeOptions):
    """Parameters of mock_hand besides those of the hand's driver."""

    hand: str = parameter(
        'allegro_v5', 'name of a hand, or a .yaml that describes one', read_only=True
    )
    order: tuple[str, ...] = parameter(
        (), "the controller's order of joints; empty: as its driver ships it"
    )
    dead_time_s: float = parameter(0.0, 'before a command acts', unit='s', range=(0.0, 2.0))
    lag_s: float = parameter(
        0.02, 'time constant of the position loop', unit='s', range=(1e-3, 2.0)
    )
    sensor: str = parameter('', 'key of the sensors that its closing presses; empty: none')
    fingers: tuple[str, ...] = parameter((), 'sensors that are pressed; empty: all of the hand')
    ports: tuple[str, ...] = parameter((), 'paths where their serial ports appear, in their order')
    seed: int = parameter(0, 'of the sensors, counted up')
    contact_at: float = parameter(
        0.4, 'closure at which each finger touches', range=(0.0, 1.0), live=True
    )
    stiffness: float = parameter(
        40.0, 'of what a finger touches', unit='N per closure', range=(0.0, 1e4), live=True
    )
    fault: str = parameter(
        'none',
        'silent: no joint states; frozen: the same again and again; partial: a joint is missing; '
        'nan: positions are NaN',
        choices=('none', 'silent', 'frozen', 'partial', 'nan'),
        live=True,
    )


@dataclass(frozen=True)
class RecordOptions(NodeOptions):
    """Parameters of record."""

    bag: str = parameter('', 'folder of the bag; it must not exist yet')


@dataclass(frozen=True)
class PlayerOptions(NodeOptions):
    """Parameters of player."""

    recording: str = parameter('', 'a recording (.npz), or the name of one that is shipped')
    sensor: str = parameter(
        'reskin_board', 'key of the sensor whose recordings are shipped', read_only=True
    )
    port: str = parameter('', 'where the simulated port appears; empty: a private place, logged')
    speed_up: float = parameter(1.0, 'recorded time over played time', range=(1e-3, inf))
    rate_hz: float = parameter(400.0, 'rows without stamps', unit='Hz', range=(0.1, 1e9))
    window: int = parameter(16, 'rows on their way at most', range=(1, 40))
    loop: bool = parameter(False, 'begin again at the end')
    tare: bool = parameter(True, 'call the tare after resting rows')
    listeners: int = parameter(
        0, 'subscriptions to truth/contacts before the start', range=(0, 100)
    )
    patience_s: float = parameter(30.0, 'longest wait for the graph', unit='s', range=(0.1, 1e6))


class Entry:
    """One dataclass field as a ROS parameter; ValueError where it is none.

    An array is flattened row by row; an optional field may be unknown.
    """

    def __init__(self, about: Field[Any], default: object) -> None:
        text = str(about.type)
        self.array = 'Array' in text or text.startswith('tuple')
        kind = text.partition(' |')[0]
        if self.array:
            kind = 'str' if 'str' in text else 'float'
        if kind not in KINDS:
            msg = f'{about.name} is no number, text or array of them'
            raise ValueError(msg)
        self.kind, self.optional = KINDS[kind], 'None' in text
        self.name, self.default, self.metadata = about.name, default, about.metadata

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
        about = self.metadata
        when = 'read at start' if about.get('read_only') else 'read at configure'
        parts = [
            about.get('help', self.name),
            f'unit {about["unit"]}' if 'unit' in about else '',
            f'one of {", ".join(about["choices"])}' if 'choices' in about else '',
            'may change any time' if about.get('live') else when,
        ]
        described = ParameterDescriptor(
            description='; '.join(filter(None, parts)),
            read_only=bool(about.get('read_only')),
            # so that 100 is taken where 100.0 is meant, and [] where numbers may follow
            dynamic_typing=True,
        )
        if 'range' in about and not self.array and not self.optional:
            low, high = map(self.kind, about['range'])
            if self.kind is float:
                span = FloatingPointRange(from_value=low, to_value=high)
                described.floating_point_range = [span]
            else:
                described.integer_range = [IntegerRange(from_value=low, to_value=high)]
        return described

    def field_value(self, value: Value) -> Value:
        """Value of the field for a value of ROS; its dataclass refuses what cannot be."""
        if not self.array:
            unknown = self.optional and (value == '' or value != value)  # noqa: PLR0124
            return None if unknown else value
        numbers = np.ravel([] if value is None else value)
        if not numbers.size:
            return None if self.optional else self.default
        rows = self.metadata.get('shape', ())[1:]
        whole = numbers.size % int(np.prod(rows)) == 0
        return numbers.reshape(-1, *rows) if rows and whole else numbers.tolist()


class Schema(Generic[T]):
    """Parameters of one dataclass on one node."""

    def __init__(self, defaults: T) -> None:
        self.defaults = defaults
        self.entries: dict[str, Entry] = {}
        for about in fields(defaults):  # type: ignore[arg-type]
            with suppress(ValueError):
                self.entries[about.name] = Entry(about, getattr(defaults, about.name))

    def declare(self, node: Node) -> None:
        """Declare every field; rclpy refuses a name that another dataclass has already."""
        for name, entry in self.entries.items():
            node.declare_parameter(name, entry.ros_default, entry.descriptor())

    def read(self, node: Node) -> T:
        """Dataclass of the node's parameters; ValueError for the first value that cannot be."""
        return self.build({name: node.get_parameter(name).value for name in self.entries})

    def build(self, values: dict[str, Value]) -> T:
        """Dataclass with ROS values; ValueError with one sentence for what cannot be."""
        given = {name: self.entries[name].field_value(value) for name, value in values.items()}
        return replace(self.defaults, **given)  # type: ignore[type-var]

    def validate(self, node: Node, wanted: dict[str, Value], running: bool) -> None:
        """Refuse changes of the node's parameters by a ValueError, without any effect.

        While it is configured (`running`) only live parameters may change.
        """
        own = {name: value for name, value in wanted.items() if name in self.entries}
        fixed = sorted(n for n in own if not self.entries[n].metadata.get('live'))
        if running and fixed:
            msg = f'{fixed[0]} is read at configure: deactivate and clean up first'
            raise ValueError(msg)
        if own:
            self.build({name: node.get_parameter(name).value for name in self.entries} | own)
