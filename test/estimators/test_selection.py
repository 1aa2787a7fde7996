# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The choice among estimators looks at held-out groups only."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.model_selection import select
from tactile_ros.estimators.regression import Ridge, group_folds


def line(rows: int = 120) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    x = rng.normal(size=(rows, 2))
    return x, x @ [[1.0], [-2.0]] + 0.01 * rng.normal(size=(rows, 1)), np.arange(rows) // 4


def test_the_better_candidate_is_named_and_candidates_stay_unfitted() -> None:
    candidates = {'knn': GridKnn(), 'ridge': Ridge()}
    selection = select(candidates, *line())
    assert selection.name == 'ridge'
    assert selection.errors['ridge'] < 0.02 < selection.errors['knn']
    assert not hasattr(candidates['ridge'], 'weights_')


def test_winner_never_saw_the_group_it_is_judged_on() -> None:
    x, _, groups = line()
    secret = np.random.default_rng(0).normal(size=groups.max() + 1)[groups][:, None]
    memory = select({'knn': GridKnn(neighbours=1)}, np.column_stack([x, groups]), secret, groups)
    assert memory.errors['knn'] > 0.9 * secret.std()


def test_fewer_rounds_judge_fewer_rows() -> None:
    x, y, groups = line()
    assert len(select({'ridge': Ridge()}, x, y, groups, folds=5, rounds=2).y) == 48


def test_order_of_rows_does_not_matter() -> None:
    x, y, groups = line()
    order = np.random.default_rng(5).permutation(len(x))
    a = select({'ridge': Ridge()}, x, y, groups)
    b = select({'ridge': Ridge()}, x[order], y[order], groups[order] + 17)
    np.testing.assert_array_equal(a.predictions, b.predictions)


def test_no_candidate_is_an_error_and_one_group_is_none() -> None:
    x, y, _ = line()
    with pytest.raises(ValueError, match='at least one estimator'):
        select({}, x, y)
    assert select({'ridge': Ridge()}, x, y, np.zeros(120, int)).name == 'ridge'


def test_folds_share_rows_of_uneven_groups_and_never_split_one() -> None:
    groups = np.repeat(np.arange(6), [50, 10, 10, 10, 10, 10])
    fold = group_folds(groups, 2, seed=0)
    assert np.bincount(fold).tolist() == [50, 50]
    assert all(len(set(fold[groups == g])) == 1 for g in range(6))
    assert set(group_folds(np.array([0, 0, 1]), 9, seed=0)) == {0, 1}


class Parrot:
    """Knows what it was told, and nothing else."""

    def fit(self, x: np.ndarray, y: np.ndarray, groups: np.ndarray | None = None) -> Parrot:
        self.known = dict(zip(x[:, 0].tolist(), y, strict=True))
        return self

    def predict(self, x: np.ndarray) -> np.ndarray:
        return np.array([self.known.get(one, np.full(1, np.nan)) for one in x[:, 0].tolist()])


def test_rows_of_a_single_group_are_judged_unseen_too() -> None:
    x, y, groups = line()
    chosen = select({'parrot': Parrot()}, x, y, 0 * groups)
    assert np.isnan(chosen.residuals).all()
    assert (chosen.groups == 0).all()
