# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Dipoles, blocks and discs: against magpylib, identities, and where closed forms fail."""

import dataclasses
import itertools

import magpylib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_ros.physics.magnetics import (
    EXACT,
    Blocks,
    cuboid_field,
    cylinder_field,
    dipole_field,
    exact_disc,
    in_chip_axes,
    magnet_moment,
    rotations,
)

RNG = np.random.default_rng(0)
POINTS, PLACES = RNG.uniform(-1, 1, (5, 3)), RNG.uniform(2, 3, (4, 3))
MOMENTS = RNG.normal(size=(4, 3))
SIZE, POLARISATION = np.array([2e-3, 1.5e-3, 1e-3]), np.array([0.3, -0.7, 1.1])
BLOCK = np.array([2e-3, 2e-3, 1e-3])
CHIP, CENTRE = np.array([[0.0, 0, 0], [3e-3, -2e-3, 0]]), np.array([[1e-3, 0.5e-3, 6.4e-3]])
UP = np.array([0.0, 0.0, 1.4])


def near_and_far(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(-r, r, (400, 3)) for r in (2e-3, 1.9e-2)])


def test_dipole_field_is_that_of_magpylib() -> None:
    place, moment = np.array([0.014, 3e-3, 5e-3]), np.array([0.01, -0.02, 0.05])
    truth = magpylib.misc.Dipole(position=place, moment=moment).getB(CHIP)
    np.testing.assert_allclose(dipole_field(CHIP, place[None], moment[None]), truth, rtol=1e-9)


def test_dipole_fields_add_scale_and_vectorise() -> None:
    whole = dipole_field(POINTS, PLACES, MOMENTS)
    parts = [dipole_field(POINTS, PLACES[i : i + 1], MOMENTS[i : i + 1]) for i in range(4)]
    np.testing.assert_allclose(whole, np.sum(parts, axis=0), rtol=1e-12)
    np.testing.assert_allclose(dipole_field(2 * POINTS, 2 * PLACES, MOMENTS), whole / 8)
    moved = np.stack([PLACES, PLACES + 0.1])
    np.testing.assert_allclose(dipole_field(POINTS, moved, MOMENTS)[0], whole)


def test_turned_chip_reads_in_its_own_axes() -> None:
    # the chip's x axis lies along the sensor's y
    turn = np.array([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]])
    field = np.array([[[1.0, 2, 3]]])
    np.testing.assert_allclose(in_chip_axes(field, turn), [[[2, -1, 3]]])
    assert in_chip_axes(field, None) is field


def test_cuboid_is_that_of_magpylib_inside_and_outside() -> None:
    where = near_and_far()
    truth = magpylib.magnet.Cuboid(dimension=SIZE, polarization=POLARISATION).getB(where)
    assert np.abs(cuboid_field(where, SIZE, POLARISATION) - truth).max() < 1e-11


def test_cylinder_is_that_of_magpylib_inside_and_outside() -> None:
    where = np.concatenate([near_and_far(), [[0, 0, 2e-3], [0, 0, 0]]])
    truth = magpylib.magnet.Cylinder(dimension=(2e-3, 1e-3), polarization=UP).getB(where)
    assert np.abs(cylinder_field(where, 2e-3, 1e-3, 1.4) - truth).max() < 1e-11


@pytest.mark.parametrize('far', [0.19, 0.21, 10.0, 100.0])
def test_far_away_magnets_are_dipoles(far: float) -> None:
    where = far * np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    moment = np.array([[0.0, 0.0, magnet_moment(1.4, np.pi * 1e-9)]])
    dipole = dipole_field(where, np.zeros((1, 3)), moment)
    disc = cylinder_field(where, 2e-3, 1e-3, 1.4)
    assert np.allclose(disc, dipole, rtol=3e-4, atol=0)
    edge = np.sqrt(np.pi) * 1e-3
    block = cuboid_field(where, np.array([edge, edge, 1e-3]), UP)
    assert np.allclose(block, dipole, rtol=3e-4, atol=0)


def test_edges_corners_and_faces_are_finite() -> None:
    grid = SIZE / 2 * np.array(list(itertools.product((-1, 0, 1), repeat=3)), float)
    field, near = (cuboid_field(grid * s, SIZE, POLARISATION) for s in (1.0, 1 + 1e-6))
    assert np.isfinite(field).all()
    size = np.abs(near).max(axis=1)
    assert (np.abs(field).max(axis=1) < 3 * size + 2 * np.abs(POLARISATION).max()).all()
    rim = [[1e-3, 0, 5e-4], [1e-3, 0, -5e-4], [1e-3, 0, 0], [0, 1e-3, 1e-3], [0, 0, 5e-4]]
    field = cylinder_field(np.array(rim), 2e-3, 1e-3, 1.4)
    assert np.isfinite(field).all()
    assert np.abs(field).max() < 20


def test_tilted_disc_is_that_of_magpylib() -> None:
    pixels = 1e-3 * np.array([[-1, -1, 0], [1, 1, 0]], float)
    state = np.array([[2e-4, -3e-4, 2.4e-3, 0.1, -0.2]])
    turn = Rotation.from_rotvec([0.1, -0.2, 0.0])
    assert np.allclose(rotations(np.pad(state[0, 3:], (0, 1))), turn.as_matrix(), atol=1e-15)
    magnet = magpylib.magnet.Cylinder(
        dimension=(2e-3, 1e-3), polarization=UP, position=state[0, :3], orientation=turn
    )
    found = exact_disc(pixels, (2e-3, 1e-3, 1.4)).readings(state)
    assert np.abs(found[0] - magnet.getB(pixels)).max() < 1e-12


def block_along(axis: tuple[float, float, float] = (0, 0, 1)) -> Blocks:
    return Blocks.along(CENTRE, np.array([axis], float), BLOCK, 1.4)


def test_blocks_carried_by_a_rigid_motion() -> None:
    shift, turn = np.array([1e-4, -2e-4, 3e-4]), np.array([1e-3, 2e-3, -1e-3])
    for axis in ((0, 0, 1), (1, 1, 0), (0, -1, 1)):
        moved, turned = block_along(axis).carried(
            lambda p: (shift + np.cross(turn, p - CENTRE))[None]
        )
        np.testing.assert_allclose(moved[0, 0], shift, atol=1e-12)
        np.testing.assert_allclose(turned[0, 0], turn, atol=1e-12)


@pytest.mark.parametrize('axis', [(0, 0, 1), (1, -0.5, 2)])
def test_more_dipoles_come_nearer_to_the_exact_block(axis: tuple[float, float, float]) -> None:
    moved, turned = np.array([[[2e-4, -1e-4, -2e-3]]]), np.array([[[0.2, -0.1, 0.3]]])
    block = block_along(axis)
    field = {
        n: dataclasses.replace(block, edge_nodes=n).field(CHIP, moved, turned)
        for n in (EXACT, 1, 2, 3, 4)
    }
    error = [np.abs(field[n] - field[EXACT]).max() for n in (1, 2, 3, 4)]
    assert all(later < 0.2 * former for former, later in itertools.pairwise(error))
    turn = Rotation.from_rotvec(turned[0, 0]) * Rotation.from_matrix(block.frames[0])
    magnet = magpylib.magnet.Cuboid(
        dimension=BLOCK, polarization=UP, position=(CENTRE + moved[0])[0], orientation=turn
    )
    np.testing.assert_allclose(field[EXACT][0], magnet.getB(CHIP), atol=1e-12)
