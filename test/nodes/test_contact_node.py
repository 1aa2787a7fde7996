# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""contact_node over real DDS: contacts as offline, tare, wrench, markers, refusals."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Quaternion, WrenchStamped
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
from tactile_ros.physics.coverage import washer
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions
from tactile_ros.types import Frame, FrameStatus, Layout, Recording

if TYPE_CHECKING:
    from conftest import Ros

PITCH, TAXELS = 5e-3, 72
SPEC = load_sensor('taxel_array')
OUTER, INNER = 14e-3, 6.5e-3
CONFIG = dataclasses.replace(  # type: ignore[type-var]
    SPEC.config(), positions=grid_positions(8, 9, PITCH), areas=np.full(TAXELS, PITCH**2),
    force_range=(0.0, 5.0), objects=(washer('washer', OUTER, INNER),),
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


class Sensor:
    """Stands in for sensor_node, and an active contact_node that is heard."""

    def __init__(self, ros: Ros, *parameters: str) -> None:
        ros.init('listeners:=1', *parameters)
        self.ros, self.node, self.count = ros, ros.add(ContactNode()), 0
        self.frame = ros.listener.create_publisher(TactileFrame, 'frame', qos())
        self.layout = ros.listener.create_publisher(TactileLayout, 'layout', qos('layout'))
        self.contacts: list[TactileContacts] = ros.hear(TactileContacts, 'contacts')
        self.baselines: list[TactileFrame] = ros.hear(TactileFrame, 'baseline')
        self.calibrations: list[String] = ros.hear(String, 'calibration')
        lifecycle.start([self.node])
        assert ros.until(lambda: self.frame.get_subscription_count() and self.node.is_ready())

    def hear(self, kind: type, topic: str) -> list:
        """Messages of a standard topic, whose listener is matched."""
        heard = self.ros.hear(kind, topic)
        assert self.ros.until(lambda: self.node.count_subscribers(topic))
        return heard

    def send(self, values: np.ndarray, stamp_ns: int | None = None) -> None:
        """Publish rows as frames, 10 ms apart where no stamp is given."""
        for row in np.asarray(values):
            message, at = TactileFrame(), stamp_of(self.count) if stamp_ns is None else stamp_ns
            fill_frame(message, Frame(at, self.count, row), 'thumb')
            self.frame.publish(message)
            self.count += 1

    def process(self, values: np.ndarray) -> None:
        """Send rows and hear their contacts."""
        self.send(values)
        assert self.ros.until(lambda: len(self.contacts) == self.count)

    def announce(self, layout: Layout) -> None:
        message = TactileLayout()
        fill_layout(message, layout, Point, Quaternion)
        self.layout.publish(message)

    def tare(self) -> Trigger.Response:
        return self.ros.ask(Trigger, 'contact_node/tare')

    def told(self) -> dict[str, str]:
        """Values of the diagnostics."""
        status = self.node.diagnose()
        return {'message': status.message, **{pair.key: pair.value for pair in status.values}}


def stamp_of(sequence: int) -> int:
    return 1_000_000_000 + 10_000_000 * sequence


@pytest.fixture
def sensor(ros: Ros, calibration: Path) -> Sensor:
    return Sensor(
        ros, f'calibration:={calibration}', 'tare_frames:=1', 'allow_tare_in_contact:=true'
    )


def test_contact_node_publishes_object_surface_and_contacts_of_an_array(
    ros: Ros, array: tuple[Path, Pipeline]
) -> None:
    path, pipeline = array
    sensor = Sensor(ros, 'sensor:=taxel_array', f'calibration:={path}')
    poses = sensor.hear(PoseWithCovarianceStamped, 'object_pose')
    surfaces = sensor.hear(PointCloud2, 'surface')
    ring = 1.5 * covered(2e-3, -1e-3, OUTER, INNER)
    two = 1.0 * covered(-15e-3, 10e-3, 4e-3) + 2.0 * covered(12e-3, -8e-3, 4e-3)
    sent: list[np.ndarray] = []

    def send(force: np.ndarray) -> None:
        sent.append(outputs(force))
        sensor.send(sent[-1:])

    # standard topics are published once their listeners are matched
    assert ros.until(lambda: (poses and surfaces) or send(ring))
    pose = poses[-1]
    assert pose.header.frame_id == 'thumb'
    place = pose.pose.pose.position
    np.testing.assert_allclose([place.x, place.y, place.z], [2e-3, -1e-3, 0], atol=3e-4)
    assert 0 < pose.pose.covariance[0] < 1e-6
    points = np.frombuffer(bytes(surfaces[-1].data), '<f4').reshape(TAXELS, 3)
    touched = ring > 0.1
    np.testing.assert_allclose(points[touched, 2], -1e-4 * ring[touched], rtol=0.05)
    np.testing.assert_allclose(points[touched, :2], CONFIG.positions[touched, :2], atol=1e-7)
    assert np.isnan(points[ring == 0]).all()
    send(two)
    send(np.zeros(TAXELS))
    assert ros.until(lambda: len(sensor.contacts) == len(sent))
    assert ros.until(lambda: stamp_ns(surfaces[-1].header) == stamp_of(len(sent) - 1))
    # the message says of both contacts what the pipeline says
    got = read_contacts(sensor.contacts[-2:], TAXELS)
    pipeline.reset()
    states = [pipeline.process(Frame(stamp_of(k), k, values)) for k, values in enumerate(sent)]
    assert (states[-2].contacts_id >= 0).sum() == 2
    for name in ('contacts_id', 'contacts_position', 'contacts_force'):
        np.testing.assert_array_equal(got[name][0], getattr(states[-2], name)[:2])
    assert got['contacts_id'][1].tolist() == [-1, -1]
    # what is none of the known objects has no pose; nothing touched has no surface
    assert {stamp_ns(m.header) for m in poses} <= {stamp_of(k) for k in range(len(sent) - 2)}
    assert np.isnan(np.frombuffer(bytes(surfaces[-1].data), '<f4')).all()


def test_tare_takes_the_last_frame_and_its_rule_can_change(
    ros: Ros, sensor: Sensor, touches: Recording
) -> None:
    assert sensor.node.diagnose().level == DiagnosticStatus.STALE
    sensor.process(touches.values[:3])
    assert (sensor.told()['tares'], sensor.told()['baseline age (s)']) == ('0', 'nan')
    answer = sensor.tare()
    assert answer.success
    assert answer.message == 'baseline of 1 frames, from sequence 3 on'
    assert ros.until(lambda: len(sensor.baselines) == 2)
    assert sensor.baselines[-1].sequence == 3
    np.testing.assert_array_equal(sensor.baselines[-1].values, touches.values[2].ravel())
    # what was the baseline is untouched now
    sensor.process(np.concatenate([touches.values[2:3], touches.values[:1] + 5e-3]))
    assert [message.in_contact for message in sensor.contacts[-2:]] == [0, 1]
    assert ros.change(sensor.node, allow_tare_in_contact=False).successful
    refused = sensor.tare()
    assert not refused.success
    assert 'while something touches' in refused.message
    told = sensor.told()
    assert told['tare state'] == f'refused: {refused.message}'
    assert told['baseline age (s)'] == '0.02'
    assert (told['in contact'], told['baseline tracking']) == ('1', 'frozen in contact')
    assert sensor.node.diagnose().level == DiagnosticStatus.ERROR
    assert sensor.node.diagnose().message == 'no frame came in the last second'


def test_contacts_without_a_calibration_say_so(ros: Ros, touches: Recording) -> None:
    sensor = Sensor(ros)
    sensor.process(touches.values[:2])
    assert sensor.contacts[0].status & FrameStatus.NOT_CALIBRATED
    assert np.isnan(sensor.contacts[0].wrench.force.z)
    assert 'NOT_CALIBRATED' in sensor.node.diagnose().message


def test_wrench_and_markers_show_the_unknown_as_asked(
    ros: Ros, sensor: Sensor, touches: Recording
) -> None:
    assert ros.change(sensor.node, unknown_as='nan').successful
    wrenches = sensor.hear(WrenchStamped, 'wrench')
    markers = sensor.hear(MarkerArray, 'markers')
    rows = iter(range(2, 200))
    assert ros.until(
        lambda: (wrenches and markers) or sensor.send(touches.values[1:2] + 1e-6 * next(rows))
    )
    wrench = wrenches[0].wrench
    assert np.isnan([wrench.force.z, wrench.torque.x]).all()
    taxels, ball, arrow = markers[0].markers
    assert len(taxels.points) == 5
    assert (ball.action, arrow.action) == (Marker.ADD, Marker.DELETE)
    assert ball.scale.x > 0


def test_contact_node_refuses_a_foreign_calibration(
    ros: Ros, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'other.npz'
    np.savez(path, sensor=np.array('gradiometer'))
    ros.init(f'calibration:={path}')
    contact = ros.add(ContactNode())
    lifecycle.start([contact])
    assert (contact.finished.is_set(), contact.exit_code, contact.is_ready()) == (True, 1, False)
    assert str(path) in capfd.readouterr().err
    assert contact.trigger_configure() != lifecycle.SUCCESS


def test_contact_node_refuses_frames_and_layouts_of_another_sensor(
    ros: Ros, sensor: Sensor, touches: Recording, capfd: pytest.CaptureFixture[str]
) -> None:
    sensor.send(np.zeros((2, 10, 3)))
    assert ros.until(lambda: sensor.told()['refused'] == '2')
    said = capfd.readouterr().err
    sentence = 'values of a TactileFrame of (5, 3) must have 15 entries; received (30,)'
    assert said.count(sentence) == 1
    assert 'the calibration is of reskin_board' in said
    sensor.announce(Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T', sensor='other'))
    assert ros.until(lambda: 'of other' in sensor.told()['message'])
    assert 'the calibration is of reskin_board' in sensor.told()['message']
    sensor.send(touches.values[:1])
    assert ros.until(lambda: sensor.told()['refused'] == '3')
    sensor.announce(load_sensor('reskin_board').layout(load_sensor('reskin_board').config()))
    assert ros.until(lambda: 'of other' not in sensor.told()['message'])
    sensor.send(touches.values[:1])
    assert ros.until(lambda: sensor.contacts)
    assert [message.sequence for message in sensor.contacts] == [3]


def test_tracking_is_switched_off_whatever_the_calibration_says(
    ros: Ros, calibration: Path
) -> None:
    sensor = Sensor(ros, f'calibration:={calibration}', 'track_baseline:=false')
    assert sensor.told()['baseline tracking'] == 'off'
    assert ros.until(lambda: sensor.calibrations)
    told = json.loads(sensor.calibrations[0].data)
    pipeline = load_sensor('reskin_board').load(calibration)
    assert told['sha256'] != pipeline.digest
    assert (told['sensor'], told['estimators']) == ('reskin_board', pipeline.estimators)
    # a sensor without objects offers neither topic of them
    offered = {name for name, _ in sensor.node.get_topic_names_and_types()}
    assert '/wrench' in offered
    assert not offered & {'/object_pose', '/surface'}


def test_diagnostics_name_times_that_cannot_be_and_a_second_publisher(
    ros: Ros, sensor: Sensor, touches: Recording
) -> None:
    sensor.process(touches.values[:2])
    for at_ns in (0, sensor.node.now_ns() + 365 * 86_400 * 10**9):
        sensor.send(touches.values[:1], at_ns)
    assert ros.until(lambda: len(sensor.contacts) == 4)
    assert [message.valid for message in sensor.contacts] == [True, True, False, False]
    assert all(message.status & FrameStatus.STALE for message in sensor.contacts[2:])
    sensor.count -= 1
    sensor.send(touches.values[:1])
    assert ros.until(lambda: len(sensor.contacts) == 5)
    told = sensor.told()['message']
    for sentence in ('2 stamps replaced', '1 stamps backwards', '1 sequences repeated'):
        assert sentence in told
    ros.listener.create_publisher(TactileFrame, 'frame', qos())
    assert ros.until(
        lambda: (
            '2 publishers send /frame' in sensor.told()['message']
            or sensor.send(touches.values[:1])
        )
    )


def test_quality_of_service_of_one_topic_can_be_overridden(ros: Ros) -> None:
    override = 'qos_overrides./contacts.publisher'
    ros.init(f'{override}.reliability:=best_effort', f'{override}.depth:=5')
    node = ros.add(ContactNode())
    for topic, wanted in (
        ('/contacts', ReliabilityPolicy.BEST_EFFORT), ('/wrench', ReliabilityPolicy.RELIABLE),
    ):  # fmt: skip
        assert ros.until(lambda topic=topic: node.get_publishers_info_by_topic(topic))
        (offered,) = node.get_publishers_info_by_topic(topic)
        assert offered.qos_profile.reliability == wanted
