# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Surroundings of a grip while its delay is taken: boards that send, a hand that listens.

Each in a process of its own, so that what is measured is the nodes alone. Boards play a rest, and
a press that stays once fingers close: of a hand that stands still no other is believed. They keep
when they wrote each frame; the listener keeps when the middleware of the nodes sent each command,
which is the end of their work, and when its own received it. The kernel tells in /proc how long a
thread ran and how long it was ready without a processor; in which of its functions a thread sleeps
is looked at again and again, from another process.
"""

from __future__ import annotations

import dataclasses
import os
import struct
import time
import tty
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from itertools import cycle
from math import nan
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from select import select
from threading import get_native_id

import numpy as np

from tactile_ros.devices.framed_protocol import encode as framed
from tactile_ros.devices.framed_protocol import gradiometer
from tactile_ros.devices.reskin_protocol import encode as packet
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.nodes.graph import Value
from tactile_ros.nodes.sensor_node import Reader
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array

COMMANDS, STATES = '/allegroHand_0/joint_cmd', '/allegroHand_0/joint_states'
POSTURE_S, PATIENCE_S = 0.01, 30.0
FLICKER = 1e-5  # rad, of encoders: a posture that never changes is a fault
CLOSING = 0.02  # rad of a command from the posture: fingers know their zero
SILENT_S = 2.0  # without commands, after which a grasp is asked for again
STAMP = struct.Struct('<iI')  # of the header behind the four bytes that every message begins with
FORK = get_context('fork')
NS = 1_000_000_000
FAST_HZ, SLOW_HZ = 1000.0, 100.0
FINGERS = ('index', 'middle', 'ring', 'thumb')
CHIPS, PITCH = 20, 5e-3  # of a skin; m
FORCE = 1.5  # N, of the press that the boards play, and of the grasp
KEPT, REST = 512, 200  # noisy frames of it that are played again and again, after a rest
LOOK_S = 5e-3
LOCK = 'futex'  # in the name of the kernel function that waits for a lock
UNKNOWN = 'this system does not tell what its threads waited for'


@dataclass(frozen=True)
class Scene:
    """What is played into which nodes, at a rate of frames and commands alike."""

    sensor: str
    rate_hz: float
    fingers: tuple[str, ...]  # with a sensor of their own; the others of the hand hear the first
    encode: Callable[[int, int, int], bytes]  # of row, frame, time (us)
    values: dict[str, Value]  # parameters of the sensors

    @property
    def heard(self) -> dict[str, str]:
        """Topics of fingers without a sensor."""
        others = [name for name in FINGERS if name not in self.fingers]
        return {f'/{name}/contacts': f'/{self.fingers[0]}/contacts' for name in others}


def gradiometer_scene(folder: Path, estimator: str | None = None) -> Scene:
    """One gradiometer at 1 kHz that four fingers hear."""
    spec, payload = load_sensor('gradiometer'), gradiometer()
    config = dataclasses.replace(spec.config(), rate_hz=FAST_HZ)
    values, warmth = _calibrated(folder, 'gradiometer', config, estimator)
    counts = np.rint(values / spec.connection().tesla_per_count).astype(np.int64)

    def encode(row: int, frame: int, time_us: int) -> bytes:
        return framed(payload, counts[row], frame, time_us, warmth[row])

    parameters = {'rate_hz': FAST_HZ, 'native_usb': True}
    return Scene('gradiometer', FAST_HZ, FINGERS[:1], encode, parameters)


def skin_scene(folder: Path) -> Scene:
    """Four skins of 20 chips at 100 Hz, one for each finger."""
    spec = load_sensor('reskin_board')
    rows, columns = np.divmod(np.arange(CHIPS), 5)
    places = PITCH * np.stack([columns - 2.0, rows - 1.5, np.zeros(CHIPS)], axis=1)
    config = dataclasses.replace(spec.config(), positions=places, rate_hz=SLOW_HZ)
    frames = [packet(row) for row in _calibrated(folder, 'reskin_board', config)[0]]
    parameters = {'rate_hz': SLOW_HZ, 'positions': places.ravel().tolist()}
    return Scene('reskin_board', SLOW_HZ, FINGERS, lambda row, *_: frames[row], parameters)


def _calibrated(
    folder: Path, key: str, config: object, estimator: str | None = None
) -> tuple[Array, Array]:
    """Calibrate on presses of another seed; rows (s, t, c) to play, and warmth (s,)."""
    spec = load_sensor(key)
    learnt, presses = spec.presses(config, 1), spec.presses(config, 0)
    some = slice(None, None, -(-len(learnt) // 3000))
    pipeline = spec.pipeline(config, estimator=estimator).fit(learnt.select(some))
    (folder / key).mkdir(parents=True, exist_ok=True)
    for finger in FINGERS:
        pipeline.save(folder / key / f'{finger}.npz')
    force = np.nan_to_num(presses.truth['force'])
    straight = np.linalg.norm(force - [0.0, 0.0, FORCE], axis=1).argmin()
    rests = np.flatnonzero(force[:, 2] == 0)
    rows = np.append(np.resize(rests, REST), np.full(KEPT, straight))
    values = presses.values[rows].copy()
    noise = np.random.default_rng(0).normal(size=values[REST:].shape)
    values[REST:] += pipeline.rest_.noise * noise
    chips = presses.temperature_c
    return values, np.full(len(rows), nan) if chips is None else chips[rows].mean(axis=1)


@dataclass
class Helper:
    """A process that reports and ends when it is asked."""

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


def boards(scene: Scene) -> Callable[[Connection], None]:
    """Work of boards that rest until told, then press; reports when the last wrote each frame."""

    def work(pipe: Connection) -> None:
        with ExitStack() as stack:
            ports = [stack.enter_context(SimulatedSerialPort()) for _ in scene.fingers]
            pipe.send([port.port for port in ports])
            for port in ports:
                port.wait_for_reader(PATIENCE_S)
            period_ns, begin, written = round(NS / scene.rate_hz), time.time_ns(), []
            for rows in (range(REST), range(REST, REST + KEPT)):
                for row in cycle(rows):
                    at = begin + len(written) * period_ns
                    time.sleep(max(at - time.time_ns(), 0) / NS)
                    frame = scene.encode(row, len(written), (time.time_ns() - begin) // 1000)
                    for port in ports:
                        now = time.time_ns()
                        port.send(frame)
                    written.append(now)
                    if select([pipe], [], [], 0)[0]:
                        break
                if pipe.recv() == 'end':
                    break
            pipe.send(np.array(written, np.int64))

    return work


def listener(pipe: Connection) -> None:
    """Work of a hand that stands still: tells its posture, asks for a grasp, hears commands.

    Reports that it closes; then stamps of the forces that commands answer, when they were sent and
    received (3, n), and how its grasps ended.
    """
    import rclpy
    from rclpy.node import Node

    rclpy.init()
    node = Node('listening_hand')
    hand = Hand(node, pipe)
    while not pipe.poll():
        rclpy.spin_once(node, timeout_sec=0.05)
    pipe.send((np.array(hand.heard, np.int64).reshape(-1, 3).T, '; '.join(hand.ends)))
    node.destroy_node()
    rclpy.try_shutdown()


class Hand:
    """A hand that stands still."""

    def __init__(self, node: object, pipe: Connection) -> None:
        from rclpy.action import ActionClient
        from sensor_msgs.msg import JointState

        from tactile_ros.action import Grasp
        from tactile_ros.hands import load_hand

        self.heard, self.ends = [], []
        self._pipe, self._closes, self._silent_s = pipe, False, time.monotonic()
        self._node, self._kind, self._goal = node, JointState, Grasp.Goal(target_force=FORCE)
        described = load_hand('allegro_v5')
        self._names = list(described.driver.joints)
        self._posture = described.posture('pre_grasp', np.zeros(16))
        self._rng = np.random.default_rng(0)
        self._states = node.create_publisher(JointState, STATES, 10)
        node.create_subscription(JointState, COMMANDS, self._on_command, 1000, raw=True)
        self._grasp = ActionClient(node, Grasp, 'grip_node/grasp')
        node.create_timer(POSTURE_S, self._tell)

    def _on_command(self, data: bytes, info: dict[str, int]) -> None:
        """Keep the times of a command, and look whether it closes."""
        (sec, nanosec), sent = STAMP.unpack_from(data, 4), info['source_timestamp']
        self.heard.append((sec * NS + nanosec, sent, info['received_timestamp']))
        self._silent_s = time.monotonic()
        if not self._closes:
            from rclpy.serialization import deserialize_message

            away = deserialize_message(data, self._kind).position - self._posture
            self._closes = bool(np.abs(away).max() > CLOSING)
            if self._closes:
                self._pipe.send('it closes')

    def _tell(self) -> None:
        """Say where the joints are, and ask for a grasp where no commands come."""
        flicker = FLICKER * self._rng.normal(size=len(self._posture))
        message = self._kind(name=self._names, position=(self._posture + flicker).tolist())
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._states.publish(message)
        if time.monotonic() - self._silent_s > SILENT_S and self._grasp.server_is_ready():
            self._silent_s = time.monotonic()
            self._grasp.send_goal_async(self._goal).add_done_callback(self._on_answer)

    def _on_answer(self, accepted: object) -> None:
        """Keep how a grasp ends."""
        end = accepted.result().get_result_async()
        end.add_done_callback(lambda done: self.ends.append(done.result().result.message))


def floor(port: str, threads: str) -> None:
    """Read a gradiometer's frames and publish a command for each by rclpy alone, until killed.

    Its stamp is the board's time, on this clock by the quickest frame so far.
    """
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import JointState

    from tactile_ros.hands import load_hand

    Path(threads).write_text(str(get_native_id()), 'ascii')
    layout, waiting, ahead_ns = gradiometer().frame, b'', 1 << 62
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    publisher = rclpy.create_node('floor').create_publisher(JointState, COMMANDS, 3)
    message = JointState(name=list(load_hand('allegro_v5').driver.joints), position=[0.0] * 16)
    board = os.open(port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(board)
    while True:
        waiting += os.read(board, 4096)
        while len(waiting) >= layout.itemsize:
            one, waiting = waiting[: layout.itemsize], waiting[layout.itemsize :]
            time_ns = 1000 * int(np.frombuffer(one, layout)['time_us'][0])
            ahead_ns = min(ahead_ns, time.time_ns() - time_ns)
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = divmod(time_ns + ahead_ns, NS)
            publisher.publish(message)


def caller(pipe: Connection) -> None:
    """Work of a client that asks grip_node for its parameters, again and again."""
    import rclpy
    from rcl_interfaces.srv import GetParameters
    from rclpy.node import Node

    rclpy.init()
    node = Node('asking')
    client = node.create_client(GetParameters, '/grip_node/get_parameters')
    answers = 0
    while not pipe.poll():
        if client.wait_for_service(0.1):
            future = client.call_async(GetParameters.Request(names=['use_sim_time']))
            rclpy.spin_until_future_complete(node, future, timeout_sec=1.0)
            answers += future.done()
    pipe.send(answers)
    node.destroy_node()
    rclpy.try_shutdown()


def note(path: str) -> None:
    """Let each reader of this process write its thread into a file."""
    run = Reader._run

    def noted(self: Reader) -> None:
        with Path(path).open('a', encoding='ascii') as kept:
            kept.write(f'{get_native_id()}\n')
        run(self)

    Reader._run = noted


def watched(pid: int, threads: list[int], seconds: float) -> str:
    """Watch threads of a process for a time (s); what they waited for, as a sentence."""
    places = [Path(f'/proc/{pid}/task/{thread}') for thread in threads]
    before, end, seen = _scheduled(places), time.monotonic() + seconds, []
    while time.monotonic() < end:
        for place in places:
            with suppress(OSError):  # it has ended
                seen.append((place / 'wchan').read_text('ascii'))
        time.sleep(LOOK_S)
    ran, ready = (_scheduled(places) - before) / max(len(places), 1) / seconds / NS
    slept = [LOCK in where for where in seen if where not in ('', '0')]
    parts = {'ran': ran, 'were ready without a processor': ready} if ran > 0 else {}
    if slept:
        parts['slept until a lock was free'] = sum(slept) / len(seen)
        parts['slept until bytes came'] = slept.count(False) / len(seen)
    waits = ', '.join(f'{what} for {100 * share:.0f} %' for what, share in parts.items())
    return f'the threads that read and answer, of the time: {waits}' if waits else UNKNOWN


def _scheduled(places: list[Path]) -> Array:
    """Time (2,) (ns) that threads ran, and were ready without a processor."""
    found = np.zeros(2)
    for place in places:
        with suppress(OSError):  # it has ended meanwhile
            found += [int(part) for part in (place / 'schedstat').read_text('ascii').split()[:2]]
    return found
