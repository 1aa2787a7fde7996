"""Parameters of contact_node."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactile_ros.enrolment import Allowed
from tactile_ros.nodes.node_options import OneSensorOptions


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
