# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A small fitted calibration, a few real touches, and nodes that live in this process."""

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.evaluation.recording_files import save_recording
from tactile_ros.nodes import enrolment_server
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

PATIENCE_S = 120.0
TOUCHES = 20


@pytest.fixture(scope='session', autouse=True)
def patience_of_clients() -> Iterator[None]:
    """Clients of an enrolment wait as long as all others here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(enrolment_server, 'PATIENCE_S', PATIENCE_S)
        patch.setattr(enrolment_server, 'ANSWER_S', PATIENCE_S)
        yield


@pytest.fixture(scope='session')
def spatial() -> Recording:
    """Real touches, each after its own resting reading."""
    return load_sensor('reskin_board').recordings()['spatial']


@pytest.fixture(scope='session')
def touches(spatial: Recording) -> Recording:
    """The touches that are played."""
    return spatial.select(slice(0, 2 * TOUCHES))


@pytest.fixture(scope='session')
def touches_file(touches: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('touches') / 'touches.npz'
    save_recording(touches, path)
    return path


@pytest.fixture(scope='session')
def calibration(spatial: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration of other touches."""
    path = tmp_path_factory.mktemp('calibration') / 'board.npz'
    train = spatial.select(slice(2000, 3200))
    load_sensor('reskin_board').pipeline(estimator='ridge').fit(train).save(path)
    return path


class Port(SimulatedSerialPort):
    """A board's port that takes readings."""

    def play(self, rows: Sequence[np.ndarray]) -> None:
        for row in rows:
            self.send(encode(row))


@pytest.fixture
def port() -> Iterator[Port]:
    with Port() as simulated:
        yield simulated


class Ros:
    """Nodes of this process in one executor, spun until a condition holds."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.executor: SingleThreadedExecutor | None = None
        self._listener: Node | None = None

    def init(self, *parameters: str, remaps: Sequence[str] = ()) -> None:
        """Start ROS with parameters `name:=value` and remappings `from:=to`."""
        arguments = [text for parameter in parameters for text in ('-p', parameter)]
        arguments += [text for rule in remaps for text in ('-r', rule)]
        rclpy.init(args=['--ros-args', *arguments] if arguments else None)
        self.executor = SingleThreadedExecutor()

    def add(self, node: Node) -> Node:
        """Spin a node too."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    @property
    def listener(self) -> Node:
        """A node that is none of those under test."""
        if self._listener is None:
            self._listener = self.add(Node('listener'))
        return self._listener

    def hear(self, kind: type, topic: str) -> list:
        """Messages of a topic from now on."""
        heard: list = []
        leaf = topic.rsplit('/', 1)[-1]
        self.listener.create_subscription(kind, topic, heard.append, qos(leaf))
        return heard

    def until(self, holds: Callable[[], object], timeout: float = PATIENCE_S) -> bool:
        """Spin until a condition holds; False when it did not within `timeout` (s)."""
        deadline = time.monotonic() + timeout
        while not holds():
            if time.monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.01)
        return True

    def call(self, client: object, request: object) -> object:
        """Answer of a service of these or of other nodes."""
        assert self.until(client.service_is_ready)
        return self.result(client.call_async(request))

    def ask(self, kind: type, name: str, **request: object) -> object:
        """Answer of a service by its name."""
        return self.call(self.listener.create_client(kind, name), kind.Request(**request))

    def result(self, future: object) -> object:
        """Result of a future."""
        assert self.until(future.done)
        return future.result()

    def begin(self, send: Callable[[], object]) -> object:
        """Handle of a goal that is taken: it is refused until all listeners are matched."""
        handles = [self.result(send())]
        assert self.until(lambda: handles[-1].accepted or handles.append(self.result(send())))
        return handles[-1]

    @staticmethod
    def change(node: Node, **values: object) -> object:
        """Result of setting parameters together, as `ros2 param set` does."""
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        return node.set_parameters_atomically(parameters)

    def close(self) -> None:
        """End the nodes and ROS."""
        for node in reversed(self.nodes):
            getattr(node, 'end', node.destroy_node)()
        if self.executor is not None:
            self.executor.shutdown()
        rclpy.try_shutdown()


@pytest.fixture
def ros() -> Iterator[Ros]:
    """ROS in this process."""
    running = Ros()
    try:
        yield running
    finally:
        running.close()


@pytest.fixture
def rows(spatial: Recording) -> np.ndarray:
    """Readings, shape (s, 5, 3) (T)."""
    return spatial.values[:200]
