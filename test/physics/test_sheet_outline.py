"""Sheets of any outline against the solve of a rectangle and what is known without solving."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.resistive_sheet import (
    OutlineMesh,
    rolled,
    sheet_potential,
    unrolled,
    within,
)

SQUARE = 0.1 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
KITE = np.array([[0.0, 0.0], [0.11, 0.01], [0.09, 0.1], [-0.01, 0.08]])


def test_a_square_is_as_the_grid_says() -> None:
    mesh = OutlineMesh.of(SQUARE, 0.1 / 24)
    border = np.full(mesh.border, 24_000 * 1e-3)
    held = mesh.nearest(SQUARE)
    found = mesh.potential(border, held[[0, 2]], np.array([1.0, 0.0]))
    other = sheet_potential(
        np.array([0.1, 0.1]), (25, 25), np.full((4, 8), 24.0), np.array([1, np.nan, 0, np.nan])
    )
    x, y = (mesh.points / 0.1 * 24).T
    on_grid = (np.abs(x - np.round(x)) < 1e-6) & (np.abs(y - np.round(y)) < 1e-6)
    told = other[np.round(x[on_grid]).astype(int), np.round(y[on_grid]).astype(int)]
    np.testing.assert_allclose(found[on_grid], told, atol=2e-3)
    np.testing.assert_allclose(found, 1 - mesh.points.sum(axis=1) / 0.2, atol=5e-3)


def test_linear_potentials_are_exact_on_any_mesh() -> None:
    mesh = OutlineMesh.of(KITE, 0.008)
    plane = 0.2 + 3.0 * mesh.points[:, 0] - 2.0 * mesh.points[:, 1]
    on_border = np.arange(mesh.border)
    found = mesh.potential(np.zeros(mesh.border), on_border, plane[: mesh.border])
    np.testing.assert_allclose(found, plane, atol=1e-12)


def test_three_phases_superpose_and_stay_between_what_is_held() -> None:
    mesh = OutlineMesh.of(KITE, 0.008)
    rng = np.random.default_rng(0)
    border, held = 24.0 * rng.uniform(0.5, 1.5, mesh.border), mesh.nearest(KITE[:3])
    phases = np.cos(2 * np.pi * np.arange(3) / 3)
    one = mesh.potential(border, held, phases)
    np.testing.assert_allclose(
        mesh.potential(border, held, 2 * phases + 1), 2 * one + 1, atol=1e-9
    )
    assert one.min() >= phases.min() - 1e-9
    assert one.max() <= phases.max() + 1e-9


def test_three_phases_tell_a_place_by_more_than_two_readings() -> None:
    mesh = OutlineMesh.of(SQUARE, 0.1 / 20)
    border, corners = np.full(mesh.border, 24.0), mesh.nearest(SQUARE)
    readings = [
        mesh.potential(border, corners[:3], np.roll([1.0, 0.0, 0.5], turn)) for turn in range(3)
    ]
    # cyclic phases sum to a constant: two of them are free, the third checks them
    np.testing.assert_allclose(np.sum(readings, axis=0), 1.5, atol=1e-9)


@pytest.mark.parametrize('ratio', [1e3, 1e8, 1e14])
def test_huge_border_ratios_make_linear_edges(ratio: float) -> None:
    mesh = OutlineMesh.of(SQUARE, 0.1 / 16)
    held = mesh.nearest(SQUARE)[[0, 2]]
    found = mesh.potential(np.full(mesh.border, ratio * 1e-3), held, np.array([1.0, 0.0]))
    np.testing.assert_allclose(found, 1 - mesh.points.sum(axis=1) / 0.2, atol=0.06)
    if ratio > 1e6:
        np.testing.assert_allclose(found, 1 - mesh.points.sum(axis=1) / 0.2, atol=1e-5)


def test_a_panel_is_unrolled_and_rolled_without_stretching() -> None:
    flat = np.random.default_rng(1).uniform(-0.05, 0.05, (50, 2))
    panel = rolled(flat, 0.2)
    np.testing.assert_allclose(unrolled(panel, 0.2), flat, atol=1e-12)
    np.testing.assert_allclose(np.hypot(panel[:, 0], panel[:, 2] + 0.2), 0.2, atol=1e-12)


def test_what_lies_inside_and_that_something_must_be_held() -> None:
    assert within(np.array([[0.05, 0.05], [0.2, 0.0]]), KITE).tolist() == [True, False]
    mesh = OutlineMesh.of(SQUARE, 0.02)
    with pytest.raises(ValueError, match='at least one'):
        mesh.potential(np.ones(mesh.border), np.zeros(0, int), np.zeros(0))
