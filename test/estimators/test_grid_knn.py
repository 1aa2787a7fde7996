# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Neighbours of whole windows: hard case 7, ties and large offsets."""

import numpy as np

from tactile_ros.estimators.grid_knn import GridKnn


def test_small_differences_of_large_fields_are_told() -> None:
    # |a|^2 - 2 a b + |b|^2 in singles gives -128 for 9 between vectors of 40 mT
    rng = np.random.default_rng(0)
    field = 40e-3 * np.sign(rng.normal(size=60))
    known = field + 3e-6 * rng.normal(size=(50, 60))
    named = np.eye(50)
    found = GridKnn(neighbours=1).fit(known, named).predict(known + 0.3e-6)
    np.testing.assert_array_equal(found.argmax(axis=1), np.arange(50))
    single = known.astype(np.float32)
    expanded = (single**2).sum(axis=1)[:, None] - 2 * single @ single.T + (single**2).sum(axis=1)
    assert (expanded < 0).any()


def test_of_samples_as_near_the_first_in_order_answers_and_one_that_is_met_is_not_nan() -> None:
    x = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    y = np.array([[10.0], [20.0], [30.0], [40.0]])
    for order in (np.arange(4), np.arange(4)[::-1]):
        model = GridKnn(neighbours=2).fit(x[order], y[order])
        middle = model.predict(np.zeros((1, 2)))
        first = GridKnn(neighbours=2).fit(x, y).predict(np.zeros((1, 2)))
        np.testing.assert_allclose(middle, first)
        np.testing.assert_allclose(model.predict(x), y, rtol=0.01)
