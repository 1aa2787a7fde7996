# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Columns of serialised messages beside what rosbags reads from them one by one."""

import numpy as np
import pytest

from reference import made_bags as make
from tactile_ros import messages as live
from tactile_ros.evaluation.bag import all_types
from tactile_ros.evaluation.cdr_columns import (
    MessageLayout,
    NoColumnsError,
    read_columns,
    read_contacts,
    read_frames,
    read_rows,
    read_texts,
)
from tactile_ros.evaluation.truth import STANDARD

TAXELS = 5
CONTACTS = 'tactile_ros/msg/TactileContacts'
FRAME = 'tactile_ros/msg/TactileFrame'


def contacts(seed: int) -> object:
    """Contacts with any number of patches, per-taxel lists present or not, and any numbers."""
    rng = np.random.default_rng(seed)
    message = make.contacts(seed, 1_000_000_000 + 7 * seed, rng.normal(size=3), rng.normal(size=3))
    message.contacts = [make.patch(rng.normal(size=3)) for _ in range(seed % 4)]
    for i, patch in enumerate(message.contacts):
        patch.id = -1 if i and i == len(message.contacts) - 1 and seed % 3 else 10 + i
        patch.position_covariance, patch.force_covariance = rng.normal(size=(2, 9))
    message.wrench_covariance = rng.normal(size=36)
    message.label_name = 'x' * (seed % 6)
    message.taxel_force = rng.normal(size=TAXELS if seed % 2 else 0)
    message.taxel_status = rng.integers(0, 9, TAXELS if seed % 5 else 0).astype(np.uint8)
    message.cell, message.slip, message.yaw = int(rng.integers(9)), -1, float(rng.normal())
    return message


def test_contacts_are_those_of_rosbags() -> None:
    messages = [contacts(seed) for seed in range(60)]
    found = read_contacts([make.cdr(m) for m in messages], TAXELS)
    slow = live.read_contacts(messages, TAXELS)
    assert found.rows.tolist() == list(range(60))
    assert (found.damaged, found.misfits) == (0, 0)
    for name, column in found.arrays.items():
        np.testing.assert_array_equal(column, slow[name], name)


def frames(count: int) -> list[object]:
    rng = np.random.default_rng(2)
    found = []
    for k in range(count):
        frame = make.frame(k, rng.normal(size=15), 10**9 + k)
        frame.temperature_c = rng.normal(size=TAXELS if k % 3 else 0)
        frame.status = rng.integers(0, 9, TAXELS if k % 4 else 0).astype(np.uint8)
        frame.header.frame_id = 'p' * (k % 9)
        found.append(frame)
    return found


def test_frames_are_those_of_rosbags() -> None:
    messages = frames(70)
    found = read_frames([make.cdr(m) for m in messages], (TAXELS, 3))
    for k, message in enumerate(messages):
        slow = live.read_frame(message, (TAXELS, 3))
        assert found.arrays['stamp_ns'][k] == slow.stamp_ns
        assert found.arrays['sequence'][k] == slow.sequence
        np.testing.assert_array_equal(found.arrays['values'][k], slow.values)
        chips = np.full(TAXELS, np.nan) if slow.temperature_c is None else slow.temperature_c
        np.testing.assert_array_equal(found.arrays['temperature_c'][k], chips)
        bits = np.zeros(TAXELS) if slow.status is None else slow.status
        np.testing.assert_array_equal(found.arrays['status'][k], bits)


def test_what_is_cut_or_of_another_board_is_counted() -> None:
    whole = [make.cdr(m) for m in frames(8)]
    other = make.cdr(make.frame(9, np.zeros(6), 5))
    found = read_frames([whole[0], whole[1][:-30], b'', other, *whole[2:]], (TAXELS, 3))
    assert found.rows.tolist() == [0, 4, 5, 6, 7, 8, 9]
    assert found.arrays['sequence'].tolist() == [0, 2, 3, 4, 5, 6, 7]
    assert (found.damaged, found.misfits) == (2, 1)


def test_big_endian_messages_go_through_rosbags() -> None:
    (message,) = frames(1)
    data = bytes(all_types().serialize_cdr(message, FRAME, little_endian=False))
    with pytest.raises(NoColumnsError):
        MessageLayout(data, FRAME)
    found = read_frames([data], (TAXELS, 3))
    np.testing.assert_array_equal(found.arrays['values'][0].ravel(), message.values)


def test_a_length_that_cannot_be_is_refused_and_not_believed() -> None:
    data = bytearray(make.cdr(contacts(0)))
    at = MessageLayout(bytes(data), CONTACTS).lengths[2]  # of the list of patches
    data[at : at + 4] = b'\xff\xff\xff\x7f'
    with pytest.raises(NoColumnsError):
        MessageLayout(bytes(data), CONTACTS)
    assert read_columns([bytes(data)], CONTACTS) == ([], 1)


def test_load_cells_probes_and_texts() -> None:
    wrench = make.wrench(123456789012, (1, 2, 3), (4, 5, 6))
    kind = 'geometry_msgs/msg/WrenchStamped'
    told = read_rows([make.cdr(wrench)] * 2, kind, STANDARD[kind])
    assert told.arrays['stamp_ns'].tolist() == [123456789012] * 2
    assert told.arrays['force'].tolist() == [[1.0, 2.0, 3.0]] * 2
    turned = make.new('Pose', orientation=make.new('Quaternion', z=1.0))
    probe = make.new('PoseStamped', header=make.header(5), pose=turned)
    nowhere = make.new('PoseStamped', header=make.header(6))  # of a quaternion that is none
    kind = 'geometry_msgs/msg/PoseStamped'
    told = read_rows([make.cdr(probe), make.cdr(nowhere)], kind, STANDARD[kind])
    np.testing.assert_allclose(np.diag(told.arrays['object_pose'][0]), [-1, -1, 1, 1])
    assert np.isnan(told.arrays['object_pose'][1, :3, :3]).all()
    rows, texts = read_texts([b'', make.cdr(make.new('String', data='mug'))])
    assert (rows.tolist(), texts) == ([1], ['mug'])
