"""Parameters of grip_node."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactile_ros.nodes.node_options import NodeOptions


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
