"""Plots of a pad: which cells are named rightly, where places err, and at what cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.cells import confusion
from tactile_ros.evaluation.drawing import standalone
from tactile_ros.evaluation.figure import MM
from tactile_ros.evaluation.svg import Plot

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.types import Array, Integers

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


def confusion_map(table: Array, told: str) -> str:
    """Share (n, n) (%) of each true cell that is named as each; empty below half a per cent."""
    count = len(table)
    ends = (-0.5, count - 0.5)
    plot = Plot(ends, ends, 'named cell', 'true cell', (380, 380), told=told)
    true, named = np.nonzero(np.nan_to_num(table) >= 0.5)
    limits = (2.0, 5.0, 15.0, 40.0)
    kinds = [f's{1 + np.searchsorted(limits, share)}' for share in table[true, named]]
    kinds = ['s4' if kind == 's5' else kind for kind in kinds]
    plot.boxes(named.astype(float), true.astype(float), 0.9, kinds)
    return standalone(plot)


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
        'mean error of the place (mm)', (520, 320), log_x=True, told=told,
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
        found[f'confusion_{name}'] = confusion_map(table, words)
    error = np.linalg.norm(said - places, axis=1)
    found['errors'] = error_map(places, error, 'Error of the place over the pad')
    found['speed'] = cost_map(costs, 'Time of a frame against error of the place')
    return found
