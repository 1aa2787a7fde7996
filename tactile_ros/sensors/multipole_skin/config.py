# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Geometry and materials of the multipole skin, as [1] built it, and its layout.

[1] says: a magnetised sheet of 75 x 75 x 2 mm on 2 mm of the same silicone (Ecoflex 00-30), a
pedestal of 1 mm, five places uniformly distributed with four chips each, 80 Hz and more, five new
measuring heads. It does not say where in their clusters the chips sit, nor the depth of the Hall
elements, the remanence and the width of a pole: those defaults are assumptions, to be measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Layout, Outline
from tactile_ros.types.config_fields import (
    Outlines,
    admit,
    array,
    each_channel,
    maybe_array,
    number,
    outlines,
    switch,
    text_of,
    whole,
)

CHANNELS = ('Bx', 'By', 'Bz')
CLUSTERS = 22e-3 * np.array([[0, 0], [-1, 1], [1, 1], [-1, -1], [1, -1]], float)
CORNERS = 4e-3 * np.array([[-1, 1], [1, 1], [-1, -1], [1, -1]], float)
PEDESTAL = 1e-3
PACKAGE = 0.5e-3  # Hall elements below the face of their package
GAIN_5 = (16.4e-3, 16.4e-3, 26.4e-3)  # range of the chips at gain 1.67x, resolution 1
# cluster by cluster, the middle one first
CHIPS = np.pad((CLUSTERS[:, None] + CORNERS).reshape(-1, 2), ((0, 0), (0, 1)))
CHIPS[:, 2] = -PEDESTAL - PACKAGE


def regular(name: str, corners: int, radius: float, turn: float = 0.0) -> Outline:
    """Regular polygon of a radius (m)."""
    angle = turn + 2 * np.pi * np.arange(corners) / corners
    return Outline(name, (radius * np.column_stack([np.cos(angle), np.sin(angle)]),))


def box(name: str, length: float, width: float) -> Outline:
    """Rectangle (m)."""
    return Outline(name, (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [length, width] / 2,))


def nine_heads() -> tuple[Outline, ...]:
    """Squares, triangles and circles of three sizes: edge, edge and diameter."""
    found = []
    for mm in (10, 15, 20):
        size = 1e-3 * mm
        found.append(box(f'square_{mm}', size, size))
        found.append(regular(f'triangle_{mm}', 3, size / np.sqrt(3), np.pi / 2))
        found.append(regular(f'circle_{mm}', 48, size / 2))
    return tuple(found)


HEADS = (
    box('rectangle_10x15', 15e-3, 10e-3),
    box('rectangle_8x12', 12e-3, 8e-3),
    regular('circle_12', 48, 6e-3),
    box('square_12', 12e-3, 12e-3),
    regular('triangle_12', 3, 12e-3 / np.sqrt(3), np.pi / 2),
)


@dataclass(frozen=True)
class MultipoleSkinConfig:
    """A magnetised sheet on a soft layer over 3-axis chips; lengths in m, origin at z = 0.

    Where `positions` say otherwise than `gap`, they win. Magnetised is the sheet M1 along +z, M2
    along +y, M3 +y for y > 0 and -y below, M4 +-y in bands along y. The label of a head is its
    index in `objects`.
    """

    positions: Array = array(CHIPS, 'Hall elements of the chips', 'm', (-1, 3))
    rotations: Array | None = maybe_array('chip to sensor axes; empty: aligned', '1', ('t', 3, 3))
    saturation: float | Array | None = each_channel(GAIN_5, 'range of the chips', 'T')
    noise: float | Array | None = each_channel(None, 'noise; empty: estimated from rest', 'T')
    rate_hz: float = number(80.0, 'frames per second', 'Hz', 0.1, 5000)
    track_baseline: bool = switch(True, 'follow slow drift while nothing touches')
    gap: float = number(2e-3 + PEDESTAL + PACKAGE, 'Hall plane to sheet at rest', 'm', 1e-5, 0.1)
    sheet_size: Array = array((75e-3, 75e-3), 'sheet along x and y', 'm', (2,), 1e-4, 1.0)
    sheet_thickness: float = number(2e-3, 'thickness of the sheet', 'm', 1e-5, 0.1)
    layer_thickness: float = number(2e-3, 'soft layer under the sheet', 'm', 1e-5, 0.1)
    pole_pitch: float = number(75e-3 / 8, 'width of one pole', 'm', 1e-4, 1.0)
    magnetisation: str = text_of('M4', 'how the sheet is magnetised', ('M1', 'M2', 'M3', 'M4'))
    youngs_modulus: float = number(69e3, 'of layer and sheet', 'Pa', 1e2, 1e9)
    poisson_ratio: float = number(0.49, 'of layer and sheet', '1', 0.0, 0.5)
    remanence: float = number(0.1, 'of the sheet', 'T', 1e-6, 2.0)
    window: int = whole(10, 'frames of a press', 1, 10_000)
    objects: Outlines = outlines(HEADS, 'heads that may press')

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self, len(CHANNELS))


def layout(config: MultipoleSkinConfig) -> Layout:
    """Layout of a skin: t chips of three channels."""
    return Layout.of(config, 'multipole_skin', CHANNELS, 'T')
