"""Parameters of sensor_node."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactile_ros.nodes.node_options import OneSensorOptions


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
