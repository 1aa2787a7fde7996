"""One tactile sensor: frames, contacts, wrench, markers; real, from a recording, or simulated.

ros2 launch tactile_ros sensor.launch.py port:=/dev/ttyACM0 calibration:=thumb.npz namespace:=thumb
ros2 launch tactile_ros sensor.launch.py source:=recorded speed_up:=10.0
ros2 launch tactile_ros sensor.launch.py source:=simulated sensor:=gradiometer fault:=flipped:3
"""

from __future__ import annotations

from dataclasses import fields

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from tactile_ros.nodes.graph import PACKAGE, Process, Setting, sensing
from tactile_ros.sensors import list_sensors

DEFAULTS = Setting()
TRUE_OR_FALSE = ['true', 'false']
# of Setting: what it means, and what it may be
ARGUMENTS: dict[str, tuple[str, list[str] | None]] = {
    'sensor': ('key of the sensor', list_sensors()),
    'source': (
        'where frames come from: the sensor, a recording in place of a board, a simulated twin',
        ['hardware', 'recorded', 'simulated'],
    ),
    'port': ('serial port; where no board is used, one in a private folder', None),
    'recording': ('recording to play: a name of a shipped one, or a file (.npz)', None),
    'calibration': ('calibration file (.npz); empty: contacts say NOT_CALIBRATED', None),
    'bag': ('folder to record into; empty: nothing is recorded', None),
    'stack': ('sensor and contact in one process by direct calls', TRUE_OR_FALSE),
    'tare': ('the player calls the tare before each touch', TRUE_OR_FALSE),
    'speed_up': ('recorded time over played time', None),
    'loop': ('the player begins again at the end', TRUE_OR_FALSE),
    'seed': ('of a simulated twin: its signal, noise and faults', None),
    'fault': ('that a simulated twin suffers at the start, as name or name:count', None),
    'frame_id': ('name of the sensor frame in tf', None),
    'namespace': ('namespace of nodes, topics and services: one sensor each', None),
    'params_file': ('YAML file of parameters, as config/reskin_board.yaml; empty: none', None),
    'use_sim_time': ('take time from /clock', TRUE_OR_FALSE),
    'autostart': ('configure and activate the nodes at start', TRUE_OR_FALSE),
}
POSE = {
    'parent_frame': ('', 'frame that the sensor is mounted on; empty: no static transform'),
    'x': ('0.0', 'pose of the sensor in parent_frame (m)'),
    'y': ('0.0', 'pose of the sensor in parent_frame (m)'),
    'z': ('0.0', 'pose of the sensor in parent_frame (m)'),
    'roll': ('0.0', 'pose of the sensor in parent_frame (rad)'),
    'pitch': ('0.0', 'pose of the sensor in parent_frame (rad)'),
    'yaw': ('0.0', 'pose of the sensor in parent_frame (rad)'),
}


def text_of(value: bool | float | str) -> str:
    """A default as a launch argument."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def setting_of(context: LaunchContext) -> Setting:
    """What the arguments choose."""
    values: dict[str, bool | float | str] = {}
    for field in fields(Setting):
        text = LaunchConfiguration(field.name).perform(context)
        default = getattr(DEFAULTS, field.name)
        if isinstance(default, bool):
            values[field.name] = text == 'true'
        else:
            values[field.name] = type(default)(text)
    if LaunchConfiguration('simulated').perform(context) == 'true':
        values['source'] = 'simulated'
    return Setting(**values)


def node_of(process: Process, log_level: str) -> Node:
    """A process of the graph as an action."""
    files = [process.params_file] if process.params_file else []
    return Node(
        package=PACKAGE,
        executable=process.executable,
        namespace=process.namespace,
        parameters=[*files, dict(process.parameters)],
        remappings=list(process.remappings.items()),
        arguments=['--ros-args', '--log-level', log_level],
        output='screen',
    )


def mounting(context: LaunchContext, setting: Setting) -> list[Node]:
    """Static transform from the parent to the sensor frame, where a parent is named."""
    pose = {name: LaunchConfiguration(name).perform(context) for name in POSE}
    parent = pose.pop('parent_frame')
    if not parent:
        return []
    arguments = [text for name, value in pose.items() for text in (f'--{name}', value)]
    frames = ['--frame-id', parent, '--child-frame-id', setting.frame_id]
    return [
        Node(
            package='tf2_ros',
            executable='static_transform_publisher',
            namespace=setting.namespace,
            arguments=[*arguments, *frames],
        )
    ]


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Every process of the graph that the arguments choose."""
    setting = setting_of(context)
    level = LaunchConfiguration('log_level').perform(context)
    nodes = [node_of(process, level) for process in sensing(setting).processes]
    return [*nodes, *mounting(context, setting)]


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the graph."""
    declared = [
        DeclareLaunchArgument(
            name,
            default_value=text_of(getattr(DEFAULTS, name)),
            description=description,
            **({'choices': choices} if choices else {}),
        )
        for name, (description, choices) in ARGUMENTS.items()
    ]
    declared += [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in POSE.items()
    ]
    declared.append(
        DeclareLaunchArgument(
            'simulated',
            default_value='false',
            description='the same as source:=simulated',
            choices=TRUE_OR_FALSE,
        )
    )
    declared.append(
        DeclareLaunchArgument(
            'log_level',
            default_value='info',
            description='how much the nodes say',
            choices=['debug', 'info', 'warn', 'error', 'fatal'],
        )
    )
    return LaunchDescription([*declared, OpaqueFunction(function=start)])
