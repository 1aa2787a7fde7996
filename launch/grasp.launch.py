# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A hand that holds: the sensors of its fingers, their contacts, the grip; one argument chooses.

ros2 launch tactile_ros grasp.launch.py hand:=allegro_v4 calibrations:=calibrations/
ros2 launch tactile_ros grasp.launch.py hand:=qb_softhand fingers:=thumb,index
ros2 launch tactile_ros grasp.launch.py hand:=allegro_v5 mock_hand:=true source:=simulated
"""

from __future__ import annotations

from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from tactile_ros.nodes.graph import HandSetup, grasping
from tactile_ros.nodes.processes import chosen, declared, node_of

DEFAULTS = HandSetup(stack=True)


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Every process of the graph that the arguments choose."""
    level = LaunchConfiguration('log_level').perform(context)
    setting = chosen(context, DEFAULTS)
    return [node_of(p, level, setting.respawn) for p in grasping(setting).processes]


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the graph."""
    return LaunchDescription([*declared(DEFAULTS), OpaqueFunction(function=start)])
