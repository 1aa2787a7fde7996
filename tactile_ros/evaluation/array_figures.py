"""Plots of taxel arrays: objects over the taxels that they press, spread, drift, speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.drawing import standalone
from tactile_ros.evaluation.figure import MM
from tactile_ros.evaluation.svg import Plot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tactile_ros.types import Array, Outline

MANY = 500  # taxels, of which those that feel nothing are not drawn
SHADES = (0.02, 0.2, 0.4, 0.6, 0.8)  # of the largest pressure, between six shades
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
        if len(corners) > MANY and not value > SHADES[0] * top:
            continue
        shade = 's0' if np.isnan(value) else f's{np.searchsorted(SHADES[:4], value / top)}'
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
        log_x=log_x, told=told, log_y=log_y,
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
        *labels, (520, 320), log_x=True, told=told, log_y=True,
    )  # fmt: skip
    for i, (name, (a, b)) in enumerate(points.items()):
        plot.mark(a, b, i, f'fill c{i % 5}')
        plot.text(a, b, name, shift=-12.0)
    return standalone(plot)
