# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Drawing of the delays of a grip: which share of the frames is answered later than a time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.figures import Plot, standalone

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.types import Array

MS = 1e3
RANGE_MS = (0.05, 1000.0)
SHARES = np.geomspace(100.0, 0.1, 150)  # %
KINDS = ('c0', 'c1', 'c2', 'c3', 'c4', 'ink')


def drawn(delays: Mapping[str, Array], aim_ms: float) -> str:
    """Shares of frames that are later (%), of the delays (s) of every run; lost ones left out."""
    plot = Plot(RANGE_MS, (SHARES[-1], SHARES[0]), 'delay from bytes to command (ms)',
                'frames that are later (%)', (520, 360), log_x=True, log_y=True,
                description='Tails of the delays from bytes to command')  # fmt: skip
    known = {name: delay[np.isfinite(delay)] for name, delay in delays.items()}
    for row, (name, delay) in enumerate(known.items()):
        kind = KINDS[row % len(KINDS)]
        if len(delay):
            later = MS * np.quantile(delay, 1 - SHARES / 100)
            plot.line(np.clip(later, *RANGE_MS), SHARES, f'line {kind}')
        lowest = SHARES[-1] * 1.35 ** (1 + 1.3 * (len(known) - 1 - row))
        plot.text(RANGE_MS[0], lowest, name if len(delay) else f'{name}: no command', 'start',
                  f'key {kind}')  # fmt: skip
    plot.rule(aim_ms, f'aim of p99: {aim_ms:g} ms')
    return standalone(plot)
