# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What surrounds a grip while its delay is taken: boards that send, a hand that listens.

Each in a process of its own, so that what is measured is the nodes alone. Boards write one frame
at a time and keep when they did; the listener keeps when the middleware of the nodes sent each
command, which is the end of their work, and when its own received it.
"""

from __future__ import annotations

import os
import struct
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.types import Integers

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection

COMMANDS, STATES = '/allegroHand_0/joint_cmd', '/allegroHand_0/joint_states'
POSTURE_S, PATIENCE_S = 0.01, 30.0
TARGET = 1.5  # N
FLICKER = 1e-5  # rad, of encoders: a posture that never changes is a fault
SILENT_S = 2.0  # without commands, after which a grasp is asked for again
STAMP = struct.Struct('<iI')  # of the header behind the four bytes that every message begins with
FORK = get_context('fork')
NS = 1_000_000_000


@dataclass(frozen=True)
class Heard:
    """Commands of one run.

    Attributes
    ----------
    stamp_ns : ndarray, shape (n,)
        Of the forces that they answer.
    sent_ns, received_ns : ndarray, shape (n,)
        When the middleware sent and received them.
    refusal : str
        What grip_node said in its diagnostics when it sent nothing last; empty: it always did.
    """

    stamp_ns: Integers
    sent_ns: Integers
    received_ns: Integers
    refusal: str = ''


@dataclass
class Helper:
    """A process that reports and ends when it is told."""

    work: Callable[[Connection], None]
    ours: Connection = field(init=False)

    def __enter__(self) -> Helper:
        """Start it."""
        self.ours, theirs = FORK.Pipe()
        self._process = FORK.Process(target=self.work, args=(theirs,), daemon=True)
        self._process.start()
        return self

    def hear(self) -> object:
        """What it reports next."""
        if not self.ours.poll(PATIENCE_S):
            msg = f'a helper of the bench said nothing for {PATIENCE_S:g} s'
            raise TimeoutError(msg)
        return self.ours.recv()

    def end(self) -> object:
        """Tell it to end; its last report."""
        self.ours.send('end')
        last = self.hear()
        self._process.join(PATIENCE_S)
        return last

    def __exit__(self, *_: object) -> None:
        """Leave nothing behind."""
        if self._process.is_alive():
            self._process.terminate()
        self._process.join(PATIENCE_S)


def boards(
    encode: Callable[[int, int, int], bytes], count: int, rate_hz: float
) -> Callable[[Connection], None]:
    """Work of boards that send side by side; `encode(board, frame, time_us)` gives the bytes."""

    def work(pipe: Connection) -> None:
        with ExitStack() as stack:
            ports = [stack.enter_context(SimulatedSerialPort()) for _ in range(count)]
            pipe.send([port.port for port in ports])
            for port in ports:
                port.wait_for_reader(PATIENCE_S)
            pipe.send(_stream(ports, encode, rate_hz, pipe))

    return work


def _stream(
    ports: list[SimulatedSerialPort],
    encode: Callable[[int, int, int], bytes],
    rate_hz: float,
    pipe: Connection,
) -> Integers:
    """Send until told to end; when each frame of the last board was written (ns)."""
    period_ns = round(NS / rate_hz)
    begin = time.time_ns()
    written: list[int] = []
    while len(written) % 64 or not pipe.poll():
        at = begin + len(written) * period_ns
        time.sleep(max(at - time.time_ns(), 0) / NS)
        time_us = (time.time_ns() - begin) // 1000
        frames = [encode(board, len(written), time_us) for board in range(len(ports))]
        for port, frame in zip(ports, frames, strict=True):
            now = time.time_ns()
            port.send(frame)
        written.append(now)
    return np.array(written, np.int64)


def listener(pipe: Connection) -> None:
    """Work of a hand that stands still: tells its posture, asks for a grasp, hears commands."""
    import rclpy
    from rclpy.node import Node

    rclpy.init()
    node = Node('listening_hand')
    hand = Hand(node)
    while not pipe.poll():
        rclpy.spin_once(node, timeout_sec=0.05)
        if hand.news():
            pipe.send('commands come')
    pipe.send(Heard(*np.array(hand.heard, np.int64).reshape(-1, 3).T, hand.refusal))
    node.destroy_node()
    rclpy.try_shutdown()


class Hand:
    """A hand that stands still."""

    def __init__(self, node: object) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.action import ActionClient
        from rclpy.qos import QoSProfile
        from sensor_msgs.msg import JointState

        from tactile_ros.action import Grasp
        from tactile_ros.hands import load_hand

        self.heard: list[tuple[int, int, int]] = []
        self.refusal = ''
        self._counted, self._silent_s = 0, time.monotonic()
        self._told = False
        self._asked_s = 0.0
        self._node, self._kind, self._goal = node, JointState, Grasp.Goal(target_force=TARGET)
        described = load_hand('allegro_v5')
        self._names = list(described.driver.joints)
        self._posture = described.posture('pre_grasp', np.zeros(16))
        self._rng = np.random.default_rng(0)
        self._states = node.create_publisher(JointState, STATES, 10)
        deep = QoSProfile(depth=1000)
        node.create_subscription(JointState, COMMANDS, self._on_command, deep, raw=True)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, deep)
        self._grasp = ActionClient(node, Grasp, 'grip_node/grasp')
        node.create_timer(POSTURE_S, self._tell)

    def _on_command(self, data: bytes, info: dict[str, int]) -> None:
        """Keep the times of a command."""
        sec, nanosec = STAMP.unpack_from(data, 4)
        self.heard.append(
            (sec * NS + nanosec, info['source_timestamp'], info['received_timestamp'])
        )

    def _on_diagnostics(self, message: object) -> None:
        """Keep why the grip sends nothing, once it has sent something."""
        for status in message.status:
            told = {pair.key: pair.value for pair in status.values}
            refusal = told.get('refusal', 'none')
            if self.heard and refusal != 'none':
                self.refusal = refusal

    def _tell(self) -> None:
        """Say where the joints are, and ask for a grasp where no commands come."""
        flicker = FLICKER * self._rng.normal(size=len(self._posture))
        message = self._kind(name=self._names, position=(self._posture + flicker).tolist())
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._states.publish(message)
        now_s = time.monotonic()
        if len(self.heard) > self._counted:
            self._counted, self._silent_s = len(self.heard), now_s
        if now_s - max(self._silent_s, self._asked_s) > SILENT_S:
            if self._grasp.server_is_ready():
                self._grasp.send_goal_async(self._goal)
            self._asked_s = now_s

    def news(self) -> bool:
        """Whether the first commands have just come."""
        told, self._told = self._told, len(self.heard) > 10
        return self._told and not told


def caller(service: str) -> Callable[[Connection], None]:
    """Work of a client that asks a node for its parameters, again and again."""

    def work(pipe: Connection) -> None:
        import rclpy
        from rcl_interfaces.srv import GetParameters
        from rclpy.node import Node

        rclpy.init()
        node = Node('asking')
        client = node.create_client(GetParameters, service)
        answers = 0
        while not pipe.poll():
            if client.wait_for_service(0.1):
                future = client.call_async(GetParameters.Request(names=['use_sim_time']))
                rclpy.spin_until_future_complete(node, future, timeout_sec=1.0)
                answers += future.done()
        pipe.send(answers)
        node.destroy_node()
        rclpy.try_shutdown()

    return work


class Spun:
    """Nodes of this process, as `test/reference/grip_roads.py` asks for them."""

    def init(self, *parameters: str) -> None:
        """Start ROS with parameters."""
        import rclpy

        from tactile_ros.nodes.lifecycle import events_executor

        chosen = [text for parameter in parameters for text in ('-p', parameter)]
        rclpy.init(args=['--ros-args', *chosen])
        self._executor, self._nodes = events_executor(), []

    def add(self, node: object) -> object:
        """Spin a node too."""
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def until(self, holds: Callable[[], object]) -> bool:
        """Spin until a condition holds; False when it did not in time."""
        deadline = time.monotonic() + PATIENCE_S
        while not holds() and time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.01)
        return bool(holds())

    def close(self) -> None:
        """End the nodes and ROS."""
        import rclpy

        for node in reversed(self._nodes):
            node.destroy_node()
        rclpy.try_shutdown()


def difference(pipe: Connection) -> None:
    """Play the same press on every road and send the largest difference of commands."""
    from reference import grip_roads
    from tactile_ros.nodes import grip_node

    with TemporaryDirectory() as folder:
        press = grip_roads.learnt_press(Path(folder) / 'force.npz')
        alone = grip_roads.offline(press)
        found = []
        for direct in (True, False):
            clock, ros = grip_roads.Clock(), Spun()
            grip_node.time = SimpleNamespace(monotonic=clock.monotonic)
            found.append(grip_roads.lived(ros, press, clock, direct))
            ros.close()
    pipe.send(max(float(np.abs(live - alone).max()) for live in found))


def kept_waiting(pid: int) -> dict[int, tuple[float, float]]:
    """Of each thread: how long it ran, and how long it was ready without a processor (s)."""
    found = {}
    for task in Path(f'/proc/{pid}/task').iterdir():
        with suppress(OSError):  # it has ended meanwhile
            ran, waited = (task / 'schedstat').read_text('ascii').split()[:2]
            found[int(task.name)] = int(ran) / NS, int(waited) / NS
    return found


def busiest(
    before: dict[int, tuple[float, float]], after: dict[int, tuple[float, float]]
) -> float:
    """Time of waiting over time of running, of the thread that ran most; NaN: unknown."""
    ran = {task: one[0] - before.get(task, (0.0, 0.0))[0] for task, one in after.items()}
    most = max(ran, key=ran.__getitem__, default=-1)
    if most < 0 or not ran[most] > 0:
        return float('nan')
    return (after[most][1] - before.get(most, (0.0, 0.0))[1]) / ran[most]


def processor_seconds(pid: int) -> float:
    """User and system time of a process so far (s)."""
    fields = Path(f'/proc/{pid}/stat').read_text('ascii').rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
