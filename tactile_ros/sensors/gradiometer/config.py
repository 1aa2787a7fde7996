# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Geometry and materials of the gradiometer, as [3] built it, and its layout.

[3], table I and text: a disc of 2 mm diameter and 1 mm height, remanence 1.4 T, an air gap of 2.5
mm, four pixels (two dies of two) about 2 mm apart that sense Bx and Bz, full scale 3.5 N, a Hall
sensitivity that falls by 0.5 % a degree around 35 C. The range of 70 mT is that of the pixels.
That they sit at the corners of a square is an assumption.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Layout
from tactile_ros.types.config_fields import admit, array, each_channel, maybe_array, number, switch

CHANNELS = ('Bx', 'Bz')
PIXELS = 1e-3 * np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], float)


@dataclass(frozen=True)
class GradiometerConfig:
    """A disc magnet in an elastomer over pixels of two axes; lengths in m, origin mid-pixels."""

    positions: Array = array(PIXELS, 'pixels', 'm', (-1, 3))
    rotations: Array | None = maybe_array('chip to sensor axes; empty: aligned', '1', ('t', 3, 3))
    saturation: float | Array | None = each_channel((70e-3, 70e-3), 'range of the pixels', 'T')
    noise: float | Array | None = each_channel(None, 'noise; empty: estimated from rest', 'T')
    rate_hz: float = number(1000.0, 'frames per second', 'Hz', 0.1, 20_000)
    track_baseline: bool = switch(True, 'follow slow drift while nothing touches')
    gap: float = number(2.5e-3, 'pixels to the near face of the disc', 'm', 1e-5, 0.1)
    disc_diameter: float = number(2e-3, 'diameter of the disc', 'm', 1e-5, 0.1)
    disc_height: float = number(1e-3, 'height of the disc', 'm', 1e-5, 0.1)
    remanence: float = number(1.4, 'of the disc', 'T', 1e-6, 2.0)
    # p0, p1, p2: raw = true (p0 + p1 dT + p2 dT^2), dT = T - 35 C
    sensitivity: Array = array((1.0, -0.005, 0.0), 'Hall sensitivity over dT', '1', (3,), -2, 2)
    full_scale: float = number(3.5, 'of every component of force', 'N', 1e-6, 1e6)
    stray_term: bool = switch(True, 'fields from outside are unknown; false: there are none')
    thermal_term: bool = switch(True, 'the disc warms and cools; false: it does not')
    thermal_lag: float = number(0.0, 'disc behind chip; 0: learned from recordings', 's', 0.0, 1e4)

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self, len(CHANNELS))


def layout(config: GradiometerConfig) -> Layout:
    """Layout of a gradiometer: t pixels of two channels."""
    return Layout.of(config, 'gradiometer', CHANNELS, 'T')
