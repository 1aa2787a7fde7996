# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Magnetised sheets against magpylib and one another."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import magpylib
import numpy as np
import pytest

from benchmarks.worlds.multipole_fidelity import harmonics
from reference import multipole_world as world
from tactile_ros.physics import magnet_sheet
from tactile_ros.physics.elastomer import Layer, PunchDents
from tactile_ros.physics.magnet_sheet import (
    Sheet,
    carpet,
    inverse_distance_series,
    moved_dipole_series,
    powers,
)
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


def test_a_carpet_has_the_moment_of_the_sheet() -> None:
    for kind, whole in (('M1', 1.0), ('M2', 1.0), ('M3', 0.0), ('M4', 0.0)):
        _, moments = carpet(sheet_of(kind), 3e-3, 2)
        wanted = 0.1 / (4e-7 * np.pi) * SIZE.prod() * whole
        assert np.abs(moments.sum(axis=0)).max() == pytest.approx(wanted, abs=1e-12)


def test_bands_that_do_not_fill_the_sheet_end_with_it() -> None:
    _, low, high, signs = zip(*sheet_of('M4', pitch=20e-3).bands, strict=True)
    np.testing.assert_allclose(1e3 * np.array(low), [-37.5, -17.5, 2.5, 22.5])
    np.testing.assert_allclose(1e3 * np.array(high), [-17.5, 2.5, 22.5, 37.5])
    assert signs == (1, -1, 1, -1)


def test_without_edges_a_few_harmonics_are_enough() -> None:
    # 400 bands wide and long: the middle does not know of edges
    sheet = sheet_of('M4', np.array([4.0, 400 * PITCH, 2e-3]))
    points = np.concatenate([UNDER, UNDER * [1, 1, -1]])
    exact = sheet.field(points)
    error = [np.abs(harmonics(sheet, points, n) - exact).max() for n in (1, 2, 4, 8)]
    assert error[0] > error[1] > error[2] > 0.99 * error[3]
    assert error[3] < 1e-3 * np.abs(exact).max()


def test_a_body_that_carries_the_whole_sheet_moves_its_field() -> None:
    sheet = sheet_of('M4')
    places, moments = carpet(sheet, 1e-3, 2)
    shift = np.array([3e-4, -5e-4, -6e-4])
    moved = dipole_field(UNDER, places + shift, moments)
    exact = sheet.field(UNDER - shift)
    assert np.abs(moved - exact).max() < 0.015 * np.abs(exact).max()


def square_sheet(kind: str = 'M4') -> Sheet:
    return Sheet(np.array([75e-3, 75e-3]), 2e-3, 2e-3, 75e-3 / 8, kind, np.full(9, 0.1))


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


def test_series_of_the_inverse_distance_obey_laplace() -> None:
    found = inverse_distance_series(np.random.default_rng(0).normal(size=(20, 3)), 4)
    laplacian = 2 * (found[2, 0, 0] + found[0, 2, 0] + found[0, 0, 2])
    np.testing.assert_allclose(laplacian, 0, atol=1e-9)


@pytest.mark.parametrize('kind', ['M1', 'M2', 'M3', 'M4'])
def test_resting_fields_are_those_of_a_sum_of_dipoles(kind: str) -> None:
    skin = world.World(0, world.IDEAL, kind)
    own = square_sheet(kind).field(skin.config.positions)
    assert np.abs(own - skin.rest()).max() < 0.01 * np.abs(own).max()


def test_an_uneven_sheet_has_the_field_of_its_dipoles() -> None:
    plain, chips = square_sheet(), world.SENSOR.config().positions
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


def test_a_dented_sheet_changes_as_its_dipoles_say() -> None:
    one, chips = square_sheet(), world.SENSOR.config().positions
    dents = PunchDents(one, 0.0, Layer(4e-3, 69e3 / 2.98, 0.49))
    images = dents.images(*dents.loads(world.box('', 10e-3, 8e-3)), np.array([3e-3, 1e-3, 0.4]))
    flat = dents.on_sheet(one, images)
    moved = 0.5e-3 * flat[:3].T
    places, moments = one.dipoles
    rest, dented = (dipole_field(chips, at, moments) for at in (places, places + moved))
    exact = dented - rest
    every = np.arange(len(moved))
    found = one.cell_changes(chips, every, moved, 0 * moved) @ one.each_moment
    assert np.abs(found - exact).max() < 0.02 * np.abs(exact).max()


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


def test_weights_around_an_edge_integrate_cubics() -> None:
    skin = square_sheet()
    line, pitch = skin.lines[1], skin.pitch
    for edge in (-20e-3, 0.3e-3, 11.9e-3, 37.5e-3):
        weight = skin._up_to(edge)
        for power in range(4):
            t = (line - line[30]) / 1e-2
            found = pitch * weight @ t**power
            ends = (np.array([edge, line[0] - pitch / 2]) - line[30]) / 1e-2
            # at the sheet's end, midpoints are kept
            wanted = 1e-2 * (ends[0] ** (power + 1) - ends[1] ** (power + 1)) / (power + 1)
            slope = 0.0 if power == 0 else power * ends[1] ** (power - 1)
            third = 6.0 if power == 3 else 0.0
            left = pitch**2 / 24 * slope / 1e-2 - 7 * pitch**4 / 5760 * third / 1e-6
            np.testing.assert_allclose(found, wanted + left, rtol=1e-9, atol=1e-12)
