# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""MagneticField per chip and Image of a matrix: only for those who listen or ask."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Image, MagneticField

from tactile_ros.messages import read_frame
from tactile_ros.msg import TactileFrame
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.sensor_node import SensorNode
from tactile_ros.nodes.standard_messages import (
    LISTENERS_NS,
    FrameViews,
    StandardTopics,
    grid_of,
    image_of,
)
from tactile_ros.physics.magnetics import in_sensor_axes
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactState, Frame, Layout

if TYPE_CHECKING:
    from conftest import Ros

MS = 1_000_000
BEGIN_NS = 5_000_000_000
STATE = ContactState.assemble(5, {})


class Publisher:
    """Counts how often it is asked who listens, and what it sends."""

    def __init__(self) -> None:
        self.listeners = self.asked = 0
        self.sent: list[object] = []
        self.publish = self.sent.append

    def get_subscription_count(self) -> int:
        self.asked += 1
        return self.listeners


class Talk:
    """Standard topics whose publishers are those."""

    def __init__(self) -> None:
        made: dict[str, Publisher] = {}
        node = SimpleNamespace(managed_publisher=lambda _, t: made.setdefault(t, Publisher()))
        self.topics = StandardTopics(node, load_sensor('reskin_board'))  # type: ignore[arg-type]
        self.wrench = made['wrench']

    def say(self, at_ns: int) -> None:
        frame = Frame(at_ns, 0, np.zeros((5, 3)))
        self.topics.publish(frame, STATE, 'pad', None, 'nan')  # type: ignore[arg-type]


@pytest.fixture
def talk() -> Talk:
    return Talk()


def test_a_fast_stream_asks_rarely_who_listens(talk: Talk) -> None:
    for i in range(100):
        talk.say(BEGIN_NS + i * MS)
    assert talk.wrench.asked == 100 // (LISTENERS_NS // MS) + 1
    assert not talk.wrench.sent
    # one who comes is heard within a look, and one who leaves too
    for i in range(100, 140):
        talk.wrench.listeners = int(105 <= i < 125)
        talk.say(BEGIN_NS + i * MS)
    stamps = [sent.header.stamp.nanosec // MS for sent in talk.wrench.sent]  # type: ignore[attr-defined]
    assert 105 <= stamps[0] <= 105 + LISTENERS_NS // MS
    assert stamps == list(range(stamps[0], 125))


@pytest.mark.parametrize('step_ns', [10 * MS, -MS])
def test_slow_frames_and_clocks_that_step_back_ask_every_time(talk: Talk, step_ns: int) -> None:
    for i in range(10):
        talk.wrench.listeners = i % 2
        talk.say(BEGIN_NS + i * step_ns)
    assert len(talk.wrench.sent) == 5


SQUARE = np.array([[x, y, 0] for y in range(3) for x in range(4)], float) * 2e-3
QUARTER = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def matrix(positions: np.ndarray) -> Layout:
    return Layout(positions, ('p',), '1')


def test_an_image_looks_at_the_skin_from_above() -> None:
    order = np.random.default_rng(0).permutation(12)
    grid = grid_of(matrix(SQUARE[order]))
    assert (grid.height, grid.width) == (3, 4)
    values = (10 * SQUARE[order, 1] + SQUARE[order, 0])[:, None] / 2e-3
    message = image_of(Frame(5, 0, values), grid, 'thumb')
    pixels = np.frombuffer(bytes(message.data), '<f4').reshape(3, 4)
    # the largest y is the first row, x grows to the right
    np.testing.assert_allclose(pixels, [[20, 21, 22, 23], [10, 11, 12, 13], [0, 1, 2, 3]])
    assert (message.encoding, message.step) == ('32FC1', 16)
    assert (message.header.frame_id, message.header.stamp.nanosec) == ('thumb', 5)


@pytest.mark.parametrize(
    'layout',
    [
        matrix(SQUARE[:-1]),
        matrix(SQUARE * [1, 1.5, 1] + [[1e-3 * (i == 3), 0, 0] for i in range(12)]),
        matrix(np.vstack([SQUARE[:11], SQUARE[:1]])),
        Layout(SQUARE, ('Bx', 'By', 'Bz'), 'T'),
    ],
    ids=['a hole', 'out of line', 'twice', 'three channels'],
)
def test_what_is_no_matrix_has_no_image(layout: Layout) -> None:
    assert grid_of(layout) is None


def test_fields_are_turned_into_the_axes_of_the_sensor() -> None:
    layout = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T', np.array([np.eye(3), QUARTER]))
    made: list[str] = []
    node = SimpleNamespace(
        create_publisher=lambda _, name, __: made.append(name), count_subscribers=lambda _: 0
    )
    FrameViews(node, layout, magnetic_field=True, image=True)  # type: ignore[arg-type]
    assert made == ['magnetic_field/chip_0', 'magnetic_field/chip_1']
    got = in_sensor_axes(np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]), layout.rotations)
    np.testing.assert_allclose(got, [[1, 2, 3], [-2, 1, 3]])
    FrameViews(node, Layout(np.zeros((2, 3)), ('Bx', 'Bz'), 'T'), True, True)  # type: ignore[arg-type]
    assert len(made) == 2


def topics(node: Node) -> set[str]:
    """What the node publishes beside frames."""
    names = [name for name, _ in node.get_topic_names_and_types() if node.count_publishers(name)]
    return {name for name in names if 'magnetic_field' in name or 'image' in name}


def test_a_subscription_makes_the_view_of_one_chip(ros: Ros) -> None:
    ros.init('sensor:=reskin_board', 'simulated:=true', 'frame_id:=thumb')
    node = ros.add(SensorNode())
    frames: list[TactileFrame] = ros.hear(TactileFrame, 'frame')
    lifecycle.start([node])
    assert ros.until(lambda: frames)
    assert not topics(node)
    fields: list[MagneticField] = ros.hear(MagneticField, 'magnetic_field/chip_2')
    assert ros.until(lambda: len(fields) > 5)
    assert ros.until(lambda: topics(node) == {'/magnetic_field/chip_2'})
    field = fields[0]
    same = [m for m in frames if m.header == field.header]
    assert ros.until(lambda: same or same.extend(m for m in frames if m.header == field.header))
    seen = field.magnetic_field
    np.testing.assert_array_equal([seen.x, seen.y, seen.z], read_frame(same[0], (5, 3)).values[2])
    assert field.header.frame_id == 'thumb'
    node.trigger_deactivate()
    assert ros.until(lambda: not topics(node))


def test_a_parameter_offers_the_image_of_a_matrix(ros: Ros) -> None:
    square = [float(v) for i in range(16) for v in (5e-3 * (i % 4), 5e-3 * (i // 4), 0.0)]
    offers = ('image:=true', 'magnetic_field:=true')
    ros.init('sensor:=taxel_array', 'simulated:=true', f'positions:={square}', *offers)
    node = ros.add(SensorNode())
    lifecycle.start([node])
    assert ros.until(lambda: topics(node) == {'/image'})
    images: list[Image] = ros.hear(Image, 'image')
    assert ros.until(lambda: images)
    assert (images[0].height, images[0].width) == (4, 4)
