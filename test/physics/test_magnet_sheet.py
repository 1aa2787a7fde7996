# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Magnetised sheets against magpylib and one another."""

from dataclasses import replace
from itertools import pairwise

import magpylib
import numpy as np
import pytest

from reference import multipole_world as world
from tactile_ros.physics import magnet_sheet
from tactile_ros.physics.magnet_sheet import Sheet, carpet, moved_dipole_series, powers
from tactile_ros.physics.magnetics import dipole_field

SIZE = np.array([60e-3, 75e-3, 2e-3])
PITCH = 75e-3 / 8
KINDS = ('M1', 'M2', 'M3', 'M4')
UNDER = np.random.default_rng(0).uniform([-0.03, -0.03, -8e-3], [0.03, 0.03, -3.5e-3], (60, 3))


def sheet_of(kind: str, size: np.ndarray = SIZE, pitch: float = PITCH) -> Sheet:
    """A sheet whose middle is the origin."""
    return Sheet(size[:2], -size[2] / 2, size[2], pitch, kind, np.full(2, 0.1))


def truth(sheet: Sheet, points: np.ndarray) -> np.ndarray:
    """The same sheet of magpylib's blocks."""
    count = {'M1': 1, 'M2': 1, 'M3': 2, 'M4': 8}[sheet.magnetisation]
    width = SIZE[1] / count
    field = np.zeros((len(points), 3))
    for i in range(count):
        sign = {'M3': (-1, 1), 'M4': (1, -1) * 4}.get(sheet.magnetisation, (1,))[i]
        axis = (0, 0, 1) if sheet.magnetisation == 'M1' else (0, 1, 0)
        field += magpylib.magnet.Cuboid(
            dimension=(SIZE[0], width, SIZE[2]),
            polarization=0.1 * sign * np.array(axis),
            position=(0, -SIZE[1] / 2 + (i + 0.5) * width, 0),
        ).getB(points)
    return field


@pytest.mark.parametrize('kind', KINDS)
def test_a_sheet_is_its_blocks(kind: str) -> None:
    sheet = sheet_of(kind)
    np.testing.assert_allclose(sheet.field(UNDER), truth(sheet, UNDER), atol=1e-12)


@pytest.mark.parametrize('kind', KINDS)
def test_a_finer_carpet_of_dipoles_is_nearer(kind: str) -> None:
    sheet = sheet_of(kind)
    exact = sheet.field(UNDER)
    error = []
    for pitch, levels in ((4e-3, 1), (2e-3, 2), (1e-3, 2)):
        places, moments = carpet(sheet, pitch, levels)
        error.append(np.abs(dipole_field(UNDER, places, moments) - exact).max())
    # middles of cells: the square of the pitch
    assert error[2] < 0.06 * error[0]
    assert error[2] < 0.01 * np.abs(exact).max()


def test_bands_that_do_not_fill_the_sheet_end_with_it() -> None:
    _, low, high, signs = zip(*sheet_of('M4', pitch=20e-3).bands, strict=True)
    np.testing.assert_allclose(1e3 * np.array(low), [-37.5, -17.5, 2.5, 22.5])
    np.testing.assert_allclose(1e3 * np.array(high), [-17.5, 2.5, 22.5, 37.5])
    assert signs == (1, -1, 1, -1)


def test_series_of_a_moved_dipole_converge() -> None:
    r, moment = np.array([1e-3, 2e-3, -5e-3]), 1e-3
    moved = np.array([1e-4, -2e-4, 3e-4])
    exact = dipole_field(r[None], moved[None], np.array([[0, moment, 0.0]]))[0]
    total, misses = np.zeros(3), []
    for order in range(5):
        terms = moved_dipole_series(r, np.array(moment), 1, order)
        total = total + np.array([np.prod(moved ** np.array(k)) for k in powers(order)]) @ terms
        misses.append(np.abs(total - exact).max() / np.abs(exact).max())
    assert all(later < 0.2 * sooner for sooner, later in pairwise(misses))


def test_an_uneven_sheet_has_the_field_of_its_dipoles() -> None:
    plain = Sheet(np.array([75e-3, 75e-3]), 2e-3, 2e-3, 75e-3 / 8, 'M4', np.full(9, 0.1))
    chips = world.SENSOR.config().positions
    x, y = plain.lines
    uneven = 0.2 * np.sin(x / 9e-3)[:, None] * np.cos(y / 7e-3)
    whole = replace(plain, uneven=uneven)
    change = dipole_field(chips, *whole.dipoles) - dipole_field(chips, *plain.dipoles)
    found = whole.field(chips) - plain.field(chips)
    np.testing.assert_allclose(found, change, atol=1e-12)
    even = plain.each_moment.reshape(len(x), len(y), -1)
    np.testing.assert_allclose(
        whole.each_moment.reshape(even.shape), even * (1 + uneven[..., None]), rtol=1e-12
    )


@pytest.mark.parametrize(('pole_pitch', 'most'), [(75e-3 / 8, 0.016), (7.5e-3, 0.022)])
def test_bands_are_integrated_to_their_edges(
    pole_pitch: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # midpoints alone miss 2 to 4 % of a dent's field, wherever edges of bands lie
    rng = np.random.default_rng(4)
    chips = np.column_stack([rng.uniform(-2e-2, 2e-2, (9, 2)), np.full(9, -1.5e-3)])

    def change(cells: int) -> np.ndarray:
        monkeypatch.setattr(magnet_sheet, 'CELLS', cells)
        kinds = np.full(12, 0.1)
        skin = Sheet(np.array([75e-3, 75e-3]), 2e-3, 2e-3, pole_pitch, 'M4', kinds, 3e-4)
        away = skin.dipoles[0][:, :2] - [3e-3, -5e-3]
        dent = 5e-4 * np.exp(-0.5 * np.square(away / 2e-3).sum(axis=1))[:, None]
        moved = dent * np.column_stack([away / 4e-3, -np.ones(len(away))])
        every = np.arange(len(moved))
        return skin.cell_changes(chips, every, moved, 0 * moved) @ skin.each_moment

    fine = change(180)
    assert np.linalg.norm(change(60) - fine) < most * np.linalg.norm(fine)
