# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Soft bodies under loads: identities, limits, slow references and each other."""

import numpy as np
import pytest

from benchmarks.worlds.multipole_fidelity import FlatPunch
from reference import multipole_world as world
from tactile_ros.physics.elastomer import (
    DISC,
    SHARES,
    Layer,
    PunchDents,
    PunchedCarpet,
    disc_press,
    punch_pressure,
)
from tactile_ros.physics.magnet_sheet import Sheet

SHEAR, LOAD, FORCE = 0.2e6, np.array([1e-3, -2e-3, 8e-3]), np.array([0.4, -0.7, -2.0])
G, H, RADIUS = 0.1e6, 4e-3, 6e-3
LAYER, BODY = Layer(H, G, 0.49), Layer(H, 69e3 / 2.98, 0.49)
HEIGHTS = np.array([2.4e-3, 3.6e-3])
LINE = 37e-3 * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 41))  # rows need not be even
CARPET = PunchedCarpet(BODY, LINE, 0.9 * LINE, HEIGHTS)


def point_load(
    points: np.ndarray, loads: np.ndarray, forces: np.ndarray, shear_modulus: float
) -> np.ndarray:
    """Displacement of a half-space under point loads on its surface."""
    r = points - loads
    near = 1 / np.sqrt((r * r).sum(axis=-1, keepdims=True) + 1e-5**2)
    along = (forces * r).sum(axis=-1, keepdims=True)
    return (forces * near + along * r * near**3) / (4 * np.pi * shear_modulus)


def base_image(
    points: np.ndarray, loads: np.ndarray, forces: np.ndarray, shear_modulus: float
) -> np.ndarray:
    """Displacement that a rigid base at z = 0 adds (Blake 1971, Eq. 2.3, doubled)."""
    height = loads[..., 2:]
    mirrored = forces * np.array([1.0, 1.0, -1.0])
    r = points - loads * np.array([1.0, 1.0, -1.0])
    near = 1 / np.linalg.norm(r, axis=-1, keepdims=True)
    z, up = r[..., 2:], np.array([0.0, 0.0, 1.0])
    along = (forces * r).sum(axis=-1, keepdims=True)
    across = (mirrored * r).sum(axis=-1, keepdims=True)
    lift = mirrored[..., 2:]
    dipoles = height * (mirrored * near**3 - 3 * r * across * near**5)
    dipoles += (up * across - mirrored * z - r * lift) * near**3 + 3 * r * z * across * near**5
    moved: np.ndarray = -forces * near - along * r * near**3 + 2 * height * dipoles
    return moved / (4 * np.pi * shear_modulus)


def close(found: np.ndarray, wanted: np.ndarray) -> None:
    np.testing.assert_allclose(found, wanted, atol=0.01 * np.abs(wanted).max())


def test_an_even_disc_sinks_by_the_integral_below_its_centre() -> None:
    # on the axis of even pressure over a disc: w = P / (2 pi G a^2) * a^2 / sqrt(a^2 + z^2)
    radius, depth, force = 2e-3, 3e-3, 1.5
    at = np.array([[[0.0, 0.0, -depth]]])
    up, zero = np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3))
    moved = disc_press(at, zero, up, -force * up, np.array([radius]), SHEAR, np.zeros(1))
    rho = np.linspace(0, radius, 4001)
    sink = (1 / np.hypot(rho, depth) + depth**2 / np.hypot(rho, depth) ** 3) * rho
    mean = 2 / radius**2 * np.sum((sink[1:] + sink[:-1]) / 2 * np.diff(rho))
    assert moved[0, 0, 2] == pytest.approx(-force * mean / (4 * np.pi * SHEAR), rel=2e-3)


def test_disc_is_the_sum_of_its_point_loads_and_their_images() -> None:
    rng = np.random.default_rng(0)
    angle, forces = rng.uniform(0.5, 2.6, 20), rng.normal(size=(20, 3))
    normals = np.column_stack([0 * angle, np.cos(angle), np.sin(angle)])
    contacts = 1e-2 * normals + np.array([5e-3, 0, 0])
    points = np.array([0, 0, 6e-3]) + 2e-3 * rng.normal(size=(20, 4, 3))
    radius, bond = rng.uniform(1e-3, 3e-3, 20), rng.uniform(0, 1, 20)
    first, wanted = np.cross(normals, [1.0, 0, 0]), np.zeros_like(points)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    for (u, v), share in zip(DISC, SHARES, strict=True):
        spot = contacts + radius[:, None] * (u * first + v * np.cross(normals, first))
        part = points, spot[:, None], share * forces[:, None], SHEAR
        wanted += point_load(*part) + bond[:, None, None] * base_image(*part)
    moved = disc_press(points, contacts, normals, forces, radius, SHEAR, bond)
    np.testing.assert_allclose(moved, wanted, atol=1e-12 * np.abs(wanted).max())
    base = points * [1.0, 1.0, 0.0]
    free, held = (
        disc_press(base, contacts, normals, forces, radius, SHEAR, np.full(20, b)) for b in (0, 1)
    )
    assert np.abs(held).max() < 1e-4 * np.abs(free).max()  # a bonded base does not move


def test_long_waves_are_springs_or_lubrication() -> None:
    k, top = np.array([20.0, 0.02, 0.03]), np.array([H])
    spring = -Layer(H, G, 0.3).pressed(k, top)[1][0, 0]
    assert spring == pytest.approx(H * 0.4 / (2 * G * 0.7), rel=0.02)
    squeezed = -Layer(H, G, 0.5).pressed(k, top)[1][0, 0]
    assert squeezed == pytest.approx(H**3 * k[0] ** 2 / (3 * G), rel=0.02)
    nearly_even = LAYER.pressed(k, top)[1][:, 0]
    assert nearly_even[1] == pytest.approx(nearly_even[2], rel=1e-3)


@pytest.mark.parametrize('depth', [0.0, 1e-3])
def test_short_waves_are_those_of_a_half_space(depth: float) -> None:
    # point load of an incompressible half-space, transformed: (1 + k d) e^(-k d) / (2 G k)
    k = np.array([3000.0, 9000.0, 30_000.0])
    across, up = (wave[:, 0] for wave in Layer(H, G, 0.5).pressed(k, np.array([H - depth])))
    fading = np.exp(-k * depth) / (2 * G)
    np.testing.assert_allclose(-up, (1 + k * depth) * fading / k, rtol=2e-3, atol=1e-16)
    np.testing.assert_allclose(
        np.abs(across), depth * fading, rtol=1e-2, atol=2e-4 * fading[0] / k[0]
    )


def test_pressure_waves_are_those_of_the_plain_form() -> None:
    # constants of growing and fading waves by a linear system of four (Johnson, sec. 5.7)
    nu = 0.45
    kappa = 3 - 4 * nu
    for number in (50.0, 400.0, 2000.0):
        e, d, at = np.exp(number * H), np.exp(-number * H), number * H
        system = np.array([
            [1, 0, 1, 0],
            [1, -kappa, -1, -kappa],
            [2 * e, (2 * at + 1 - kappa) * e, -2 * d, (1 - kappa - 2 * at) * d],
            [2 * e, (2 * (1 - kappa + at) - 4 * nu) * e,
             2 * d, (4 * nu + 2 * (kappa - 1 + at)) * d],
        ])  # fmt: skip
        a, b, c, f = np.linalg.solve(system, [0, 0, 0, -1.0])
        heights = np.array([0.3, 0.7, 1.0]) * H
        x = number * heights
        across = (a + b * x) * np.exp(x) + (c + f * x) * np.exp(-x)
        up = (a - kappa * b + b * x) * np.exp(x) + (-c - kappa * f - f * x) * np.exp(-x)
        moved = Layer(H, G, nu).pressed(np.array(number), heights)
        wanted = np.array([across, up]) / (G * number)
        np.testing.assert_allclose(moved, wanted, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize('poisson', [0.0, 0.3, 0.49])
def test_waves_agree_with_finite_elements(poisson: float) -> None:
    waves = world.body_waves(4e-3, 69e3, poisson, 2e-3)
    k = 2 * np.pi * np.abs(np.fft.fftfreq(world.SIDE, world.GRID))[1:40]
    heights = 2e-3 + 2e-3 * world.LEVELS
    across, up = Layer(4e-3, 69e3 / (2 * (1 + poisson)), poisson).pressed(
        k, np.append(heights, 4e-3)
    )
    for level in range(3):
        # along x alone: movement is i times `across`
        close(waves[level, 1:40, 0].imag, across[:, level])
        close(waves[6 + level, 1:40, 0].real, up[:, level])
    close(waves[-1, 1:40, 0].real, up[:, 3])


def test_an_outline_without_area_is_refused() -> None:
    with pytest.raises(ValueError, match='must cover an area'):
        punch_pressure((np.outer([0.0, 1e-3, 2e-3], [1.0, 0.0]),), BODY)


def test_on_a_deep_layer_it_is_boussinesqs_punch() -> None:
    ratio = 0.3
    punch = FlatPunch(Layer(2.0, 3e4, ratio), RADIUS, 20e-3)
    # total load of a rigid punch on a half-space: 4 G a d / (1 - nu)
    total = 2 * np.pi * punch.pressure(np.zeros(1))[0]
    assert total == pytest.approx(4 * 3e4 * RADIUS / (1 - ratio), rel=0.02)


def test_a_round_punch_moves_its_nodes_as_the_exact_one() -> None:
    pose = np.array([4e-3, -3e-3, 0.7])
    points, loads = CARPET.loads(world.regular('', 96, 6e-3))
    moved, turned = CARPET.under(points, loads, pose)
    places = np.stack(np.meshgrid(LINE, 0.9 * LINE, HEIGHTS, indexing='ij'), -1).reshape(-1, 3)
    apart = places[:, :2] - pose[:2]
    away = np.hypot(*apart.T)
    exact = FlatPunch(BODY, 6e-3, 60e-3)
    for height in HEIGHTS:
        here = (places[:, 2] == height) & (away < 30e-3)
        out, up = exact.movement(BODY.thickness - height)(away[here]).T
        side = apart[here] / np.maximum(away[here], 1e-12)[:, None]
        wanted = np.column_stack([side * out[:, None], up])
        error = moved[here] - wanted
        # the exact one has a root at the rim, which no sum of waves follows
        assert np.sqrt(np.square(error).mean()) < 0.005
        assert np.abs(error).max() < 0.08
    assert not turned[:, 2].any()


def test_a_turned_outline_is_turned() -> None:
    triangle = world.regular('', 3, 8e-3, np.pi / 2)
    punch = CARPET.loads(triangle)
    moved, _ = CARPET.under(*punch, np.array([0.0, 0.0, 0.0]))
    mirrored, _ = CARPET.under(*punch, np.array([0.0, 0.0, np.pi]))
    shape = (*CARPET.shape, 3)
    turned = moved.reshape(shape)[::-1, ::-1] * [-1, -1, 1]
    np.testing.assert_allclose(mirrored.reshape(shape), turned, atol=1e-9)
    assert np.abs(mirrored - moved).max() > 0.1


def test_turns_are_those_of_cells() -> None:
    one = Sheet(np.array([75e-3, 75e-3]), 2e-3, 2e-3, 75e-3 / 8, 'M4', np.full(9, 0.1))
    carpet = PunchedCarpet(BODY, *one.lines, one.levels)
    dents, head, pose = PunchDents(one, BODY), world.box('', 14e-3, 9e-3), np.zeros(3)
    images = dents.on_sheet(one, dents.images(*dents.loads(head), pose))
    moved, turned = carpet.under(*carpet.loads(head), pose)
    assert np.corrcoef(moved.T.ravel(), images[:3].ravel())[0, 1] > 0.997
    assert np.corrcoef(turned[:, :2].T.ravel(), images[3:].ravel())[0, 1] > 0.98
