"""Grippers of [4] Fig. 4 with parts that they pick: 72 radial taxels, 16 on a cup, a jaw of 2000.

[4] gives counts and pitch (5 mm, 1 mm); radii, washers and tubes are assumptions.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.physics.parts import washer
from tactile_ros.sensors.taxel_array.config import (
    TaxelArrayConfig,
    grid_positions,
    radial_positions,
    sectors,
)
from tactile_ros.types import Outline

RINGS = ((6, 2.5e-3), (12, 7.5e-3), (24, 12.5e-3), (30, 17.5e-3))  # taxels, inner radius (m)
PITCH = 5e-3
WASHERS = ((16e-3, 8e-3), (14e-3, 6.5e-3), (12e-3, 5e-3), (18e-3, 9e-3), (10e-3, 4e-3))
TUBE_RADIUS = 9e-3
BENDS = (90.0, 135.0)  # degrees


def washers(radii: tuple[tuple[float, float], ...] = WASHERS) -> tuple[Outline, ...]:
    """Washers of some outer and inner radii (m)."""
    return tuple(washer(f'washer_{i}', *pair) for i, pair in enumerate(radii))


def tubes(bends: tuple[float, ...] = BENDS, radius: float = TUBE_RADIUS) -> tuple[Outline, ...]:
    """Angle tubes of some bends (degrees)."""
    return tuple(Outline(f'tube_{bend:g}', (), radius, np.deg2rad(bend)) for bend in bends)


def magnet_gripper() -> TaxelArrayConfig:
    """72 taxels in four rings, and washers of five types."""
    shapes = [o for count, r in RINGS for o in sectors(count, r, r + PITCH)]
    areas = [np.full(n, np.pi * ((r + PITCH) ** 2 - r**2) / n) for n, r in RINGS]
    return TaxelArrayConfig(
        positions=np.concatenate([radial_positions(n, r, r + PITCH) for n, r in RINGS]),
        areas=np.concatenate(areas),
        taxel_outlines=tuple(Outline(f'taxel_{i}', o.loops) for i, o in enumerate(shapes)),
        force_range=np.array([0.0, 8.0]),
        objects=washers(),
    )


def suction_cup() -> TaxelArrayConfig:
    """16 sectors, and angle tubes of two bends."""
    return TaxelArrayConfig(taxel_outlines=sectors(), objects=tubes())


def jaw() -> TaxelArrayConfig:
    """2000 taxels of 1 mm, and a part without symmetry."""
    corners = np.array([[-8, -6], [10, -6], [10, 0], [-2, 0], [-2, 8], [-8, 8.0]])
    return TaxelArrayConfig(
        positions=grid_positions(40, 50, 1e-3),
        areas=np.full(2000, 1e-6),
        force_range=np.array([0.0, 1.0]),
        objects=(Outline('angle', (1e-3 * corners,)),),
    )
