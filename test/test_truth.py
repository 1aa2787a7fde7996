"""What recordings know: joined with and without stamps, tare and truth; rest, touch and groups."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.truth import firm_rows, groups_of, join, left_out, resting_rows, touched_rows
from tactile_ros.types import TRUTH_KEYS, Layout, Recording

LAYOUT = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T')


def recording(samples: int, seed: int = 0, **columns: object) -> Recording:
    values = np.random.default_rng(seed).normal(size=(samples, 2, 3))
    return Recording.from_arrays(LAYOUT, values, **columns)  # type: ignore[arg-type]


def test_one_recording_stays_as_it_is() -> None:
    one = recording(3)
    assert join([one]) is one


def test_columns_that_some_lack_are_filled_with_what_means_nothing() -> None:
    full = recording(
        3,
        stamp_ns=[5, 6, 7],
        sequence=[1, 2, 3],
        temperature_c=np.full((3, 2), 30.0),
        status=np.full((3, 2), 2),
        tare=[True, False, False],
        truth={'force': np.ones((3, 3)), 'cell': [4, 5, 6], 'in_contact': [0, 1, 1]},
    )
    bare = recording(2, 1, truth={'label': [1, 2]})
    joined = join([full, bare, full])
    assert len(joined) == 8
    np.testing.assert_array_equal(
        joined.values, np.concatenate([full.values, bare.values, full.values])
    )
    assert joined.stamp_ns is None
    assert joined.tare is not None
    assert joined.tare.tolist() == [True] + 4 * [False] + [True] + 2 * [False]
    assert joined.status is not None
    assert joined.status[:, 0].tolist() == [2, 2, 2, 0, 0, 2, 2, 2]
    assert joined.temperature_c is not None
    assert np.isnan(joined.temperature_c[3:5]).all()
    assert joined.truth['cell'].tolist() == [4, 5, 6, -1, -1, 4, 5, 6]
    assert joined.truth['in_contact'].tolist() == [0, 1, 1, -1, -1, 0, 1, 1]
    assert joined.truth['label'].tolist() == [-1, -1, -1, 1, 2, -1, -1, -1]
    assert np.isnan(joined.truth['force'][3:5]).all()
    assert joined.truth['session'].tolist() == [0, 0, 0, 1, 1, 2, 2, 2]


def test_stamps_are_kept_where_all_have_them_and_may_run_back_between() -> None:
    one = recording(3, stamp_ns=[50, 60, 70])
    joined = join([one, recording(2, stamp_ns=[1, 2]), recording(0, stamp_ns=[]), one])
    assert joined.stamp_ns is not None
    assert joined.stamp_ns.tolist() == [50, 60, 70, 1, 2, 50, 60, 70]
    assert np.flatnonzero(joined.restarts).tolist() == [0, 3, 5]


def test_streams_and_sessions_stay_apart() -> None:
    one = recording(4, stream=[3, 3, 8, 3], truth={'session': [1, 1, 2, 2]})
    joined = join([one, one, recording(2)])
    assert np.flatnonzero(joined.restarts).tolist() == [0, 2, 3, 4, 6, 7, 8]
    assert joined.stream is not None
    assert len(np.unique(joined.stream)) == 7
    assert joined.truth['session'].tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]


def test_many_streams_of_one_row_stay_apart() -> None:
    one = recording(5, stream=np.arange(5))
    assert join([one, one]).restarts.all()


def test_nothing_joined_to_nothing() -> None:
    joined = join([recording(0), recording(0)])
    assert len(joined) == 0
    assert not resting_rows(joined).any()
    assert groups_of(joined)['group'].shape == (0,)


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
        ({}, [0, 0, 0]),
        ({'force': np.ones((3, 3))}, [0, 0, 0]),
        ({'cell': [0, -1, 3]}, [1, 0, 1]),
        ({'label': [-1, 0, -1]}, [0, 1, 0]),
        ({'position': [[0, 0, np.nan], [np.nan] * 3, [np.nan, 0, 0]]}, [1, 0, 1]),
        ({'in_contact': [1, 0, -1]}, [1, 0, 0]),
        ({'in_contact': [-1, 0, 1], 'cell': [2, 2, -1]}, [1, 0, 1]),
    ],
)
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


def test_a_tare_row_is_not_touched() -> None:
    tared = recording(3, truth={'cell': [1, 1, 1]}, tare=[True, False, False])
    assert touched_rows(tared).tolist() == [False, True, True]


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


def test_joined_truth_of_every_key() -> None:
    rng = np.random.default_rng(2)
    shapes = {
        'object_pose': (4, 4), 'force': (3,), 'torque': (3,), 'position': (3,),
        'stray_field': (3,), 'taxel_force': (2,), 'deformation': (2,),
    }  # fmt: skip
    truth = {key: rng.integers(0, 2, (3, *shapes.get(key, ()))) for key in TRUTH_KEYS}
    truth['object_pose'] = np.tile(np.eye(4), (3, 1, 1))
    joined = join([recording(3, truth=truth), recording(1), recording(3, truth=truth)])
    for key in set(TRUTH_KEYS) - {'session'}:
        column = joined.truth[key]
        np.testing.assert_array_equal(column[:3], truth[key])
        np.testing.assert_array_equal(column[4:], truth[key])
        assert (np.isnan(column[3]) if column.dtype.kind == 'f' else column[3] == -1).all()


def test_what_was_told_and_not_learned_is_counted() -> None:
    truth = {
        'force': [[np.nan, np.nan, 1.0], [np.nan] * 3, [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]],
        'label': [-1, -1, -1, 3],
        'cell': [-1, -1, -1, -1],
        'in_contact': [1, 0, 1, 1],
        'session': [0, 0, 1, 1],
    }
    one = recording(4, truth=truth)
    whole = np.array([True, True, False, True])
    good = np.array([True, True, False, False])
    base = {'rows with a faulty taxel': 1.0, 'rows without a baseline': 1.0}
    assert left_out([one], one, whole, good, {'force', 'label'}) == base
    assert left_out([one], one, whole, good, ()) == {
        **base,
        'usable rows that tell force, which was not learned': 1.0,
        'usable rows that tell label, which was not learned': 0.0,
    }
    everything = np.ones(4, bool)
    assert left_out([one], one, everything, everything, {'force', 'label'}) == {}
    none = recording(0, truth={'force': np.zeros((0, 3))})
    assert left_out([none], none, np.zeros(0, bool), np.zeros(0, bool), ()) == {}
