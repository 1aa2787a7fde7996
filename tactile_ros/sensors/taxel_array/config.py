# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Geometry and ranges of a piezoresistive array, as [4] built it, and its layout.

[4]: 16 radial taxels on a suction cup, 72 on a magnet gripper (5 mm), about 2000 at 1 mm on a jaw;
10 bit, 50..200 Hz; cells of 110 mm2 loaded with up to 40 N. The default is the array of 16:
sectors of 110 mm2 between the radii 8 and 25 mm, which are an assumption.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.physics.coverage import read_parts
from tactile_ros.types import Array, Layout, Outline
from tactile_ros.types.config_fields import (
    Outlines,
    admit,
    array,
    each_channel,
    maybe_array,
    maybe_outlines,
    number,
    outlines,
    switch,
    text_of,
    whole,
)

CHANNELS = ('output',)
CROSSTALK = ('none', 'grounded', 'floating')
TAXELS, INNER, AREA = 16, 8e-3, 110e-6
OUTER = float(np.sqrt(INNER**2 + TAXELS * AREA / np.pi))
ARC = 9  # points of an arc of a sector


def sectors(taxels: int = TAXELS, inner: float = INNER, outer: float = OUTER) -> Outlines:
    """Outlines of the taxels of a radial array, counter-clockwise from +x (m)."""
    edges = 2 * np.pi * np.arange(taxels + 1) / taxels
    rays = [np.linspace(edges[i], edges[i + 1], ARC) for i in range(taxels)]
    arcs = [np.column_stack([np.cos(ray), np.sin(ray)]) for ray in rays]
    return tuple(
        Outline(f'taxel_{i}', (np.concatenate([outer * arc, inner * arc[::-1]]),))
        for i, arc in enumerate(arcs)
    )


def radial_positions(taxels: int = TAXELS, inner: float = INNER, outer: float = OUTER) -> Array:
    """Centroids of those sectors, shape (taxels, 3) (m)."""
    half = np.pi / taxels
    radius = 2 / 3 * np.sin(half) / half * (outer**3 - inner**3) / (outer**2 - inner**2)
    angle = 2 * half * (np.arange(taxels) + 0.5)
    plane = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(taxels)], axis=1)
    return np.asarray(plane, np.float64)


def grid_positions(rows: int, columns: int, pitch: float) -> Array:
    """Centres of a matrix of taxels, shape (rows * columns, 3) (m), row by row."""
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing='ij')
    plane = pitch * (np.stack([x, y], axis=-1) - np.array([columns - 1, rows - 1]) / 2)
    return np.column_stack([plane.reshape(-1, 2), np.zeros(rows * columns)])


@dataclass(frozen=True)
class TaxelArrayConfig:
    """Taxels whose output is a fraction of the converter's range; lengths in m.

    Attributes
    ----------
    areas : ndarray, shape (t,)
        Of the taxels (m2); one number, or equal numbers, hold for any count of taxels.
    taxel_outlines : tuple of Outline, or None
        Shapes of the taxels in the sensor frame; see `sectors`. None: only the areas are known.
    objects : tuple of Outline
        Parts that may be gripped; `label` is an index into them.
    parts : str
        The same as a text, for ROS parameters: see `physics.coverage.read_parts`; `objects` win.
    crosstalk : str
        'none': the read-out isolates every crossing; 'grounded': rows that are not selected are
        tied to ground, u_ij = g_ij / (1 + sum_k g_kj); 'floating': they and the columns float,
        sneak paths add to every crossing. See `physics/crosstalk.py`.
    matrix_lines : ndarray, shape (t, 2), or None
        Row and column of each taxel in the matrix, for crosstalk; None: by its y and x.
    area_law : ndarray, shape (4,), or None
        p1, p2 (1 / m2), p3, p4 (m2) of the paper's Eq. (2), current over pressed area at one load;
        None: a load on a part of a taxel reads like one on the whole.
    """

    positions: Array = array(radial_positions(), 'centres of the taxels', 'm', (-1, 3))
    rotations: Array | None = maybe_array('axes of the taxels; empty: aligned', '1', ('t', 3, 3))
    saturation: float | Array | None = each_channel((1.0,), 'full output', '1')
    noise: float | Array | None = each_channel(None, 'noise; empty: estimated from rest', '1')
    rate_hz: float = number(100.0, 'frames per second', 'Hz', 0.1, 5000)
    track_baseline: bool = switch(True, 'follow slow drift while nothing touches')
    areas: Array = array([AREA] * TAXELS, 'areas of the taxels', 'm2', ('t',), 1e-9, 1.0)
    taxel_outlines: Outlines | None = maybe_outlines('shapes of the taxels')
    force_range: Array = array((0.0, 40.0), 'least and largest force', 'N', (2,), 0.0, 1e5)
    objects: Outlines = outlines((), 'parts that may be gripped')
    parts: str = text_of('', 'parts as a text, "washer 16 8; tube 90 9" (mm, degrees)')
    most_contacts: int = whole(8, 'patches of a frame that are reported', 1, 64)
    crosstalk: str = text_of('none', 'what the other lines of the matrix do', CROSSTALK)
    matrix_lines: Array | None = maybe_array(
        'row and column of each taxel; empty: by y and x', '1', ('t', 2), 0, 1e4
    )
    area_law: Array | None = maybe_array('p1..p4 of the area law', '1', (4,))

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        self._spread_areas()
        admit(self, len(CHANNELS))
        if self.taxel_outlines is not None and len(self.taxel_outlines) != len(self.positions):
            msg = (
                f'taxel_outlines of TaxelArrayConfig must be {len(self.positions)}, one for each '
                f'taxel; received {len(self.taxel_outlines)}'
            )
            raise ValueError(msg)
        if not self.force_range[0] < self.force_range[1]:
            msg = (
                'force_range of TaxelArrayConfig must grow from the least force to the largest; '
                f'received {self.force_range.tolist()}'
            )
            raise ValueError(msg)

        self._refuse_readout()
        if self.parts and not self.objects:
            object.__setattr__(self, 'objects', read_parts(self.parts))

    def _refuse_readout(self) -> None:
        """Refuse lines that two taxels share, and an area law without a scale."""
        lines = self.matrix_lines
        if lines is not None and len(np.unique(np.rint(lines), axis=0)) < len(lines):
            msg = 'matrix_lines of TaxelArrayConfig must give each taxel its own crossing'
            raise ValueError(msg)
        if self.area_law is not None and not self.area_law[3] > 0:
            msg = (
                'p4, the last of area_law of TaxelArrayConfig, must be an area above 0; '
                f'received {self.area_law[3]}'
            )
            raise ValueError(msg)

    def _spread_areas(self) -> None:
        """Let one area, which holds for any count of taxels, hold for this one."""
        areas = np.atleast_1d(np.asarray(self.areas))
        alike = areas.ndim == 1 and areas.dtype.kind in 'iuf' and len(np.unique(areas)) == 1
        if alike and np.ndim(self.positions) == 2:
            object.__setattr__(self, 'areas', np.full(len(self.positions), float(areas[0])))


def layout(config: TaxelArrayConfig) -> Layout:
    """Layout of an array: t taxels of one channel."""
    return Layout.of(config, 'taxel_array', CHANNELS, '1')
