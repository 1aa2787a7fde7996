# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The network of [5]."""

import numpy as np
import pytest

from tactile_ros.estimators.rbf_force import RbfForce, k_means


def test_k_means_leaves_out_empty_and_equal_clusters() -> None:
    points = np.repeat(np.array([[0.0, 0.0], [1.0, 1.0]]), 20, axis=0)
    assert len(k_means(points, 8, seed=0)) == 2
    x = np.column_stack([points, points[:, :1]])
    found = RbfForce().fit(x, points[:, :1])
    np.testing.assert_allclose(found.predict(x), points[:, :1], atol=1e-6)


def test_more_nodes_until_the_target_is_met() -> None:
    x = np.random.default_rng(3).uniform(size=(300, 1))
    coarse = RbfForce(target=0.05).fit(x, np.sin(9 * x))
    fine = RbfForce(target=1e-5).fit(x, np.sin(9 * x))
    assert len(coarse.centres_) < len(fine.centres_)


def test_hard_case_5_duplicated_centres_leave_weights_small_and_widths_above_zero() -> None:
    rng = np.random.default_rng(5)
    few = rng.uniform(size=(20, 2))
    x = np.repeat(few, 15, axis=0) + 1e-9 * rng.normal(size=(300, 2))
    y = np.sin(3 * x[:, :1]) + x[:, 1:]
    found = RbfForce(target=0.0, nodes=(96,)).fit(x, y)
    assert np.abs(found.weights_).max() < 1e3
    assert np.abs(found.predict(x) - y).max() < 0.05
    one = RbfForce(nodes=(1,)).fit(x, y)
    same = RbfForce().fit(np.ones((12, 2)), y[:12])
    for network in (one, same):
        assert network.width_ > 0
        assert np.isfinite(network.predict(x)).all()


def test_the_width_is_that_of_equation_7() -> None:
    x = np.random.default_rng(6).uniform(size=(200, 3))
    found = RbfForce(nodes=(16,)).fit(x, x[:, :1])
    apart = np.linalg.norm(found.centres_[:, None] - found.centres_, axis=2).max()
    assert found.width_ == pytest.approx(apart / np.sqrt(2 * len(found.centres_)))
