"""What the launch files share: arguments from a dataclass of choices, nodes from a graph.

`launch` comes with ROS 2 alone, so it is imported where it is used.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar

from tactile_ros.nodes.graph import PACKAGE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from launch.actions import DeclareLaunchArgument
    from launch_ros.actions import Node

    from launch import LaunchContext
    from tactile_ros.nodes.graph import Process

T = TypeVar('T')
TRUE_OR_FALSE = ['true', 'false']
LEVELS = ['debug', 'info', 'warn', 'error', 'fatal']
# what an argument means, and what it may be
About = tuple[str, 'list[str] | None']


def text_of(value: bool | float | str) -> str:
    """A default as a launch argument."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def declared(defaults: object, about: Mapping[str, About]) -> list[DeclareLaunchArgument]:
    """Arguments for fields of a dataclass, and `log_level`."""
    from launch.actions import DeclareLaunchArgument

    found = [
        DeclareLaunchArgument(
            name,
            default_value=text_of(getattr(defaults, name)),
            description=description,
            **({'choices': choices} if choices else {}),
        )
        for name, (description, choices) in about.items()
    ]
    level = DeclareLaunchArgument(
        'log_level', default_value='info', description='how much the nodes say', choices=LEVELS
    )
    return [*found, level]


def chosen(context: LaunchContext, defaults: T) -> T:
    """Dataclass of what the arguments say, each in the type of its default."""
    from launch.substitutions import LaunchConfiguration

    values: dict[str, Any] = {}
    for field in fields(defaults):  # type: ignore[arg-type]
        text = LaunchConfiguration(field.name).perform(context)
        default = getattr(defaults, field.name)
        is_switch = isinstance(default, bool)
        values[field.name] = text == 'true' if is_switch else type(default)(text)
    return type(defaults)(**values)


def node_of(process: Process, log_level: str) -> Node:
    """A process of the graph as an action."""
    from launch_ros.actions import Node

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
