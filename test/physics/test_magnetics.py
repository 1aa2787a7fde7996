"""Closed forms against magpylib, identities, and the places where closed forms fail."""

from __future__ import annotations

import magpylib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_ros.physics.magnetics import (
    cuboid_field,
    cylinder_field,
    dipole_stray,
    disc_on_pixels,
    tilt_rotation,
    uniform_stray,
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


def test_case_4_a_corner_is_finite_where_a_plain_form_is_not() -> None:
    corner = SIZE / 2
    for at in (corner, corner * [1, 1, 0], corner * [1, 0, 1], [1e-3, 0, 5e-4]):
        point = np.array([at], float)
        assert np.isfinite(cuboid_field(point, SIZE, POLARISATION)).all()
        near = cuboid_field(point * (1 + 1e-6), SIZE, POLARISATION)
        assert np.abs(cuboid_field(point, SIZE, POLARISATION)).max() < 3 * np.abs(near).max()


@pytest.mark.parametrize('far', [1.0, 10.0, 100.0])
def test_case_4_far_away_nothing_cancels(far: float) -> None:
    # a plain closed form errs by 1.3e-4 at 10 m and 5 % at 100 m
    size, where = np.array([2e-3, 2e-3, 1e-3]), far * np.array([[0.3, -0.4, 0.866]])
    moment = np.array([0, 0, 1.4 * size.prod() / (4e-7 * np.pi)])
    truth = magpylib.misc.Dipole(moment=moment).getB(where)
    found = cuboid_field(where, size, np.array([0, 0, 1.4]))
    assert np.abs(found[0] - truth).max() < 2e-6 * np.abs(truth).max()


def test_case_4_the_change_to_a_dipole_is_no_step() -> None:
    for size in (np.array([2e-3, 2e-3, 1e-3]), np.array([1e-3, 1e-3, 4e-3])):
        edge = 100 * size.max()
        ray = np.array([0.48, -0.6, 0.64])
        fields = [
            cuboid_field(ray * (edge + d), size, np.array([0, 0, 1.4])) * (edge + d) ** 3
            for d in (-1e-6, 1e-6)
        ]
        assert np.abs(fields[0] - fields[1]).max() < 2e-4 * np.abs(fields[0]).max()


def test_a_stray_dipole_is_that_of_magpylib_and_fades_with_the_third_power() -> None:
    pixels = 1e-3 * np.array([[-1, -1, 0], [1, 1, 0]], float)
    place, moment = np.array([0.014, 3e-3, 5e-3]), np.array([0.01, -0.02, 0.05])
    truth = magpylib.misc.Dipole(position=place, moment=moment).getB(pixels)
    np.testing.assert_allclose(dipole_stray(pixels, place, moment), truth, rtol=1e-9)
    far = dipole_stray(pixels, 1e3 * place, moment)
    assert np.linalg.norm(far[0]) == pytest.approx(np.linalg.norm(far[1]), rel=1e-3)


def test_a_uniform_stray_field_has_no_gradient() -> None:
    fields = np.array([[1e-3, 0, 0], [0, 2e-3, -1e-3]])
    found = uniform_stray(np.zeros((4, 3)), fields)
    assert found.shape == (2, 4, 3)
    assert (found - found.mean(axis=1, keepdims=True) == 0).all()
    np.testing.assert_array_equal(found[:, 0], fields)
