# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Drawing of the faults of a grasp: the true force after each, and when the safe action began."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.figures import Plot, standalone

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
    """Forces (N) after all faults of each hand, between bounds; a mark where it began to hold."""
    ends = [float(one.at[-1]) for each in hands.values() for one in each if len(one.at)]
    longest = MS * max(ends, default=1.0)
    plot = Plot((0.0, longest), (0.0, 1.4 * target), 'time after the fault (ms)',
                'largest force of a finger (N)', (480, 300),
                description='Force after each fault of a grasp')  # fmt: skip
    for bound, told in zip(bounds, ('least', 'most'), strict=True):
        plot.line(np.array([0.0, longest]), np.full(2, bound), 'rule')
        plot.text(longest, bound, f'{told} that is allowed', 'end', shift=-9.0)
    for i, (hand, each) in enumerate(hands.items()):
        for one in each:
            plot.line(MS * one.at, one.force, f'line c{i}')
            if np.isfinite(one.after):
                held = float(np.interp(one.after, one.at, one.force))
                plot.mark(MS * one.after, held, i, f'fill c{i}')
        words = f'{hand}: {len(each)} faults, and when it held'
        plot.text(longest, (0.3 - 0.12 * i) * target, words, 'end', f'key c{i}')
    plot.rule(MS * stale, 'an input counts as stale')
    return standalone(plot)
