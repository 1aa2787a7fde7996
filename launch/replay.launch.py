# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Play the frames of a bag into contact_node, on the bag's own clock: to look at, not to measure.

ros2 launch tactile_ros replay.launch.py bag:=touches calibration:=board.npz
ros2 launch tactile_ros replay.launch.py bag:=out/demo/reskin_board/bags/place namespace:=place

`tactile replay` repeats a live run exactly, its tares included, and evaluates it without ROS. Here
the tares of the bag are not repeated: call contact_node/tare where the bag is at rest.

The player starts once contact_node listens, however long that takes to load; without autostart
it waits for whoever activates the node.
"""

from __future__ import annotations

from launch.actions import (
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
    TimerAction,
)
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.ros_adapters import get_ros_node

from launch import Event, LaunchContext, LaunchDescription, LaunchDescriptionEntity
from tactile_ros.nodes.graph import BagPlayback, replaying
from tactile_ros.nodes.processes import chosen, declared, node_of

DEFAULTS = BagPlayback()
ON_ITS_WAY_S = 1.0  # for frames that the node has not taken yet
LOOK_S = 0.2


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """contact_node, and then the player of the bag; whichever ends ends everything."""
    choice = chosen(context, DEFAULTS)
    level = LaunchConfiguration('log_level').perform(context)
    (contact,) = [node_of(process, level) for process in replaying(choice).processes]
    player = ExecuteProcess(cmd=choice.command(), output='screen')
    end = TimerAction(period=ON_ITS_WAY_S, actions=[Shutdown(reason='the bag is over')])
    ended = OnProcessExit(target_action=player, on_exit=[end])
    gone = OnProcessExit(target_action=contact, on_exit=without_node)
    waiting = OpaqueFunction(function=once_heard, args=[player, choice.topics[0]])
    return [contact, RegisterEventHandler(ended), RegisterEventHandler(gone), waiting]


def without_node(_: Event, context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """The end, where the node ended by itself."""
    return [] if context.is_shutdown else [Shutdown(reason='contact_node ended')]


def once_heard(
    context: LaunchContext, player: ExecuteProcess, topic: str
) -> list[LaunchDescriptionEntity]:
    """The player, as soon as contact_node listens to the frames; until then look again."""
    listeners = get_ros_node(context).get_subscriptions_info_by_topic(topic)
    if 'contact_node' in (one.node_name for one in listeners):
        return [player]
    again = OpaqueFunction(function=once_heard, args=[player, topic])
    return [TimerAction(period=LOOK_S, actions=[again])]


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the graph."""
    return LaunchDescription([*declared(DEFAULTS), OpaqueFunction(function=start)])
