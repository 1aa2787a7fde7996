"""One drawing of a report, and the words and figures that all of them share."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from tactile_ros.evaluation.metrics import TargetErrors

MM = 1e3
Colours = dict[str, str]
NAMES = {
    'position': 'place',
    'force_z': 'normal force',
    'force_x': 'shear force x',
    'force_y': 'shear force y',
}


class Figure(NamedTuple):
    """One drawing with its headline, what it shows, and a key of (class, words).

    `narrow` takes its place on narrow screens; empty: the same drawing.
    """

    title: str
    caption: str
    drawing: str
    key: tuple[tuple[str, str], ...] = ()
    narrow: str = ''


def title_of(target: TargetErrors) -> str:
    """Name of a target in words."""
    return NAMES.get(target.name, target.name.replace('_', ' '))


def shown(target: TargetErrors) -> float:
    """The figure that stands for a target: mean place error in mm, or RMSE in N."""
    return MM * target.spread.mean if target.name == 'position' else target.spread.rms


def accepted(target: TargetErrors) -> str:
    """Shares that are accepted, in per cent."""
    return f'{100 * target.coverage.low:.0f}–{100 * target.coverage.high:.0f} %'
