# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Plots of taxel arrays: objects over the taxels that they press, spread, drift, speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.figures import MM, Plot, confusion_plot, standalone
from tactile_ros.evaluation.metrics import confusion

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tactile_ros.types import Array, Integers, Outline

SHADES = (60.0, 75.0, 85.0, 92.0, 97.0)  # % of a cell: below the first one an alarming colour
STEPS_MM = (0.2, 0.4, 0.6, 0.9, 1.5)


def cell_map(cells: Array, shares: Array, told: str) -> str:
    """Share (n,) (%) of touches of each cell, centres (n, 3) (m), that is named rightly."""
    x, y = MM * cells[:, 0], MM * cells[:, 1]
    wide = _step(x)
    ends = (x.min() - wide / 2, x.max() + wide / 2), (y.min() - wide / 2, y.max() + wide / 2)
    plot = Plot.plan(*ends, '(mm)', told)
    kinds = [f's{(np.searchsorted(SHADES, share) - 1) % 6}' for share in shares]
    plot.boxes(x, y, 0.55 * wide, kinds)
    for a, b, share in zip(x, y, shares, strict=True):
        words = '-' if np.isnan(share) else f'{share:.0f}'
        plot.text(float(a), float(b), words, 'middle', shift=24.0)
    return standalone(plot)


def _step(x: Array) -> float:
    """Distance between neighbours among coordinates."""
    apart = np.diff(np.unique(np.round(x, 6)))
    return float(apart.min()) if len(apart) else 1.0


def error_map(places: Array, error: Array, told: str) -> str:
    """Where places (s, 3) (m) err by error (s,) (m), seen from above."""
    x, y = MM * places[:, 0], MM * places[:, 1]
    along, across = ((float(np.floor(v.min())), float(np.ceil(v.max()))) for v in (x, y))
    plot = Plot.plan(along, across, '(mm)', told)
    plot.boxes(x, y, 0.7, [f's{np.searchsorted(STEPS_MM, MM * one)}' for one in error])
    return standalone(plot)


def cost_map(costs: Mapping[str, tuple[float, float]], told: str) -> str:
    """Time of a frame (us) against error of the place (mm), for methods by name."""
    time, error = np.array(list(costs.values())).T
    plot = Plot(
        (0.5 * time.min(), 3 * time.max()), (0.0, 1.15 * error.max()), 'time of a frame (us)',
        'mean error of the place (mm)', (520, 320), log_x=True, description=told,
    )  # fmt: skip
    for i, (name, (a, b)) in enumerate(costs.items()):
        plot.mark(a, b, i, f'fill c{i % 5}')
        plot.text(a, b, f'  {name}', shift=(-6.0, 14.0, -10.0, 14.0, -22.0)[i % 5])
    return standalone(plot)


def drawings(
    cells: Array,
    places: Array,
    said: Array,
    named: Mapping[str, Integers],
    true: Integers,
    costs: Mapping[str, tuple[float, float]],
) -> dict[str, str]:
    """Plots by name.

    Parameters
    ----------
    cells : ndarray, shape (n, 3)
        Centres (m).
    places, said : ndarray, shape (s, 3)
        True and estimated (m).
    named : mapping of str to ndarray, shape (s,)
        Cells by the name of a method.
    true : ndarray of int, shape (s,)
        Cells.
    costs : mapping of str to tuple of float
        Time (us) and error (mm) by the name of a method.

    Returns
    -------
    dict of str to str
        SVG text.
    """
    found = {}
    for name, cell in named.items():
        table = confusion(cell, true, len(cells))
        words = f'Share of touches of each cell that {name} names rightly (%)'
        found[f'cells_{name}'] = cell_map(cells, np.diag(table), words)
        words = f'Cells as {name} name them, a row for each true cell'
        found[f'confusion_{name}'] = standalone(confusion_plot(table, 'cell', words))
    error = np.linalg.norm(said - places, axis=1)
    found['errors'] = error_map(places, error, 'Error of the place over the pad')
    found['speed'] = cost_map(costs, 'Time of a frame against error of the place')
    return found


MANY = 500  # taxels, of which those that feel nothing are not drawn
ARRAY_FIGURES_SHADES = (0.02, 0.2, 0.4, 0.6, 0.8)  # of the largest pressure, between six shades
GLYPHS = '●■▲◆'  # of the marks, in their order
KEY = 0.09  # of the axis, that a line of the key takes
MARKS = (0.15, 0.5, 0.85)  # of a line, where its marks stand
ARM = 0.04  # m, of a tube: longer than an array


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
    corners: Sequence[Array], pressure: Array, found: list[Array], true: list[Array], told: str
) -> str:
    """What taxels feel, where an object was found (strong line) and where it lies (thin line).

    Parameters
    ----------
    corners : sequence of ndarray, shape (n, 2)
        Of the taxels (m).
    pressure : ndarray, shape (t,)
        Any unit; NaN: a taxel that is known to be bad.
    found, true : list of ndarray, shape (n, 2)
        Lines of the object (m).
    told : str
        What is shown, for those who cannot see it.

    Returns
    -------
    str
        SVG.
    """
    every = MM * np.concatenate(list(corners))
    margin = 0.03 * float(np.ptp(every[:, 0]))
    ends = [(float(v.min()) - margin, float(v.max()) + margin) for v in every.T]
    plot = Plot.plan(ends[0], ends[1], '(mm)', told)
    top = max(float(np.nanmax(pressure)), 1e-30)
    for shape, value in zip(corners, pressure, strict=True):
        if len(corners) > MANY and not value > ARRAY_FIGURES_SHADES[0] * top:
            continue
        shade = (
            's0'
            if np.isnan(value)
            else f's{np.searchsorted(ARRAY_FIGURES_SHADES[:4], value / top)}'
        )
        x, y = MM * np.concatenate([shape, shape[:1]]).T
        plot.line(x, y, shade)
        if np.isnan(value):
            centre = MM * shape.mean(axis=0)
            plot.text(float(centre[0]), float(centre[1]), 'x', 'middle')
    for lines, kind in ((true, 'line ink'), (found, 'line c1')):
        for line in lines:
            x, y = MM * line.T
            plot.line(x, y, kind)
    return standalone(plot)


def curves(
    lines: Mapping[str, tuple[Array, Array]],
    labels: tuple[str, str],
    told: str,
    *,
    log_x: bool = False,
    log_y: bool = False,
) -> str:
    """Lines by name over shared axes; colours and marks along them are those of a key above."""
    x = np.concatenate([x for x, _ in lines.values()])
    y = np.concatenate([y[np.isfinite(y)] for _, y in lines.values()])
    low = float(y.min()) * 0.8 if log_y else min(0.0, 1.1 * float(y.min()))
    high, room = 1.15 * float(y.max()), KEY * len(lines)
    high = high * (high / low) ** room if log_y else high + room * (high - low)
    plot = Plot(
        (float(x.min()), float(x.max())), (low, high), *labels, (520, 320),
        log_x=log_x, description=told, log_y=log_y,
    )  # fmt: skip
    for i, (name, (u, v)) in enumerate(lines.items()):
        plot.line(u, v, f'line c{i % 5}')
        for share in MARKS:
            at = int((share + 0.05 * i) * (len(u) - 1))  # where lines meet, marks stand apart
            plot.mark(float(u[at]), float(v[at]), i, f'fill c{i % 5}')
        plot.text(float(u[0]), None, f'{GLYPHS[i % 4]} {name}', kind=f'key c{i % 5}', row=i)
    return standalone(plot)


def costs(points: Mapping[str, tuple[float, float]], labels: tuple[str, str], told: str) -> str:
    """Methods by name: time on x and error on y, both logarithmic."""
    x, y = np.array(list(points.values())).T
    plot = Plot(
        (0.5 * float(x.min()), 4 * float(x.max())), (0.4 * float(y.min()), 2 * float(y.max())),
        *labels, (520, 320), log_x=True, description=told, log_y=True,
    )  # fmt: skip
    for i, (name, (a, b)) in enumerate(points.items()):
        plot.mark(a, b, i, f'fill c{i % 5}')
        plot.text(a, b, name, shift=-12.0)
    return standalone(plot)
