"""Rx of a sheet, mended by what a recording says of it where it has another shape."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.estimators import power_law_force
from tactile_ros.estimators.power_law_force import FilmResistance, PowerLawForce
from tactile_ros.physics.resistive_sheet import SeriesResistance


def readings(places: np.ndarray, force: np.ndarray, seed: int) -> np.ndarray:
    """Features on a film beside which Rx is a bump of its own, as large as the film at 15 N."""
    x, y = places.T
    series = 0.2 * np.exp(-((x - 0.3) ** 2 + (y - 0.6) ** 2) / 0.05)
    whole = series + 0.6 * np.exp(0.2 * np.sin(3 * y)) * force**-0.7
    noise = 2.5e-4 * np.random.default_rng(seed).normal(size=len(force))
    return np.column_stack([places, 1 / (1 / (1 + whole) + noise) - 1])


def test_an_rx_of_another_shape_is_found_and_the_sigma_is_wide_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line, rng = np.linspace(0.125, 0.875, 7), np.random.default_rng(5)
    places = np.repeat(np.stack(np.meshgrid(line, line), -1).reshape(-1, 2), 8, axis=0)
    force, group = np.tile(np.linspace(1, 15, 8), 49), np.repeat(np.arange(49), 8)
    x, fresh, true = (
        readings(places, force, 0),
        rng.uniform(0.1, 0.9, (1500, 2)),
        rng.uniform(1, 15, 1500),
    )

    def errors() -> tuple[np.ndarray, np.ndarray]:
        found = PowerLawForce(2.5e-4).fit(x, force[:, None], group)
        said, sigma = found.force(readings(fresh, true, 1))
        return said - true, sigma

    error, sigma = errors()
    assert 0.55 < (np.abs(error) < sigma).mean() < 0.8
    monkeypatch.setattr(power_law_force, 'STEPS', 0)
    linear, _ = errors()
    assert (error**2).mean() < 0.6 * (linear**2).mean()


def test_mending_puts_into_rx_what_it_takes_out_of_the_logarithm() -> None:
    rng = np.random.default_rng(2)
    x = readings(rng.uniform(0.1, 0.9, (50, 2)), rng.uniform(1, 15, 50), 3)
    nominal = FilmResistance.seen(SeriesResistance(np.ones(2), 0.15, 0.2), x)
    wrong = np.zeros_like(nominal.series)
    wrong[0, 0] = 0.03
    mended = nominal.mend(x, wrong, -1.5)
    np.testing.assert_allclose(mended.series_at(x[:, :2]) - nominal.series_at(x[:, :2]), 0.02)
    np.testing.assert_allclose(mended.told(x), 0.03 / mended.at(x))
    assert not nominal.told(x).any()
