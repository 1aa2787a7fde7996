"""Rows of a sheet for a compiler: the numbers of the arrays, and the same bits alone."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.potential_map import HarmonicMap
from tactile_ros.estimators.power_law_force import PowerLawForce
from tactile_ros.estimators.smooth_fields import by_places, steady_places

SIZE = np.array([0.1, 0.08])
RNG = np.random.default_rng(11)


def map_and_potentials() -> tuple[HarmonicMap, np.ndarray]:
    """A map fitted on bent potentials, and potentials on and beyond the sheet."""
    places = RNG.uniform(0.1, 0.9, (40, 2)) * SIZE
    x, y = (places / SIZE).T
    told = np.column_stack([1 - (x + y) / 2 + 0.05 * (x - 0.5) * (y - 0.5), 0.5 + (x - y) / 2])
    return HarmonicMap(SIZE).fit(told, places), RNG.uniform(-0.2, 1.2, (300, 3))


def test_a_place_has_the_same_bits_alone() -> None:
    found, x = map_and_potentials()
    x[5, 1] = np.nan
    place, cov = found.place(x)
    assert np.isnan(place[5]).all()
    assert np.isnan(cov[5]).all()
    alone = [found.place(x[i : i + 1]) for i in range(len(x))]
    np.testing.assert_array_equal(np.concatenate([one[0] for one in alone]), place)
    np.testing.assert_array_equal(np.concatenate([one[1] for one in alone]), cov)


def test_a_force_has_the_same_bits_alone() -> None:
    place, force = RNG.uniform(0.1, 0.9, (300, 2)), RNG.uniform(1, 15, 300)
    film = 2 * np.exp(0.3 * np.sin(3 * place[:, 0])) * force**-0.7
    found = PowerLawForce(2.5e-4).fit(np.column_stack([place, film]), force[:, None])
    places, resistance = RNG.uniform(-0.1, 1.1, (400, 2)), RNG.uniform(0.01, 9.0, 400)
    said, spread = found.at(places, resistance)
    one = found.at(places[7:8].copy(), resistance[7:8].copy())
    assert (one[0][0], one[1][0]) == (said[7], spread[7])


def test_places_are_steadied_where_groups_are_of_one_place() -> None:
    true = np.repeat(RNG.uniform(0.2, 0.8, (30, 2)), 40, axis=0)
    group = np.repeat(np.arange(30), 40)
    noisy = true + [4e-4, 8e-4] * RNG.normal(size=true.shape)
    noisy[group == 3] += np.linspace(0, 0.3, 40)[:, None]  # drawn over the sheet
    steady, spread = steady_places(noisy, group)
    np.testing.assert_array_equal(steady[group == 3], noisy[group == 3])
    assert np.abs(steady - true)[group != 3].max() < 5e-4
    np.testing.assert_allclose(spread, [4e-4, 8e-4], rtol=0.1)


def test_noise_of_places_makes_what_the_slope_makes_of_it() -> None:
    x = RNG.uniform(size=(20, 3))
    variance = by_places(lambda u: 3 * u[:, 0] - 2 * u[:, 1], x, np.array([0.1, 0.2]))
    np.testing.assert_allclose(variance, 0.09 + 0.16, rtol=1e-9)
