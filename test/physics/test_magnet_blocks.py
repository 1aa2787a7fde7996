"""Blocks as eight dipoles against their exact field, and blocks carried by rigid motions."""

from __future__ import annotations

import dataclasses
import itertools

import magpylib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_ros.physics.magnetics import EXACT, Blocks, cuboid_field, rotations

SIZE = np.array([2e-3, 2e-3, 1e-3])
CHIP = np.array([[0.0, 0.0, 0.0], [3e-3, -2e-3, 0.0]])
CENTRE = np.array([[1e-3, 0.5e-3, 6.4e-3]])


def one(axis: tuple[float, float, float] = (0, 0, 1)) -> Blocks:
    return Blocks.along(CENTRE, np.array([axis], float), SIZE, 1.4)


def test_eight_dipoles_are_nearly_a_block() -> None:
    still = np.zeros((1, 1, 3))
    turned = np.array([[[0.2, -0.1, 0.3]]])
    spin = rotations(turned)[0, 0]
    for turn, frame in ((still, np.eye(3)), (turned, spin)):
        found = one().field(CHIP, still, turn)[0]
        exact = cuboid_field((CHIP - CENTRE) @ frame, SIZE, np.array([0, 0, 1.4])) @ frame.T
        assert np.abs(found - exact).max() < 2e-3 * np.abs(exact).max()


def test_magnets_that_lie_down_are_blocks_too() -> None:
    block = one((1, 0, 0))
    frame = block.frames[0]
    np.testing.assert_allclose(frame[:, 2], [1, 0, 0], atol=1e-12)
    assert np.linalg.det(frame) > 0.999
    still = np.zeros((1, 1, 3))
    exact = cuboid_field((CHIP - CENTRE) @ frame, SIZE, np.array([0, 0, 1.4])) @ frame.T
    assert np.abs(block.field(CHIP, still, still)[0] - exact).max() < 2e-3 * np.abs(exact).max()


def test_a_rigid_motion_carries_and_turns() -> None:
    shift, turn = np.array([1e-4, -2e-4, 3e-4]), np.array([1e-3, 2e-3, -1e-3])
    for axis in ((0, 0, 1), (1, 1, 0), (0, -1, 1)):
        block = one(axis)
        moved, turned = block.carried(lambda p: (shift + np.cross(turn, p - CENTRE))[None])
        np.testing.assert_allclose(moved[0, 0], shift, atol=1e-12)
        np.testing.assert_allclose(turned[0, 0], turn, atol=1e-12)


@pytest.mark.parametrize('axis', [(0, 0, 1), (1, -0.5, 2)])
def test_more_dipoles_come_nearer_to_the_exact_block(axis: tuple[float, float, float]) -> None:
    moved = np.array([[[2e-4, -1e-4, -2e-3]]])
    turned = np.array([[[0.2, -0.1, 0.3]]])
    blocks = {n: dataclasses.replace(one(axis), edge_nodes=n) for n in (EXACT, 1, 2, 3, 4)}
    field = {n: block.field(CHIP, moved, turned) for n, block in blocks.items()}
    error = [np.abs(field[n] - field[EXACT]).max() for n in (1, 2, 3, 4)]
    assert all(later < 0.2 * former for former, later in itertools.pairwise(error))
    turn = Rotation.from_rotvec(turned[0, 0]) * Rotation.from_matrix(one(axis).frames[0])
    magnet = magpylib.magnet.Cuboid(
        dimension=SIZE, polarization=(0, 0, 1.4), position=(CENTRE + moved[0])[0], orientation=turn
    )
    np.testing.assert_allclose(field[EXACT][0], magnet.getB(CHIP), atol=1e-12)
