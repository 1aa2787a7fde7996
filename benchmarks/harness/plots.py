# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Plots of benches: cells and errors over a pad, objects over taxels, curves."""

from collections.abc import Mapping, Sequence

import numpy as np

from tactile_ros.evaluation.figures import MM, Plot, shade_key, standalone
from tactile_ros.types import Array, Outline

SHADES = (60.0, 75.0, 85.0, 92.0, 97.0)  # % of a cell: below the first one an alarming colour
STEPS_MM = (0.2, 0.4, 0.6, 0.9, 1.5)
MANY = 500  # taxels, of which those that feel nothing are not drawn
PRESSURES = (0.02, 0.2, 0.4, 0.6)  # of the largest one, between shades
OBJECT_KEY = (('c1', 'estimated'), ('ink', 'true'), ('s0', '< 2 %'), ('s4', '> 60 % of largest'))
GLYPHS = '●■▲◆'  # of the marks, in their order
KEY = 0.09  # of the axis, that a line of the key takes
MARKS = (0.15, 0.5, 0.85)  # of a line, where its marks stand
ARM = 0.04  # m, of a tube: longer than an array


def cell_map(cells: Array, shares: Array, title: str) -> str:
    """Share (n,) (%) of touches of each cell, centres (n, 3) (m), that is named rightly."""
    x, y = MM * cells[:, 0], MM * cells[:, 1]
    apart = np.diff(np.unique(np.round(x, 6)))
    wide = float(apart.min()) if len(apart) else 1.0
    ends = (x.min() - wide / 2, x.max() + wide / 2), (y.min() - wide / 2, y.max() + wide / 2)
    plot = Plot.plan(*ends, '(mm)', title)
    kinds = [f's{(np.searchsorted(SHADES, share) - 1) % 6}' for share in shares]
    plot.boxes(x, y, 0.55 * wide, kinds)
    for a, b, share in zip(x, y, shares, strict=True):
        words = '-' if np.isnan(share) else f'{share:.0f}'
        plot.text(float(a), float(b), words, 'middle', shift=24.0)
    shades = zip(['s5', *(f's{i}' for i in range(5))], shade_key(SHADES, '%'), strict=True)
    return standalone(plot, title=title, key=[(kind, words) for kind, (_, words) in shades])


def error_map(places: Array, error: Array, title: str) -> str:
    """Where places (s, 3) (m) err by error (s,) (m), seen from above."""
    x, y = MM * places[:, 0], MM * places[:, 1]
    along, across = ((float(np.floor(v.min())), float(np.ceil(v.max()))) for v in (x, y))
    plot = Plot.plan(along, across, '(mm)', title)
    plot.boxes(x, y, 0.7, [f's{np.searchsorted(STEPS_MM, MM * one)}' for one in error])
    return standalone(plot, title=title, key=shade_key(STEPS_MM, 'mm'))


def taxel_corners(
    positions: Array, areas: Array, outlines: Sequence[Outline] | None
) -> list[Array]:
    """Corners (n, 2) of each taxel (m); squares where no outlines are known."""
    if outlines is not None:
        return [outline.loops[0] for outline in outlines]
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return [
        xyz[:2] + 0.94 * np.sqrt(area) * square for xyz, area in zip(positions, areas, strict=True)
    ]


def edges_of(part: Outline) -> list[Array]:
    """Lines (n, 2) that show a part in its own frame (m): its loops, or both sides of a tube."""
    if part.bend is None:
        return [np.concatenate([loop, loop[:1]]) for loop in part.loops]
    found = []
    for turn in (0.0, part.bend):
        along = np.array([np.cos(turn), np.sin(turn)])
        across = np.array([-along[1], along[0]]) * (part.thickness or 0.0) / 2
        found += [np.array([side, ARM * along + side]) for side in (across, -across)]
    return found


def placed(lines: list[Array], pose: Array) -> list[Array]:
    """Lines of a part at a pose (x, y, yaw)."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[cos, -sin], [sin, cos]])
    return [line @ turn.T + pose[:2] for line in lines]


def object_map(
    corners: Sequence[Array], pressure: Array, found: list[Array], true: list[Array], title: str
) -> str:
    """What taxels feel, where an object was found (strong line) and where it lies (thin line).

    `corners` (n, 2) of each taxel and lines (n, 2) of the object in metres; `pressure` (t,) in any
    unit, NaN: a taxel that is known to be bad.
    """
    every = MM * np.concatenate(list(corners))
    margin = 0.03 * float(np.ptp(every[:, 0]))
    ends = [(float(v.min()) - margin, float(v.max()) + margin) for v in every.T]
    plot = Plot.plan(ends[0], ends[1], '(mm)', title)
    top = max(float(np.nanmax(pressure)), 1e-30)
    for shape, value in zip(corners, pressure, strict=True):
        if len(corners) > MANY and not value > PRESSURES[0] * top:
            continue
        shade = 's0' if np.isnan(value) else f's{np.searchsorted(PRESSURES, value / top)}'
        x, y = MM * np.concatenate([shape, shape[:1]]).T
        plot.line(x, y, shade)
        if np.isnan(value):
            centre = MM * shape.mean(axis=0)
            plot.text(float(centre[0]), float(centre[1]), 'x', 'middle')
    for lines, kind in ((found, 'line c1'), (true, 'line ink')):
        for line in lines:
            x, y = MM * line.T
            plot.line(x, y, kind)
    return standalone(plot, title=title, key=OBJECT_KEY)


def curves(lines: Mapping[str, tuple[Array, Array]], labels: tuple[str, str], title: str) -> str:
    """Lines by name over shared axes; colours and marks along them are those of a key above."""
    x = np.concatenate([x for x, _ in lines.values()])
    y = np.concatenate([y[np.isfinite(y)] for _, y in lines.values()])
    low, high = min(0.0, 1.1 * float(y.min())), 1.15 * float(y.max())
    high += KEY * len(lines) * (high - low)
    plot = Plot(
        (float(x.min()), float(x.max())), (low, high), *labels, (520, 320),
        description=title,
    )  # fmt: skip
    for i, (name, (u, v)) in enumerate(lines.items()):
        plot.line(u, v, f'line c{i % 5}')
        for share in MARKS:
            at = int((share + 0.05 * i) * (len(u) - 1))  # where lines meet, marks stand apart
            plot.mark(float(u[at]), float(v[at]), i, f'fill c{i % 5}')
        plot.text(float(u[0]), None, f'{GLYPHS[i % 4]} {name}', kind=f'key c{i % 5}', row=i)
    return standalone(plot, title=title)
