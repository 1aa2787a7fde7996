# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Poses of objects and surfaces in standard messages, over the wire where they are built."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_ros import messages
from tactile_ros.types import STATE_FIELDS, ContactStates, Frame, Layout

ROOT = Path(__file__).parents[1]
LAYOUT = Layout(
    positions=np.arange(15.0).reshape(5, 3) * 1e-3, channels=('Bx', 'By', 'Bz'), unit='T',
    rotations=np.array([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]] * 4 + [np.eye(3)]),
    saturation=np.array([5e-3, 5e-3, np.inf]), rate_hz=100.0, frame_id='thumb',
    sensor='reskin_board', serial='A7',
)  # fmt: skip


def _from_rosbags() -> SimpleNamespace:
    """Message classes of rosbags as zero-argument factories, and their CDR round trip."""
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    texts = {p.stem: p.read_text() for p in (ROOT / 'msg').glob('*.msg')}
    known: dict[str, object] = {}
    for name, text in texts.items():
        known.update(typesys.get_types_from_msg(text, f'tactile_ros/msg/{name}'))
    store.register(known)

    def fresh(name: str) -> object:
        kinds = store.fielddefs[name][1]
        return store.types[name](**{f: blank(kind) for f, kind in kinds})

    def blank(kind: tuple[object, object]) -> object:
        code, what = int(kind[0]), kind[1]
        if code == 2:
            return fresh(str(what))
        if code == 3:
            return np.zeros(what[1])
        if code == 4:
            return []
        return {'string': '', 'bool': False}.get(what[0], 0)

    def wire(name: str, message: object) -> object:
        for field, kind in store.fielddefs[name][1]:
            if int(kind[0]) == 4 and kind[1][0][1][0] in ('float64', 'uint8'):
                value = np.asarray(getattr(message, field), kind[1][0][1][0])
                setattr(message, field, value)
        return store.deserialize_cdr(store.serialize_cdr(message, name), name)

    pack = 'tactile_ros/msg/'
    return SimpleNamespace(
        frame=lambda: fresh(pack + 'TactileFrame'),
        layout=lambda: fresh(pack + 'TactileLayout'),
        contacts=lambda: fresh(pack + 'TactileContacts'),
        patch=lambda: fresh(pack + 'TactileContact'),
        wrench=lambda: fresh('geometry_msgs/msg/WrenchStamped'),
        point=lambda: fresh('geometry_msgs/msg/Point'),
        quaternion=lambda: fresh('geometry_msgs/msg/Quaternion'),
        wire=lambda message: wire(message.__msgtype__, message),
    )


def _from_rclpy() -> SimpleNamespace:
    """Generated classes, and their round trip through the middleware's own bytes."""
    msg = pytest.importorskip('tactile_ros.msg', reason='interfaces are not built')
    geometry = pytest.importorskip('geometry_msgs.msg')
    rclpy = pytest.importorskip('rclpy.serialization')
    return SimpleNamespace(
        frame=msg.TactileFrame, layout=msg.TactileLayout, contacts=msg.TactileContacts,
        patch=msg.TactileContact, wrench=geometry.WrenchStamped, point=geometry.Point,
        quaternion=geometry.Quaternion,
        wire=lambda m: rclpy.deserialize_message(rclpy.serialize_message(m), type(m)),
    )  # fmt: skip


@pytest.fixture(params=[_from_rosbags, _from_rclpy], ids=['rosbags', 'rclpy'])
def made(request: pytest.FixtureRequest) -> SimpleNamespace:
    """Fresh messages of either library."""
    return request.param()


def _states(samples: int, patches: int, seed: int) -> ContactStates:
    """States with every attribute known but the object's pose, which has a topic of its own."""
    rng = np.random.default_rng(seed)
    known = {}
    for name, (shape, dtype, _) in STATE_FIELDS.items():
        tail = tuple({'t': 5, 'k': patches}.get(n, n) for n in shape)
        if dtype is np.float64:
            known[name] = rng.normal(size=(samples, *tail))
        else:
            known[name] = rng.integers(0, 2, (samples, *tail)).astype(dtype)
    del known['object_pose'], known['object_pose_cov']
    known['contacts_id'] = np.tile(np.arange(7, 7 + patches), (samples, 1))
    return ContactStates.assemble(samples, 5, known)


def _through(made: SimpleNamespace, states: ContactStates) -> dict[str, np.ndarray]:
    """States to messages, over the wire, and back."""
    sent = []
    for state in states:
        message = made.contacts()
        messages.fill_header(message.header, 1_500_000_001, 'thumb')
        messages.fill_contacts(message, state, made.patch)
        sent.append(made.wire(message))
    return messages.read_contacts(sent, 5)


@pytest.mark.parametrize('status', [None, np.array([0, 1, 0, 32, 0], np.uint8)])
def test_frame_round_trip_is_exact(made: SimpleNamespace, status: np.ndarray | None) -> None:
    values = np.random.default_rng(1).normal(size=(5, 3))
    if status is not None:
        values[2, 1] = np.nan
    frame = Frame(1_700_000_000_123_456_789, 41, values, np.arange(5.0), status, 12345, 3)
    message = made.frame()
    messages.fill_frame(message, frame, 'thumb')
    got = messages.read_frame(made.wire(message), (5, 3))
    np.testing.assert_array_equal(got.values, values)
    np.testing.assert_array_equal(got.temperature_c, frame.temperature_c)
    assert (got.stamp_ns, got.sequence, got.device_time_ns, got.dropped) == (
        frame.stamp_ns, 41, 12345, 3,
    )  # fmt: skip
    assert message.valid is (status is None)
    assert (got.status is None) == (status is None)
    assert status is None or (got.status == status).all()


def test_baseline_round_trip_keeps_the_number_of_frames(made: SimpleNamespace) -> None:
    message = made.frame()
    messages.fill_baseline(message, Frame(5, 41, np.ones((5, 3)), averaged=30), 'thumb')
    got = messages.read_baseline(made.wire(message), (5, 3))
    assert (got.sequence, got.averaged, got.device_time_ns) == (41, 30, 0)


@pytest.mark.parametrize(
    ('field', 'length', 'sentence'),
    [
        ('values', 14, r'values of a TactileFrame of \(5, 3\) must have 15 entries'),
        ('temperature_c', 4, 'temperature_c of TactileFrame must have 0 or 5 entries'),
        ('status', 6, 'status of TactileFrame must have 0 or 5 entries'),
    ],
)
def test_malformed_frame_is_one_sentence(
    made: SimpleNamespace, field: str, length: int, sentence: str
) -> None:
    message = made.frame()
    messages.fill_frame(message, Frame(0, 0, np.zeros((5, 3))), 'thumb')
    setattr(message, field, [0] * length)
    with pytest.raises(ValueError, match=sentence):
        messages.read_frame(message, (5, 3))


def test_layout_round_trip(made: SimpleNamespace) -> None:
    message = made.layout()
    messages.fill_layout(message, LAYOUT, made.point, made.quaternion)
    got = messages.read_layout(made.wire(message))
    np.testing.assert_allclose(got.rotations, LAYOUT.rotations, atol=1e-15)
    np.testing.assert_array_equal(got.positions, LAYOUT.positions)
    np.testing.assert_array_equal(got.saturation, LAYOUT.saturation)
    for name in ('channels', 'unit', 'rate_hz', 'frame_id', 'sensor', 'serial'):
        assert getattr(got, name) == getattr(LAYOUT, name)
    message, aligned = made.layout(), Layout(np.zeros((2, 3)), ('p',), '1')
    messages.fill_layout(message, aligned, made.point, made.quaternion)
    assert messages.read_layout(made.wire(message)).rotations is None


def test_mirrored_chip_and_broken_layouts_are_refused(made: SimpleNamespace) -> None:
    mirrored = Layout(np.zeros((1, 3)), ('p',), '1', rotations=np.diag([1.0, 1, -1])[None])
    with pytest.raises(ValueError, match=r'rotation|determinant'):
        messages.fill_layout(made.layout(), mirrored, made.point, made.quaternion)
    message = made.layout()
    messages.fill_layout(message, LAYOUT, made.point, made.quaternion)
    message.orientations[0].w = 3.0
    with pytest.raises(ValueError, match='unit quaternions'):
        messages.read_layout(message)
    message.orientations = message.orientations[1:]
    with pytest.raises(ValueError, match='5 positions but 4 orientations'):
        messages.read_layout(message)


@pytest.mark.parametrize('patches', [1, 3])
def test_states_round_trip_is_exact(made: SimpleNamespace, patches: int) -> None:
    states = _states(4, patches, seed=2)
    got = _through(made, states)
    assert (got['stamp_ns'] == 1_500_000_001).all()
    for name, (_, dtype, _) in STATE_FIELDS.items():
        np.testing.assert_array_equal(got[name], getattr(states, name), err_msg=name)
        assert got[name].dtype == dtype, name


def test_nothing_known_stays_unknown(made: SimpleNamespace) -> None:
    states = ContactStates.assemble(2, 5, {})
    got = _through(made, states)
    for name in STATE_FIELDS:
        np.testing.assert_array_equal(got[name], getattr(states, name), err_msg=name)
    assert (got['session'] == -1).all()
    assert (got['repetition'] == -1).all()


def test_truth_position_without_a_patch_survives(made: SimpleNamespace) -> None:
    position = np.array([[1e-3, np.nan, np.nan], [np.nan, np.nan, np.nan]])
    got = _through(made, ContactStates.assemble(2, 5, {'position': position}))
    np.testing.assert_array_equal(got['position'], position)
    assert (got['contacts_id'] == -1).all()


def test_malformed_contacts_are_refused(made: SimpleNamespace) -> None:
    message = made.contacts()
    messages.fill_contacts(message, _states(1, 1, seed=3)[0], made.patch)
    with pytest.raises(ValueError, match='taxel_force of TactileContacts must have 0 or 4'):
        messages.read_contacts([message], 4)


@pytest.mark.parametrize(('unknown_as', 'want'), [('zero', 0.0), ('nan', np.nan)])
def test_wrench_says_unknown_as_asked(
    made: SimpleNamespace, unknown_as: messages.UnknownAs, want: float
) -> None:
    state = ContactStates.assemble(1, 5, {'force': np.array([[np.nan, np.nan, 2.5]])})[0]
    message = made.wrench()
    messages.fill_wrench(message, state, unknown_as)
    got = made.wire(message).wrench
    np.testing.assert_array_equal(
        [got.force.x, got.force.y, got.force.z, got.torque.x], [want, want, 2.5, want]
    )


def state(**known: np.ndarray) -> object:
    """One state."""
    rows = {name: np.asarray(value)[None] for name, value in known.items()}
    return ContactStates.assemble(1, 3, rows)[0]


def pose_message() -> SimpleNamespace:
    """A fresh PoseWithCovarianceStamped, as far as it is written."""
    pose = SimpleNamespace(position=SimpleNamespace(), orientation=SimpleNamespace())
    return SimpleNamespace(pose=SimpleNamespace(pose=pose, covariance=None))


def test_the_pose_of_an_object_with_its_covariance() -> None:
    turn = Rotation.from_euler('z', 2.0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.as_matrix(), (1e-3, -2e-3, 0.0)
    cov = np.arange(36.0).reshape(6, 6)
    message = pose_message()
    assert messages.fill_object_pose(message, state(object_pose=pose, object_pose_cov=cov))
    place, quaternion = message.pose.pose.position, message.pose.pose.orientation
    assert (place.x, place.y, place.z) == (1e-3, -2e-3, 0.0)
    found = Rotation.from_quat([quaternion.x, quaternion.y, quaternion.z, quaternion.w])
    np.testing.assert_allclose(found.as_matrix(), turn.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(message.pose.covariance, np.arange(36.0))


def test_without_an_object_there_is_no_pose() -> None:
    assert not messages.fill_object_pose(pose_message(), state())


POINTS = np.array([[1e-3, 2e-3, -3e-4], [np.nan] * 3, [0.0, -1e-2, 5e-3]])


def test_the_surface_is_read_back_point_by_point() -> None:
    message = SimpleNamespace()
    messages.fill_surface(message, POINTS, SimpleNamespace)
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 3, 12, 36)
    assert not message.is_dense
    names = [(f.name, '<f4') for f in message.fields]
    assert [f.offset for f in message.fields] == [0, 4, 8]
    got = np.frombuffer(message.data, names)
    for i, name in enumerate('xyz'):
        np.testing.assert_array_equal(got[name], POINTS[:, i].astype(np.float32))
