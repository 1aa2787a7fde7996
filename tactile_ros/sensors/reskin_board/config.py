# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Geometry, ranges and connection of the ReSkin / AnySkin board: its defaults live here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Layout
from tactile_ros.types.config_fields import admit, array, each_channel, maybe_array, number, switch

PITCH = 7e-3
CHANNELS = 3
# centre, left, right, up, down, as the board counts its chips
CROSS = PITCH * np.array([[0, 0, 0], [-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0]], float)


@dataclass(frozen=True)
class ReskinBoardConfig:
    """Places and range of the chips, any number of them.

    The five chips of the board are turned about z by -90, -90, 180, 90 and 0 degrees; regressors
    learn that, so that the default leaves rotations out. The default saturation suits gain 4x at
    resolution 2; the boards' first firmware (gain 1.33x, resolution 0) wraps at 6.6, 6.6 and
    10.6 mT.
    """

    positions: Array = array(CROSS, 'chip positions', 'm', (-1, 3))
    rotations: Array | None = maybe_array('chip to sensor axes; empty: aligned', '1', ('t', 3, 3))
    saturation: float | Array | None = each_channel(
        (78.6e-3, 78.6e-3, 126.8e-3), 'magnitude at which a channel wraps', 'T'
    )
    noise: float | Array | None = each_channel(None, 'noise; empty: estimated from rest', 'T')
    rate_hz: float = number(100.0, 'frames per second', 'Hz', 0.1, 5000)
    track_baseline: bool = switch(True, 'follow slow drift while nothing touches')

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self, CHANNELS)


def layout(config: ReskinBoardConfig) -> Layout:
    """Layout of a board."""
    return Layout.of(config, 'reskin_board', ('Bx', 'By', 'Bz'), 'T')
