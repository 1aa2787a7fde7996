# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The power law over a film, on what it must be right about."""

import numpy as np
import pytest

from tactile_ros.estimators.power_law_force import PowerLawForce
from tactile_ros.physics.resistive_sheet import SeriesResistance


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
    said, variance = found.force(features(places, true))
    sigma = np.sqrt(variance) * said
    assert np.sqrt(((said - true) ** 2).mean()) < 0.035
    assert 0.5 < (np.abs(said - true) < sigma).mean() < 0.85


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


def test_held_out_errors_are_those_of_fits_without_the_group() -> None:
    rng = np.random.default_rng(12)
    line = np.linspace(0.15, 0.85, 6)
    place = np.repeat(np.stack(np.meshgrid(line, line), -1).reshape(-1, 2), 6, axis=0)
    force, groups = np.tile(np.linspace(2, 12, 6), 36), np.repeat(np.arange(36), 6)
    kink = 2.0 * np.maximum(0.3 - place[:, 0], 0.0) * np.sin(9 * place[:, 1])  # along one edge
    film = 2 * np.exp(0.2 * np.sin(5 * place[:, 0]) + kink) * force**-0.7
    x = np.column_stack([place, film * np.exp(3e-3 * rng.normal(size=216))])
    found = PowerLawForce(2.5e-4)
    errors, variance = found.fit_held_out(x, force[:, None], groups)
    assert 0.4 < (errors**2 < variance).mean() < 0.95
    each, stated = (np.bincount(groups, v) for v in (errors / force, variance / force**2))
    size = np.abs(each) / np.sqrt(6 * stated)
    assert size.mean() == pytest.approx((2 / np.pi) ** 0.5, rel=0.1)
    for group in (8, 21):
        rows = groups == group
        other = PowerLawForce(2.5e-4)
        other.fit_held_out(x[~rows], force[~rows, None], groups[~rows], found)
        np.testing.assert_allclose(errors[rows], other.force(x[rows])[0] - force[rows], atol=0.03)


def test_further_features_are_linear_in_the_logarithm() -> None:
    rng = np.random.default_rng(13)
    place, force = rng.uniform(0.1, 0.9, (400, 2)), rng.uniform(1, 15, 400)
    past = rng.uniform(0, 1, 400)
    film = 2 * (force * np.exp(0.05 * past)) ** -0.7
    found = PowerLawForce(1e-5).fit(np.column_stack([place, film, past]), force[:, None])
    assert found.linear_[0] == pytest.approx(-0.05, abs=0.003)
