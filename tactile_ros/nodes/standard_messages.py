# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Messages for other tools, where somebody listens: wrench, pose, markers, views, truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image, MagneticField, PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from tactile_ros import messages
from tactile_ros.messages import UnknownAs
from tactile_ros.msg import TactileContact, TactileContacts
from tactile_ros.nodes.lifecycle import ManagedNode, qos
from tactile_ros.physics.magnetics import in_sensor_axes
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec
from tactile_ros.types import (
    STATE_FIELDS,
    Array,
    ContactState,
    ContactStates,
    Frame,
    Integers,
    Layout,
    Recording,
)

LISTENERS_NS = 9_000_000  # of the stream, within which nobody is asked again whether he listens
FIELD_TOPIC = 'magnetic_field/chip_{}'  # no part of a topic's name may begin with a digit
IMAGE_TOPIC = 'image'
SAME_LINE = 1e-6  # m: coordinates nearer than this are one row or column
METRES_PER_NEWTON = 5e-3
TAXEL_SIZE = 2e-3
GREY = ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.8)
ORANGE = ColorRGBA(r=1.0, g=0.5, b=0.0, a=0.9)
BLUE = ColorRGBA(r=0.1, g=0.4, b=1.0, a=0.9)


class TruthMessages:
    """Truth of a recording as TactileContacts; tare rows are untouched, the rest as stated.

    The clock of a twin's board begins with its signal, which the node's does at `start_ns` (ns).
    """

    def __init__(self, recording: Recording, start_ns: int = 0) -> None:
        self._start_ns = start_ns
        self._rate_hz, self._count = recording.layout.rate_hz, len(recording)
        columns = {name: x for name, x in recording.truth.items() if name in STATE_FIELDS}
        if recording.tare is not None:
            touched = columns.get('in_contact', np.full(len(recording), -1)).astype(np.int64)
            columns['in_contact'] = np.where(recording.tare & (touched < 0), 0, touched)
        taxels = recording.layout.shape[0]
        self._states = ContactStates.assemble(len(recording), taxels, columns)
        groups = ('session', 'repetition')
        self._groups = {n: recording.truth[n] for n in groups if n in recording.truth}

    def row_at(self, stamp_ns: int, device_time_ns: int = 0) -> int:
        """Row that was played at a time (ns), by the board's clock where it has one."""
        since_ns = device_time_ns or stamp_ns - self._start_ns
        return round(since_ns * 1e-9 * self._rate_hz) % self._count

    def message(self, row: int, header: Header, sequence: int) -> TactileContacts:
        """Truth of a row under the name of a frame."""
        message = TactileContacts()
        messages.fill_contacts(message, self._states[row], TactileContact)
        message.header, message.sequence = header, sequence
        for name, column in self._groups.items():
            setattr(message, name, int(column[row]))
        return message


def header_of(stamp_ns: int | None, frame_id: str) -> Header:
    """Header of a time (ns; None: zero) and the name of a frame."""
    header = Header()
    messages.fill_header(header, stamp_ns, frame_id)
    return header


class StandardTopics:
    """Standard messages of one contact_node; `object_pose` and `surface` where its sensor can."""

    def __init__(self, node: ManagedNode, spec: SensorSpec) -> None:
        kinds = {'wrench': WrenchStamped, 'markers': MarkerArray}
        if hasattr(spec.config(), 'objects'):
            kinds['object_pose'] = PoseWithCovarianceStamped
        if spec.pipeline().estimation.has_surface:
            kinds['surface'] = PointCloud2
        self._publishers = {t: node.managed_publisher(kind, t) for t, kind in kinds.items()}
        self._asked_ns, self._heard = 0, False

    def publish(
        self,
        frame: Frame,
        state: ContactState,
        frame_id: str,
        pipeline: Pipeline,
        unknown_as: UnknownAs,
    ) -> None:
        """Publish a state, each message where somebody listens."""
        now_ns = frame.stamp_ns or 0
        if not 0 < now_ns - self._asked_ns < LISTENERS_NS:
            self._asked_ns = now_ns
            self._heard = any(p.get_subscription_count() for p in self._publishers.values())
        if not self._heard:
            return
        header = header_of(now_ns, frame_id)
        for topic, publisher in self._publishers.items():
            if not publisher.get_subscription_count():
                continue
            if topic == 'wrench':
                message = WrenchStamped(header=header)
                messages.fill_wrench(message, state, unknown_as)
            elif topic == 'markers':
                message = contact_markers(header, pipeline.layout, state)
            elif topic == 'surface':
                message = PointCloud2(header=header)
                messages.fill_surface(message, pipeline.estimation.surface(state), PointField)
            else:
                message = PoseWithCovarianceStamped(header=header)
                if not messages.fill_object_pose(message, state):
                    continue
            publisher.publish(message)


def contact_markers(header: Header, layout: Layout, state: ContactState) -> MarkerArray:
    """Taxels as points, the contact as a ball of two sigma, its force as an arrow.

    All three are sent, deleted where there is nothing to show.
    """

    def marker(name: str, kind: int, color: ColorRGBA) -> Marker:
        made = Marker(header=header, ns=name, type=kind, action=Marker.DELETE, color=color)
        made.pose.orientation.w = 1.0
        return made

    def point(xyz: Array) -> Point:
        x, y, z = xyz.tolist()
        return Point(x=x, y=y, z=z)

    taxels = marker('taxels', Marker.POINTS, GREY)
    taxels.action = Marker.ADD
    taxels.scale.x = taxels.scale.y = TAXEL_SIZE
    taxels.points = [point(xyz) for xyz in layout.positions]
    ball = marker('contact', Marker.SPHERE, ORANGE)
    arrow = marker('force', Marker.ARROW, BLUE)
    place = np.nan_to_num(state.position, posinf=0.0, neginf=0.0)
    if np.isfinite(state.position).any() and state.in_contact != 0:
        ball.action = Marker.ADD
        ball.pose.position = point(place)
        sigma = np.sqrt(np.diagonal(state.position_cov))
        size = 2 * np.where(np.isfinite(sigma), np.maximum(sigma, 5e-4), 1e-3)
        ball.scale.x, ball.scale.y, ball.scale.z = size.tolist()
    force = np.nan_to_num(state.force, posinf=0.0, neginf=0.0)
    if force.any():
        arrow.action = Marker.ADD
        arrow.points = [point(place), point(place + METRES_PER_NEWTON * force)]
        arrow.scale.x, arrow.scale.y = 1e-3, 2e-3
    return MarkerArray(markers=[taxels, ball, arrow])


class Grid(NamedTuple):
    """Taxels (height * width,) on a regular grid, row by row; the first has the largest y."""

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
    if not full or max(np.ptp(np.diff(xs)), np.ptp(np.diff(ys))) > 2:
        return None
    return Grid(height, width, np.argsort(place))


class FrameViews:
    """MagneticField of each three-axis chip and Image of a matrix, of one sensor.

    Publishers are made now where asked for, otherwise as soon as somebody subscribes (`offer`).
    """

    def __init__(self, node: Node, layout: Layout, magnetic_field: bool, image: bool) -> None:
        self._node, self._layout = node, layout
        self._grid = grid_of(layout)
        self._publishers: dict[str, Publisher] = {}
        is_magnetic = layout.unit == 'T' and len(layout.channels) == 3
        chips = range(len(layout.positions) if is_magnetic else 0)
        self._chips = {FIELD_TOPIC.format(i): i for i in chips}
        self.offer(magnetic_field, image)

    def offer(self, magnetic_field: bool = False, image: bool = False) -> None:
        """Make the publishers that are asked for, or that somebody has subscribed to."""
        views = [(topic, MagneticField, magnetic_field) for topic in self._chips]
        views += [(IMAGE_TOPIC, Image, image)] if self._grid is not None else []
        new = {
            topic: self._node.create_publisher(kind, topic, qos())
            for topic, kind, asked in views
            if topic not in self._publishers and (asked or self._node.count_subscribers(topic))
        }
        # never changed in place: another thread publishes
        self._publishers = {**self._publishers, **new}

    def close(self) -> None:
        """Remove the publishers."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers = {}

    def publish(self, frame: Frame, frame_id: str) -> None:
        """Publish a frame's views where somebody listens."""
        heard = {t: p for t, p in self._publishers.items() if p.get_subscription_count()}
        if heard and self._chips:
            header = header_of(frame.stamp_ns, frame_id)
            field = in_sensor_axes(frame.values, self._layout.rotations)
        for topic, publisher in heard.items():
            if topic == IMAGE_TOPIC:
                message = image_of(frame, self._grid, frame_id)
            else:
                message = MagneticField(header=header, magnetic_field_covariance=np.zeros(9))
                messages.fill_vector(message.magnetic_field, field[self._chips[topic]])
            publisher.publish(message)


def image_of(frame: Frame, grid: Grid, frame_id: str) -> Image:
    """Image of a matrix, 32FC1: readings as they are (fractions, say)."""
    data = np.ascontiguousarray(frame.values[grid.taxels, 0], '<f4').tobytes()
    shape = {'height': grid.height, 'width': grid.width, 'step': 4 * grid.width}
    return Image(header=header_of(frame.stamp_ns, frame_id), encoding='32FC1', data=data, **shape)
