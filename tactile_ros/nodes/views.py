"""Standard messages of a frame for other tools: MagneticField per chip, Image of a matrix.

They exist where a parameter asks for them, or as soon as somebody subscribes to their names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from sensor_msgs.msg import Image, MagneticField

from tactile_ros import messages
from tactile_ros.nodes.quality import data

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from tactile_ros.types import Array, Frame, Integers, Layout

FIELD_TOPIC = 'magnetic_field/chip_{}'  # no part of a topic's name may begin with a digit
IMAGE_TOPIC = 'image'
SAME_LINE = 1e-6  # m: coordinates nearer than this are one row or column
UNKNOWN = 0.0  # covariance of MagneticField: not known


@dataclass(frozen=True)
class Grid:
    """Taxels on a regular grid in x and y.

    Attributes
    ----------
    height, width : int
        Rows and columns.
    taxels : ndarray, shape (height * width,)
        Taxel of each place, row by row; the first row has the largest y, as one looks at the skin.
    """

    height: int
    width: int
    taxels: Integers


def grid_of(layout: Layout) -> Grid | None:
    """Grid of a layout; None where its taxels are no full regular matrix of one channel."""
    if len(layout.channels) != 1 or len(layout.positions) < 4:
        return None
    steps = np.rint(layout.positions[:, :2] / SAME_LINE).astype(np.int64)
    xs, column = np.unique(steps[:, 0], return_inverse=True)
    ys, row = np.unique(steps[:, 1], return_inverse=True)
    height, width = len(ys), len(xs)
    place = (height - 1 - np.ravel(row)) * width + np.ravel(column)
    full = height * width == len(steps) == len(np.unique(place)) and min(height, width) > 1
    if not (full and _even(xs) and _even(ys)):
        return None
    return Grid(height, width, np.argsort(place))


def _even(lines: Integers) -> bool:
    """All lines are equally far from the next."""
    gaps = np.diff(lines)
    return bool(np.ptp(gaps) <= 2)


def is_magnetic(layout: Layout) -> bool:
    """Taxels are three-axis magnetometers."""
    return layout.unit == 'T' and len(layout.channels) == 3


def in_sensor_axes(values: Array, layout: Layout) -> Array:
    """Readings (t, 3) of chips turned from their own axes to the sensor's."""
    if layout.rotations is None:
        return values
    turned: Array = np.einsum('tij,tj->ti', layout.rotations, values)
    return turned


class Views:
    """Publishers of the views of one sensor.

    Parameters
    ----------
    node : Node
        Whose publishers they are.
    layout : Layout
        Of the sensor.
    magnetic_field, image : bool
        Make the publishers now; otherwise as soon as somebody subscribes (`look`).
    """

    def __init__(self, node: Node, layout: Layout, magnetic_field: bool, image: bool) -> None:
        self._node = node
        self._layout = layout
        self._grid = grid_of(layout)
        self._fields: dict[int, Publisher] = {}
        self._image: Publisher | None = None
        self._offered = range(len(layout.positions)) if is_magnetic(layout) else range(0)
        self.look(magnetic_field, image)

    def look(self, magnetic_field: bool = False, image: bool = False) -> None:
        """Make the publishers that are asked for, or that somebody has subscribed to."""
        new = {
            i: self._node.create_publisher(MagneticField, FIELD_TOPIC.format(i), data())
            for i in self._offered
            if i not in self._fields and (magnetic_field or self._is_wanted(FIELD_TOPIC.format(i)))
        }
        # never changed in place: another thread publishes
        self._fields = {**self._fields, **new}
        wanted = self._grid is not None and self._image is None
        if wanted and (image or self._is_wanted(IMAGE_TOPIC)):
            self._image = self._node.create_publisher(Image, IMAGE_TOPIC, data())

    def _is_wanted(self, topic: str) -> bool:
        return bool(self._node.count_subscribers(topic))

    def close(self) -> None:
        """Remove the publishers."""
        for publisher in [*self._fields.values(), *([self._image] if self._image else [])]:
            self._node.destroy_publisher(publisher)
        self._fields, self._image = {}, None

    def publish(self, frame: Frame, frame_id: str) -> None:
        """Publish a frame's views where somebody listens."""
        heard = [i for i, p in self._fields.items() if p.get_subscription_count()]
        if heard:
            self._publish_fields(frame, frame_id, heard)
        if self._image is not None and self._image.get_subscription_count():
            self._image.publish(image_of(frame, self._grid, frame_id))

    def _publish_fields(self, frame: Frame, frame_id: str, chips: list[int]) -> None:
        """One message per chip (T), turned into the sensor's axes."""
        field = in_sensor_axes(frame.values, self._layout)
        for i in chips:
            message = MagneticField()
            messages.fill_header(message.header, frame.stamp_ns, frame_id)
            x, y, z = field[i].tolist()
            message.magnetic_field.x = x
            message.magnetic_field.y = y
            message.magnetic_field.z = z
            message.magnetic_field_covariance = np.full(9, UNKNOWN)
            self._fields[i].publish(message)


def image_of(frame: Frame, grid: Grid, frame_id: str) -> Image:
    """Image of a matrix, 32FC1: readings as they are (fractions, say)."""
    pixels = np.ascontiguousarray(frame.values[grid.taxels, 0], '<f4')
    message = Image(
        height=grid.height, width=grid.width, encoding='32FC1', is_bigendian=0, step=4 * grid.width
    )
    messages.fill_header(message.header, frame.stamp_ns, frame_id)
    message.data = pixels.tobytes()
    return message
