"""contact_node over real DDS: contacts as offline, tare, wrench, markers, refusals."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Quaternion, WrenchStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from tactile_ros.messages import fill_frame, fill_layout, read_contacts, stamp_ns
from tactile_ros.msg import TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions
from tactile_ros.types import Frame, FrameStatus, Layout, Outline, Recording

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Ros

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Recording

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


class ObjectSensor(Node):
    """Stands in for sensor_node and hears contact_node."""

    def __init__(self) -> None:
        super().__init__('sensor')
        self.contacts: list[TactileContacts] = []
        self.poses: list[PoseWithCovarianceStamped] = []
        self.surfaces: list[PointCloud2] = []
        self.frame = self.create_publisher(TactileFrame, 'frame', qos())
        self.create_subscription(TactileContacts, 'contacts', self.contacts.append, qos())
        self.create_subscription(
            PoseWithCovarianceStamped, 'object_pose', self.poses.append, qos()
        )
        self.create_subscription(PointCloud2, 'surface', self.surfaces.append, qos())

    def send(self, sequence: int, values: np.ndarray) -> None:
        """Publish one frame."""
        message = TactileFrame()
        fill_frame(message, Frame(1_000_000_000 + 10_000_000 * sequence, sequence, values), 'jaw')
        self.frame.publish(message)


def test_object_surface_and_contacts_of_an_array(ros: Ros, array: tuple[Path, Pipeline]) -> None:
    path, pipeline = array
    ros.init('sensor:=taxel_array', f'calibration:={path}')
    contact, sensor = ros.add(ContactNode()), ros.add(ObjectSensor())
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


class Sensor(Node):
    """Stands in for sensor_node and hears contact_node."""

    def __init__(self) -> None:
        super().__init__('sensor')
        self.contacts: list[TactileContacts] = []
        self.baselines: list[TactileFrame] = []
        self.wrenches: list[WrenchStamped] = []
        self.markers: list[MarkerArray] = []
        self.calibrations: list[String] = []
        self.frame = self.create_publisher(TactileFrame, 'frame', qos())
        self.layout = self.create_publisher(TactileLayout, 'layout', qos('layout'))
        self.create_subscription(TactileContacts, 'contacts', self.contacts.append, qos())
        self.create_subscription(TactileFrame, 'baseline', self.baselines.append, qos('baseline'))
        self.create_subscription(WrenchStamped, 'wrench', self.wrenches.append, qos())
        self.create_subscription(MarkerArray, 'markers', self.markers.append, qos())
        self.create_subscription(String, 'calibration', self.calibrations.append, qos('layout'))
        self.tare = self.create_client(Trigger, 'contact_node/tare')
        self.count = 0

    def send(self, values: np.ndarray) -> None:
        """Publish rows as frames, 10 ms apart."""
        for row in np.asarray(values):
            message = TactileFrame()
            stamp_ns = 1_000_000_000 + 10_000_000 * self.count
            fill_frame(message, Frame(stamp_ns, self.count, row), 'thumb')
            self.frame.publish(message)
            self.count += 1

    def announce(self, layout: Layout) -> None:
        """Publish a layout."""
        message = TactileLayout()
        fill_layout(message, layout, Point, Quaternion)
        self.layout.publish(message)


def graph(ros: Ros, *parameters: str) -> tuple[ContactNode, Sensor]:
    """Both nodes, connected."""
    ros.init(*parameters)
    contact, sensor = ros.add(ContactNode()), ros.add(Sensor())
    lifecycle.start([contact])
    return contact, sensor


def refused(contact: ContactNode) -> str:
    """Count of frames that were not processed."""
    return next(pair.value for pair in contact.diagnose().values if pair.key == 'refused')


def connected(ros: Ros, sensor: Sensor, contact: ContactNode) -> bool:
    """Whoever must hear the first frame does."""
    return ros.until(
        lambda: (
            sensor.frame.get_subscription_count()
            and contact.count_subscribers('contacts')
            and contact.is_heard()
        )
    )


@pytest.fixture
def pair(ros: Ros, calibration: Path) -> tuple[ContactNode, Sensor]:
    """A calibrated contact_node that is heard, and its sensor."""
    contact, sensor = graph(
        ros, f'calibration:={calibration}', 'listeners:=1', 'tare_frames:=1',
        'allow_tare_in_contact:=true',
    )  # fmt: skip
    assert connected(ros, sensor, contact)
    return contact, sensor


def test_contacts_are_those_of_the_pipeline(
    ros: Ros, pair: tuple[ContactNode, Sensor], calibration: Path, touches: Recording
) -> None:
    _, sensor = pair
    pipeline = load_sensor('reskin_board').load(calibration)
    sensor.send(touches.values[:60])
    assert ros.until(lambda: len(sensor.contacts) == 60)
    got = read_contacts(sensor.contacts, 5)
    assert got['sequence'].tolist() == list(range(60))
    assert (np.diff(got['stamp_ns']) == 10_000_000).all()
    for row in range(60):
        stamp_ns = 1_000_000_000 + 10_000_000 * row
        state = pipeline.process(Frame(stamp_ns, row, touches.values[row]))
        for name in ('position', 'position_cov', 'in_contact', 'valid', 'status', 'contacts_id'):
            np.testing.assert_array_equal(got[name][row], getattr(state, name), err_msg=name)
    assert np.isfinite(got['position'][got['in_contact'] == 1][:, :2]).all()
    assert {message.header.frame_id for message in sensor.contacts} == {'thumb'}


def test_calibration_is_announced(
    ros: Ros, pair: tuple[ContactNode, Sensor], calibration: Path
) -> None:
    _, sensor = pair
    assert ros.until(lambda: sensor.calibrations)
    told = json.loads(sensor.calibrations[0].data)
    pipeline = load_sensor('reskin_board').load(calibration)
    assert told['sha256'] == pipeline.digest
    assert told['sensor'] == 'reskin_board'
    assert told['estimators'] == pipeline.estimators


def test_tare_takes_the_last_frame_and_says_from_where(
    ros: Ros, pair: tuple[ContactNode, Sensor], touches: Recording
) -> None:
    _, sensor = pair
    sensor.send(touches.values[:3])
    assert ros.until(lambda: len(sensor.contacts) == 3)
    answer = ros.call(sensor.tare, Trigger.Request())
    assert answer.success
    assert answer.message == 'baseline of 1 frames, from sequence 3 on'
    assert ros.until(lambda: len(sensor.baselines) == 2)
    baseline = sensor.baselines[-1]
    assert baseline.sequence == 3
    np.testing.assert_array_equal(baseline.values, touches.values[2].ravel())
    # what was the baseline is untouched now
    sensor.send(touches.values[2:3])
    assert ros.until(lambda: len(sensor.contacts) == 4)
    assert sensor.contacts[-1].in_contact == 0


def test_tare_is_refused_in_contact_and_its_rule_can_change(
    ros: Ros, pair: tuple[ContactNode, Sensor], touches: Recording
) -> None:
    contact, sensor = pair
    sensor.send(touches.values[:1])
    assert ros.until(lambda: len(sensor.contacts) == 1)
    assert ros.call(sensor.tare, Trigger.Request()).success
    assert contact.set_parameters([Parameter('allow_tare_in_contact', value=False)])[0].successful
    sensor.send(np.concatenate([touches.values[:1], touches.values[1:2] + 5e-3]))
    assert ros.until(lambda: len(sensor.contacts) == 3)
    assert sensor.contacts[-1].in_contact == 1
    answer = ros.call(sensor.tare, Trigger.Request())
    assert not answer.success
    assert 'while something touches' in answer.message


@pytest.mark.parametrize(('unknown_as', 'torque'), [('zero', 0.0), ('nan', math.nan)])
def test_wrench_and_markers_say_what_is_unknown(
    ros: Ros,
    pair: tuple[ContactNode, Sensor],
    touches: Recording,
    unknown_as: str,
    torque: float,
) -> None:
    contact, sensor = pair
    assert contact.set_parameters([Parameter('unknown_as', value=unknown_as)])[0].successful
    assert ros.until(
        lambda: contact.count_subscribers('wrench') and contact.count_subscribers('markers')
    )
    rows = iter(range(2, 200))
    # standard topics are published once their listeners are matched
    assert ros.until(
        lambda: (
            (sensor.wrenches and sensor.markers)
            or sensor.send(touches.values[1:2] + 1e-6 * next(rows))
        )
    )
    wrench = sensor.wrenches[0].wrench
    np.testing.assert_array_equal([wrench.force.z, wrench.torque.x], [torque, torque])
    taxels, ball, arrow = sensor.markers[0].markers
    assert len(taxels.points) == 5
    assert (ball.action, arrow.action) == (Marker.ADD, Marker.DELETE)
    assert ball.scale.x > 0


def test_without_a_calibration_contacts_say_so(ros: Ros, touches: Recording) -> None:
    contact, sensor = graph(ros, 'listeners:=1')
    assert connected(ros, sensor, contact)
    sensor.send(touches.values[:2])
    assert ros.until(lambda: len(sensor.contacts) == 2)
    assert sensor.contacts[0].status & FrameStatus.NOT_CALIBRATED
    assert math.isnan(sensor.contacts[0].wrench.force.z)
    assert 'NOT_CALIBRATED' in contact.diagnose().message


def test_a_foreign_calibration_is_refused(
    ros: Ros, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'other.npz'
    np.savez(path, sensor=np.array('gradiometer'))
    contact, _ = graph(ros, f'calibration:={path}')
    assert contact.is_over is False
    assert not contact.is_heard()
    assert str(path) in capfd.readouterr().err
    assert contact.trigger_configure() != lifecycle.SUCCESS


def test_frames_of_another_shape_are_refused_with_both_named(
    ros: Ros, pair: tuple[ContactNode, Sensor], capfd: pytest.CaptureFixture[str]
) -> None:
    contact, sensor = pair
    sensor.send(np.zeros((2, 10, 3)))
    assert ros.until(lambda: refused(contact) == '2')
    said = capfd.readouterr().err
    assert 'values of a TactileFrame of (5, 3) must have 15 entries; received (30,)' in said
    assert 'the calibration is of reskin_board' in said
    assert said.count('must have 15 entries') == 1
    assert not sensor.contacts


def test_layout_of_another_sensor_stops_processing_until_the_right_one(
    ros: Ros, pair: tuple[ContactNode, Sensor], touches: Recording
) -> None:
    contact, sensor = pair
    sensor.announce(Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T', sensor='other'))
    assert ros.until(lambda: 'of other' in contact.diagnose().message)
    assert 'the calibration is of reskin_board' in contact.diagnose().message
    sensor.send(touches.values[:1])
    assert ros.until(lambda: refused(contact) == '1')
    sensor.announce(load_sensor('reskin_board').layout(load_sensor('reskin_board').config()))
    assert ros.until(lambda: 'of other' not in contact.diagnose().message)
    sensor.send(touches.values[:1])
    assert ros.until(lambda: sensor.contacts)
    assert [message.sequence for message in sensor.contacts] == [1]


def test_diagnostics_tell_tare_age_and_tracking(
    ros: Ros, pair: tuple[ContactNode, Sensor], touches: Recording
) -> None:
    contact, sensor = pair

    def told() -> dict[str, str]:
        return {entry.key: entry.value for entry in contact.diagnose().values}

    assert contact.diagnose().level == DiagnosticStatus.STALE
    sensor.send(touches.values[:1])
    assert ros.until(lambda: len(sensor.contacts) == 1)
    assert (told()['tares'], told()['baseline age (s)']) == ('0', 'nan')
    assert ros.call(sensor.tare, Trigger.Request()).success
    sensor.send(np.concatenate([touches.values[:3:2], touches.values[:1] + 5e-3]))
    assert ros.until(lambda: len(sensor.contacts) == 4)
    assert told()['tare state'] == 'baseline of 1 frames, from sequence 1 on'
    assert told()['baseline age (s)'] == '0.03'
    assert (told()['in contact'], told()['baseline tracking']) == ('1', 'frozen in contact')
    assert contact.diagnose().level == DiagnosticStatus.ERROR
    assert contact.diagnose().message == 'no frame came in the last second'


def test_tracking_is_switched_off_whatever_the_calibration_says(
    ros: Ros, calibration: Path
) -> None:
    contact, sensor = graph(ros, f'calibration:={calibration}', 'track_baseline:=false')
    told = {entry.key: entry.value for entry in contact.diagnose().values}
    assert told['baseline tracking'] == 'off'
    assert ros.until(lambda: sensor.calibrations)
    digest = json.loads(sensor.calibrations[0].data)['sha256']
    assert digest != load_sensor('reskin_board').load(calibration).digest


def test_quality_of_service_of_one_topic_can_be_overridden(ros: Ros) -> None:
    override = 'qos_overrides./contacts.publisher'
    ros.init(f'{override}.reliability:=best_effort', f'{override}.depth:=5')
    node = ros.add(ContactNode())

    def reliability(topic: str) -> ReliabilityPolicy:
        assert ros.until(lambda: node.get_publishers_info_by_topic(topic))
        return node.get_publishers_info_by_topic(topic)[0].qos_profile.reliability

    assert reliability('/contacts') == ReliabilityPolicy.BEST_EFFORT
    assert reliability('/wrench') == ReliabilityPolicy.RELIABLE
