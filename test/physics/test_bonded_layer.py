"""Bonded layers, sheets and dents against slow references written apart."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from reference import multipole_world as world
from tactile_ros.physics import magnet_sheet
from tactile_ros.physics.elastomer import Layer, PunchDents, punch_pressure
from tactile_ros.physics.magnet_sheet import (
    Sheet,
    inverse_distance_series,
    moved_dipole_series,
    powers,
)
from tactile_ros.physics.magnetics import dipole_field


def body(poisson: float = 0.49) -> Layer:
    return Layer(4e-3, 69e3 / (2 * (1 + poisson)), poisson)


BODY = body()
SQUARE = 5e-3 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])


def sheet(kind: str = 'M4') -> Sheet:
    return Sheet(np.array([75e-3, 75e-3]), 2e-3, 2e-3, 75e-3 / 8, kind, np.full(9, 0.1))


def test_a_layer_holds_to_its_base() -> None:
    k = np.geomspace(10, 1e5, 30)
    across, up = BODY.pressed(k, np.array([0.0]))
    assert np.abs(across).max() < 1e-18
    assert np.abs(up).max() < 1e-18


def close(found: np.ndarray, wanted: np.ndarray) -> None:
    np.testing.assert_allclose(found, wanted, atol=0.01 * np.abs(wanted).max())


@pytest.mark.parametrize('poisson', [0.0, 0.3, 0.49])
def test_waves_agree_with_finite_elements(poisson: float) -> None:
    waves = world.body_waves(4e-3, 69e3, poisson, 2e-3)
    k = 2 * np.pi * np.abs(np.fft.fftfreq(world.SIDE, world.GRID))[1:40]
    heights = 2e-3 + 2e-3 * world.LEVELS
    across, up = body(poisson).pressed(k, np.append(heights, 4e-3))
    for level in range(3):
        # along x alone: movement is i times `across`
        close(waves[level, 1:40, 0].imag, across[:, level])
        close(waves[6 + level, 1:40, 0].real, up[:, level])
    close(waves[-1, 1:40, 0].real, up[:, 3])


def test_the_squeeze_moves_more_than_the_dent() -> None:
    # half-spaces and springs have the wrong sign here; 0.75 mm for each mm at the edge
    dents = PunchDents(sheet(), 0.0, BODY)
    images = dents.images(*dents.loads(world.box('', 10e-3, 10e-3)), np.zeros(3))
    n = dents.count
    line = (np.arange(n) + 0.5 - n * (np.arange(n) >= n // 2)) * dents.pitch
    outward = images[0, 0, :, 0] * np.sign(line)
    inside, outside = np.abs(line) < 5e-3, (np.abs(line) > 5e-3) & (np.abs(line) < 9e-3)
    assert outward[inside].min() > -0.05
    assert 0.4 < outward.max() < 1.0
    assert outward[outside].max() > np.abs(images[2, 0]).max() * 0.9


def test_a_punch_is_flat_and_heavier_at_its_rim() -> None:
    points, loads = punch_pressure((SQUARE,), BODY)
    assert loads.min() > 0
    rim = np.abs(points).max(axis=1) > 4.6e-3
    assert loads[rim].mean() > loads[~rim].mean()
    smaller = punch_pressure((0.5 * SQUARE,), BODY)[1].sum()
    assert loads.sum() > 4 * smaller  # a bonded layer stiffens with the area


def test_an_outline_without_area_is_refused() -> None:
    with pytest.raises(ValueError, match='must cover an area'):
        punch_pressure((np.outer([0.0, 1e-3, 2e-3], [1.0, 0.0]),), BODY)


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
    own = sheet(kind).field(skin.config.positions)
    assert np.abs(own - skin.rest()).max() < 0.01 * np.abs(own).max()


def test_a_dented_sheet_changes_as_its_dipoles_say() -> None:
    one, chips = sheet(), world.SENSOR.config().positions
    dents = PunchDents(one, 0.0, BODY)
    images = dents.images(*dents.loads(world.box('', 10e-3, 8e-3)), np.array([3e-3, 1e-3, 0.4]))
    flat = dents.on_sheet(one, images)
    moved = 0.5e-3 * flat[:3].T
    exact = one.dented(chips, moved, 0 * moved) - one.dented(chips, 0 * moved, 0 * moved)
    bands = one.band_changes(chips, moved, 0 * moved)
    found = np.tensordot(one.strengths, bands, axes=1)
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
        return np.tensordot(kinds, skin.band_changes(chips, moved, 0 * moved), axes=1)

    fine = change(180)
    assert np.linalg.norm(change(60) - fine) < most * np.linalg.norm(fine)


def test_weights_around_an_edge_integrate_cubics() -> None:
    skin = sheet()
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
