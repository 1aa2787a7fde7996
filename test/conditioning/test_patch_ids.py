"""Ids of patches: moved, split, merged, gone, back again, and unseen for a while."""

from __future__ import annotations

import numpy as np

from tactile_ros.conditioning.contact import PatchIds

X = np.arange(12.0)


def frames(*rows: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Labels, counts and centres on a row of 12 taxels; 'a' is the strongest patch."""
    label = np.array([[' abc'.index(c) - 1 for c in row.ljust(12)] for row in rows])
    count = label.max(axis=1) + 1
    centre = np.full((len(rows), 3, 3), np.nan)
    for i, row in enumerate(label):
        for k in set(row[row >= 0]):
            centre[i, k] = X[row == k].mean(), 0, 0
    return label, count, centre


def numbered(*rows: str, unseen: tuple[int, ...] = (), restart: tuple[int, ...] = (0,)) -> list:
    """Ids of patches a, b, c in each frame."""
    tells = ~np.isin(np.arange(len(rows)), unseen)
    fresh = np.isin(np.arange(len(rows)), restart)
    return PatchIds(1.0).number(*frames(*rows), tells, fresh).tolist()


def test_an_id_stays_with_its_patch_whatever_its_rank() -> None:
    found = numbered('aa   bb', ' aa   bb', ' bb   aa', '  b   aaa')
    assert found == [[0, 1, -1], [0, 1, -1], [1, 0, -1], [1, 0, -1]]


def test_what_moves_by_more_than_itself_is_followed_within_reach() -> None:
    assert numbered('a', ' a', '  a', '      a') == [[0, -1, -1]] * 3 + [[1, -1, -1]]


def test_a_patch_that_splits_leaves_its_id_to_the_part_that_shares_most() -> None:
    assert numbered('aaaaaa', 'aa bbb') == [[0, -1, -1], [1, 0, -1]]


def test_patches_that_merge_keep_the_id_of_which_most_is_shared() -> None:
    found = numbered('aa bbb', 'aaaaaa', 'aa bbb')
    assert found == [[0, 1, -1], [1, -1, -1], [2, 1, -1]]


def test_an_id_that_ended_never_comes_back() -> None:
    assert numbered('a', '', 'a') == [[0, -1, -1], [-1, -1, -1], [1, -1, -1]]


def test_frames_that_cannot_tell_end_nothing() -> None:
    found = numbered('aa  b', 'c', '', 'bb  a', unseen=(1, 2))
    assert found == [[0, 1, -1], [-1] * 3, [-1] * 3, [1, 0, -1]]


def test_a_new_baseline_ends_all_and_a_new_stream_counts_from_zero() -> None:
    assert numbered('a', 'a', restart=(0, 1)) == [[0, -1, -1], [1, -1, -1]]
    ids = PatchIds(1.0)
    both = np.ones(2, bool)
    found = ids.number(*frames('a', 'a'), both, both, np.array([True, True]))
    assert found[:, 0].tolist() == [0, 0]


def test_frame_by_frame_is_all_at_once() -> None:
    rng = np.random.default_rng(3)
    label = np.repeat(rng.integers(-1, 3, (40, 6)), 2, axis=1)
    count = np.full(40, 3)
    centre = rng.uniform(0, 12, (40, 3, 3))
    tells, restart = rng.uniform(size=40) > 0.1, rng.uniform(size=40) < 0.05
    whole = PatchIds(1.0).number(label, count, centre, tells, restart)
    live = PatchIds(1.0)
    for i in range(40):
        row = slice(i, i + 1)
        one = live.number(label[row], count[row], centre[row], tells[row], restart[row])
        np.testing.assert_array_equal(one[0], whole[i])
