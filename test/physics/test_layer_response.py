"""A bonded layer against its equations, its limits, and what springs and half-spaces say."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.elastomer import Layer, point_load

G, H = 0.1e6, 4e-3
LAYER = Layer(H, G, 0.49)
RATIOS = [0.0, 0.3, 0.49, 0.5]


def wave(layer: Layer, k: tuple[float, float], traction: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Complex displacement at points (n, 3) under one wave of traction."""
    found = [layer.response(np.array(k[0]), np.array(k[1]), float(z)) @ traction for z in at[:, 2]]
    return np.array(found) * np.exp(1j * at[:, :2] @ np.array(k))[:, None]


@pytest.mark.parametrize('nu', RATIOS[:3])
@pytest.mark.parametrize('k', [(500.0, 300.0), (-60.0, 20.0), (0.0, 2500.0)])
def test_it_solves_naviers_equations(nu: float, k: tuple[float, float]) -> None:
    layer, step = Layer(H, G, nu), 1e-5
    traction = np.array([1.0, 0.5 - 0.3j, -2.0])
    centre = np.array([1e-3, -2e-3, 0.6 * H])

    def at(*moves: np.ndarray) -> np.ndarray:
        return wave(layer, k, traction, np.array([centre + m for m in moves]))

    e = step * np.eye(3)
    here = at(0 * e[0])[0]
    second = np.empty((3, 3, 3), complex)  # i, j, component
    for i in range(3):
        for j in range(3):
            pp, pm, mp, mm = at(e[i] + e[j], e[i] - e[j], e[j] - e[i], -e[i] - e[j])
            second[i, j] = (pp - pm - mp + mm) / (4 * step**2)
    laplacian = np.einsum('iic->c', second)
    gradient = np.array([sum(second[i, j, j] for j in range(3)) for i in range(3)])
    left = gradient / (1 - 2 * nu) + laplacian
    assert np.abs(left).max() < 2e-3 * np.abs(second).max() / (1 - 2 * nu)
    assert np.abs(here).max() > 0


@pytest.mark.parametrize('nu', RATIOS[:3])
def test_the_surface_bears_the_traction(nu: float) -> None:
    layer, k, step = Layer(H, G, nu), (400.0, -250.0), 1e-7
    traction = np.array([1.0, 0.4j, -2.0])
    top = np.array([0.0, 0.0, H])
    low, high = wave(layer, k, traction, np.array([top - [0, 0, 2 * step], top]))
    slope = np.empty((3, 3), complex)  # d u_i / d x_j
    middle = wave(layer, k, traction, np.array([top - [0, 0, step]]))[0]
    slope[:, 2] = (high - low) / (2 * step)
    slope[:, 0], slope[:, 1] = 1j * k[0] * middle, 1j * k[1] * middle
    lame = 2 * G * nu / (1 - 2 * nu)
    stress = G * (slope + slope.T) + lame * np.trace(slope) * np.eye(3)
    np.testing.assert_allclose(stress[:, 2], traction, atol=5e-3)


@pytest.mark.parametrize('nu', RATIOS)
def test_the_base_does_not_move(nu: float) -> None:
    k = np.array([0.0, 10.0, 1000.0, 1e5])
    assert np.abs(Layer(H, G, nu).response(k, 0 * k, 0.0)).max() == 0


def test_an_incompressible_layer_keeps_its_volume() -> None:
    layer, k, step = Layer(H, G, 0.5), (300.0, 400.0), 1e-6
    at = np.array([[0, 0, 0.5 * H - step], [0, 0, 0.5 * H], [0, 0, 0.5 * H + step]])
    low, mid, high = wave(layer, k, np.array([0.3, 0.0, -1.0]), at)
    divergence = 1j * (k[0] * mid[0] + k[1] * mid[1]) + (high[2] - low[2]) / (2 * step)
    assert abs(divergence) < 1e-6 * abs(k[0] * mid[0])


def test_responses_are_reciprocal() -> None:
    k = np.array([200.0, 900.0])
    found = LAYER.response(k, -0.5 * k, H)
    np.testing.assert_allclose(found, np.conj(np.swapaxes(found, 1, 2)), rtol=1e-9, atol=1e-20)


def test_long_waves_are_springs_or_lubrication() -> None:
    k = np.array([20.0])
    spring = Layer(H, G, 0.3).response(k, 0 * k, H)[0, 2, 2].real
    assert spring == pytest.approx(H * 0.4 / (2 * G * 0.7), rel=0.02)
    squeezed = Layer(H, G, 0.5).response(k, 0 * k, H)[0, 2, 2].real
    assert squeezed == pytest.approx(H**3 * k[0] ** 2 / (3 * G), rel=0.02)
    nearly_even = LAYER.response(np.array([0.02, 0.03]), np.zeros(2), H)
    np.testing.assert_allclose(nearly_even[0], nearly_even[1], rtol=1e-3, atol=1e-11)


@pytest.mark.parametrize('depth', [0.0, 1e-3])
def test_short_waves_are_those_of_a_half_space(depth: float) -> None:
    # point load of an incompressible half-space, transformed: (1 + k d) e^(-k d) / (2 G k)
    for k in (3000.0, 9000.0, 30_000.0):
        found = Layer(H, G, 0.5).response(np.array([k]), np.zeros(1), H - depth)[0]
        wanted = (1 + k * depth) * np.exp(-k * depth) / (2 * G * k)
        assert found[2, 2].real == pytest.approx(wanted, rel=2e-3, abs=1e-16)
        assert abs(found[0, 2]) == pytest.approx(
            depth * np.exp(-k * depth) / (2 * G), rel=1e-2, abs=2e-4 * wanted
        )


def test_a_thick_layer_gives_way_as_boussinesq_says() -> None:
    layer, pitch, count = Layer(0.04, G, 0.5), 0.5e-3, 256
    tractions = np.zeros((count, count, 3))
    tractions[128, 128, 2] = -1.0 / pitch**2
    deep = 4e-3
    moved = layer.displacement(tractions, pitch, layer.thickness - deep)
    at = pitch * np.array([[4, 0], [8, 0], [0, -8]])
    points = np.column_stack([at, np.full(3, -deep)])
    wanted = point_load(points, np.zeros(3), np.array([0, 0, -1.0]), G)
    found = np.array([moved[128, 132], moved[128, 136], moved[120, 128]])
    assert np.abs(found[:, :2] - wanted[:, :2]).max() < 0.05 * np.abs(wanted).max()
    # a base and periodic neighbours change the sink by a constant, hardly its shape
    assert found[0, 2] - found[1, 2] == pytest.approx(wanted[0, 2] - wanted[1, 2], rel=0.05)


def test_the_squeeze_goes_outward_and_is_larger_than_half_the_dent() -> None:
    pitch, count = 0.5e-3, 128
    line = pitch * (np.arange(count) - count // 2)
    x, y = np.meshgrid(line, line)
    covered = np.hypot(x, y) <= 6e-3
    tractions = LAYER.punch(covered, pitch, 0.6e-3)
    sunk = LAYER.displacement(tractions, pitch, H)
    np.testing.assert_allclose(sunk[covered][:, 2], -0.6e-3, rtol=1e-5)
    middle = LAYER.displacement(tractions, pitch, H / 2)
    edge = middle[64, 64 + 12]  # 6 mm along x, mid-height
    assert edge[0] > 0.3 * 0.6e-3  # outward
    # a half-space at its surface: nothing sideways; springs: nothing at all
    free = point_load(np.array([6e-3, 0, 0]), np.zeros(3), np.array([0, 0, -1.0]), G)
    assert abs(free[0]) < 1e-6 * abs(free[2])
    assert sunk[64, 64 + 15, 2] > 0  # the layer rises beside the punch


def test_the_punch_presses_hardest_at_its_edge() -> None:
    pitch, count = 0.5e-3, 64
    line = pitch * (np.arange(count) - count // 2)
    covered = np.hypot(*np.meshgrid(line, line)) <= 4e-3
    pressure = Layer(0.05, G, 0.3).punch(covered, pitch, 0.5e-3)[..., 2]
    assert (pressure[~covered] == 0).all()
    assert pressure[32, 32] < 0
    assert pressure[32, 39] < 1.5 * pressure[32, 32]


def test_pressure_waves_are_those_of_the_plain_form() -> None:
    # constants of growing and fading waves by a linear system of four (Johnson, sec. 5.7)
    k, nu = np.array([50.0, 400.0, 2000.0]), 0.45
    for z in (0.3 * H, 0.7 * H, H):
        found = Layer(H, G, nu).response(k, 0 * k, z)[:, :, 2]
        for number, moved in zip(k, found, strict=True):
            kappa = 3 - 4 * nu
            e, d = np.exp(number * H), np.exp(-number * H)
            at = number * H
            system = np.array([
                [1, 0, 1, 0],
                [1, -kappa, -1, -kappa],
                [2 * e, (2 * at + 1 - kappa) * e, -2 * d, (1 - kappa - 2 * at) * d],
                [2 * e, (2 * (1 - kappa + at) - 4 * nu) * e,
                 2 * d, (4 * nu + 2 * (kappa - 1 + at)) * d],
            ])  # fmt: skip
            a, b, c, f = np.linalg.solve(system, [0, 0, 0, 1.0])
            x = number * z
            across = (a + b * x) * np.exp(x) + (c + f * x) * np.exp(-x)
            up = (a - kappa * b + b * x) * np.exp(x) + (-c - kappa * f - f * x) * np.exp(-x)
            np.testing.assert_allclose(
                moved[[0, 2]], np.array([1j * across, up]) / (G * number), rtol=1e-9, atol=1e-20
            )
