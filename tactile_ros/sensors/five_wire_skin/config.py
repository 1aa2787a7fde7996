# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Geometry and materials of the five-wire skin, as [5] built it, and its layout.

[5]: a sheet of 100 x 100 mm, ITO-PET of 100 ohm per square (its "ohm/cm2") with a silver border
of 2.4e7 S/m, Velostat, a foil, 15 x 15 mm touches, 5 wires. The border's thickness is not given:
10 um make its sheet conductance 24 000 times that of the sheet. Supply, divider and rate are
assumptions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Layout
from tactile_ros.types.config_fields import admit, array, each_channel, maybe_array, number, switch

CHANNELS = ('u_AC', 'u_BD', 'divider', 'u_third')
SIZE = 100e-3


@dataclass(frozen=True)
class FiveWireSkinConfig:
    """One sheet with four corner electrodes and a foil; lengths in m, origin at electrode A.

    The sheet reaches from A to B along x, from A to D along y. With `third_excitation` the foil is
    read under a third one, too, of any levels at the corners, such as the third phase of three: a
    fourth channel, whose share in the place is learned.
    """

    positions: Array = array([[SIZE / 2, SIZE / 2, 0]], 'middle of the sheet', 'm', (-1, 3))
    rotations: Array | None = maybe_array('axes of the sheet; empty: aligned', '1', ('t', 3, 3))
    saturation: float | Array | None = each_channel((np.inf,), 'largest reading', '1')
    noise: float | Array | None = each_channel(None, 'noise; empty: estimated from rest', '1')
    rate_hz: float = number(100.0, 'frames per second', 'Hz', 0.1, 5000)
    track_baseline: bool = switch(True, 'follow slow drift while nothing touches')
    size: Array = array((SIZE, SIZE), 'sheet along x and y', 'm', (2,), 1e-3, 10.0)
    touch_size: float = number(15e-3, 'edge of a square touch', 'm', 1e-4, 1.0)
    sheet_resistance: float = number(100.0, 'of the sheet', 'ohm per square', 1e-3, 1e9)
    border_ratio: float = number(24_000.0, 'conductance of border over sheet', '1', 1.0, 1e18)
    supply_voltage: float = number(5.0, 'of divider and excitation', 'V', 1e-3, 1e3)
    reference_resistance: float = number(1000.0, 'R0 of the divider', 'ohm', 1e-3, 1e9)

    third_excitation: bool = switch(False, 'the foil is read under a third excitation, too')

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self, len(self.channels))

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels (c)."""
        return CHANNELS if self.third_excitation else CHANNELS[:3]


def layout(config: FiveWireSkinConfig) -> Layout:
    """Layout of a sheet: one taxel of three channels, or four with a third excitation."""
    return Layout.of(config, 'five_wire_skin', config.channels, '1')
