# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Faults during a grasp through the whole graph: what the grip does, and how soon.

Twins of taxel arrays that a fake hand presses, their drivers, contacts and the grip, in processes
of their own; hand and twins live here, so that the true force and the time of each fault are
known. Both fingers are needed (`fewest_fingers`), so that each fault asks for the safe action.
"""

import math
import os
import signal
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.harness.live import QUIET
from benchmarks.harness.rows import Row
from tactile_ros.control import GripPhase
from tactile_ros.evaluation.figures import Plot, standalone
from tactile_ros.hands.drivers import read_command
from tactile_ros.nodes.graph import Graph, HandSetup, grasping
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array

SENSOR = 'taxel_array'
HANDS = {'joint_trajectory': ('left', 'right'), 'allegro_v5': ('index', 'thumb')}
TARGET, MS, ROW_N = 2.0, 1e3, 0.2  # N, and of a row that is drawn
LEAST, LARGEST = 0.5 * TARGET, 1.2 * TARGET  # neither dropped nor crushed
STALE_S = 0.1  # as in GripConfig
WATCHED_S, PATIENCE_S = 0.8, 40.0
GRIP = {'closing_rate': 0.5, 'stiffness_high': 60.0, 'fewest_fingers': 2, 'fault_time': 30.0}
SENDING_S = 0.02  # by which commands may lie closer together than they were made
LIES_S = 0.005  # between forces that are no numbers
NEAR = 0.01  # of a joint to the last target (unit of the joint)
KILLED_IN = (GripPhase.CLOSE, GripPhase.LOAD)  # while the command moves
Found = tuple[list[Row], str]  # rows, and a sentence


@dataclass(frozen=True)
class Fault:
    """What goes wrong, and how it is mended; `stale` (s) until the input counts as such.

    0: it says itself that it is bad. Where not `refused` the grip must go on as if nothing was.
    """

    name: str
    begin: Callable[[], object]
    end: Callable[[], object] = lambda: None
    stale: float = STALE_S
    refused: bool = True


@dataclass(frozen=True)
class Suffered:
    """True force (s,) (N) of the finger that presses most, at times (s,) after a fault (s).

    `after`: when the safe action began (s); NaN: never.
    """

    at: Array
    force: Array
    after: float


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
        self.graph = Graph(tuple(p for p in whole.processes if p.executable != 'mock_hand'))
        self.running = held.enter_context(Running(self.graph, QUIET))

    def _on_state(self, state: object) -> None:
        self.seen.states.append((time.monotonic(), state))
        self.seen.forces.append(self.force)

    def _on_command(self, message: object, info: dict[str, int]) -> None:
        position, _ = read_command(self._topic.kind, message, self.hand._driver.joints)
        self.seen.commands.append((1e-9 * info['source_timestamp'], position))
        self.seen.last = message

    @property
    def force(self) -> float:
        """True force of the finger that presses most (N)."""
        return max(self.hand.pressed.force)

    @property
    def is_moving(self) -> bool:
        """The last two commands differ."""
        newest = [position for _, position in self.seen.commands[-2:]]
        return len(newest) == 2 and bool(np.abs(newest[1] - newest[0]).max() > 0.0)

    @property
    def phase(self) -> int:
        """Newest phase."""
        return self.seen.states[-1][1].phase if self.seen.states else GripPhase.IDLE

    def spin(self, seconds: float, until: Callable[[], object] = lambda: False) -> bool:
        """Serve callbacks until something holds; whether it did in time."""
        deadline = time.monotonic() + seconds
        while not until():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.005)
        return True

    def hold(self) -> None:
        """Wait until the object is held, asking for a grasp where there is none."""
        self.ask(self.goal, lambda: self.phase == GripPhase.HOLD)
        self.spin(0.5)
        self.ask(self.goal, lambda: self.phase == GripPhase.HOLD)

    def ask(self, goal: object, until: Callable[[], object], other: object = None) -> None:
        """Ask again and again until something holds, for another goal in between."""
        asked = -math.inf
        deadline = time.monotonic() + PATIENCE_S
        while not self.spin(0.01, until):
            if time.monotonic() - asked > 4.0 and self.grasp.server_is_ready():
                self.grasp.send_goal_async(goal)
                asked, goal, other = time.monotonic(), other or goal, goal
            if time.monotonic() > deadline:
                msg = f'the grip did not answer within {PATIENCE_S:g} s: {self.running.lines}'
                raise TimeoutError(msg)

    def kill(self, name: str) -> None:
        """End a process at once."""
        self.running.children[name].send_signal(signal.SIGKILL)

    def again(self, name: str) -> None:
        """Start a killed process again."""
        self.running.children[name].wait(PATIENCE_S)
        (process,) = (p for p in self.graph.processes if self.graph.name_of(p) == name)
        self.running.start(process)

    def outside(self) -> Row:
        """Commands beyond limits, or farther from any before than the joints' speed allows."""
        count, limits = 0, self.hand._driver.limits
        if self.seen.commands:
            at, position = map(np.array, zip(*self.seen.commands, strict=True))
            beyond = (position < limits.lower - 1e-9) | (position > limits.upper + 1e-9)
            for way in (position, -position):
                ahead = way - limits.velocity * at[:, None]
                ahead = ahead - np.minimum.accumulate(ahead)
                beyond |= ahead > limits.velocity * SENDING_S + 1e-9
            count = int(beyond.any(axis=1).sum())
        return Row('commands outside limits', '1', float(count), aim=0.0)

    def faults(self) -> list[Fault]:
        """All that can go wrong here."""
        from rclpy.parameter import Parameter

        twin = self.hand.pressed.twins[0]
        contact, sensor = f'{self.fingers[0]}/contact_node', f'{self.fingers[1]}/sensor_node'

        def hand(fault: str) -> Callable[[], object]:
            return lambda: self.hand.set_parameters([Parameter('fault', value=fault)])

        def lie() -> None:
            message = self.contacts(valid=True, sequence=2**40, slip=-1)
            message.wrench.force.z = math.nan
            message.header.stamp = self.node.get_clock().now().to_msg()
            self.spoof.publish(message)

        def nan() -> None:
            self.lies = self.node.create_timer(LIES_S, lie)

        return [
            Fault('sensor unplugged for 1 s', lambda: twin.inject('unplug')),
            Fault('sensor sends nothing for 0.5 s', lambda: twin.inject('stall')),
            Fault('frames frozen', lambda: twin.inject('stuck_chip', 100)),
            Fault('board clock jumps', lambda: twin.inject('clock_jump'), refused=False),
            Fault('NaN between the forces', nan, lambda: self.node.destroy_timer(self.lies), 0.0),
            Fault('hand driver silent', hand('silent'), hand('none')),
            Fault('joint states NaN', hand('nan'), hand('none')),
            Fault('contact_node killed', lambda: self.kill(contact), lambda: self.again(contact)),
            Fault('sensor_node killed', lambda: self.kill(sensor), lambda: self.again(sensor)),
        ]

    def suffer(self, fault: Fault) -> tuple[list[Row], str, Suffered]:
        """Let one fault happen; what the grip did."""
        before = self.force
        self.seen = seen = Seen()
        began = time.monotonic()
        fault.begin()
        self.spin(WATCHED_S)
        bad = [(at, state.refusal) for at, state in seen.states if state.phase == GripPhase.FAULT]
        after, why = (bad[0][0] - began, bad[0][1]) if bad else (math.nan, '')
        fault.end()
        largest, least = max(seen.forces, default=before), min(seen.forces, default=before)
        rows = [
            Row('force, largest', 'N', largest, aim=LARGEST),
            Row('force, least', 'N', least, 'high', aim=LEAST),
            self.outside(),
        ]
        if fault.refused:
            late = MS * max(after - fault.stale, 0.0) if bad else MS * WATCHED_S
            rows.insert(0, Row('safe action after stale', 'ms', late, aim=100.0))
        did = f'holds: {why}' if bad else ('NO REACTION' if fault.refused else 'goes on')
        shown = f'{MS * after:.0f} ms after the fault' if bad else '-'
        at = np.array([at for at, _ in seen.states]) - began
        return rows, f'{did} | {shown}', Suffered(at, np.array(seen.forces), after)

    def die(self, phase: GripPhase) -> Found:
        """Kill the grip while its command moves: it must have sent a posture last, which holds."""
        self.ask(self.opening, lambda: self.phase == GripPhase.IDLE and self.force == 0.0)
        self.seen = seen = Seen()
        self.ask(self.goal, lambda: self.phase == phase and self.is_moving, self.opening)
        self.kill('grip_node')
        self.spin(WATCHED_S)
        stopped = self.hand.joints.position
        self.spin(0.2)
        now, (_, target) = self.hand.joints.position, seen.commands[-1]
        rows = [
            Row('joints beside the last target', 'rad', float(np.abs(now - target).max()),
                aim=NEAR),
            Row('joints that still move', 'rad', float(np.abs(now - stopped).max()), aim=NEAR),
            Row('last command holds no posture', '1', float(not is_posture(seen.last)), aim=0.0),
            Row('force, largest', 'N', max([*seen.forces, self.force]), aim=LARGEST),
            self.outside(),
        ]  # fmt: skip
        self.again('grip_node')
        self.seen = Seen()
        return rows, f'the last posture holds, {self.force:.2f} N | at once'


def fault_rows(extent: str) -> tuple[list[Row], list[str], dict[str, str]]:
    """Rows, notes and drawings of every fault (quick: the first and one death, of one hand)."""
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    traces: dict[str, dict[str, Suffered]] = {}
    rows: list[Row] = []
    notes = [
        f'Faults during a grasp of {TARGET:g} N on twins and a fake hand: fault | reaction | time'
    ]

    def keep(hand: str, name: str, found: list[Row], sentence: str) -> None:
        rows.extend(replace(row, what=f'{hand}: fault, {name}: {row.what}') for row in found)
        notes.append(f'{hand}: {name} | {sentence}')

    for hand in HANDS if extent != 'quick' else [*HANDS][:1]:
        with ExitStack() as held:
            scene = Scene(held, hand)
            for fault in scene.faults()[: 1 if extent == 'quick' else None]:
                scene.hold()
                *found, trace = scene.suffer(fault)
                traces.setdefault(hand, {})[fault.name] = trace
                keep(hand, fault.name, *found)
            for phase in KILLED_IN[-1:] if extent == 'quick' else KILLED_IN:
                keep(hand, f'grip_node killed in {phase.name}', *scene.die(phase))
    return rows, notes, {'faults': drawn(traces)}


def is_posture(message: object) -> bool:
    """Whether a command asks for positions alone, none of which is unknown."""
    points = getattr(message, 'points', [message])
    for point in points:
        values = getattr(point, 'positions', getattr(point, 'position', ()))
        more = [getattr(point, name, ()) for name in ('velocity', 'velocities', 'accelerations')]
        if not len(values) or not np.isfinite(values).all() or any(len(one) for one in more):
            return False
    return True


def drawn(hands: Mapping[str, Mapping[str, Suffered]]) -> str:
    """Change of the force after each fault, a row for each; a mark where a hand began to hold."""
    names = list(dict.fromkeys(name for each in hands.values() for name in each))
    ends = [float(one.at[-1]) for each in hands.values() for one in each.values() if len(one.at)]
    plot = Plot((0.0, MS * max(ends, default=1.0)), (len(names) + 0.7, 0.0),
                'time after the fault (ms)', f'change of force, {MS * ROW_N:.0f} mN a row',
                (480, 44 * len(names) + 80), integer_ticks=True,
                description='Change of the force after each fault of a grasp')  # fmt: skip
    for row, name in enumerate(names, 1):
        plot.text(0.35 * plot.x.values[1], row - 0.3, name)
        for i, each in enumerate(hands.values()):
            if name in each and len((one := each[name]).at):
                force = row + 0.2 - (one.force - one.force[0]) / ROW_N
                plot.line(MS * one.at, force, f'line c{i}')
                if np.isfinite(one.after):
                    held = np.interp(one.after, one.at, force)
                    plot.mark(MS * one.after, float(held), i, f'fill c{i}')
    plot.rule(MS * STALE_S, 'an input counts as stale')
    title = (f'A grip of {TARGET:g} N after each fault; marks: it holds. Allowed are '
             f'{MS * (LEAST - TARGET):+.0f} to {MS * (LARGEST - TARGET):+.0f} mN')  # fmt: skip
    return standalone(plot, title=title, key=[(f'c{i}', name) for i, name in enumerate(hands)])
