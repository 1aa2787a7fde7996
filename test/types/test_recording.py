"""Recordings: shapes, kinds, streams and order are checked once; rows can be taken out."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.types import TRUTH_KEYS, Layout, Recording, field_shape

LAYOUT = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T')


def full_recording(samples: int = 6) -> Recording:
    rng = np.random.default_rng(1)
    return Recording.from_arrays(
        LAYOUT,
        rng.normal(size=(samples, 2, 3)),
        stamp_ns=np.arange(samples) * 10,
        sequence=np.arange(samples) + 5,
        temperature_c=rng.normal(25, 1, (samples, 2)),
        status=rng.integers(0, 64, (samples, 2)),
        stream=np.arange(samples) // 4,
        tare=np.arange(samples) % 4 == 0,
        truth={'force': rng.normal(size=(samples, 3)), 'in_contact': np.ones(samples, np.int8)},
    )


def test_columns_become_what_the_public_face_says() -> None:
    recording = full_recording()
    assert recording.values.dtype == np.float64
    assert recording.stamp_ns is not None
    assert recording.stamp_ns.dtype == np.int64
    assert recording.status is not None
    assert recording.status.dtype == np.uint8
    assert recording.tare is not None
    assert recording.tare.dtype == np.bool_
    assert len(recording) == 6
    assert recording.restarts.tolist() == [True, False, False, False, True, False]


@pytest.mark.parametrize('key', TRUTH_KEYS)
def test_every_truth_key_is_taken_in_its_shape_only(key: str) -> None:
    shape = (3, *field_shape(key, 2))
    blank = np.full(shape, np.nan)
    recording = Recording.from_arrays(LAYOUT, np.zeros((3, 2, 3)), truth={key: blank})
    assert recording.truth[key].shape == shape
    with pytest.raises(ValueError, match=f"truth '{key}' of Recording must have shape"):
        Recording.from_arrays(
            LAYOUT, np.zeros((3, 2, 3)), truth={key: np.zeros((*shape[:-1], shape[-1] + 1))}
        )


def test_truth_that_is_unknown() -> None:
    truth = {
        'cell': [0.0, np.nan, 2.0],
        'in_contact': np.array([1, 0, -1], np.int8),
        'label': np.array([True, False, True]),
        'force': None,
        'session': np.array([3, 3, 4], np.uint8),
    }
    recording = Recording.from_arrays(LAYOUT, np.zeros((3, 2, 3)), truth=truth)
    assert 'force' not in recording.truth
    assert recording.truth['cell'].tolist() == [0, -1, 2]
    assert recording.truth['in_contact'].tolist() == [1, 0, -1]
    assert recording.truth['label'].tolist() == [1, 0, 1]
    assert recording.truth['session'].tolist() == [3, 3, 4]
    with pytest.raises(ValueError, match="received 'weight'"):
        Recording.from_arrays(LAYOUT, np.zeros((3, 2, 3)), truth={'weight': np.zeros(3)})


@pytest.mark.parametrize('key', ['in_contact', 'slip'])
@pytest.mark.parametrize('wrong', [2, -2, 255, 0.5, 1e300])
def test_yes_no_and_unknown_are_all_the_answers(key: str, wrong: float) -> None:
    values = np.zeros((3, 2, 3))
    told = {key: [1.0, 0.0, np.nan]}
    assert Recording.from_arrays(LAYOUT, values, truth=told).truth[key].tolist() == [1, 0, -1]
    with pytest.raises(ValueError, match=rf"'{key}' .* must be 1, 0 or -1 .*; received .* row 1"):
        Recording.from_arrays(LAYOUT, values, truth={key: [1, wrong, 0]})


def turned(angle: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return pose


@pytest.mark.parametrize(
    'pose',
    [
        np.zeros((4, 4)),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        1.01 * turned(0.3),
        np.diag([1.0, 1.0, 1.0, 0.0]),
        np.full((4, 4), np.inf),
        np.where(np.eye(4), np.inf, 0.0),
        np.where(np.eye(4, k=3), np.inf, turned(0.3)),
        np.full((4, 4), 1e200),
    ],
)
def test_poses_are_rotations_and_translations(pose: np.ndarray) -> None:
    poses = np.stack([turned(0.3), np.full((4, 4), np.nan), np.round(turned(0.7), 4), pose])
    values = np.zeros((4, 2, 3))
    good = Recording.from_arrays(LAYOUT, values[:3], truth={'object_pose': poses[:3]})
    np.testing.assert_array_equal(good.truth['object_pose'], poses[:3])
    with pytest.raises(
        ValueError, match=r"'object_pose' .* must hold rotations .* row 3 does not"
    ):
        Recording.from_arrays(LAYOUT, values, truth={'object_pose': poses})


def test_infinite_truth_is_refused() -> None:
    force = np.full((3, 3), np.nan)
    force[1, 2] = np.inf
    with pytest.raises(ValueError, match="truth 'force' of Recording must be finite"):
        Recording.from_arrays(LAYOUT, np.zeros((3, 2, 3)), truth={'force': force})


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('values', np.zeros((3, 3, 2))),
        ('stamp_ns', np.arange(4)),
        ('sequence', np.zeros((3, 1))),
        ('temperature_c', np.zeros(3)),
        ('status', np.zeros((3, 3))),
        ('stream', np.zeros(2)),
        ('tare', np.zeros(2)),
    ],
)
def test_other_lengths_are_refused_by_name(name: str, value: np.ndarray) -> None:
    arguments = {'values': np.zeros((3, 2, 3)), name: value}
    with pytest.raises(ValueError, match=f'{name} of Recording must have shape'):
        Recording.from_arrays(LAYOUT, **arguments)


@pytest.mark.parametrize('name', ['stamp_ns', 'sequence', 'stream'])
def test_counts_must_be_whole(name: str) -> None:
    with pytest.raises(ValueError, match=f'{name} of Recording must be whole'):
        Recording.from_arrays(LAYOUT, np.zeros((3, 2, 3)), **{name: np.array([0, np.nan, 2])})


def test_stamps_increase_inside_a_stream_only() -> None:
    values = np.zeros((4, 2, 3))
    with pytest.raises(ValueError, match='row 2 does not'):
        Recording.from_arrays(LAYOUT, values, stamp_ns=[0, 5, 5, 6])
    with pytest.raises(ValueError, match='row 3 does not'):
        Recording.from_arrays(LAYOUT, values, stamp_ns=[0, 5, 9, 6], stream=[0, 0, 1, 1])
    back = Recording.from_arrays(LAYOUT, values, stamp_ns=[8, 9, 0, 1], stream=[0, 0, 1, 1])
    assert len(back) == 4


def test_a_stream_that_comes_back_is_a_new_one() -> None:
    recording = Recording.from_arrays(LAYOUT, np.zeros((5, 2, 3)), stream=[7, 7, 3, 7, 7])
    assert recording.restarts.tolist() == [True, False, True, True, False]


@pytest.mark.parametrize('samples', [0, 1])
def test_recordings_may_be_short(samples: int) -> None:
    recording = full_recording(samples)
    assert len(recording) == samples
    assert recording.restarts.tolist() == [True] * samples


@given(st.lists(st.integers(0, 5), max_size=8))
def test_rows_are_taken_out_with_all_that_is_known_of_them(rows: list[int]) -> None:
    recording = full_recording()
    part = recording.select(np.array(rows, np.int64))
    assert part.layout is recording.layout
    for field in fields(Recording):
        if field.name not in ('layout', 'truth'):
            whole, some = getattr(recording, field.name), getattr(part, field.name)
            np.testing.assert_array_equal(some, whole[rows])
    for key, column in recording.truth.items():
        np.testing.assert_array_equal(part.truth[key], column[rows])


def test_a_row_is_a_frame() -> None:
    recording = full_recording()
    frame = recording.frame(2)
    assert frame.stamp_ns == 20
    assert frame.sequence == 7
    np.testing.assert_array_equal(frame.values, recording.values[2])
    assert frame.status is not None
    assert frame.temperature_c is not None
    plain = Recording.from_arrays(LAYOUT, np.zeros((2, 2, 3))).frame(1)
    assert plain.stamp_ns is None
    assert plain.sequence == 1
    assert plain.status is None
