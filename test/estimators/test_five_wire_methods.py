"""Maps and curves of the five-wire skin, each on what it must be right about."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.harmonic_map import HarmonicMap
from tactile_ros.estimators.mean_curve import MeanCurve
from tactile_ros.estimators.power_force import PowerForce
from tactile_ros.estimators.rbf_force import RbfForce, k_means
from tactile_ros.estimators.stated_spread import StatedSpread
from tactile_ros.estimators.thin_plate import ThinPlate
from tactile_ros.types import Estimator

SIZE = np.array([0.1, 0.1])


def bent(places: np.ndarray) -> np.ndarray:
    """Two harmonic functions that differ from the linear ones."""
    z = (places[:, 0] + 1j * places[:, 1] - 0.05 - 0.05j) / 0.05
    return np.column_stack(
        [
            0.5 - (z.real + z.imag) / 4 + 0.05 * (z**2).real + 0.02 * (z**3).imag,
            0.5 + (z.real - z.imag) / 4 - 0.04 * (z**2).imag,
        ]
    )


def test_harmonic_map_finds_harmonic_functions_from_16_points() -> None:
    line = np.linspace(0.0125, 0.0875, 4)
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    found = HarmonicMap(SIZE).fit(bent(places), places)
    fresh = np.random.default_rng(0).uniform(0.0125, 0.0875, (200, 2))
    assert np.abs(found.predict(bent(fresh)) - fresh).max() < 2e-5
    plate = ThinPlate().fit(bent(places), places)
    assert np.abs(plate.predict(bent(fresh)) - fresh).max() > 1e-4


def test_garbage_potentials_stay_on_the_sheet() -> None:
    places = np.random.default_rng(1).uniform(0.01, 0.09, (40, 2))
    found = HarmonicMap(SIZE).fit(bent(places), places)
    wild = found.predict(np.array([[1e6, -1e6], [0.0, 1.0]]))
    assert np.isfinite(wild).all()
    assert (wild >= 0).all()
    assert (wild <= 0.1).all()


def test_power_force_finds_a_power_law_that_varies() -> None:
    rng = np.random.default_rng(2)
    place, force = rng.uniform(0.1, 0.9, (500, 2)), rng.uniform(1, 15, 500)
    film = 2 * np.exp(0.3 * np.sin(3 * place[:, 0])) * force ** -(0.7 + 0.1 * place[:, 1])
    x = np.column_stack([place, film + 0.03, np.full(500, 0.03)])
    found = PowerForce().fit(x[:400], force[:400, None])
    error = found.predict(x[400:])[:, 0] - force[400:]
    assert np.sqrt((error**2).mean()) < 0.05


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


def test_stated_spreads_hold_what_they_say() -> None:
    rng = np.random.default_rng(4)
    spread = rng.uniform(0.5, 2.0, (4000, 1))
    error = 3 * spread * rng.normal(size=(4000, 1))
    fair = StatedSpread().fit(spread[:2000], error[:2000])(spread[2000:])
    assert 0.65 < (np.abs(error[2000:]) < fair).mean() < 0.72


@pytest.mark.parametrize(
    'estimator', [HarmonicMap(SIZE), PowerForce(), RbfForce(), MeanCurve(0), ThinPlate()]
)
def test_nothing_is_predicted_before_a_fit(estimator: Estimator) -> None:
    with pytest.raises(NotCalibratedError, match='must be fitted'):
        estimator.predict(np.zeros((1, 4)))
