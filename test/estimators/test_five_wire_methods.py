"""Maps and curves of the five-wire skin, each on what it must be right about."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.covariance import SigmaCalibration
from tactile_ros.estimators.potential_map import HarmonicMap
from tactile_ros.estimators.power_law_force import MeanCurve, PowerLawForce
from tactile_ros.estimators.rbf_force import RbfForce, ThinPlate, k_means
from tactile_ros.physics.resistive_sheet import SeriesResistance
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
    found = PowerLawForce().fit(x[:400], force[:400, None])
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
    fair = SigmaCalibration().fit(spread[:2000], error[:2000])(spread[2000:])
    assert 0.65 < (np.abs(error[2000:]) < fair).mean() < 0.72


@pytest.mark.parametrize(
    'estimator', [HarmonicMap(SIZE), PowerLawForce(), RbfForce(), MeanCurve(0), ThinPlate()]
)
def test_nothing_is_predicted_before_a_fit(estimator: Estimator) -> None:
    with pytest.raises(NotCalibratedError, match='must be fitted'):
        estimator.predict(np.zeros((1, 4)))


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


def test_a_wrong_series_resistance_and_an_air_gap_are_learned() -> None:
    rng = np.random.default_rng(7)
    place, force = rng.uniform(0.1, 0.9, (600, 2)), rng.uniform(0.8, 15, 600)
    film = 2 * (force - 0.3 * (1 + 0.2 * place[:, 0])) ** -0.7
    x = np.column_stack([place, film + 0.03 * (1 + place[:, 1])])
    found = PowerLawForce(1e-5, series=SeriesResistance(np.ones(2), 0.15, 0.1))
    found.fit(x[:400], force[:400, None])
    error = found.predict(x[400:])[:, 0] - force[400:]
    assert np.sqrt((error**2).mean()) < 0.05
    assert found.gap_ > 0


def test_forces_near_the_border_of_a_large_panel_know_its_steep_rx() -> None:
    size, rng = np.array([0.25, 0.2]), np.random.default_rng(11)
    lines = [np.linspace(0.0125 / edge, 1 - 0.0125 / edge, 7) for edge in size]
    known = np.repeat(np.stack(np.meshgrid(*lines), -1).reshape(-1, 2), 8, axis=0)
    series = SeriesResistance(size, 0.015, 0.4)

    def features(places: np.ndarray, force: np.ndarray) -> np.ndarray:
        whole = 2 * np.exp(0.1 * np.sin(4 * places[:, 0])) * force**-0.75
        whole += 1.05 * series.at(places) - 0.02  # neither is the sheet's, nor is the touch's
        divider = 1 / (1 + whole) + 2.5e-4 * rng.normal(size=len(force))
        return np.column_stack([places, 1 / divider - 1])

    load = np.tile(np.linspace(1, 15, 8), 49)
    found = PowerLawForce(2.5e-4, size, series)
    found.fit(features(known, load), load[:, None], np.repeat(np.arange(49), 8))
    places = rng.uniform(0.0125 / size, 1 - 0.0125 / size, (1500, 2))
    true = rng.uniform(1, 15, 1500)
    said, sigma = found.force(features(places, true))
    assert np.sqrt(((said - true) ** 2).mean()) < 0.035
    assert 0.5 < (np.abs(said - true) < sigma).mean() < 0.85
    assert found.film_.nominal.sheet == pytest.approx(1.05 * series.sheet, rel=0.03)


def test_spreads_of_calibration_grow_away_from_what_was_touched() -> None:
    rng = np.random.default_rng(8)
    line = np.linspace(0.3, 0.7, 4)
    place = np.repeat(np.stack(np.meshgrid(line, line), -1).reshape(-1, 2), 8, axis=0)
    force = np.tile(np.linspace(1, 15, 8), 16)
    film = 2 * np.exp(0.3 * np.sin(6 * place[:, 0])) * force**-0.7
    x = np.column_stack([place, film * np.exp(1e-3 * rng.normal(size=128))])
    found = PowerLawForce(2.5e-4).fit(x, force[:, None], np.repeat(np.arange(16), 8))
    near, far = found.force(np.array([[0.3, 0.3, 0.5], [0.05, 0.05, 0.5]]))[1]
    assert far > 3 * near


def test_touches_of_one_force_or_at_one_place_are_learned_without_a_warning() -> None:
    rng = np.random.default_rng(9)
    place = rng.uniform(0.1, 0.9, (60, 2))
    equal = PowerLawForce(2.5e-4).fit(
        np.column_stack([place, 0.6 + 1e-3 * rng.normal(size=60)]), np.full((60, 1), 5.0)
    )
    force, spread = equal.force(np.array([[0.5, 0.5, 0.6]]))
    assert force[0] == pytest.approx(5.0, rel=0.05)
    assert np.isfinite(spread).all()
    load = np.linspace(1, 15, 20)
    x = np.column_stack([np.full((20, 2), 0.5), 2 * load**-0.7])
    alone = PowerLawForce(2.5e-4).fit(x, load[:, None], np.zeros(20, np.int64))
    np.testing.assert_allclose(alone.predict(x)[:, 0], load, rtol=0.02)
