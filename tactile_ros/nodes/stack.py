# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""stack: sensor_node and contact_node in one process, with direct calls; of a hand grip_node too.

One loop reads, estimates, decides and publishes; the executor's thread serves services, parameters
and joint states. Each sensor of a hand has such a loop, and the one that brings the last force
steps the grip. Names of nodes, topics, services and parameters are those of the processes.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rclpy.node import Node

from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.graph import HandSetup, stack_of
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.lifecycle import ManagedNode
from tactile_ros.nodes.parameters import Schema, StackOptions
from tactile_ros.nodes.sensor_node import SensorNode

# s; at the default of 5 ms a busy thread delays the loop by tens of milliseconds
SWITCH_INTERVAL_S = 2e-4
FRAMES_BEFORE_FREEZE = 100
LOOK_S = 0.25


def setup_of() -> HandSetup:
    """Graph that the parameters of this process ask for."""
    node = Node('stack')
    schema = Schema(StackOptions())
    schema.declare(node)
    choices = dict(vars(schema.read(node)))
    refusal = raise_priority(choices.pop('priority'))
    if refusal:
        node.get_logger().warning(refusal)
    namespace = node.get_namespace().strip('/')
    node.destroy_node()
    for name in ('fingers', 'ports'):
        choices[name] = ','.join(choices[name])
    return HandSetup(**choices, namespace=namespace, stack=True)


def raise_priority(priority: int) -> str:
    """Give all threads of the process a real-time priority; a sentence where it is not granted.

    One without it that holds Python's lock, and waits for a processor, would stop them all.
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


def rest_collector(contact: ContactNode) -> None:
    """Keep the garbage collector off all that stays, once a contact_node has run for a while."""

    def rest() -> None:
        if contact.loop is not None and contact.loop.statistics.frames >= FRAMES_BEFORE_FREEZE:
            contact.destroy_timer(timer)
            gc.collect()
            gc.freeze()

    timer = contact.create_timer(LOOK_S, rest, clock=contact.steady)


def build() -> Sequence[ManagedNode]:
    """Make the nodes; who listens comes first: it is ready before the first frame."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    setup = setup_of()
    if not setup.hand:
        contact = ContactNode(direct=True)
        rest_collector(contact)
        return [contact, SensorNode(contact.take, contact.is_ready)]
    grip = GripNode()
    contacts, sensors = [], []
    for name, process in zip(setup.sensors(), stack_of(setup), strict=True):
        if grip.topic_of(name) != f'/{process.namespace}/contacts':
            continue  # remapped: it has no sensor of its own
        own = process.ros_arguments()
        contact = ContactNode(True, grip.take_states, own)
        contacts.append(contact)
        sensors.append(SensorNode(contact.take, contact.is_ready, own))
    for contact in contacts[:1]:
        rest_collector(contact)
    grip.direct = {contact.topic for contact in contacts}
    return [grip, *contacts, *sensors]
