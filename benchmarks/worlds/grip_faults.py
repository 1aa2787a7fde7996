# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Faults during a grasp through the whole graph: what the grip does, and how soon.

Twins of taxel arrays that a fake hand presses, their drivers, contacts and the grip, in processes
of their own; hand and twins live here, so that the true force and the time of each fault are
known. Both fingers are needed (`fewest_fingers`), so that each fault asks for the safe action.
"""

from __future__ import annotations

import math
import os
import signal
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.rows import Row
from benchmarks.worlds import grip_fault_plot
from tactile_ros.control import GripPhase
from tactile_ros.hands.drivers import read_command
from tactile_ros.nodes.graph import Graph, HandSetup, Process, grasping
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable

    from worlds.grip_fault_plot import Suffered

    from tactile_ros.types import Array

SENSOR = 'taxel_array'
HANDS = {'joint_trajectory': ('left', 'right'), 'allegro_v5': ('index', 'thumb')}
TARGET = 2.0  # N
LEAST, LARGEST = 0.5, 1.2  # of it: neither dropped nor crushed
STALE_S = 0.1  # as in GripConfig
WATCHED_S = 0.8
PATIENCE_S = 40.0
GRIP = {'closing_rate': 0.5, 'stiffness_high': 60.0, 'fewest_fingers': 2, 'fault_time': 30.0}
SENDING_S = 0.02  # by which commands may lie closer together than they were made
LIES_S = 0.005  # between forces that are no numbers
NEAR = 0.01  # of a joint to the last target (unit of the joint)
KILLED_IN = (GripPhase.CLOSE, GripPhase.LOAD)  # while the command moves


@dataclass(frozen=True)
class Fault:
    """What goes wrong, how it is mended, and what is expected.

    Attributes
    ----------
    name : str
        As the table says.
    begin, end : callable
        Cause it, mend it.
    stale : float
        Time after which the input counts as stale (s); 0: it says itself that it is bad.
    refused : bool
        The grip must refuse to go on; otherwise it must go on as if nothing was.
    """

    name: str
    begin: Callable[[], None]
    end: Callable[[], None]
    stale: float = STALE_S
    refused: bool = True


@dataclass
class Seen:
    """What was seen since a fault began."""

    states: list[tuple[float, object]] = field(default_factory=list)
    commands: list[tuple[float, Array]] = field(default_factory=list)
    last: object = None  # message
    forces: list[float] = field(default_factory=list)


class Scene:
    """The graph, its hand and its twins, spun here."""

    def __init__(self, held: ExitStack, hand: str) -> None:
        import rclpy
        from rclpy.action import ActionClient
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node

        from tactile_ros.action import Grasp
        from tactile_ros.msg import GripState, TactileContacts
        from tactile_ros.nodes.grip_node import MESSAGES
        from tactile_ros.nodes.lifecycle import qos, start
        from tactile_ros.nodes.mock_hand_node import MockHandNode

        folder = Path(held.enter_context(tempfile.TemporaryDirectory()))
        spec = load_sensor(SENSOR)
        pipeline = spec.pipeline(estimator='ridge').fit(spec.presses(spec.config(), 1))
        self.fingers = HANDS[hand]
        for finger in self.fingers:
            pipeline.save(folder / f'{finger}.npz')
        choice = HandSetup(
            hand, mock_hand=True, fingers=','.join(self.fingers), source='simulated',
            sensor=SENSOR, calibrations=str(folder),
        )  # fmt: skip
        whole = grasping(choice).with_parameters('grip_node', GRIP)
        rclpy.init(args=['--ros-args', *whole['mock_hand'].ros_arguments()])
        held.callback(rclpy.try_shutdown)
        # not that of events, which cannot tell when a message was sent
        self._executor = SingleThreadedExecutor()
        self.hand = MockHandNode()
        held.callback(self.hand.end)
        self.node = Node('watching')
        held.callback(self.node.destroy_node)
        for node in (self.hand, self.node):
            self._executor.add_node(node)
        start([self.hand])
        self.limits = self.hand._driver.limits
        self.seen = Seen()
        self.node.create_subscription(GripState, 'grip_node/state', self._on_state, 10)
        self._topic = self.hand._driver.topics[-1]
        kind = MESSAGES[self._topic.kind]
        self.node.create_subscription(kind, self._topic.name, self._on_command, qos())
        self.grasp = ActionClient(self.node, Grasp, 'grip_node/grasp')
        self.goal, self.opening = Grasp.Goal(target_force=TARGET), Grasp.Goal(target_force=0.0)
        contacts = f'{self.fingers[0]}/contacts'
        self.spoof = self.node.create_publisher(TactileContacts, contacts, qos())
        self.contacts = TactileContacts
        graph = Graph(tuple(p for p in whole.processes if p.executable != 'mock_hand'))
        self.running = held.enter_context(
            Running(graph, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
        )

    def _on_state(self, state: object) -> None:
        self.seen.states.append((time.monotonic(), state))
        self.seen.forces.append(max(self.hand.pressed.force))

    def _on_command(self, message: object, info: dict[str, int]) -> None:
        position, _ = read_command(self._topic.kind, message, self.hand._driver.joints)
        self.seen.commands.append((1e-9 * info['source_timestamp'], position))
        self.seen.last = message

    def spin(self, seconds: float, until: Callable[[], object] = lambda: False) -> bool:
        """Serve callbacks until something holds; whether it did in time."""
        deadline = time.monotonic() + seconds
        while not until():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.005)
        return True

    @property
    def is_open(self) -> bool:
        """Nothing is pressed."""
        return max(self.hand.pressed.force) == 0.0

    @property
    def is_moving(self) -> bool:
        """The last two commands differ."""
        newest = [position for _, position in self.seen.commands[-2:]]
        return len(newest) == 2 and bool(np.abs(newest[1] - newest[0]).max() > 0.0)

    @property
    def phase(self) -> int:
        """Newest phase."""
        return self.seen.states[-1][1].phase if self.seen.states else GripPhase.IDLE

    def hold(self) -> None:
        """Wait until the object is held, asking for a grasp where there is none."""
        self.ask(self.goal, lambda: self.phase == GripPhase.HOLD)
        self.spin(0.5)
        self.ask(self.goal, lambda: self.phase == GripPhase.HOLD)

    def ask(self, goal: object, until: Callable[[], object]) -> None:
        """Ask again and again until something holds."""
        asked = -math.inf
        deadline = time.monotonic() + PATIENCE_S
        while not self.spin(0.01, until):
            if time.monotonic() - asked > 4.0 and self.grasp.server_is_ready():
                self.grasp.send_goal_async(goal)
                asked = time.monotonic()
            if time.monotonic() > deadline:
                msg = f'the grip did not answer within {PATIENCE_S:g} s: {self.running.lines}'
                raise TimeoutError(msg)

    def outside(self, seen: Seen) -> int:
        """Commands beyond limits, or farther from any before than the joints' speed allows."""
        if not seen.commands:
            return 0
        at = np.array([at for at, _ in seen.commands])
        position = np.array([position for _, position in seen.commands])
        limits = self.limits
        beyond = (position < limits.lower - 1e-9) | (position > limits.upper + 1e-9)
        reach = limits.velocity * at[:, None]
        for way in (position, -position):
            ahead = way - reach
            ahead = ahead - np.minimum.accumulate(ahead)
            beyond |= ahead > limits.velocity * SENDING_S + 1e-9
        return int(beyond.any(axis=1).sum())


def faults(scene: Scene) -> list[Fault]:
    """All that can go wrong here."""
    left = scene.hand.pressed.twins[0]
    one, other = scene.fingers
    processes = {scene.running.graph.name_of(p): p for p in scene.running.graph.processes}

    def kill(name: str) -> Callable[[], None]:
        return lambda: scene.running.children[name].send_signal(signal.SIGKILL)

    def again(name: str) -> Callable[[], None]:
        return lambda: _restart(scene, name, processes[name])

    def hand(fault: str) -> Callable[[], None]:
        from rclpy.parameter import Parameter

        return lambda: scene.hand.set_parameters([Parameter('fault', value=fault)]) and None

    def lie() -> None:
        message = scene.contacts(valid=True, sequence=2**40, slip=-1)
        message.wrench.force.z = math.nan
        message.header.stamp = scene.node.get_clock().now().to_msg()
        scene.spoof.publish(message)

    def nan() -> None:
        scene.lies = scene.node.create_timer(LIES_S, lie)

    def true() -> None:
        scene.node.destroy_timer(scene.lies)

    nothing: Callable[[], None] = lambda: None  # noqa: E731 - it mends itself
    return [
        Fault('sensor unplugged for 1 s', lambda: left.inject('unplug'), nothing),
        Fault('sensor sends nothing for 0.5 s', lambda: left.inject('stall'), nothing),
        Fault('frames frozen', lambda: left.inject('stuck_chip', 100), nothing),
        Fault('board clock jumps', lambda: left.inject('clock_jump'), nothing, refused=False),
        Fault('NaN between the forces', nan, true, stale=0.0),
        Fault('hand driver silent', hand('silent'), hand('none')),
        Fault('joint states NaN', hand('nan'), hand('none')),
        Fault('contact_node killed', kill(f'{one}/contact_node'), again(f'{one}/contact_node')),
        Fault('sensor_node killed', kill(f'{other}/sensor_node'), again(f'{other}/sensor_node')),
    ]


def _restart(scene: Scene, name: str, process: Process) -> None:
    """Start a killed process again."""
    scene.running.wait(name, PATIENCE_S)
    scene.running.start(process)


def fault_rows(extent: str) -> tuple[list[Row], list[str], dict[str, str]]:
    """Rows of every fault (quick: of the first and of one death, of one hand), told and drawn."""
    traces: dict[str, list[Suffered]] = {}
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rows: list[Row] = []
    told = [
        f'Faults during a grasp of {TARGET:g} N on twins and a fake hand: fault | reaction | time'
    ]
    for hand in HANDS if extent != 'quick' else [*HANDS][:1]:
        with ExitStack() as held:
            scene = Scene(held, hand)
            for fault in faults(scene)[: 1 if extent == 'quick' else None]:
                scene.hold()
                found, sentence, trace = _suffer(scene, fault)
                traces.setdefault(hand, []).append(grip_fault_plot.Suffered(*trace))
                rows += [replace(row, what=f'{hand}: {row.what}') for row in found]
                told.append(f'{hand}: {sentence}')
            for phase in KILLED_IN[-1:] if extent == 'quick' else KILLED_IN:
                found, sentence = _killed(scene, phase)
                rows += [replace(row, what=f'{hand}: {row.what}') for row in found]
                told.append(f'{hand}: {sentence}')
    drawing = grip_fault_plot.drawn(traces, TARGET, (LEAST * TARGET, LARGEST * TARGET), STALE_S)
    return rows, told, {'faults': drawing}


def _suffer(scene: Scene, fault: Fault) -> tuple[list[Row], str, tuple[Array, Array, float]]:
    """Let one fault happen; what the grip did, and times, forces and when it began to hold."""
    before = max(scene.hand.pressed.force)
    scene.seen = seen = Seen()
    began = time.monotonic()
    fault.begin()
    scene.spin(WATCHED_S)
    bad = [(at, state.refusal) for at, state in seen.states if state.phase == GripPhase.FAULT]
    after, why = (bad[0][0] - began, bad[0][1]) if bad else (math.nan, '')
    fault.end()
    largest, least = max(seen.forces, default=before), min(seen.forces, default=before)
    name = f'fault, {fault.name}'
    rows = [
        Row(f'{name}: force, largest', 'N', largest, aim=LARGEST * TARGET),
        Row(f'{name}: force, least', 'N', least, 'high', aim=LEAST * TARGET),
        Row(f'{name}: commands outside limits', '1', float(scene.outside(seen)), aim=0.0),
    ]
    if fault.refused:
        late = 1e3 * max(after - fault.stale, 0.0) if bad else 1e3 * WATCHED_S
        rows.insert(0, Row(f'{name}: safe action after stale', 'ms', late, aim=100.0))
    did = f'holds: {why}' if bad else ('NO REACTION' if fault.refused else 'goes on')
    shown = f'{1e3 * after:.0f} ms after the fault' if bad else '-'
    at = np.array([at for at, _ in seen.states]) - began
    return rows, f'{fault.name} | {did} | {shown}', (at, np.array(seen.forces), after)


def _killed(scene: Scene, phase: GripPhase) -> tuple[list[Row], str]:
    """The grip dies while its command moves: what it sent last must be a posture, and hold."""
    scene.ask(scene.opening, lambda: scene.phase == GripPhase.IDLE and scene.is_open)
    scene.seen = seen = Seen()
    scene.ask(scene.goal, lambda: scene.phase == phase and scene.is_moving)
    scene.running.children['grip_node'].send_signal(signal.SIGKILL)
    scene.spin(WATCHED_S)
    stopped = scene.hand.joints.position
    scene.spin(0.2)
    now, (_, target) = scene.hand.joints.position, seen.commands[-1]
    rows = [
        Row('joints beside the last target', 'rad', float(np.abs(now - target).max()), aim=NEAR),
        Row('joints that still move', 'rad', float(np.abs(now - stopped).max()), aim=NEAR),
        Row('last command holds no posture', '1', float(not is_posture(seen.last)), aim=0.0),
        Row('force, largest', 'N', max([*seen.forces, *scene.hand.pressed.force]),
            aim=LARGEST * TARGET),
        Row('commands outside limits', '1', float(scene.outside(seen)), aim=0.0),
    ]  # fmt: skip
    name = f'grip_node killed in {phase.name}'
    process = next(p for p in scene.running.graph.processes if p.executable == 'grip_node')
    _restart(scene, 'grip_node', process)
    scene.seen = Seen()
    held = max(scene.hand.pressed.force)
    return (
        [replace(row, what=f'fault, {name}: {row.what}') for row in rows],
        f'{name} | the last posture holds, {held:.2f} N | at once',
    )


def is_posture(message: object) -> bool:
    """Whether a command asks for positions alone, none of which is unknown."""
    points = getattr(message, 'points', [message])
    for point in points:
        values = getattr(point, 'positions', getattr(point, 'position', ()))
        more = [getattr(point, name, ()) for name in ('velocity', 'velocities', 'accelerations')]
        if not len(values) or not np.isfinite(values).all() or any(len(one) for one in more):
            return False
    return True
