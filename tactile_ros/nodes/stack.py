"""stack: sensor_node and contact_node in one process, with direct calls; of a hand grip_node too.

One loop reads, estimates, decides and publishes; the executor's thread serves services, parameters
and joint states. Each sensor of a hand has such a loop, and the one that brings the last force
steps the grip. Names of nodes, topics, services and parameters are those of the processes.
"""

from __future__ import annotations

import gc
import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.node import Node

from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.graph import Grasping, sensors_of, stack_of
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.lifecycle import ManagedNode, main_of, serving
from tactile_ros.nodes.parameters import Schema
from tactile_ros.nodes.sensor_node import SensorNode

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Frame

# s; at the default of 5 ms a busy thread delays the loop by tens of milliseconds
SWITCH_INTERVAL_S = 2e-4
WARM_FRAMES = 100


@dataclass(frozen=True)
class StackOptions:
    """Parameters that say what runs in the process; the nodes have their own."""

    hand: str = field(
        default='',
        metadata={'help': 'hand whose sensors and grip run here; empty: one sensor alone'},
    )
    fingers: tuple[str, ...] = field(
        default=(), metadata={'help': 'sensors of the hand that take part; empty: all'}
    )
    sensor: str = field(default='reskin_board', metadata={'help': 'key of the sensors'})
    source: str = field(
        default='hardware',
        metadata={
            'help': 'where frames come from',
            'choices': ('hardware', 'recorded', 'simulated'),
        },
    )
    ports: tuple[str, ...] = field(
        default=(), metadata={'help': 'serial ports in the order of the fingers'}
    )
    calibrations: str = field(default='', metadata={'help': 'folder with <finger>.npz'})
    seed: int = field(default=0, metadata={'help': 'of the twins, counted up by finger'})
    priority: int = field(
        default=0,
        metadata={
            'help': 'real-time priority of the process (SCHED_FIFO), where the system grants it; '
            '0: none',
            'range': (0, 99),
        },
    )


def choice() -> Grasping:
    """What the parameters of this process ask for."""
    node = Node('stack')
    schema = Schema(StackOptions())
    schema.declare(node)
    options, space = schema.read(node), node.get_namespace()
    refusal = raised(options.priority)
    if refusal:
        node.get_logger().warning(refusal)
    node.destroy_node()
    return Grasping(
        hand=options.hand,
        fingers=','.join(options.fingers),
        sensor=options.sensor,
        source=options.source,
        ports=','.join(options.ports),
        calibrations=options.calibrations,
        seed=options.seed,
        namespace=space.strip('/'),
        stack=True,
    )


def raised(priority: int) -> str:
    """Give the process a real-time priority; why not, empty: it has it, or none was asked for.

    All threads get it, and those that they start: one without it that holds Python's lock, and is
    kept from a processor by another program, would stop them all.
    """
    if priority == 0:
        return ''
    try:
        for thread in Path('/proc/self/task').iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return (
            f'the system grants no real-time priority {priority}: allow it with `ulimit -r`, '
            'rtprio in /etc/security/limits.conf, or CAP_SYS_NICE; going on without'
        )
    return ''


def frozen_after(
    take: Callable[[Sequence[Frame], str], None], frames: int = WARM_FRAMES
) -> Callable[[Sequence[Frame], str], None]:
    """Hand frames on and, once warm, keep the garbage collector off all that stays."""
    left = frames

    def step(some: Sequence[Frame], frame_id: str) -> None:
        nonlocal left
        take(some, frame_id)
        if left > 0:
            left -= len(some)
            if left <= 0:
                gc.collect()
                gc.freeze()

    return step


def build() -> Sequence[ManagedNode]:
    """Who listens comes first: it is ready before the first frame."""
    chosen = choice()
    if not chosen.hand:
        contact = ContactNode(direct=True)
        return [contact, SensorNode(frozen_after(contact.take), contact.is_heard)]
    grip = GripNode()
    contacts, sensors = [], []
    for name, process in zip(sensors_of(chosen), stack_of(chosen), strict=True):
        if grip.topic_of(name) != f'/{process.namespace}/contacts':
            continue  # remapped: it has no sensor of its own
        own = process.ros_arguments()
        contact = ContactNode(True, grip.take_states, own)
        # the collector rests once the first sensor is warm
        take = contact.take if contacts else frozen_after(contact.take)
        contacts.append(contact)
        sensors.append(SensorNode(take, contact.is_heard, own))
    grip.direct = {contact.topic for contact in contacts}
    return [grip, *contacts, *sensors]


def main() -> None:
    """Run the stack until it is told to stop."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    main_of(build, serving)


if __name__ == '__main__':
    main()
