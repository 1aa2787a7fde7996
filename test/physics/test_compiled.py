"""Compiled loops: the same bits alone and among others, the same numbers as arrays."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.estimators.polynomial_force import PolynomialForce
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.estimators.polynomial_rows import spread, times
from tactile_ros.estimators.uncertainty import CalibratedCovariance
from tactile_ros.physics import compiled

RNG = np.random.default_rng(4)
X, Y = RNG.normal(size=(200, 8)), RNG.normal(size=(200, 3))


def test_without_a_compiler_a_function_stays_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, 'AVAILABLE', False)
    assert compiled.compiled(abs) is abs


@pytest.mark.skipif(not compiled.available(), reason='numba is not installed')
@pytest.mark.parametrize('kind', [PolynomialForce, PolynomialRidge])
def test_a_row_has_the_same_bits_alone_and_as_arrays(
    kind: type[PolynomialForce] | type[PolynomialRidge], monkeypatch: pytest.MonkeyPatch
) -> None:
    x = X.copy()
    model = kind().fit(x, Y)
    x[7, 2] = np.nan
    many = model.predict(x)
    assert np.isnan(many[7]).all()
    alone = np.concatenate([model.predict(x[i : i + 1]) for i in range(len(x))])
    np.testing.assert_array_equal(alone, many)
    monkeypatch.setattr(compiled, 'AVAILABLE', False)
    np.testing.assert_array_equal(model.predict(x), many)
    rows = [model.predict(x[i : i + 1]) for i in range(len(x))]
    np.testing.assert_array_equal(np.concatenate(rows), many)


@pytest.mark.skipif(not compiled.available(), reason='numba is not installed')
def test_spreads_and_products_are_those_of_arrays() -> None:
    covariance = CalibratedCovariance().fit(X[:, :3], Y)
    np.testing.assert_allclose(
        spread(covariance, X[:, :3].copy()), covariance.sigma(X[:, :3]), rtol=1e-12
    )
    matrix = RNG.normal(size=(8, 6))
    np.testing.assert_allclose(times(X, matrix), X @ matrix, rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(times(X[5:6], matrix)[0], times(X, matrix)[5])
