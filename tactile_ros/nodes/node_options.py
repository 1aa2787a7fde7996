"""Parameters that several nodes have."""

from __future__ import annotations

from dataclasses import dataclass, field


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
