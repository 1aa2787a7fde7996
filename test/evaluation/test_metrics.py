# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Errors, coverage and classes against plain sums."""

import math
import statistics
from dataclasses import astuple

import numpy as np
import pytest
from scipy import stats

from tactile_ros.evaluation import metrics
from tactile_ros.sensors.regression import places_of
from tactile_ros.types import ContactStates, Layout, Recording


def test_rows_of_a_confusion_are_true_cells() -> None:
    true, said = np.array([0, 0, 0, 1, 1]), np.array([0, 0, 2, 1, -1])
    wanted = [[200 / 3, 0, 100 / 3], [0, 50, 0], [np.nan] * 3]
    np.testing.assert_allclose(metrics.confusion(said, true, 3), wanted)


def test_coverage_accepts_true_covariances_alone() -> None:
    rng = np.random.default_rng(2)
    error, groups = rng.normal(0, 2, 4000), np.repeat(np.arange(400), 10)
    honest = metrics.coverage(error, np.full(4000, 4.0), groups)
    assert honest.share == pytest.approx(metrics.ONE_SIGMA, abs=0.03)
    assert honest.honest
    assert (honest.count, honest.groups) == (4000, 400)
    assert not metrics.coverage(error, np.full(4000, 1.0), groups).honest
    assert not metrics.coverage(error, np.full(4000, 16.0), groups).honest
    unknown = np.where(np.arange(4000) < 3000, 4.0, np.nan)  # no covariance, no judgement
    assert metrics.coverage(error, unknown, groups).count == 3000
    assert math.isnan(metrics.coverage(error, np.full(4000, np.nan), groups).share)


def test_few_groups_widen_what_is_accepted_to_the_binomial_interval() -> None:
    found = metrics.coverage(np.zeros(30), np.ones(30), np.repeat(np.arange(10), 3))
    ends = stats.binom.ppf((0.025, 0.975), 10, metrics.ONE_SIGMA) / 10
    assert (found.low, found.high) == pytest.approx(ends)
    many = metrics.coverage(np.zeros(10_000), np.ones(10_000), np.arange(10_000))
    assert (many.low, many.high) == (metrics.ONE_SIGMA - 0.05, metrics.ONE_SIGMA + 0.05)


LAYOUT = Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T')
NOTHING = 'none of position, force_x, force_y, force_z, torque_x, torque_y, torque_z'
Known = dict[str, np.ndarray]


def unjudged_in(truth: Known, estimates: Known) -> tuple[str, ...]:
    """Sentences about four frames with some truth and some estimates."""
    recording = Recording.from_arrays(LAYOUT, np.zeros((4, 5, 3)), truth=truth)
    states = ContactStates.assemble(4, 5, {'valid': np.ones(4, bool), **estimates})
    counts = {
        target.name: target.spread.count for target in metrics.target_errors(recording, states)
    }
    return metrics.unjudged('ridge', counts, metrics.given_targets(states))


def axis(number: int, rows: slice = slice(None)) -> np.ndarray:
    """Vectors (4, 3) known along one axis in some rows."""
    vectors = np.full((4, 3), np.nan)
    vectors[rows, number] = 1.0
    return vectors


@pytest.mark.parametrize(
    ('truth', 'estimates', 'words'),
    [
        ({'force': axis(2)}, {'force': axis(0)}, 'it estimates force_x, truth has force_z'),
        ({'slip': np.ones(4, int)}, {'force': axis(0)}, f'force_x, truth has {NOTHING}'),
        ({'force': axis(2)}, {}, f'it estimates {NOTHING}, truth has force_z'),
        ({'force': axis(2, slice(2))}, {'force': axis(2, slice(2, 4))},
         'no row with true force_z has an estimate'),
    ],
)  # fmt: skip
def test_no_error_is_explained(truth: Known, estimates: Known, words: str) -> None:
    (sentence,) = unjudged_in(truth, estimates)
    assert sentence.startswith('ridge has no error: ')
    assert sentence.endswith(words)
    one = {'force': axis(2), 'torque': axis(1)}
    assert unjudged_in(one, {'force': axis(2, slice(1))}) == ()  # one error is enough


def test_spread_against_plain_sums() -> None:
    values = np.random.default_rng(0).normal(size=101)
    values[::7] = np.nan
    known = [abs(x) for x in values.tolist() if not math.isnan(x)]
    percentiles = statistics.quantiles(known, n=100, method='inclusive')
    rms = math.sqrt(statistics.fmean(x * x for x in known))
    wanted = [statistics.fmean(known), rms, *(percentiles[k] for k in (49, 94, 98)), max(known)]
    assert astuple(metrics.spread(values)) == pytest.approx((len(known), *wanted), rel=1e-12)
    assert metrics.spread([math.nan]).count == 0
    assert math.isnan(metrics.spread([]).mean)


def test_errors_of_position_and_force_against_plain_loops() -> None:
    rng = np.random.default_rng(3)
    count = 60
    place = np.repeat(rng.uniform(-0.01, 0.01, (12, 2)), 5, axis=0)
    position = np.column_stack([place, np.full(count, np.nan)])
    position[7] = np.nan
    force = np.full((count, 3), np.nan)
    force[::2, 2] = rng.uniform(0, 5, 30)
    guess = position + rng.normal(0, 1e-3, (count, 3))
    guess[9] = np.nan
    push = np.nan_to_num(force) + rng.normal(0, 0.1, (count, 3))
    force[40:50:2, 2] = push[40:50:2, 2] = 0.0  # nothing was, and nothing was said
    truth = {'position': position, 'force': force}
    recording = Recording.from_arrays(LAYOUT, np.zeros((count, 5, 3)), truth=truth)
    states = ContactStates.assemble(count, 5, {
        'position': guess, 'position_cov': np.tile(1e-6 * np.eye(3), (count, 1, 1)),
        'force': push, 'force_cov': np.tile(0.01 * np.eye(3), (count, 1, 1)),
        'valid': np.arange(count) != 11,
    })  # fmt: skip
    place_error, push_error = metrics.target_errors(recording, states)
    rows = [k for k in range(count) if k not in (7, 9, 11)]
    sizes = [math.hypot(*(guess[k, :2] - position[k, :2])) for k in rows]
    assert place_error.spread.mean == pytest.approx(sum(sizes) / len(sizes), rel=1e-12)
    assert (place_error.missed, place_error.invalid) == (1, 1)
    inside = [abs(guess[k, a] - position[k, a]) <= 1e-3 for k in rows for a in (0, 1)]
    assert place_error.coverage.share == pytest.approx(sum(inside) / len(inside))
    assert place_error.coverage.groups == 12
    assert push_error.coverage.count == 25
    squares = [(push[k, 2] - force[k, 2]) ** 2 for k in range(0, count, 2)]
    assert (place_error.unit, push_error.name) == ('m', 'force_z')
    assert push_error.spread.rms == pytest.approx(math.sqrt(sum(squares) / 30), rel=1e-12)
    assert push_error.rows.tolist() == list(range(0, count, 2))
    blind = Recording.from_arrays(LAYOUT, recording.values)
    assert metrics.target_errors(blind, states) == ()


def test_places_that_do_not_repeat_give_way_to_other_groups() -> None:
    plane = np.array([[0.0, 0.0], [0.0, 1e-6], [1e-3, 0.0], [1e-3, 0.0], [np.nan, 0.0]])
    places = places_of(plane)
    assert places is not None
    assert places.tolist() == [0, 0, 1, 1, -1]
    for lone in (np.column_stack([np.arange(5.0), np.zeros(5)]), np.full((5, 2), np.nan)):
        assert places_of(lone) is None


def test_dropped_frames_are_gaps_inside_streams() -> None:
    sequence = np.array([5, 6, 9, 10, 0, 1, 4])
    restarts = np.array([True, False, False, False, True, False, False])
    assert metrics.frames_dropped(sequence, restarts) == 2 + 2
    assert (
        metrics.frames_dropped(None, restarts)
        == metrics.frames_dropped(sequence[:1], restarts[:1])
        == 0
    )


def test_contact_is_judged_at_rest_by_force_and_at_its_end() -> None:
    force = np.full((12, 3), np.nan)
    force[:, 2] = [0, 0, 0.05, 0.5, 2, 2, 0, 0, 0, 0.3, 0, 0]
    told = np.array([0, 1, 0, 0, 1, 1, 1, 1, 0, 1, 0, -1], np.int8)
    recording = Recording.from_arrays(
        LAYOUT, np.zeros((12, 5, 3)), 10**8 * np.arange(12), tare=np.arange(12) == 10,
        truth={'force': force},
    )  # fmt: skip
    states = ContactStates.assemble(12, 5, {'in_contact': told, 'force': force})
    found = metrics.contact_errors(recording, states)
    assert found.touched.tolist() == [*[False] * 2, *[True] * 3, *[False] * 3, True, False]
    assert found.contact_at_rest == 50.0  # of 6 frames
    assert found.found == 75.0
    np.testing.assert_allclose(found.table, [[100 / 3, 50], [25, 75]])
    assert found.release_s == pytest.approx([0.2])  # a tare is no release
    twice = metrics.ContactErrors.pool([found, found])
    assert (twice.found, len(twice.release_s)) == (75.0, 2)
    assert metrics.contact_errors(recording, ContactStates.assemble(12, 5, {})) is None
    np.testing.assert_allclose(metrics.tare_age(recording)[9:], [np.nan, 0.0, 0.1])
