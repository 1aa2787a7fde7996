# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Classes from few presses: depth, means of several, nuisances, and the choice of a metric."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_ros.estimators import few_shot
from tactile_ros.estimators.few_shot import (
    Metric,
    Presses,
    SupportSet,
    choose_metric,
    press_pattern,
    share_of,
    support_scores,
)

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
        patterns, np.full(n, 5.0), np.array(labels), np.arange(n), np.ones(n),
        np.zeros((n, 3, D)), np.zeros((n, D)),
    )  # fmt: skip


def test_speed_of_a_press_does_not_change_its_pattern() -> None:
    parts = drawn(2) * [[1.0], [0.2]]
    for rise in (3, 9):
        course = np.clip(np.arange(1, 11) / rise, 0, 1)
        window = course[:, None] * parts[0] + course[:, None] ** 2 * parts[1]
        pattern, frames = press_pattern(window, BASIS)
        depth = (course**3).sum() / (course**2).sum()
        wanted = depth * parts[0] + depth**2 * parts[1]
        np.testing.assert_allclose(pattern, wanted, atol=0.01 * np.abs(wanted).max())
        assert 1 <= frames <= 20
    assert np.isnan(press_pattern(np.full((4, D), np.nan), BASIS)[0]).all()


def test_alike_presses_are_one_mean_and_others_stay() -> None:
    first, other = drawn(2)
    known = supports(np.array([0.6, 1.0, 0.8])[:, None] * first, [2, 2, 2])
    found = known.joined(supports(other[None], [2])).averaged(BASIS)
    assert found.label.tolist() == [2, 2]
    np.testing.assert_allclose(found.pattern[0], first, rtol=1e-9)
    np.testing.assert_allclose(found.pattern[1], other, rtol=1e-12)
    assert 1 < found.presses[0] <= 3


def test_scores_are_likelihoods_with_their_nuisances() -> None:
    # against the density with the same covariance; depth and uniform field are open
    pattern, slope, bend = drawn(3)
    known = replace(
        supports(pattern[None], [0]), slopes=np.array([[slope / 1e-3, 0 * slope, 0 * slope]]),
        bends=0.3 * bend[None],
    )  # fmt: skip
    metric = Metric(3e-4, 0.02, 0.2, 0.02)
    asked = pattern + 0.2 * slope + 2e-6 * RNG.normal(size=D)
    presses = Presses(asked[None], np.full(1, 5.0))
    score = support_scores(known, presses, NOISE, COMMON, 1e-6, metric)
    ratio = (asked @ pattern) / (pattern @ pattern)
    made = ratio * (pattern + np.log(ratio) * known.bends[0])
    variance = (1 + ratio**2) * (NOISE**2 / 5 + 1e-12) + 2 * share_of(asked, 0.02)
    ways = [metric.place * known.slopes[0, 0], metric.bend * known.bends[0]]
    ways = np.array(ways) * ratio * np.sqrt(2) / np.sqrt(variance)
    size = made / few_shot.ANY_DEPTH / np.sqrt(variance)
    field = 1e4 * COMMON.T / np.sqrt(variance)
    miss = (asked - made) / np.sqrt(variance)
    free = np.vstack([ways, size, 1e-5 * field])
    cost = miss @ np.linalg.solve(np.eye(D) + free.T @ free, miss)
    span = np.linalg.qr(field.T)[0]
    ways = ways - (ways @ span) @ span.T
    level = np.log(variance).sum() + np.linalg.slogdet(np.eye(2) + ways @ ways.T)[1]
    assert score[0, 0] == pytest.approx(cost + level, rel=1e-6)


def places_and_shapes(kinds: int, presses: int, aside: float) -> SupportSet:
    """Presses of shapes that differ less than their placement changes them."""
    base, slope = drawn(1)[0], drawn(1)[0]
    shapes = base + 0.15 * drawn(kinds)
    shape, along = np.repeat(np.arange(kinds), presses), aside * RNG.normal(size=kinds * presses)
    known = supports(shapes[shape] + along[:, None] * slope, shape)
    slopes = np.zeros((len(shape), 3, D))
    slopes[:, 0] = slope / 4e-4
    return replace(known, slopes=slopes)


def test_a_metric_that_discounts_placement_names_more_than_prototypes() -> None:
    known = places_and_shapes(6, 12, 0.4)
    metric, right = choose_metric(known, NOISE, COMMON, 1e-6)
    assert metric is not None
    assert right['accuracy_whitened'] > right['accuracy_prototypes'] + 0.2


def test_a_metric_that_loses_to_prototypes_is_not_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    known = places_and_shapes(6, 12, 0.1)

    def lost(some: SupportSet, asked: Presses, *_: object) -> np.ndarray:
        return np.zeros((len(asked.frames), len(some.label)))

    monkeypatch.setattr(few_shot, 'support_scores', lost)
    metric, right = choose_metric(known, NOISE, COMMON, 1e-6)
    assert metric is None
    assert right['accuracy_prototypes'] > right['accuracy_whitened']


def test_presses_of_which_none_repeats_choose_nothing() -> None:
    assert choose_metric(supports(drawn(4), [0, 1, 2, 3]), NOISE, COMMON, 1e-6) == (Metric(), {})
