"""Play the frames of a bag into contact_node, on the bag's own clock: to look at, not to measure.

ros2 launch tactile_ros replay.launch.py bag:=out/demo/bags/place calibration:=place.npz

`tactile replay` repeats a live run exactly, its tares included, and evaluates it without ROS. Here
the tares of the bag are not repeated: call contact_node/tare where the bag is at rest.
"""

from __future__ import annotations

from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
)
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from tactile_ros.nodes.graph import PACKAGE
from tactile_ros.sensors import list_sensors

ARGUMENTS: dict[str, tuple[str | None, str]] = {
    'bag': (None, 'folder of the bag'),
    'calibration': ('', 'calibration file (.npz); empty: contacts say NOT_CALIBRATED'),
    'namespace': ('', 'namespace of the sensor in the bag'),
    'rate': ('1.0', 'played time: recorded time divided by this'),
    'params_file': ('', 'YAML file of parameters; empty: none'),
}


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """contact_node and the player of the bag, which ends everything when it ends."""
    value = {name: LaunchConfiguration(name).perform(context) for name in (*ARGUMENTS, 'sensor')}
    space = value['namespace'].strip('/')
    topics = [f'/{space}/{name}'.replace('//', '/') for name in ('frame', 'layout')]
    files = [value['params_file']] if value['params_file'] else []
    chosen = {name: value[name] for name in ('sensor', 'calibration')}
    contact = Node(
        package=PACKAGE,
        executable='contact_node',
        namespace=space,
        parameters=[*files, {**chosen, 'use_sim_time': True}],
        output='screen',
    )
    bag = ['ros2', 'bag', 'play', value['bag'], '--clock', '--rate', value['rate']]
    player = ExecuteProcess(cmd=[*bag, '--topics', *topics], output='screen')
    ended = OnProcessExit(target_action=player, on_exit=[Shutdown(reason='the bag is over')])
    return [contact, player, RegisterEventHandler(ended)]


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the nodes."""
    declared = [
        DeclareLaunchArgument(
            name,
            description=description,
            **({} if default is None else {'default_value': default}),
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    keys = list_sensors()
    declared.append(
        DeclareLaunchArgument(
            'sensor', default_value=keys[0], description='key of the sensor', choices=keys
        )
    )
    return LaunchDescription([*declared, OpaqueFunction(function=start)])
