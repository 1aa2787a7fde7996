"""Objects and surfaces of a taxel array over real DDS, with several contacts in the message."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from tactile_ros.messages import fill_frame, read_contacts, stamp_ns
from tactile_ros.msg import TactileContacts, TactileFrame
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.lifecycle import data
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions
from tactile_ros.types import Frame, Outline, Recording

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Ros

    from tactile_ros.pipeline import Pipeline

PITCH, TAXELS = 5e-3, 72
SPEC = load_sensor('taxel_array')
OUTER, INNER = 14e-3, 6.5e-3
ANGLE = 2 * np.pi * np.arange(96) / 96
RIM = np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])
WASHER = Outline('washer', (OUTER * RIM, (INNER * RIM)[::-1]))
CONFIG = dataclasses.replace(  # type: ignore[type-var]
    SPEC.config(), positions=grid_positions(8, 9, PITCH), areas=np.full(TAXELS, PITCH**2),
    force_range=(0.0, 5.0), objects=(WASHER,),
)  # fmt: skip


def outputs(force: np.ndarray) -> np.ndarray:
    return (force / (force + 1.5))[..., None]


def covered(x: float, y: float, outer: float, inner: float = 0.0) -> np.ndarray:
    """Part of each taxel under a ring, by 400 points."""
    line = PITCH * ((np.arange(20) + 0.5) / 20 - 0.5)
    points = CONFIG.positions[:, None, :2] + np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    away = np.linalg.norm(points - np.array([x, y]), axis=2)
    return ((away < outer) & (away >= inner)).mean(axis=1)


@pytest.fixture(scope='module')
def array(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Pipeline]:
    """A calibration that knows forces, and how deep the skin gives way."""
    force = np.repeat(np.linspace(0, 3, 80)[:, None], TAXELS, axis=1)
    truth = {
        'taxel_force': force, 'deformation': 1e-4 * force,
        'in_contact': (force[:, 0] > 0).astype(np.int8),
    }  # fmt: skip
    recording = Recording.from_arrays(SPEC.layout(CONFIG), outputs(force), truth=truth)
    path = tmp_path_factory.mktemp('array') / 'array.npz'
    SPEC.pipeline(CONFIG).fit(recording).save(path)
    return path, SPEC.load(path)


class Sensor(Node):
    """Stands in for sensor_node and hears contact_node."""

    def __init__(self) -> None:
        super().__init__('sensor')
        self.contacts: list[TactileContacts] = []
        self.poses: list[PoseWithCovarianceStamped] = []
        self.surfaces: list[PointCloud2] = []
        self.frame = self.create_publisher(TactileFrame, 'frame', data())
        self.create_subscription(TactileContacts, 'contacts', self.contacts.append, data())
        self.create_subscription(
            PoseWithCovarianceStamped, 'object_pose', self.poses.append, data()
        )
        self.create_subscription(PointCloud2, 'surface', self.surfaces.append, data())

    def send(self, sequence: int, values: np.ndarray) -> None:
        """Publish one frame."""
        message = TactileFrame()
        fill_frame(message, Frame(1_000_000_000 + 10_000_000 * sequence, sequence, values), 'jaw')
        self.frame.publish(message)


def test_object_surface_and_contacts_of_an_array(ros: Ros, array: tuple[Path, Pipeline]) -> None:
    path, pipeline = array
    ros.init('sensor:=taxel_array', f'calibration:={path}')
    contact, sensor = ros.add(ContactNode()), ros.add(Sensor())
    lifecycle.start([contact])
    topics = ('contacts', 'object_pose', 'surface')
    assert ros.until(
        lambda: (
            all(contact.count_subscribers(t) and sensor.count_publishers(t) for t in topics)
            and sensor.frame.get_subscription_count()
        )
    )
    ring = 1.5 * covered(2e-3, -1e-3, OUTER, INNER)
    two = 1.0 * covered(-15e-3, 10e-3, 4e-3) + 2.0 * covered(12e-3, -8e-3, 4e-3)
    rows = iter(range(10_000))
    sent: dict[int, np.ndarray] = {}

    def send(force: np.ndarray) -> None:
        sequence = next(rows)
        sent[sequence] = outputs(force)
        sensor.send(sequence, sent[sequence])

    # standard topics are published once their listeners are matched
    assert ros.until(lambda: (sensor.poses and sensor.surfaces) or send(ring))
    pose = sensor.poses[-1]
    assert pose.header.frame_id == 'jaw'
    place = pose.pose.pose.position
    np.testing.assert_allclose([place.x, place.y, place.z], [2e-3, -1e-3, 0], atol=3e-4)
    assert 0 < pose.pose.covariance[0] < 1e-6
    cloud = sensor.surfaces[-1]
    points = np.frombuffer(bytes(cloud.data), '<f4').reshape(TAXELS, 3)
    touched = ring > 0.1
    np.testing.assert_allclose(points[touched, 2], -1e-4 * ring[touched], rtol=0.05)
    np.testing.assert_allclose(points[touched, :2], CONFIG.positions[touched, :2], atol=1e-7)
    assert np.isnan(points[ring == 0]).all()
    send(two)
    send(np.zeros(TAXELS))
    assert ros.until(lambda: len(sensor.contacts) == len(sent))
    last = 1_000_000_000 + 10_000_000 * (len(sent) - 1)
    assert ros.until(lambda: stamp_ns(sensor.surfaces[-1].header) == last)
    # the message says of both contacts what the pipeline says
    got = read_contacts(sensor.contacts[-2:], TAXELS)
    pipeline.reset()
    for sequence, values in sent.items():
        state = pipeline.process(Frame(1_000_000_000 + 10_000_000 * sequence, sequence, values))
        if sequence == len(sent) - 2:
            assert (state.contacts_id >= 0).sum() == 2
            for name in ('contacts_id', 'contacts_position', 'contacts_force'):
                np.testing.assert_array_equal(got[name][0], getattr(state, name)[:2])
    assert got['contacts_id'][1].tolist() == [-1, -1]
    # what is none of the known objects has no pose; nothing touched has no surface
    placed = {stamp_ns(pose.header) for pose in sensor.poses}
    assert placed <= {1_000_000_000 + 10_000_000 * sequence for sequence in range(len(sent) - 2)}
    assert np.isnan(np.frombuffer(bytes(sensor.surfaces[-1].data), '<f4')).all()


def test_sensors_that_tell_no_objects_offer_neither_topic(ros: Ros, calibration: Path) -> None:
    ros.init(f'calibration:={calibration}')
    contact = ros.add(ContactNode())
    offered = {name for name, _ in contact.get_topic_names_and_types()}
    assert '/wrench' in offered
    assert not offered & {'/object_pose', '/surface'}
