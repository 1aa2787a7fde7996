# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""One contract for every registered method, and for that of docs/adding_a_method.md."""

import copy
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.calibration import flatten, restore
from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.regression import KernelRidge, Perceptron, Standardisation
from tactile_ros.sensors.regression import methods
from tactile_ros.types import Array, Estimator, Integers

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'adding_a_method.md'


def of_the_page() -> Estimator:
    """The method that the page makes."""
    made: dict[str, type] = {'__name__': __name__}  # type: ignore[dict-item]
    exec(PAGE.read_text().split('```python\n')[1].split('```')[0], made)
    return made['Nearest']()


ESTIMATORS: dict[str, Estimator] = {
    **methods(),
    'of the page': of_the_page(),
    'anchored': KernelRidge(common=10.0),
    'perceptron': Perceptron(members=2, width=24, epochs=60),
    'pattern': Perceptron(members=2, width=24, epochs=60, pattern=True),
}
CLASSES = {
    c.__name__: c
    for c in (Standardisation, *{type(estimator) for estimator in ESTIMATORS.values()})
}


def plane_touches(rows: int, seed: int = 0) -> tuple[Array, Array, Integers]:
    """Fields (T) of a dipole pressed above five chips, its place (m), and the place's number."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.01, 0.01, (max(rows // 4, 2), 2))
    groups = rng.integers(0, len(places), rows)
    depth = rng.uniform(1e-3, 4e-3, rows)
    chips = 7e-3 * np.array([[0, 0], [-1, 0], [1, 0], [0, 1], [0, -1]])
    plane = places[groups][:, None] - chips
    height = np.broadcast_to((8e-3 - depth)[:, None, None], (rows, 5, 1))
    reach = np.concatenate([plane, height], axis=2)
    field = 3e-10 * depth[:, None, None] * reach
    field /= np.linalg.norm(reach, axis=2, keepdims=True) ** 3
    return field.reshape(rows, 15) + 1e-10 * rng.normal(size=(rows, 15)), places[groups], groups


@pytest.fixture(params=ESTIMATORS)
def estimator(request: pytest.FixtureRequest) -> Estimator:
    return copy.deepcopy(ESTIMATORS[request.param])


def test_fit_returns_itself_and_learns(estimator: Estimator) -> None:
    x, y, groups = plane_touches(600)
    held = groups % 5 == 0
    assert estimator.fit(x[~held], y[~held], groups[~held]) is estimator
    error = np.linalg.norm(estimator.predict(x[held]) - y[held], axis=1).mean()
    guess = np.linalg.norm(y[~held].mean(axis=0) - y[held], axis=1).mean()
    assert error < 0.5 * guess


def test_predict_before_fit_raises(estimator: Estimator) -> None:
    with pytest.raises(NotCalibratedError, match='must be fitted'):
        estimator.predict(np.zeros((1, 15)))


def test_order_of_rows_and_names_of_groups_do_not_matter(estimator: Estimator) -> None:
    x, y, groups = plane_touches(200)
    order = np.random.default_rng(1).permutation(len(x))
    first = estimator.fit(x, y, groups).predict(x)
    again = copy.deepcopy(estimator).fit(x[order], y[order], 1000 - 7 * groups[order])
    np.testing.assert_allclose(again.predict(x[order]), first[order], rtol=1e-9, atol=1e-12)


def test_fit_is_deterministic_and_forgets_the_last(estimator: Estimator) -> None:
    x, y, groups = plane_touches(150)
    first = copy.deepcopy(estimator).fit(x, y, groups).predict(x)
    other = estimator.fit(*plane_touches(90, seed=4)).fit(x, y, groups).predict(x)
    np.testing.assert_array_equal(first, other)


def test_one_row_gives_the_numbers_of_a_batch(estimator: Estimator) -> None:
    x, y, groups = plane_touches(200)
    batch = estimator.fit(x, y, groups).predict(x)
    single = np.concatenate([estimator.predict(row[None]) for row in x])
    np.testing.assert_allclose(single, batch, rtol=1e-9, atol=1e-12)


def test_rows_that_are_not_finite_are_left_out(estimator: Estimator) -> None:
    x, y, groups = plane_touches(120)
    clean = copy.deepcopy(estimator).fit(x, y, groups)
    hurt_x = np.concatenate([x, np.full((2, 15), np.nan), np.full((1, 15), np.inf), x[:1]])
    hurt_y = np.concatenate([y, y[:3], [[np.nan, 0.0]]])
    estimator.fit(hurt_x, hurt_y, np.concatenate([groups, [0, 1, 2, 3]]))
    np.testing.assert_allclose(estimator.predict(x), clean.predict(x), rtol=1e-9, atol=1e-12)
    answer = estimator.predict(hurt_x)
    assert np.isnan(answer[120:123]).all()
    assert np.isnan(estimator.predict(np.array([[np.inf, -np.inf] + 13 * [1e308]]))).all()
    assert np.isfinite(answer[:120]).all()


@pytest.mark.parametrize('rows', [1, 2, 5, 20])
def test_few_rows_give_something_simple(estimator: Estimator, rows: int) -> None:
    x, y, groups = plane_touches(rows)
    answer = estimator.fit(x, y, groups).predict(x)
    assert answer.shape == (rows, 2)
    assert np.abs(answer).max() < 0.05


def test_constant_columns_and_unseen_values_in_them_count_for_nothing(
    estimator: Estimator,
) -> None:
    x, y, groups = plane_touches(120)
    x[:, 4] = 3e-6
    answer = estimator.fit(x, y, groups).predict(x)
    x[:, 4] = 9.0
    np.testing.assert_allclose(estimator.predict(x), answer, rtol=1e-9, atol=1e-12)


def test_units_do_not_matter(estimator: Estimator) -> None:
    x, y, groups = plane_touches(160)
    tesla = copy.deepcopy(estimator).fit(x, y, groups).predict(x)
    micro = estimator.fit(1e6 * x, 1e3 * y, groups).predict(1e6 * x)
    np.testing.assert_allclose(micro, 1e3 * tesla, rtol=1e-5, atol=1e-5)


def test_groups_may_be_left_out_and_one_target_is_enough(estimator: Estimator) -> None:
    x, y, _ = plane_touches(120)
    assert estimator.fit(x, y[:, :1]).predict(x[:7]).shape == (7, 1)
    assert estimator.predict(x[:0]).shape == (0, 1)


def test_a_stored_estimator_says_the_same(estimator: Estimator) -> None:
    x, y, groups = plane_touches(120)
    estimator.fit(x, y, groups)
    again = restore(flatten(estimator, 'e'), 'e', CLASSES)
    np.testing.assert_array_equal(again.predict(x), estimator.predict(x))  # type: ignore[attr-defined]


def test_wrong_shapes_are_named(estimator: Estimator) -> None:
    x, y, groups = plane_touches(30)
    with pytest.raises(ValueError, match='as many rows'):
        estimator.fit(x, y[:-1], groups)
    with pytest.raises(ValueError, match='at least one finite row'):
        estimator.fit(np.full_like(x, np.nan), y, groups)
    with pytest.raises(ValueError, match='x of predict must have shape'):
        estimator.fit(x, y, groups).predict(x[:, :4])
