"""MagneticField per chip and Image of a matrix: only for those who listen or ask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Image, MagneticField

from tactile_ros.messages import read_frame
from tactile_ros.msg import TactileFrame
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.lifecycle import data
from tactile_ros.nodes.sensor_node import SensorNode
from tactile_ros.nodes.standard_messages import grid_of, image_of, in_sensor_axes, is_magnetic
from tactile_ros.types import Frame, Layout

if TYPE_CHECKING:
    from conftest import Ros

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
        matrix(SQUARE[:4]),
        matrix(SQUARE * [1, 1.5, 1] + [[1e-3 * (i == 3), 0, 0] for i in range(12)]),
        matrix(np.vstack([SQUARE[:11], SQUARE[:1]])),
        Layout(SQUARE, ('Bx', 'By', 'Bz'), 'T'),
    ],
    ids=['a hole', 'a line', 'out of line', 'twice', 'three channels'],
)
def test_what_is_no_matrix_has_no_image(layout: Layout) -> None:
    assert grid_of(layout) is None


def test_fields_are_turned_into_the_axes_of_the_sensor() -> None:
    layout = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T', np.array([np.eye(3), QUARTER]))
    got = in_sensor_axes(np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]), layout)
    np.testing.assert_allclose(got, [[1, 2, 3], [-2, 1, 3]])
    assert is_magnetic(layout)
    assert not is_magnetic(Layout(np.zeros((2, 3)), ('Bx', 'Bz'), 'T'))


def topics(node: Node) -> set[str]:
    """What the node publishes beside frames."""
    names = [name for name, _ in node.get_topic_names_and_types() if node.count_publishers(name)]
    return {name for name in names if 'magnetic_field' in name or 'image' in name}


def test_a_subscription_makes_the_view_of_one_chip(ros: Ros) -> None:
    ros.init('sensor:=reskin_board', 'simulated:=true', 'frame_id:=thumb')
    node, listener = ros.add(SensorNode()), ros.add(Node('listener'))
    fields: list[MagneticField] = []
    frames: list[TactileFrame] = []
    listener.create_subscription(TactileFrame, 'frame', frames.append, data())
    lifecycle.start([node])
    assert ros.until(lambda: frames)
    assert not topics(node)
    listener.create_subscription(MagneticField, 'magnetic_field/chip_2', fields.append, data())
    assert ros.until(lambda: len(fields) > 5)
    assert ros.until(lambda: topics(node) == {'/magnetic_field/chip_2'})
    by_stamp = {(m.header.stamp.sec, m.header.stamp.nanosec): m for m in frames}
    field = fields[0]
    assert ros.until(lambda: (field.header.stamp.sec, field.header.stamp.nanosec) in by_stamp)
    frame = read_frame(by_stamp[field.header.stamp.sec, field.header.stamp.nanosec], (5, 3))
    seen = field.magnetic_field
    np.testing.assert_array_equal([seen.x, seen.y, seen.z], frame.values[2])
    assert field.header.frame_id == 'thumb'
    node.trigger_deactivate()
    assert ros.until(lambda: not topics(node))


def test_a_parameter_offers_the_image_of_a_matrix(ros: Ros) -> None:
    square = [float(v) for i in range(16) for v in (5e-3 * (i % 4), 5e-3 * (i // 4), 0.0)]
    offers = ('image:=true', 'magnetic_field:=true')
    ros.init('sensor:=taxel_array', 'simulated:=true', f'positions:={square}', *offers)
    node, listener = ros.add(SensorNode()), ros.add(Node('listener'))
    images: list[Image] = []
    lifecycle.start([node])
    assert ros.until(lambda: topics(node) == {'/image'})
    listener.create_subscription(Image, 'image', images.append, data())
    assert ros.until(lambda: images)
    assert (images[0].height, images[0].width) == (4, 4)
