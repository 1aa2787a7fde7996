"""Values of a figure over its seeds, their deviation and the aim: a drawing as small as a word."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.page import number

if TYPE_CHECKING:
    from tactile_ros.evaluation.benchmark import Row

WIDTH, HEIGHT, EDGE = 96.0, 12.0, 4.0


def strip(row: Row) -> str:
    """Dots at the values, a bar of one deviation to either side, a line at the aim.

    Empty where there are not several values, or all are one.
    """
    if not row.spread or row.ours is None:
        return ''
    values = np.array(row.by_seed)
    bar = row.ours + row.spread * np.array([-1.0, 1.0])
    aim = [] if row.aim is None else [row.aim]
    shown = np.array([*values, *bar, *aim])
    low, size = float(shown.min()), float(np.ptp(shown))

    def x(value: float) -> float:
        return EDGE + (value - low) / size * (WIDTH - 2 * EDGE)

    middle = HEIGHT / 2
    dots = ''.join(f'M{x(value):.1f} {middle}h0' for value in values.tolist())
    line = ''.join(f'<path class="rule" d="M{x(value):.1f} 0V{HEIGHT:g}"/>' for value in aim)
    told = 'by seed: ' + ', '.join(number(value) for value in values.tolist())
    return (
        f'<svg class="strip" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        f'aria-label="{escape(told)}"><title>{escape(told)}</title>'
        f'<path class="line c0" d="M{x(bar[0]):.1f} {middle}H{x(bar[1]):.1f}"/>'
        f'<path class="dots c0" d="{dots}"/>{line}</svg>'
    )
