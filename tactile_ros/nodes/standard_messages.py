"""Standard messages for other tools: wrench, pose, surface, markers and views of a frame.

Each is filled only where somebody listens.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, WrenchStamped
from sensor_msgs.msg import Image, MagneticField, PointCloud2, PointField
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from tactile_ros import messages
from tactile_ros.nodes.lifecycle import data

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from std_msgs.msg import Header

    from tactile_ros.messages import UnknownAs
    from tactile_ros.nodes.lifecycle import ManagedNode
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.sensors import SensorSpec
    from tactile_ros.types import Array, ContactState, Frame, Integers, Layout

METRES_PER_NEWTON = 5e-3
TAXEL_SIZE = 2e-3
GREY = ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.8)
ORANGE = ColorRGBA(r=1.0, g=0.5, b=0.0, a=0.9)
BLUE = ColorRGBA(r=0.1, g=0.4, b=1.0, a=0.9)


def _point(xyz: Array) -> Point:
    """Point of three numbers."""
    x, y, z = xyz.tolist()
    return Point(x=x, y=y, z=z)


def _marker(header: Header, name: str, kind: int, color: ColorRGBA) -> Marker:
    """Marker at the sensor's origin, not there yet."""
    marker = Marker(header=header, ns=name, id=0, type=kind, action=Marker.DELETE, color=color)
    marker.pose.orientation.w = 1.0
    return marker


def contact_markers(header: Header, layout: Layout, state: ContactState) -> MarkerArray:
    """Taxels as points, the contact as a ball of two sigma, its force as an arrow.

    Parameters
    ----------
    header : Header
        Of the frame.
    layout : Layout
        Where the taxels are.
    state : ContactState
        What is not estimated is not shown.

    Returns
    -------
    MarkerArray
        Always the same three markers, deleted where there is nothing to show.
    """
    taxels = _marker(header, 'taxels', Marker.POINTS, GREY)
    taxels.action = Marker.ADD
    taxels.scale.x = taxels.scale.y = TAXEL_SIZE
    taxels.points = [_point(xyz) for xyz in layout.positions]
    ball = _marker(header, 'contact', Marker.SPHERE, ORANGE)
    arrow = _marker(header, 'force', Marker.ARROW, BLUE)
    place = np.where(np.isfinite(state.position), state.position, 0.0)
    if np.isfinite(state.position).any() and state.in_contact != 0:
        ball.action = Marker.ADD
        ball.pose.position = _point(place)
        sigma = np.sqrt(np.diagonal(state.position_cov))
        size = 2 * np.where(np.isfinite(sigma), np.maximum(sigma, 5e-4), 1e-3)
        ball.scale.x, ball.scale.y, ball.scale.z = size.tolist()
    force = np.where(np.isfinite(state.force), state.force, 0.0)
    if force.any():
        arrow.action = Marker.ADD
        arrow.points = [_point(place), _point(place + METRES_PER_NEWTON * force)]
        arrow.scale.x, arrow.scale.y = 1e-3, 2e-3
    return MarkerArray(markers=[taxels, ball, arrow])


LOOK_NS = 9_000_000  # of the stream, within which nobody is asked again whether he listens


class StandardTopics:
    """Publishers of one contact_node.

    Parameters
    ----------
    node : ManagedNode
        Whose publishers they are.
    spec : SensorSpec
        Of its sensor: without `objects` in the config there is no `object_pose`, and without
        `surface` of the estimation no `surface`.
    """

    def __init__(self, node: ManagedNode, spec: SensorSpec) -> None:
        self._wrench = node.managed_publisher(WrenchStamped, 'wrench', data())
        self._markers = node.managed_publisher(MarkerArray, 'markers', data())
        self._object: Publisher | None = None
        self._surface: Publisher | None = None
        if hasattr(spec.config(), 'objects'):
            self._object = node.managed_publisher(PoseWithCovarianceStamped, 'object_pose', data())
        if spec.pipeline().estimation.has_surface:
            self._surface = node.managed_publisher(PointCloud2, 'surface', data())
        offered = self._wrench, self._markers, self._object, self._surface
        self._offered = [publisher for publisher in offered if publisher is not None]
        self._looked_ns, self._heard = 0, False

    def publish(
        self,
        frame: Frame,
        state: ContactState,
        frame_id: str,
        pipeline: Pipeline,
        unknown_as: UnknownAs,
    ) -> None:
        """Publish a state, each message where somebody listens."""
        if not self._is_heard(frame.stamp_ns or 0):
            return
        if self._wrench.get_subscription_count():
            wrench = WrenchStamped()
            messages.fill_header(wrench.header, frame.stamp_ns, frame_id)
            messages.fill_wrench(wrench, state, unknown_as)
            self._wrench.publish(wrench)
        if self._markers.get_subscription_count():
            header = WrenchStamped().header
            messages.fill_header(header, frame.stamp_ns, frame_id)
            self._markers.publish(contact_markers(header, pipeline.layout, state))
        if self._object is not None and self._object.get_subscription_count():
            pose = PoseWithCovarianceStamped()
            messages.fill_header(pose.header, frame.stamp_ns, frame_id)
            if messages.fill_object_pose(pose, state):
                self._object.publish(pose)
        if self._surface is not None and self._surface.get_subscription_count():
            cloud = PointCloud2()
            messages.fill_header(cloud.header, frame.stamp_ns, frame_id)
            messages.fill_surface(cloud, pipeline.estimation.surface(state), PointField)
            self._surface.publish(cloud)

    def _is_heard(self, stamp_ns: int) -> bool:
        """Whether anybody listens; of a fast sensor not asked with every frame."""
        if not 0 < stamp_ns - self._looked_ns < LOOK_NS:
            self._looked_ns = stamp_ns
            self._heard = any(one.get_subscription_count() for one in self._offered)
        return self._heard


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
