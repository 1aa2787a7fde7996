"""Dipole fields: identities, and slopes against differences."""

from __future__ import annotations

import numpy as np

from tactile_ros.physics.magnetics import (
    VACUUM_PERMEABILITY,
    dipole_field,
    dipole_gradients,
    in_chip_axes,
    magnet_moment,
)

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-1, 1, (5, 3))
PLACES = RNG.uniform(2, 3, (4, 3))
MOMENTS = RNG.normal(size=(4, 3))


def test_on_the_axis_and_beside_it() -> None:
    moment = np.array([[0, 0, 2.0]])
    points = np.array([[0, 0, 0.1], [0.1, 0, 0]])
    field = dipole_field(points, np.zeros((1, 3)), moment)
    along = VACUUM_PERMEABILITY * 2 / (2 * np.pi * 0.1**3)
    np.testing.assert_allclose(field, [[0, 0, along], [0, 0, -along / 2]], atol=1e-18)


def test_the_block_of_the_magnet_pad_gives_its_resting_field() -> None:
    # [2]: 2 x 2 x 1 mm of 1.4 T, 6.4 mm above the Hall element: about 3.3 mT
    moment = np.array([[0, 0, magnet_moment(1.4, 4e-9)]])
    field = dipole_field(np.zeros((1, 3)), np.array([[0, 0, 6.4e-3]]), moment)
    assert abs(field[0, 2] - 3.4e-3) < 0.1e-3


def test_fields_add_scale_and_vectorise() -> None:
    whole = dipole_field(POINTS, PLACES, MOMENTS)
    parts = [dipole_field(POINTS, PLACES[i : i + 1], MOMENTS[i : i + 1]) for i in range(4)]
    np.testing.assert_allclose(whole, np.sum(parts, axis=0), rtol=1e-12)
    np.testing.assert_allclose(dipole_field(2 * POINTS, 2 * PLACES, MOMENTS), whole / 8)
    moved = np.stack([PLACES, PLACES + 0.1])
    np.testing.assert_allclose(dipole_field(POINTS, moved, MOMENTS)[0], whole)


def test_no_divergence_and_no_curl() -> None:
    slope = -dipole_gradients(POINTS, PLACES[:1], MOMENTS[:1])[:, :, 0]
    np.testing.assert_allclose(np.trace(slope, axis1=1, axis2=2), 0, atol=1e-18)
    np.testing.assert_allclose(slope, np.swapaxes(slope, 1, 2), atol=1e-18)


def test_slopes_are_differences() -> None:
    step = 1e-6
    slopes = dipole_gradients(POINTS, PLACES, MOMENTS)
    for m in range(4):
        for axis in range(3):
            moved = np.stack([PLACES, PLACES])
            moved[0, m, axis] += step
            moved[1, m, axis] -= step
            ahead, behind = dipole_field(POINTS, moved, MOMENTS)
            wanted = (ahead - behind) / (2 * step)
            np.testing.assert_allclose(slopes[:, :, m, axis], wanted, rtol=1e-6, atol=1e-16)


def test_a_turned_chip_reads_in_its_own_axes() -> None:
    # the chip's x axis lies along the sensor's y
    turn = np.array([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]])
    field = np.array([[[1.0, 2, 3]]])
    np.testing.assert_allclose(in_chip_axes(field, turn), [[[2, -1, 3]]])
    assert in_chip_axes(field, None) is field
