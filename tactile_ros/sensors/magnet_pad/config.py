# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Geometry and materials of the magnet pad, as [2] built it, and its layout.

[2]: half a cylinder of Vytaflex 20 (Shore 20 A) on a base of 40 x 20 mm, three neodymium blocks of
2 x 2 x 1 mm 10 mm apart on the middle axis, two MLX90393 20 mm apart and 10 mm from the ends, 6,
15 or 25 cells. Its "10 mm from the base" would put the magnets on the surface; the field at rest
(3.3 mT) puts them 6.4 mm above the Hall elements. Its "magnetic moment of 1.4" is the remanence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Layout
from tactile_ros.types.config_fields import admit, array, each_channel, maybe_array, number, switch

CHANNELS = ('Bx', 'By', 'Bz')
RADIUS, LENGTH = 10e-3, 40e-3
HEIGHT = 6.4e-3
GAIN_1 = (39.4e-3, 39.4e-3, 63.4e-3)  # range of the chips at gain 4x, resolution 1
# Gent's relation between Shore A and Young's modulus gives 0.73 MPa for 20 A; G = E / 3
SHEAR_MODULUS = 0.245e6


def surface_cells(
    along: int, around: int, radius: float = RADIUS, length: float = LENGTH
) -> Array:
    """Centres (along * around, 3) (m) of a grid of cells on the half cylinder, in rows along x.

    They are equally wide as seen from above; [2] has 3 x 2, 5 x 3 and 5 x 5.
    """
    x = length * ((np.arange(along) + 0.5) / along - 0.5)
    y = 2 * radius * ((np.arange(around) + 0.5) / around - 0.5)
    grid = np.stack(np.meshgrid(x, y, indexing='xy'), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.sqrt(radius**2 - grid[:, 1] ** 2)])


@dataclass(frozen=True)
class MagnetPadConfig:
    """Magnets in a soft half cylinder over 3-axis chips; lengths in m, origin mid-base."""

    positions: Array = array([[-10e-3, 0, 0], [10e-3, 0, 0]], 'Hall elements', 'm', (-1, 3))
    rotations: Array | None = maybe_array('chip to sensor axes; empty: aligned', '1', ('t', 3, 3))
    saturation: float | Array | None = each_channel(GAIN_1, 'range of the chips', 'T')
    noise: float | Array | None = each_channel(None, 'noise; empty: estimated from rest', 'T')
    rate_hz: float = number(100.0, 'frames per second', 'Hz', 0.1, 5000)
    track_baseline: bool = switch(True, 'follow slow drift while nothing touches')
    magnet_positions: Array = array(
        [[-10e-3, 0, HEIGHT], [0, 0, HEIGHT], [10e-3, 0, HEIGHT]], 'centres', 'm', (-1, 3)
    )
    magnet_axes: Array = array([[0, 0, 1]] * 3, 'magnetisation directions', '1', (-1, 3))
    magnet_size: Array = array((2e-3, 2e-3, 1e-3), 'edges of a magnet', 'm', (3,), 1e-5, 0.1)
    cells: Array = array(surface_cells(5, 3), 'centres of the cells', 'm', (-1, 3))
    radius: float = number(RADIUS, 'radius of the half cylinder', 'm', 1e-4, 1.0)
    length: float = number(LENGTH, 'length of the half cylinder', 'm', 1e-4, 1.0)
    shear_modulus: float = number(SHEAR_MODULUS, 'of the soft body', 'Pa', 1e2, 1e9)
    remanence: float = number(1.4, 'of the magnets', 'T', 1e-6, 2.0)
    # of fields from outside, so much may be left in the estimate of a touch
    gain_spread: float = number(0.02, 'of the gains of the chips', '1', 0.0, 0.5)
    stray_term: bool = switch(True, 'fields from outside are unknown; false: there are none')

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self, len(CHANNELS))
        length = np.linalg.norm(self.magnet_axes, axis=1)
        if self.magnet_axes.shape != self.magnet_positions.shape or not length.all():
            msg = (
                'magnet_axes of MagnetPadConfig must be one direction for each of the '
                f'{len(self.magnet_positions)} magnets; received {self.magnet_axes.tolist()}'
            )
            raise ValueError(msg)


def layout(config: MagnetPadConfig) -> Layout:
    """Layout of a pad: t chips of three channels."""
    return Layout.of(config, 'magnet_pad', CHANNELS, 'T')
