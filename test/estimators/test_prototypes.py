# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Prototypes of [1]: hard case 14."""

import numpy as np

from tactile_ros.estimators.prototypes import Prototypes


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
