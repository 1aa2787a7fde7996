"""The paper's grippers: counts, pitch, taxels that tile their array without overlap."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.simulation import grippers
from tactile_ros.simulation.taxel_scene import TaxelScene


@pytest.mark.parametrize(
    ('build', 'taxels'),
    [(grippers.magnet_gripper, 72), (grippers.suction_cup, 16), (grippers.jaw, 2000)],
)
def test_points_stand_for_the_areas_of_their_taxels(build: object, taxels: int) -> None:
    config = build()  # type: ignore[operator]
    assert len(config.positions) == taxels
    scene = TaxelScene(config)
    area = np.bincount(scene.owner, scene.part, taxels)
    np.testing.assert_allclose(area, config.areas, rtol=1e-9)
    for axis in (0, 1):
        centre = np.bincount(scene.owner, scene.part * scene.points[:, axis], taxels) / area
        np.testing.assert_allclose(centre, config.positions[:, axis], atol=1.5e-4)


def test_rings_are_five_millimetres_wide() -> None:
    inner = np.array([radius for _, radius in grippers.RINGS])
    np.testing.assert_allclose(np.diff(inner), grippers.PITCH)
    assert sum(count for count, _ in grippers.RINGS) == 72
