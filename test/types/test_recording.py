# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Recordings: shapes, kinds, streams and order are checked once; rows can be taken out."""

import numpy as np
import pytest

from tactile_ros.types import TRUTH_KEYS, Layout, Recording, field_shape, groups_of, join
from tactile_ros.types.recording import calm_rows, firm_rows, resting_rows, touched_rows

LAYOUT = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T')


def recording(samples: int, seed: int = 0, **columns: object) -> Recording:
    values = np.random.default_rng(seed).normal(size=(samples, 2, 3))
    return Recording.from_arrays(LAYOUT, values, **columns)  # type: ignore[arg-type]


def test_columns_that_some_lack_are_filled_with_what_means_nothing() -> None:
    full = recording(
        3, stamp_ns=[5, 6, 7], sequence=[1, 2, 3], temperature_c=np.full((3, 2), 30.0),
        status=np.full((3, 2), 2), tare=[True, False, False],
        truth={'force': np.ones((3, 3)), 'cell': [4, 5, 6], 'in_contact': [0, 1, 1]},
    )  # fmt: skip
    bare = recording(2, 1, truth={'label': [1, 2]})
    joined = join([full, bare, full])
    assert len(joined) == 8
    np.testing.assert_array_equal(
        joined.values, np.concatenate([full.values, bare.values, full.values])
    )
    assert joined.stamp_ns is None
    assert joined.tare.tolist() == [True] + 4 * [False] + [True] + 2 * [False]
    assert joined.status[:, 0].tolist() == [2, 2, 2, 0, 0, 2, 2, 2]
    assert np.isnan(joined.temperature_c[3:5]).all()
    assert joined.truth['cell'].tolist() == [4, 5, 6, -1, -1, 4, 5, 6]
    assert joined.truth['in_contact'].tolist() == [0, 1, 1, -1, -1, 0, 1, 1]
    assert joined.truth['label'].tolist() == [-1, -1, -1, 1, 2, -1, -1, -1]
    assert np.isnan(joined.truth['force'][3:5]).all()
    assert joined.truth['session'].tolist() == [0, 0, 0, 1, 1, 2, 2, 2]


def test_stamps_are_kept_where_all_have_them_and_may_run_back_between() -> None:
    one = recording(3, stamp_ns=[50, 60, 70])
    joined = join([one, recording(2, stamp_ns=[1, 2]), recording(0, stamp_ns=[]), one])
    assert joined.stamp_ns.tolist() == [50, 60, 70, 1, 2, 50, 60, 70]
    assert np.flatnonzero(joined.restarts).tolist() == [0, 3, 5]


def test_streams_and_sessions_stay_apart() -> None:
    one = recording(4, stream=[3, 3, 8, 3], truth={'session': [1, 1, 2, 2]})
    joined = join([one, one, recording(2)])
    assert np.flatnonzero(joined.restarts).tolist() == [0, 2, 3, 4, 6, 7, 8]
    assert len(np.unique(joined.stream)) == 7
    assert joined.truth['session'].tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]


def test_tare_rows_rest_else_those_that_truth_calls_untouched() -> None:
    untouched = {'in_contact': np.array([0, 1, -1], np.int8)}
    assert resting_rows(recording(3)).tolist() == [False] * 3
    assert resting_rows(recording(3, truth=untouched)).tolist() == [True, False, False]
    tared = recording(3, truth=untouched, tare=[False, False, True])
    assert resting_rows(tared).tolist() == [False, False, True]
    never = recording(3, truth=untouched, tare=[False] * 3)
    assert resting_rows(never).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ('truth', 'touched'),
    [
        ({}, [0, 0, 0]), ({'force': np.ones((3, 3))}, [0, 0, 0]),
        ({'cell': [0, -1, 3]}, [1, 0, 1]), ({'label': [-1, 0, -1]}, [0, 1, 0]),
        ({'position': [[0, 0, np.nan], [np.nan] * 3, [np.nan, 0, 0]]}, [1, 0, 1]),
        ({'in_contact': [1, 0, -1]}, [1, 0, 0]),
        ({'in_contact': [-1, 0, 1], 'cell': [2, 2, -1]}, [1, 0, 1]),
    ],
)  # fmt: skip
def test_rows_that_truth_calls_touched(truth: dict[str, object], touched: list[int]) -> None:
    assert touched_rows(recording(3, truth=truth)).astype(int).tolist() == touched


def test_a_firm_force_is_above_that_of_a_load_cell_at_rest() -> None:
    force = [[0, 0, 8.0], [0, 0, 0.12], [np.nan, np.nan, -3.0], [np.nan] * 3]
    truth = {'force': force}
    assert not touched_rows(recording(4, truth=truth)).any()
    assert firm_rows(recording(4, truth=truth)).tolist() == [True, False, True, False]
    tared = recording(4, truth=truth, tare=[False, False, True, False])
    assert firm_rows(tared).tolist() == [True, False, False, False]
    assert not firm_rows(recording(4)).any()
    assert not firm_rows(recording(4, truth={'force': np.zeros((4, 3))})).any()
    assert firm_rows(recording(0, truth={'force': np.zeros((0, 3))})).shape == (0,)


def test_a_calm_force_is_what_a_load_cell_makes_of_nothing() -> None:
    force = [[0, 0, 8.0], [0, 0, 0.01], [np.nan, np.nan, 0.0], [np.nan] * 3]
    stamps = 10**9 * np.arange(1, 5)
    calm = recording(4, truth={'force': force}, stamp_ns=stamps)
    assert calm_rows(calm).tolist() == [False, True, True, False]
    tared = recording(4, truth={'force': force}, stamp_ns=stamps, tare=[False, False, True, False])
    assert calm_rows(tared).tolist() == [False, True, False, False]
    assert not calm_rows(recording(4, truth={'force': force})).any()  # no time course
    assert not calm_rows(recording(4, stamp_ns=stamps)).any()


def test_groups_are_repetitions_inside_sessions() -> None:
    truth = {'session': [0, 0, 0, 1, 1, 1], 'repetition': [0, 1, 0, 0, 1, -1]}
    groups = groups_of(recording(6, truth=truth))
    assert groups['session'].tolist() == truth['session']
    pairs = list(zip(truth['session'], truth['repetition'], strict=True))
    for i, one in enumerate(pairs):
        for j, other in enumerate(pairs):
            assert (groups['group'][i] == groups['group'][j]) == (one == other)


def test_where_nothing_is_known_parts_that_follow_one_another_are_groups() -> None:
    group = groups_of(recording(95, stamp_ns=np.arange(95)))['group']
    assert (np.diff(group) >= 0).all()
    assert np.bincount(group).tolist() == [10, 9] * 5
    # streams are not cut where there are enough of them
    stream = np.repeat(np.arange(25), 4)
    group = groups_of(recording(100, stream=stream))['group']
    assert len(np.unique(group)) == 10
    assert all(len(np.unique(group[stream == i])) == 1 for i in range(25))


def test_groups_of_independent_frames_do_not_depend_on_their_order() -> None:
    frames = recording(95)
    frames.values[3, 0, 0] = np.nan
    frames.values[7] = frames.values[8]
    group = groups_of(frames)['group']
    assert group[7] == group[8]
    assert np.bincount(group).min() >= 9
    order = np.random.default_rng(0).permutation(95)
    np.testing.assert_array_equal(groups_of(frames.select(order))['group'], group[order])


@pytest.mark.parametrize('key', TRUTH_KEYS)
def test_every_truth_key_is_taken_in_its_shape_only(key: str) -> None:
    shape = (3, *field_shape(key, 2))
    assert recording(3, truth={key: np.full(shape, np.nan)}).truth[key].shape == shape
    with pytest.raises(ValueError, match=f"truth '{key}' of Recording must have shape"):
        recording(3, truth={key: np.zeros((*shape[:-1], shape[-1] + 1))})


def test_truth_that_is_unknown() -> None:
    truth = {
        'cell': [0.0, np.nan, 2.0], 'in_contact': np.array([1, 0, -1], np.int8),
        'label': np.array([True, False, True]), 'force': None,
        'session': np.array([3, 3, 4], np.uint8),
    }  # fmt: skip
    told = {key: column.tolist() for key, column in recording(3, truth=truth).truth.items()}
    assert told == {
        'cell': [0, -1, 2], 'in_contact': [1, 0, -1], 'label': [1, 0, 1], 'session': [3, 3, 4],
    }  # fmt: skip
    with pytest.raises(ValueError, match="received 'weight'"):
        recording(3, truth={'weight': np.zeros(3)})


@pytest.mark.parametrize('key', ['in_contact', 'slip'])
@pytest.mark.parametrize('wrong', [2, -2, 255, 0.5, 1e300])
def test_yes_no_and_unknown_are_all_the_answers(key: str, wrong: float) -> None:
    assert recording(3, truth={key: [1.0, 0.0, np.nan]}).truth[key].tolist() == [1, 0, -1]
    with pytest.raises(ValueError, match=rf"'{key}' .* must be 1, 0 or -1 .*; received .* row 1"):
        recording(3, truth={key: [1, wrong, 0]})


def turned(angle: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return pose


@pytest.mark.parametrize(
    'pose',
    [
        np.zeros((4, 4)), np.diag([1.0, 1.0, -1.0, 1.0]), 1.01 * turned(0.3),
        np.diag([1.0, 1.0, 1.0, 0.0]), np.full((4, 4), np.inf), np.where(np.eye(4), np.inf, 0.0),
        np.where(np.eye(4, k=3), np.inf, turned(0.3)), np.full((4, 4), 1e200),
    ],
)  # fmt: skip
def test_poses_are_rotations_and_translations(pose: np.ndarray) -> None:
    poses = np.stack([turned(0.3), np.full((4, 4), np.nan), np.round(turned(0.7), 4), pose])
    values = np.zeros((4, 2, 3))
    good = Recording.from_arrays(LAYOUT, values[:3], truth={'object_pose': poses[:3]})
    np.testing.assert_array_equal(good.truth['object_pose'], poses[:3])
    with pytest.raises(
        ValueError, match=r"'object_pose' .* must hold rotations .* row 3 does not"
    ):
        Recording.from_arrays(LAYOUT, values, truth={'object_pose': poses})


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('values', np.zeros((3, 3, 2))), ('stamp_ns', np.arange(4)),
        ('sequence', np.zeros((3, 1))), ('temperature_c', np.zeros(3)),
        ('status', np.zeros((3, 3))), ('stream', np.zeros(2)), ('tare', np.zeros(2)),
    ],
)  # fmt: skip
def test_other_lengths_are_refused_by_name(name: str, value: np.ndarray) -> None:
    arguments = {'values': np.zeros((3, 2, 3)), name: value}
    with pytest.raises(ValueError, match=f'{name} of Recording must have shape'):
        Recording.from_arrays(LAYOUT, **arguments)
    if name in ('stamp_ns', 'sequence', 'stream'):
        with pytest.raises(ValueError, match=f'{name} of Recording must be whole'):
            recording(3, **{name: np.array([0, 0.5, np.nan])})


def test_stamps_increase_inside_a_stream_only() -> None:
    values = np.zeros((4, 2, 3))
    with pytest.raises(ValueError, match='row 2 does not'):
        Recording.from_arrays(LAYOUT, values, stamp_ns=[0, 5, 5, 6])
    with pytest.raises(ValueError, match='row 3 does not'):
        Recording.from_arrays(LAYOUT, values, stamp_ns=[0, 5, 9, 6], stream=[0, 0, 1, 1])
    back = Recording.from_arrays(LAYOUT, values, stamp_ns=[8, 9, 0, 1], stream=[0, 0, 1, 1])
    assert len(back) == 4


def test_infinite_truth_is_refused() -> None:
    force = np.full((3, 3), np.nan)
    force[1, 2] = np.inf
    with pytest.raises(ValueError, match="truth 'force' of Recording must be finite"):
        Recording.from_arrays(LAYOUT, np.zeros((3, 2, 3)), truth={'force': force})
