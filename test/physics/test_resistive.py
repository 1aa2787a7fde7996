"""Potentials of the sheet against what is known of them without solving."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.resistive import (
    linear_place,
    linear_potentials,
    sheet_potential,
    spreading_resistance,
)

SIZE = np.array([0.1, 0.08])
EVEN = np.full((4, 8), 24_000 * 1e-3)
FIRST = np.array([1.0, np.nan, 0.0, np.nan])


def test_the_formula_turns_round() -> None:
    places = np.random.default_rng(0).uniform(0, 0.08, (20, 2))
    np.testing.assert_allclose(linear_place(linear_potentials(places, SIZE), SIZE), places)


def test_an_even_border_makes_linear_potentials_even_at_huge_ratios() -> None:
    square = np.array([0.1, 0.1])
    for border in (EVEN, 1e8 * EVEN):
        found = sheet_potential(square, (21, 21), border, FIRST)
        line = np.linspace(0, 0.1, 21)
        places = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1)
        np.testing.assert_allclose(found, linear_potentials(places, square)[..., 0], atol=1e-3)


def test_superposition_and_three_phases() -> None:
    border = EVEN * np.random.default_rng(1).uniform(0.5, 1.5, EVEN.shape)
    held = np.array([1.0, 0.5, 0.0, np.nan])
    one = sheet_potential(SIZE, (15, 13), border, held)
    np.testing.assert_allclose(
        sheet_potential(SIZE, (15, 13), border, 2 * held + 1), 2 * one + 1, atol=1e-9
    )
    assert one.min() >= 0
    assert one.max() <= 1


def test_no_corner_held_is_refused() -> None:
    with pytest.raises(ValueError, match='at least one'):
        sheet_potential(SIZE, (5, 5), EVEN, np.full(4, np.nan))


def test_resistance_is_largest_in_the_middle() -> None:
    places = np.array([[0.05, 0.05], [0.02, 0.05], [0.02, 0.02]])
    found = spreading_resistance(places, np.array([0.1, 0.1]), 0.015, 100.0)
    assert (np.diff(found) < 0).all()
    assert found[0] == pytest.approx(28.8, rel=0.02)
