# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Place from potentials: what terms, inversion and held-out errors must be right about."""

import numpy as np
import pytest

from tactile_ros.estimators.potential_map import (
    ORDER,
    OWN,
    TERMS,
    WAVES,
    PotentialMap,
    write_terms,
)

SIZE = np.array([0.12, 0.1])


def terms(place: np.ndarray) -> np.ndarray:
    out = np.empty((3, TERMS))
    write_terms(np.asarray(place), SIZE, out)
    return out


def bent(places: np.ndarray) -> np.ndarray:
    """Two harmonic functions that differ from the linear ones."""
    z = (places[:, 0] + 1j * places[:, 1] - 0.05 - 0.05j) / 0.05
    return np.column_stack(
        [
            0.5 - (z.real + z.imag) / 4 + 0.05 * (z**2).real + 0.02 * (z**3).imag,
            0.5 + (z.real - z.imag) / 4 - 0.04 * (z**2).imag,
        ]
    )


def grid(count: int) -> np.ndarray:
    line = np.linspace(0.0125, 0.0875, count)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize('place', [[0.03, 0.02], [0.1, 0.08], [0.06, 0.05]])
def test_terms_have_their_derivatives_and_are_harmonic(place: list[float]) -> None:
    here, step = np.array(place), 1e-5
    value = terms(here)[0]
    laplacian = -4 * value
    for axis in range(2):
        move = step * np.eye(2)[axis]
        high, low = terms(here + move), terms(here - move)
        slope = (high[0] - low[0]) / (2 * step)
        np.testing.assert_allclose(terms(here)[1 + axis], slope, rtol=1e-4, atol=1e-2)
        laplacian += high[0] + low[0]
    waves = np.arange(2 * ORDER + 1, 2 * ORDER + 1 + WAVES**2)
    harmonic = np.setdiff1d(np.arange(TERMS), waves)
    np.testing.assert_allclose(laplacian[harmonic] / step**2, 0.0, atol=2.0)


def test_border_terms_are_sines_on_one_side_and_0_on_the_others() -> None:
    along = terms([0.03, 0.0])[0, OWN : OWN + 20]
    np.testing.assert_allclose(along, np.sin(np.pi * np.arange(1, 21) * 0.25), atol=1e-12)
    for place in ([0.0, 0.04], [0.12, 0.04], [0.05, 0.1]):
        np.testing.assert_allclose(terms(place)[0, OWN : OWN + 20], 0.0, atol=1e-12)


def test_map_finds_harmonic_functions_from_16_points() -> None:
    places = grid(4)
    found = PotentialMap(np.array([0.1, 0.1])).fit(bent(places), places)
    fresh = np.random.default_rng(0).uniform(0.0125, 0.0875, (200, 2))
    assert np.abs(found.predict(bent(fresh)) - fresh).max() < 5e-5


def test_garbage_potentials_stay_on_the_sheet_and_nan_stays_nan() -> None:
    places = np.random.default_rng(1).uniform(0.01, 0.09, (40, 2))
    found = PotentialMap(np.array([0.1, 0.1])).fit(bent(places), places)
    wild = found.predict(np.array([[1e6, -1e6], [0.0, 1.0]]))
    assert ((wild >= 0) & (wild <= 0.1)).all()
    assert np.isnan(found.place(np.array([[np.nan, 0.5]]))[0]).all()


def test_held_out_errors_are_those_of_fits_without_the_group() -> None:
    rng = np.random.default_rng(3)
    places, groups = np.repeat(grid(5), 4, axis=0), np.repeat(np.arange(25), 4)
    u = bent(places) + 3e-4 * rng.normal(size=(100, 2))
    found = PotentialMap(np.array([0.1, 0.1]))
    errors, covariance = found.fit_held_out(u, places, groups)
    sigma = np.sqrt(np.einsum('sii->si', covariance))
    assert 0.5 < (np.abs(errors) < sigma).mean() < 0.85
    for group in (6, 12):
        rows = groups == group
        other = PotentialMap(np.array([0.1, 0.1])).fit(u[~rows], places[~rows])
        off = other.predict(u[rows]) - places[rows]
        np.testing.assert_allclose(errors[rows], off, atol=8e-5)


def test_a_third_potential_is_used() -> None:
    rng = np.random.default_rng(4)
    places = np.repeat(grid(5), 8, axis=0)
    three = np.column_stack([bent(places), bent(places) @ [0.9, -0.9]])
    three += 3e-4 * rng.normal(size=three.shape)
    error = []
    for count in (2, 3):
        found = PotentialMap(np.array([0.1, 0.1])).fit(three[:, :count], places)
        error.append(np.linalg.norm(found.predict(three[:, :count]) - places, axis=1).mean())
    assert error[1] < 0.9 * error[0]
