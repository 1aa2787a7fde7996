"""Smooth fields, their prior and the spreads that are told by cells."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.smooth_fields import (
    EXPECTED,
    Moments,
    SmoothFields,
    prior_spread,
)

SQUARE = np.ones(2)


def fields(most: int = 8, count: int = 49, size: np.ndarray = SQUARE) -> SmoothFields:
    """Fields for a grid of touches."""
    return SmoothFields.for_places(np.array([[0.1, 0.1], [0.9, 0.9]]), count, size, most)


def test_more_touches_allow_for_more_waves() -> None:
    assert len(fields(12, 16).entry) < len(fields(12, 49).entry)
    long = fields(12, 49, np.array([2.0, 1.0]))
    number = np.count_nonzero(long.angles, axis=1)
    assert number[0] > number[1]


def test_a_prior_of_size_one_has_that_size_whatever_its_length() -> None:
    for length in (0.1, 0.5, 2.0):
        level, _ = fields().spread(length, 1e-6)
        assert (
            np.exp(2 * level).sum() == np.float64(1.0) or abs(np.exp(2 * level).sum() - 1) < 1e-6
        )


def test_slopes_of_a_prior_are_its_differences() -> None:
    some = (fields(), fields(), fields(5), fields(7))
    _, along = prior_spread(some, EXPECTED)
    for i, step in enumerate(1e-6 * np.eye(6)):
        high, low = (np.log(prior_spread(some, EXPECTED + sign * step)[0]) for sign in (1, -1))
        np.testing.assert_allclose(along[i], (high - low) / 2e-6, atol=1e-5)


def test_slopes_of_the_evidence_are_its_differences() -> None:
    rng = np.random.default_rng(0)
    terms, spread = rng.normal(size=(40, 7)), np.exp(rng.normal(size=7))
    moments = Moments.of(terms, rng.normal(size=(40, 2)))
    level, slope = moments.slope(spread)
    assert level == moments.evidence(spread)
    for i, step in enumerate(1e-5 * np.eye(7)):
        high, low = (moments.evidence(spread * np.exp(sign * step)) for sign in (1, -1))
        assert abs(slope[i] - (high - low) / 2e-5) < 1e-5


def test_a_table_of_weights_says_what_the_terms_say() -> None:
    rng, own = np.random.default_rng(1), fields()
    places, weights = rng.uniform(size=(20, 2)), rng.normal(size=(len(own.entry), 2))
    waves = own.waves(places)
    said = np.einsum('si,sj,ijk->sk', waves[:, 0], waves[:, 1], own.table(weights))
    np.testing.assert_allclose(said, own.terms(places) @ weights, atol=1e-12)
