"""Drawing of the faults of a grasp: the true force after each, and when the safe action began."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.drawing import standalone
from tactile_ros.evaluation.svg import Plot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tactile_ros.types import Array

MS = 1e3


@dataclass(frozen=True)
class Suffered:
    """What one fault did to a grasp.

    Attributes
    ----------
    at : ndarray, shape (s,)
        Times after the fault (s).
    force : ndarray, shape (s,)
        True force of the finger that presses most (N).
    after : float
        When the safe action began (s); NaN: never.
    """

    at: Array
    force: Array
    after: float


def drawn(
    hands: Mapping[str, Sequence[Suffered]],
    target: float,
    bounds: tuple[float, float],
    stale: float,
) -> str:
    """Forces (N) after all faults of each hand, between bounds; a dot where it began to hold."""
    longest = MS * max(float(one.at.max()) for each in hands.values() for one in each)
    plot = Plot((0.0, longest), (0.0, 1.4 * target), 'time after the fault (ms)',
                'largest force of a finger (N)', (480, 300),
                told='Force after each fault of a grasp')  # fmt: skip
    for bound in bounds:
        plot.line(np.array([0.0, longest]), np.full(2, bound), 'rule')
    for i, (hand, each) in enumerate(hands.items()):
        for one in each:
            plot.line(MS * one.at, one.force, f'line c{i}')
            held = np.interp(one.after, one.at, one.force)
            plot.dots(np.array([MS * one.after]), np.array([held]), f'c{i}')
        plot.text(longest, 0.6 * target - 0.15 * i * target, f'{hand}: {len(each)} faults', 'end',
                  f'c{i}')  # fmt: skip
    plot.rule(MS * stale, 'an input counts as stale')
    return standalone(plot)
