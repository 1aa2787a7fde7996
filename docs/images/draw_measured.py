# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pictures of real data and of the golden figures: python docs/images/draw_measured.py."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT)]

from tactile_ros.evaluation.figures import Plot, standalone  # noqa: E402
from tactile_ros.sensors import load_sensor  # noqa: E402

BEGIN, END = 36.5, 77.0  # s, of one press of the recording
TOUCHED = 0.05  # N on the scale
MOST = 2.0  # times its aim, where worse figures are drawn too


def press() -> str:
    """One press of a real recording, with the words that the pages use for its parts."""
    recording = load_sensor('reskin_board').recordings()['normal_1']
    time = 1e-9 * (recording.stamp_ns - recording.stamp_ns[0])
    force = recording.truth['force'][:, 2]
    tare = np.flatnonzero(recording.tare & (time > BEGIN))[0]
    touched = time[(force > TOUCHED) & (time > BEGIN) & (time < END)]
    rows = (time > BEGIN) & (time < END)
    change = 1e6 * np.abs(recording.values - recording.values[tare]).max(axis=(1, 2))
    change[tare] = np.nan
    plot = Plot(
        (BEGIN, END), (4, 9000), 'time (s)', 'largest change since the tare (uT)', (520, 300),
        log_y=True, description='Change of field over the time of one press on an eFlesh pad',
    )  # fmt: skip
    plot.band(touched[[0, -1]], np.full(2, 4.0), np.full(2, 9000.0), 'band c2')
    plot.line(time[rows], change[rows], 'line c0')
    plot.rule(float(time[tare]), 'tare')
    plot.rule(float(touched[0]), 'touch')
    plot.rule(float(touched[-1]), 'release')
    for at, height, words in (
        (52.0, 700.0, f'press, up to {np.nanmax(force[rows]):.0f} N'),
        (71.6, 200.0, 'creep'), (37.0, 6.0, 'baseline noise'),
    ):  # fmt: skip
        plot.text(at, height, words)
    key = (('c0', 'five magnetometers under the pad'), ('c2', f'scale above {TOUCHED} N'))
    return standalone(plot, title='One press on a real skin', key=key)


def aims() -> str:
    """Golden figures over their aims, bench by bench."""
    shares: dict[str, list[float]] = {}
    for path in sorted((ROOT / 'benchmarks' / 'golden').glob('*.json')):
        for row in json.loads(path.read_bytes()):
            ours, aim = row['ours'], row['aim']
            if ours is not None and aim is not None:
                over, under = (ours, aim) if row['better'] == 'low' else (aim, ours)
                share = over / under if under else MOST * bool(over)
                shares.setdefault(path.stem, []).append(float(np.clip(share, 0, MOST)))
    plot = Plot(
        (-0.02, 1.02 * MOST), (len(shares) + 0.5, 0.3), 'figure over its aim (1)', '',
        (520, 34 * len(shares) + 80), integer_ticks=True,
        description='Golden figures of each bench over their aims; right of 1: missed',
    )  # fmt: skip
    for i, (name, each) in enumerate(shares.items(), 1):
        for share in each:
            plot.mark(share, i + 0.2, *((0, 'band c2') if share <= 1 else (2, 'fill c1')))
        held = sum(share <= 1 for share in each)
        plot.text(0.0, i - 0.3, f'{name}: {held} of {len(each)} held')
    plot.rule(1.0, '')
    key = (('c2', 'disc: aim held'), ('c1', f'triangle: missed, drawn at {MOST:g} if more'))
    return standalone(plot, title='Golden figures over their aims', key=key)


def drawings() -> dict[str, str]:
    """All pictures by name."""
    return {'press': press(), 'aims': aims()}


if __name__ == '__main__':
    for stem, drawing in drawings().items():
        (HERE / f'{stem}.svg').write_text(drawing)
