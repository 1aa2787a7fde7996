"""Magnetised sheets against magpylib and one another."""

from __future__ import annotations

import magpylib
import numpy as np
import pytest

from tactile_ros.physics.magnet_sheet import Sheet, carpet, carried_field, harmonics

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
        still = np.zeros_like(places)
        error.append(np.abs(carried_field(UNDER, places, moments, still) - exact).max())
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
    moved = carried_field(UNDER, places, moments, np.broadcast_to(shift, places.shape))
    exact = sheet.field(UNDER - shift)
    assert np.abs(moved - exact).max() < 0.015 * np.abs(exact).max()
