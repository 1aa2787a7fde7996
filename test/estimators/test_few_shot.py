"""Presses as classes: depth, noise and means of several."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.few_shot import (
    SHAPE_RANK,
    PressVectors,
    SupportSet,
    averaged,
    seen_classes,
    support_scores,
)

D = 24
NOISE = np.full(D, 3e-6)
COMMON = np.tile(np.eye(3), (D // 3, 1))
BASIS = np.linalg.qr(COMMON)[0]


def terms(seed: int) -> np.ndarray:
    """What the powers 1 to 3 of the depth do, without a uniform field."""
    found = np.array([1e-4, 3e-5, 1e-5])[:, None] * np.random.default_rng(seed).normal(size=(3, D))
    return found - (found @ BASIS) @ BASIS.T


def supports(
    patterns: np.ndarray, labels: list[int], bends: np.ndarray, powers: np.ndarray
) -> SupportSet:
    n = len(patterns)
    return SupportSet(
        np.array(labels), patterns, np.tile(powers, (n, 1)), np.full(n, 5.0), np.ones(n),
        np.zeros((n, 3, D)), np.tile(bends, (n, 1, 1)), np.full((n, D), np.nan),
        np.zeros((n, SHAPE_RANK, D)), np.arange(n),
    )  # fmt: skip


def test_a_support_tells_the_pattern_at_another_depth_and_speed() -> None:
    parts, slow, fast = terms(0), np.array([1.0, 0.8, 0.7]), np.array([1.0, 0.95, 0.92])
    known = supports((slow @ parts)[None], [0], parts[1:], slow)
    deeper = (fast * 1.7 ** np.arange(1, 4)) @ parts
    np.testing.assert_allclose(known.at_depth(np.array([1.7]), fast)[0], deeper, atol=1e-18)
    np.testing.assert_allclose(known.depths(deeper, fast), [1.7], rtol=1e-6)


def test_noise_where_shapes_do_nothing_is_not_learned() -> None:
    rng = np.random.default_rng(1)
    parts = terms(1)
    one = np.ones(3)
    factors = np.zeros((1, SHAPE_RANK, D))
    factors[0, 0] = terms(2)[0]
    true = parts[0] + 0.7 * factors[0, 0]
    seen = true + NOISE * rng.normal(size=D)
    known = supports(seen[None], [0], 0 * parts[1:], one)
    known = SupportSet(
        *(getattr(known, name) for name in ('label', 'pattern', 'powers', 'frames', 'presses')),
        known.slopes, known.bends, parts[:1], factors, known.number,
    )  # fmt: skip
    told, variance = known.told(NOISE, 0.0, 1e-3)
    assert np.linalg.norm(told.pattern - true) < 0.5 * np.linalg.norm(seen - true)
    assert (variance < np.square(NOISE) / known.frames[0]).all()
    blank = np.isnan(known.middle) | True
    plain, kept = SupportSet(
        *(getattr(known, name) for name in ('label', 'pattern', 'powers', 'frames', 'presses')),
        known.slopes, known.bends, np.where(blank, np.nan, 0.0), 0 * factors,
        known.number,
    ).told(NOISE, 0.0, 1e-3)  # fmt: skip
    np.testing.assert_allclose(plain.pattern, known.pattern)
    np.testing.assert_allclose(kept, np.square(NOISE)[None] / known.frames[0])


def test_alike_presses_are_one_mean_and_others_stay() -> None:
    parts, one = terms(3), np.ones(3)
    depths = np.array([0.6, 1.0, 0.8])
    same = (depths[:, None] ** np.arange(1, 4)) @ parts
    # a press at depth a bends by its square and cube
    other = terms(4)[0]
    known = supports(np.vstack([same, other]), [2, 2, 2, 2], 0 * parts[1:], one)
    bends = depths[:, None, None] ** np.array([2, 3])[:, None] * parts[1:]
    known.bends[:3] = bends
    found = averaged(known, BASIS)
    assert found.label.tolist() == [2, 2]
    np.testing.assert_allclose(found.pattern[0], same[1], rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(found.pattern[1], other)
    assert 1 < found.presses[0] <= 3


def test_the_class_that_was_seen_scores_best_whatever_field_is_added() -> None:
    one = np.ones(3)
    first, second = terms(5)[0], terms(6)[0]
    known = supports(np.stack([first, second]), [0, 1], np.zeros((2, D)), one)
    seen = seen_classes(known, NOISE, 1e-6, 0.02, BASIS)
    asked = np.stack([1.4 * first, 0.7 * second]) + COMMON @ np.array([5e-5, -5e-5, 4e-5])
    presses = PressVectors(asked, np.tile(one, (2, 1)), np.full(2, 5.0))
    score = support_scores(seen, presses, NOISE, COMMON, 1e-6)
    assert score.argmin(axis=1).tolist() == [0, 1]
