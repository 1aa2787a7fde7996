# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Contact: the threshold, the excursion, ids of touches and of patches."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.conditioning.contact import (
    ContactIds,
    PatchIds,
    calm_factor,
    contact_scale,
    excursion,
)

NOISE = np.array([[0.1, 0.2]])


def plain_ids(contact: list[int], restart: list[bool]) -> list[int]:
    """The definition, one frame at a time."""
    ids, last, touching = [], -1, False
    for now, again in zip(contact, restart, strict=True):
        if again:
            touching = False
        if now == 1 and not touching:
            last += 1
        touching = touching if now < 0 else now == 1
        ids.append(last if touching else -1)
    return ids


STREAM = st.lists(st.tuples(st.sampled_from([-1, 0, 1]), st.integers(0, 9)), max_size=25)


@given(STREAM, st.integers(0, 25))
def test_ids_live_from_touch_to_release(stream: list[tuple[int, int]], cut: int) -> None:
    contact = np.array([c for c, _ in stream], np.int8)
    restart = np.array([r < 2 for _, r in stream], bool)
    begins = np.array([r == 0 for _, r in stream], bool)
    wanted = []
    for part in np.split(np.arange(len(contact)), np.flatnonzero(begins)):
        wanted += plain_ids(contact[part].tolist(), restart[part].tolist())
    # at once, in two pieces and one by one
    for edges in ((0, len(contact)), (0, cut, len(contact)), range(len(contact) + 1)):
        ids, found = ContactIds(), []
        for part in (slice(a, b) for a, b in pairwise(edges)):
            found += ids.number(contact[part], restart[part], True, begins[part]).tolist()
        assert found == wanted


def test_the_threshold_is_five_sigma_or_a_share_of_light_touches() -> None:
    np.testing.assert_allclose(contact_scale(NOISE, None), [[0.5, 1.0]])
    touched = np.full((10, 1, 2), 2.0)
    np.testing.assert_allclose(contact_scale(NOISE, touched), [[0.8, 1.0]])
    np.testing.assert_allclose(contact_scale(NOISE * np.nan, touched), [[0.8, 0.8]])


def test_a_bound_of_noise_hides_one_touch_in_twenty_at_most() -> None:
    touched = np.linspace(1, 50, 491)[:, None, None] * np.ones((1, 2))
    for bound in (0.2, 0.4, 10.0, 1e6):
        scale = contact_scale(np.full((1, 2), bound), touched, touched)
        assert (excursion(touched, scale) <= 1).mean() <= 0.052
        assert (scale <= 5 * bound).all()
        np.testing.assert_allclose(
            contact_scale(np.full((1, 2), bound), touched), np.full((1, 2), 5 * bound)
        )
    # a firm touch says nothing of the lightest
    np.testing.assert_allclose(contact_scale(NOISE, None, touched), [[0.5, 1.0]])
    np.testing.assert_allclose(contact_scale(100 * NOISE, None, touched), [[3.45, 3.45]])
    still = np.zeros((4, 1, 2))
    np.testing.assert_allclose(contact_scale(NOISE, still, still), [[0.5, 1.0]])


@pytest.mark.parametrize('noise', [0.0, np.nan])
def test_a_threshold_that_nothing_tells_is_unknown(noise: float) -> None:
    assert np.isnan(contact_scale(np.full((1, 2), noise), None)).all()
    # touches that changed nothing tell nothing
    assert np.isnan(contact_scale(np.full((1, 2), noise), np.zeros((4, 1, 2)))).all()


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


def test_a_patch_that_splits_leaves_its_id_to_the_part_that_shares_most() -> None:
    assert numbered('aaaaaa', 'aa bbb') == [[0, -1, -1], [1, 0, -1]]


def test_patches_that_merge_keep_the_id_of_which_most_is_shared() -> None:
    found = numbered('aa bbb', 'aaaaaa', 'aa bbb')
    assert found == [[0, 1, -1], [1, -1, -1], [2, 1, -1]]


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


def test_calm_frames_raise_the_threshold_as_far_as_firm_touches_allow() -> None:
    scale, rows = np.full((1, 2), 0.5), np.linspace(0, 2, 201)[:, None, None] * np.ones((1, 2))
    assert calm_factor(rows, np.full((9, 1, 2), 50.0), scale) == pytest.approx(2 * 1.98)
    assert calm_factor(rows, np.full((9, 1, 2), 1.0), scale) == pytest.approx(2.0)
    assert calm_factor(0.1 * rows, np.full((9, 1, 2), 50.0), scale) == 1.0
    assert calm_factor(None, rows, scale) == 1.0
    assert calm_factor(rows[:0], rows, scale) == 1.0
    assert calm_factor(rows, rows, np.full((1, 2), np.nan)) == 1.0


def test_what_moves_by_more_than_itself_is_followed_within_reach() -> None:
    assert numbered('a', ' a', '  a', '      a') == [[0, -1, -1]] * 3 + [[1, -1, -1]]


def test_independent_frames_are_not_numbered() -> None:
    contact = np.array([1, 0, -1, 1], np.int8)
    ids = ContactIds().number(contact, np.ones(4, bool), in_time=False)
    assert ids.tolist() == [0, -1, 0, 0]
