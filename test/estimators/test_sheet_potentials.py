"""Potentials of a sheet by what its border holds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from tactile_ros.estimators.potential_map import (
    ENDS,
    SINES,
    HarmonicMap,
    SheetPotentials,
)
from tactile_ros.estimators.smooth_fields import shift_row
from tactile_ros.physics.resistive_sheet import sheet_potential

SIZE, NOISE = np.array([0.25, 0.2]), 2.5e-4
CORNERS = np.array([[1.0, 0.4, 0.0, 0.55], [0.6, 1.0, 0.45, 0.0]])


def stepped(seed: int) -> tuple[RectBivariateSpline, ...]:
    """Potentials of a panel whose silver has steps, by finite differences."""
    rng, shape = np.random.default_rng(seed), (101, 81)
    border = np.repeat(96 * np.exp(0.5 * rng.normal(size=(4, 4))), 25, axis=1)
    lines = [np.linspace(0, edge, n) for edge, n in zip(SIZE, shape, strict=True)]
    corners = np.full((2, 4), np.nan)
    corners[0, [0, 2]] = corners[1, [1, 3]] = 1.0, 0.0
    return tuple(
        RectBivariateSpline(*lines, sheet_potential(SIZE, shape, border, held)) for held in corners
    )


def grid(count: int) -> np.ndarray:
    """Places of a grid, 12.5 mm inside the border."""
    lines = [np.linspace(0.0125, edge - 0.0125, count) for edge in SIZE]
    return np.stack(np.meshgrid(*lines), -1).reshape(-1, 2)


@pytest.mark.parametrize('kind', ['polynomials', 'sides', 'border'])
def test_terms_of_a_homogeneous_sheet_are_harmonic(kind: str) -> None:
    basis, step = SheetPotentials(SIZE, kind, CORNERS), 1e-3
    places = np.random.default_rng(0).uniform(0.06, 0.14, (5, 2))
    bent = sum(
        basis.terms(places + off) + basis.terms(places - off) - 2 * basis.terms(places)
        for off in step * np.eye(2)
    )
    uneven = basis.spreads()[1] != basis.spreads()[0]  # they alone follow the last choice
    flat = np.abs(bent[:, :, ~uneven]).max()
    assert flat < 1e-3 * np.abs(bent[:, :, uneven]).max()


def test_a_side_holds_its_sine_times_what_it_falls_and_the_others_nothing() -> None:
    basis = SheetPotentials(SIZE, 'border', CORNERS)
    along = np.array([0.03, 0.11])
    on_bc = np.column_stack([np.full(2, SIZE[0]), along])
    sines = basis.terms(on_bc)[:, :, -4 * SINES - 2 : -2].reshape(2, 2, 4, SINES)
    start, end = ENDS[1]
    wave = np.sin(np.pi * np.outer(along / SIZE[1], np.arange(1, SINES + 1)))
    for output in range(2):
        fall = CORNERS[output, end] - CORNERS[output, start]
        np.testing.assert_allclose(sines[output, :, 1], fall * wave, atol=1e-12)
    np.testing.assert_allclose(sines[:, :, [0, 2, 3]], 0.0, atol=1e-12)


@pytest.mark.parametrize(('count', 'most'), [(5, 1.8), (7, 1.5)])
def test_places_on_a_large_panel_with_steps_of_silver_come_near_the_noise(
    count: int, most: float
) -> None:
    known = stepped(6)
    rng, where = np.random.default_rng(5), np.repeat(grid(count), 8, axis=0)

    def read(places: np.ndarray) -> np.ndarray:
        clean = np.column_stack([one.ev(*places.T) for one in known])
        return clean + NOISE * rng.normal(size=clean.shape)

    found = HarmonicMap(SIZE).fit(read(where), where)
    assert found.basis_.kind == 'border'
    fresh = rng.uniform(0.0125, SIZE - 0.0125, (1000, 2))
    place, covariance = found.place(read(fresh))
    slopes = [[one.ev(*fresh.T, dx=1), one.ev(*fresh.T, dy=1)] for one in known]
    inverse = np.linalg.inv(np.moveaxis(np.array(slopes), 2, 0))
    least = np.linalg.norm(inverse @ (NOISE * rng.normal(size=(1000, 2, 1))), axis=1).mean()
    assert np.linalg.norm(place - fresh, axis=1).mean() < most * least
    inside = np.abs(place - fresh) < np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert 0.58 < inside.mean() < 0.82


def test_what_is_held_out_errs_as_fits_without_it_do() -> None:
    known, rng = stepped(6), np.random.default_rng(7)
    where, group = np.repeat(grid(5), 4, axis=0), np.repeat(np.arange(25), 4)
    x = np.column_stack([one.ev(*where.T) for one in known])
    x += NOISE * rng.normal(size=x.shape)
    said, spread = HarmonicMap(SIZE).fit(x, where, group).held_out(x, where, group)
    some = [6, 7, 8, 11, 12, 13]  # not on the edge of what was touched
    for place in some:
        rows = group == place
        other = HarmonicMap(SIZE).fit(x[~rows], where[~rows]).predict(x[rows])
        off = np.linalg.norm((other - said[rows]).mean(axis=0))
        assert off < 2 * np.linalg.norm(spread[rows].mean(axis=0))


def test_a_shift_between_its_nodes_is_cubic() -> None:
    line = np.arange(-1, 12) / 10
    x, y = np.meshgrid(line, line, indexing='ij')
    table = np.stack([x * x - y, 2 * x * y + y * y], axis=-1)
    places = np.random.default_rng(1).uniform(size=(50, 2))
    x, y = places.T
    told = np.column_stack([x * x - y, 2 * x * y + y * y])
    shift, size = np.empty((50, 2)), np.ones(2)
    for place, own in zip(places, shift, strict=True):
        shift_row(place, size, table, own)
    np.testing.assert_allclose(shift, told, atol=1e-12)
