# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Classes from few presses, prototypes, templates, and what the best head leaves of a press."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_ros.estimators import few_shot
from tactile_ros.estimators.few_shot import (
    Presses,
    SupportSet,
    press_pattern,
    prototype_scores,
    support_scores,
)
from tactile_ros.estimators.press_templates import template_rows
from tactile_ros.estimators.prototypes import Prototypes

D = 24
NOISE = np.full(D, 3e-6)
COMMON = np.tile(np.eye(3), (D // 3, 1))
BASIS = np.linalg.qr(COMMON)[0]
RNG = np.random.default_rng(0)


def drawn(count: int) -> np.ndarray:
    """Patterns (count, d) without a uniform field."""
    found = 1e-4 * RNG.normal(size=(count, D))
    return found - (found @ BASIS) @ BASIS.T


def supports(patterns: np.ndarray, labels: list[int] | np.ndarray) -> SupportSet:
    n = len(patterns)
    return SupportSet(
        patterns, np.full(n, 5.0), np.array(labels), np.arange(n), np.zeros((n, 4, D))
    )  # fmt: skip


def test_a_pattern_is_the_mean_of_the_later_whole_frames() -> None:
    window = np.outer([0.0, 0.5, np.nan, 1.0, 0.8], np.ones(D))
    pattern, frames = press_pattern(window)
    np.testing.assert_allclose(pattern, 0.9)
    assert frames == 2
    assert np.isnan(press_pattern(np.full((4, D), np.nan))[0]).all()


def test_scores_are_likelihoods_with_their_nuisances() -> None:
    # against the density with the same covariance; a uniform field is open
    pattern, slope, bend = drawn(3)
    slopes = np.stack([slope / 3e-4, 0 * slope, 0 * slope, bend])
    known = replace(supports(pattern[None], [0]), slopes=slopes[None])
    asked = pattern + 0.2 * slope + 2e-6 * RNG.normal(size=D)
    score = support_scores(known, Presses(asked[None], np.full(1, 5.0)), NOISE, COMMON, 1e-6)
    ratio = (asked @ pattern) / (pattern @ pattern)
    made = ratio * (pattern + np.log(ratio) * bend)
    sigma = np.sqrt((NOISE**2 / 5 + 1e-12) * (1 + ratio**2))
    free = np.sqrt(2) * ratio * few_shot.UNLIKE[:, None] * slopes
    ways = np.vstack([few_shot.ANY_SIZE * made, free]) / sigma
    span = np.linalg.qr(COMMON / sigma[:, None])[0]
    ways, miss = (one - (one @ span) @ span.T for one in (ways, (asked - made) / sigma))
    covariance = np.eye(D) + ways.T @ ways
    cost = miss @ np.linalg.solve(covariance, miss)
    level = 2 * np.log(sigma).sum() + np.linalg.slogdet(np.eye(D) + ways[1:].T @ ways[1:])[1]
    assert score[0, 0] == pytest.approx(cost + level, rel=1e-6)


def test_a_likelihood_that_discounts_placement_names_more_than_unit_vectors() -> None:
    kinds, count = 6, 12
    base, slope = drawn(1)[0], drawn(1)[0]
    shape, aside = np.repeat(np.arange(kinds), count), RNG.normal(size=kinds * count)
    patterns = (base + 0.15 * drawn(kinds))[shape] + 0.4 * aside[:, None] * slope
    slopes = np.zeros((len(shape), 4, D))
    slopes[:, 0] = slope / 4e-4
    known = replace(supports(patterns, shape), slopes=slopes)
    first, others = known.rows(np.arange(0, len(shape), count)), known
    likely = support_scores(first, others, NOISE, COMMON, 1e-6).argmin(axis=1)
    nearest = prototype_scores(first, others, BASIS).argmin(axis=1)
    assert (likely == shape).mean() > (nearest == shape).mean() + 0.2


def test_the_nearest_mean_wins_not_the_farthest() -> None:
    # eq. (3) as printed is a softmax of +d
    features = np.array([[0.0, 0.0], [2.0, 0.0], [10.0, 10.0]])
    found = Prototypes().fit(features, np.array([0, 0, 1]))
    np.testing.assert_array_equal(found.means_, [[1.0, 0.0], [10.0, 10.0]])
    assert found.predict(np.array([[2.0, 1.0], [8.0, 8.0]])).tolist() == [0, 1]


def test_sums_of_hundreds_of_squares_do_not_underflow() -> None:
    rng = np.random.default_rng(0)
    means = 30 * rng.normal(size=(5, 320))
    assert np.exp(-np.square(means[0] - means[1]).sum()) == 0.0
    found = Prototypes().fit(means, np.arange(5))
    asked = means + 5 * rng.normal(size=means.shape)
    logarithm = found.log_probability(asked)
    assert np.isfinite(logarithm).all()
    np.testing.assert_allclose(np.exp(logarithm).sum(axis=1), 1.0)
    assert found.predict(asked).tolist() == list(range(5))


def test_template_rows_at_a_node_are_the_cubic_spline_of_its_neighbours() -> None:
    half, turns, width = 3, 5, 12
    sides = 2 * half + 1
    flat = np.random.default_rng(6).normal(size=(turns * sides * sides, width)).astype(np.float32)
    grid, about = np.array([1e-3, 2e-3, half, half], float), np.array([0.0, turns / 2.0, turns])
    work, parts = np.empty((3, width), np.float32), np.empty((4, width), np.float32)
    pose = np.array([1e-3, -2e-3, 2 * 2.0 / turns, 0.0])
    template_rows(flat, grid, about, pose, work, parts)
    table = flat.reshape(turns, sides, sides, width).astype(float)
    near = table[1:4, 3:6, 1:4]
    knot = np.array([1.0, 4.0, 1.0]) / 6.0
    np.testing.assert_allclose(
        parts[0], np.einsum('i,j,k,ijkd->d', knot, knot, knot, near), 1e-5, 1e-6
    )
