# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""One tactile sensor: frames, contacts, wrench, markers; real, from a recording, or simulated.

ros2 launch tactile_ros sensor.launch.py port:=/dev/ttyACM0 calibration:=thumb.npz namespace:=thumb
ros2 launch tactile_ros sensor.launch.py source:=recorded speed_up:=10.0
ros2 launch tactile_ros sensor.launch.py source:=simulated sensor:=gradiometer fault:=flipped:3
"""

from __future__ import annotations

from dataclasses import replace

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from tactile_ros.nodes.graph import SensorSetup, frame_of, sensing
from tactile_ros.nodes.processes import TRUE_OR_FALSE, chosen, declared, node_of, number_of

DEFAULTS = SensorSetup(stack=True)
POSE = {
    'parent_frame': ('', 'frame that the sensor is mounted on; empty: no static transform'),
    'x': ('0.0', 'pose of the sensor in parent_frame (m)'),
    'y': ('0.0', 'pose of the sensor in parent_frame (m)'),
    'z': ('0.0', 'pose of the sensor in parent_frame (m)'),
    'roll': ('0.0', 'pose of the sensor in parent_frame (rad)'),
    'pitch': ('0.0', 'pose of the sensor in parent_frame (rad)'),
    'yaw': ('0.0', 'pose of the sensor in parent_frame (rad)'),
}


def setting_of(context: LaunchContext) -> SensorSetup:
    """What the arguments choose."""
    setting = chosen(context, DEFAULTS)
    if LaunchConfiguration('simulated').perform(context) == 'true':
        return replace(setting, source='simulated')
    return setting


def mounting(context: LaunchContext, setting: SensorSetup) -> list[Node]:
    """Static transform from the parent to the sensor frame, where a parent is named."""
    pose = {name: LaunchConfiguration(name).perform(context) for name in POSE}
    parent = pose.pop('parent_frame')
    if not parent:
        return []
    arguments = []
    for name, value in pose.items():
        arguments += [f'--{name}', str(number_of(name, value, float))]
    child = frame_of(setting.namespace, setting.frame_id, setting.frame_prefix)
    frames = ['--frame-id', parent, '--child-frame-id', child]
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
    nodes = [node_of(process, level, setting.respawn) for process in sensing(setting).processes]
    return [*nodes, *mounting(context, setting)]


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the graph."""
    arguments = declared(DEFAULTS)
    arguments += [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in POSE.items()
    ]
    arguments.append(
        DeclareLaunchArgument(
            'simulated',
            default_value='false',
            description='the same as source:=simulated',
            choices=TRUE_OR_FALSE,
        )
    )
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
