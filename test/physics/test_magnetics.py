"""Closed forms against magpylib, identities, and the places where closed forms fail."""

from __future__ import annotations

import magpylib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_ros.physics.magnetics import (
    cuboid_field,
    cylinder_field,
    disc_on_pixels,
    tilt_rotation,
)

SIZE = np.array([2e-3, 1.5e-3, 1e-3])
POLARISATION = np.array([0.3, -0.7, 1.1])


def points(count: int, reach: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 3))


def test_cuboid_is_that_of_magpylib_inside_and_outside() -> None:
    where = np.concatenate([points(400, 2e-3), points(400, 1.9e-2)])
    truth = magpylib.magnet.Cuboid(dimension=SIZE, polarization=POLARISATION).getB(where)
    assert np.abs(cuboid_field(where, SIZE, POLARISATION) - truth).max() < 1e-11


def test_cylinder_is_that_of_magpylib_inside_and_outside() -> None:
    where = np.concatenate([points(400, 2e-3), points(400, 1.9e-2), [[0, 0, 2e-3], [0, 0, 0]]])
    truth = magpylib.magnet.Cylinder(dimension=(2e-3, 1e-3), polarization=(0, 0, 1.4)).getB(where)
    assert np.abs(cylinder_field(where, 2e-3, 1e-3, 1.4) - truth).max() < 1e-11


@pytest.mark.parametrize('far', [0.19, 0.21, 10.0, 100.0])
def test_far_away_magnets_are_dipoles(far: float) -> None:
    where = far * np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    moment = np.array([[0.0, 0.0, 1.4 / (4e-7 * np.pi) * np.pi * 1e-9]])
    r = np.linalg.norm(where, axis=1, keepdims=True)
    dipole = 1e-7 * (3 * where * (where @ moment.T) / r**5 - moment / r**3)
    disc = cylinder_field(where, 2e-3, 1e-3, 1.4)
    assert np.allclose(disc, dipole, rtol=3e-4, atol=0)
    edge = np.sqrt(np.pi) * 1e-3
    block = cuboid_field(where, np.array([edge, edge, 1e-3]), np.array([0, 0, 1.4]))
    assert np.allclose(block, dipole, rtol=3e-4, atol=0)


def test_edges_corners_and_faces_are_finite() -> None:
    grid = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], float)
    assert np.isfinite(cuboid_field(grid * SIZE / 2, SIZE, POLARISATION)).all()
    rim = np.array(
        [[1e-3, 0, 5e-4], [1e-3, 0, -5e-4], [1e-3, 0, 0], [0, 1e-3, 1e-3], [0, 0, 5e-4]]
    )
    field = cylinder_field(rim, 2e-3, 1e-3, 1.4)
    assert np.isfinite(field).all()
    assert np.abs(field).max() < 20


def test_the_field_through_a_face_is_continuous() -> None:
    at = np.array([[1e-4, 2e-4, 5e-4]])
    near = [
        cuboid_field(at + np.array([0, 0, d]), SIZE, POLARISATION)[0, 2] for d in (-1e-9, 0, 1e-9)
    ]
    assert np.allclose(near, near[1], atol=1e-5)


def test_a_tilted_disc_is_that_of_magpylib() -> None:
    pixels = 1e-3 * np.array([[-1, -1, 0], [1, 1, 0]], float)
    place, tilt = np.array([[2e-4, -3e-4, 2.4e-3]]), np.array([[0.1, -0.2]])
    turn = Rotation.from_rotvec([0.1, -0.2, 0.0])
    assert np.allclose(tilt_rotation(tilt)[0], turn.as_matrix(), atol=1e-15)
    magnet = magpylib.magnet.Cylinder(
        dimension=(2e-3, 1e-3), polarization=(0, 0, 1.4), position=place[0], orientation=turn
    )
    found = disc_on_pixels(pixels, place, tilt, (2e-3, 1e-3, 1.4))
    assert np.abs(found[0] - magnet.getB(pixels)).max() < 1e-12
