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
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.control import GripPhase
from tactile_ros.evaluation.benchmark import Row
from tactile_ros.nodes.graph import Graph, Process
from tactile_ros.nodes.grasp_graph import Grasping, grasping
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable

HAND, SENSOR = 'joint_trajectory', 'taxel_array'
FINGERS = ('left', 'right')
TARGET = 2.0  # N
STALE_S = 0.1  # as in GripConfig
WATCHED_S = 0.8
PATIENCE_S = 40.0
GRIP = {'closing_rate': 0.5, 'stiffness_high': 60.0, 'fewest_fingers': 2, 'fault_time': 30.0}
ALLOWED_S = 0.03  # three periods: the longest step that the law takes at once


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
    commands: list[list[float]] = field(default_factory=list)
    forces: list[float] = field(default_factory=list)


class Scene:
    """The graph, its hand and its twins, spun here."""

    def __init__(self, held: ExitStack) -> None:
        import rclpy
        from rclpy.action import ActionClient
        from rclpy.node import Node
        from trajectory_msgs.msg import JointTrajectory

        from tactile_ros.action import Grasp
        from tactile_ros.msg import GripState, TactileContacts
        from tactile_ros.nodes.lifecycle import end, serving, start
        from tactile_ros.nodes.mock_hand import MockHandNode
        from tactile_ros.nodes.quality import data

        folder = Path(held.enter_context(tempfile.TemporaryDirectory()))
        spec = load_sensor(SENSOR)
        pipeline = spec.pipeline().fit(spec.presses(spec.config(), 1))
        for finger in FINGERS:
            pipeline.save(folder / f'{finger}.npz')
        choice = Grasping(
            HAND, mock_hand=True, source='simulated', sensor=SENSOR, calibrations=str(folder)
        )
        whole = grasping(choice).with_parameters('grip_node', GRIP)
        hand = whole['mock_hand']
        rclpy.init(args=['--ros-args', *hand.ros_arguments()])
        held.callback(rclpy.try_shutdown)
        self._executor = serving()
        self.hand = MockHandNode()
        held.callback(end, self.hand)
        self.node = Node('watching')
        held.callback(self.node.destroy_node)
        for node in (self.hand, self.node):
            self._executor.add_node(node)
        start([self.hand])
        self.limits = self.hand._driver.limits
        self.seen = Seen()
        self.node.create_subscription(GripState, 'grip_node/state', self._on_state, 10)
        topic = self.hand._driver.topics[0].name
        self.node.create_subscription(JointTrajectory, topic, self._on_command, data())
        self.grasp = ActionClient(self.node, Grasp, 'grip_node/grasp')
        self.goal = Grasp.Goal(target_force=TARGET)
        self.spoof = self.node.create_publisher(TactileContacts, 'left/contacts', data())
        self.contacts = TactileContacts
        graph = Graph(tuple(p for p in whole.processes if p.executable != 'mock_hand'))
        self.running = held.enter_context(
            Running(graph, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
        )

    def _on_state(self, state: object) -> None:
        self.seen.states.append((time.monotonic(), state))
        self.seen.forces.append(max(self.hand.pressed.force))

    def _on_command(self, message: object) -> None:
        self.seen.commands.append(list(message.points[0].positions))

    def spin(self, seconds: float, until: Callable[[], object] = lambda: False) -> bool:
        """Serve callbacks until something holds; whether it did in time."""
        deadline = time.monotonic() + seconds
        while not until():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.005)
        return True

    @property
    def phase(self) -> int:
        """Newest phase."""
        return self.seen.states[-1][1].phase if self.seen.states else GripPhase.IDLE

    def hold(self) -> None:
        """Wait until the object is held, asking for a grasp where there is none."""
        asked = -math.inf
        deadline = time.monotonic() + PATIENCE_S
        while not (self.phase == GripPhase.HOLD and self.spin(0.5) is False):
            if self.phase == GripPhase.IDLE and time.monotonic() - asked > 2.0:
                if self.grasp.server_is_ready():
                    self.grasp.send_goal_async(self.goal)
                asked = time.monotonic()
            self.spin(0.05)
            if time.monotonic() > deadline:
                msg = f'nothing was held within {PATIENCE_S:g} s: {self.running.lines}'
                raise TimeoutError(msg)

    def outside(self, seen: Seen) -> int:
        """Commands beyond limits, or faster than the hand's speed allows."""
        count, last = 0, None
        for positions in seen.commands:
            now = np.array(positions)
            beyond = (now < self.limits.lower - 1e-9) | (now > self.limits.upper + 1e-9)
            if last is not None:
                beyond |= np.abs(now - last) > self.limits.velocity * ALLOWED_S + 1e-9
            count, last = count + bool(beyond.any()), now
        return count


def faults(scene: Scene) -> list[Fault]:
    """All that can go wrong here."""
    left = scene.hand.pressed.twins[0]
    processes = {scene.running.graph.name_of(p): p for p in scene.running.graph.processes}

    def kill(name: str) -> Callable[[], None]:
        return lambda: scene.running.signal(name, signal.SIGKILL)

    def again(name: str) -> Callable[[], None]:
        return lambda: _restart(scene, name, processes[name])

    def hand(fault: str) -> Callable[[], None]:
        from rclpy.parameter import Parameter

        return lambda: scene.hand.set_parameters([Parameter('fault', value=fault)]) and None

    def nan() -> None:
        message = scene.contacts(valid=True, sequence=2**40, slip=-1)
        message.wrench.force.z = math.nan
        message.header.stamp = scene.node.get_clock().now().to_msg()
        scene.spoof.publish(message)

    nothing: Callable[[], None] = lambda: None  # noqa: E731 - it mends itself
    return [
        Fault('sensor unplugged for 1 s', lambda: left.inject('unplug'), nothing),
        Fault('sensor sends nothing for 0.5 s', lambda: left.inject('stall'), nothing),
        Fault('frames frozen', lambda: left.inject('stuck_chip', 100), nothing),
        Fault('board clock jumps', lambda: left.inject('clock_jump'), nothing, refused=False),
        Fault('one NaN force', nan, nothing, stale=0.0),
        Fault('hand driver silent', hand('silent'), hand('none')),
        Fault('joint states NaN', hand('nan'), hand('none')),
        Fault('contact_node killed', kill('left/contact_node'), again('left/contact_node')),
        Fault('sensor_node killed', kill('right/sensor_node'), again('right/sensor_node')),
    ]


def _restart(scene: Scene, name: str, process: Process) -> None:
    """Start a killed process again."""
    scene.running.wait(name, PATIENCE_S)
    scene.running.start(process)


def fault_rows(extent: str) -> tuple[list[Row], list[str]]:
    """Rows of every fault, of the first three where it shall be quick; the table as sentences."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rows: list[Row] = []
    told = ['Faults during a grasp of 2 N on twins and a fake hand: fault | reaction | time']
    with ExitStack() as held:
        scene = Scene(held)
        for fault in faults(scene)[: 1 if extent == 'quick' else None]:
            scene.hold()
            found, sentence = _suffer(scene, fault)
            rows += found
            told.append(sentence)
        scene.hold()
        rows += _killed(scene)
        told.append('grip_node killed | the last posture holds | 0 ms')
    return rows, told


def _suffer(scene: Scene, fault: Fault) -> tuple[list[Row], str]:
    """Let one fault happen; what the grip did."""
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
        Row(f'{name}: force, largest', 'N', largest, aim=1.2 * TARGET),
        Row(f'{name}: force, least', 'N', least, 'high', aim=0.5 * TARGET),
        Row(f'{name}: commands outside limits', '1', float(scene.outside(seen)), aim=0.0),
    ]
    if fault.refused:
        late = 1e3 * max(after - fault.stale, 0.0) if bad else None
        rows.insert(0, Row(f'{name}: safe action after stale', 'ms', late, aim=100.0))
    did = f'holds: {why}' if bad else ('NO REACTION' if fault.refused else 'goes on')
    shown = f'{1e3 * after:.0f} ms after the fault' if bad else '-'
    return rows, f'{fault.name} | {did} | {shown}'


def _killed(scene: Scene) -> list[Row]:
    """The grip itself dies: what it sent last must hold."""
    scene.seen = Seen()
    scene.running.signal('grip_node', signal.SIGKILL)
    scene.spin(0.2)
    before = np.array(scene.hand.pressed.force)
    scene.spin(WATCHED_S)
    moved = float(np.abs(np.array(scene.hand.pressed.force) - before).max())
    return [
        Row('fault, grip_node killed: change of force', 'N', moved, aim=0.05 * TARGET),
        Row(
            'fault, grip_node killed: commands outside limits', '1',
            float(scene.outside(scene.seen)), aim=0.0,
        ),
    ]  # fmt: skip
