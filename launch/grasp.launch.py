"""A hand that holds: the sensors of its fingers, their contacts, the grip; one argument chooses.

ros2 launch tactile_ros grasp.launch.py hand:=allegro_v4 calibrations:=calibrations/
ros2 launch tactile_ros grasp.launch.py hand:=qb_softhand fingers:=thumb,index
ros2 launch tactile_ros grasp.launch.py hand:=allegro_v5 mock_hand:=true source:=simulated
"""

from __future__ import annotations

from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from tactile_ros.hands import list_hands
from tactile_ros.nodes.graph import Grasping, grasping
from tactile_ros.nodes.processes import TRUE_OR_FALSE, chosen, declared, node_of
from tactile_ros.sensors import list_sensors

DEFAULTS = Grasping()
# of Grasping: what it means, and what it may be
ARGUMENTS: dict[str, tuple[str, list[str] | None]] = {
    'hand': (f'one of {", ".join(list_hands())}, or a .yaml that describes a hand', None),
    'mock_hand': ("a fake takes the place of the hand's driver", TRUE_OR_FALSE),
    'fingers': ('sensors that take part, parted by commas; empty: all of the hand', None),
    'sensor': ('key of the sensors', list_sensors()),
    'source': (
        'where frames come from: the sensors, recordings in place of boards, simulated twins',
        ['hardware', 'recorded', 'simulated'],
    ),
    'ports': ('serial ports in the order of the fingers; empty: /dev/ttyACM0 and on', None),
    'calibrations': ('folder with <finger>.npz; empty: contacts say NOT_CALIBRATED', None),
    'stack': ('sensors, contacts and grip in one process by direct calls', TRUE_OR_FALSE),
    'use_robot_description': (
        'take limits, and pads whose frame is a link, from robot_description where it comes',
        TRUE_OR_FALSE,
    ),
    'wait_for_robot_description': ('send nothing before it has come', TRUE_OR_FALSE),
    'seed': ('of the simulated twins, counted up from finger to finger', None),
    'namespace': ('namespace of the hand; its fingers lie below it', None),
    'params_file': ('YAML file of parameters, as config/grip.yaml; empty: none', None),
    'use_sim_time': ('take time from /clock', TRUE_OR_FALSE),
    'autostart': ('configure and activate the nodes at start', TRUE_OR_FALSE),
}


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Every process of the graph that the arguments choose."""
    level = LaunchConfiguration('log_level').perform(context)
    return [node_of(p, level) for p in grasping(chosen(context, DEFAULTS)).processes]


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the graph."""
    return LaunchDescription([*declared(DEFAULTS, ARGUMENTS), OpaqueFunction(function=start)])
