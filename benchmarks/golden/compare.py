# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Comparison of quick benches with the golden figures: accuracy, coverage and counts, no times.

compare.py RESULTS            say which figures are worse than the golden ones, exit 1 where any is
compare.py RESULTS --write [NORMAL]   make RESULTS golden; spreads of seeds also from NORMAL
"""

import json
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
TIMES = {'us', 'ms', '% of a core', 'cores', 'KiB', 'MB', 'Hz'}
SIMULATED = {'grasp', 'hands'}  # whose seconds are those of the simulation
TIMED = {'latency', 'replay'}  # benches of speed alone
OF_SPEED = ('share of a core', 'frames heard', 'windows answered')
ROUNDING = 1e-9
LEAST = 0.02  # of a figure without seeds that may change by rounding alone
KEPT = ('what', 'unit', 'better', 'ours', 'aim', 'spread')
Row = dict[str, object]


def rows_of(path: Path) -> dict[str, Row]:
    """Rows of a bench that are no times, by what they are."""
    rows = json.loads(path.read_bytes())['rows']
    timed = TIMES | (set() if path.stem in SIMULATED else {'s'})
    if path.stem in TIMED:
        return {}
    kept = (row for row in rows if row['unit'] not in timed)
    return {row['what']: row for row in kept if not any(part in row['what'] for part in OF_SPEED)}


def write(results: Path, normal: Path | None) -> None:
    """Make the figures of a run golden, one json a bench."""
    for path in sorted(results.glob('*.json')):
        rows = rows_of(path)
        if normal is not None:
            for what, row in rows_of(normal / path.name).items():
                if what in rows and row['spread'] is not None:
                    rows[what]['spread'] = max(row['spread'], rows[what]['spread'] or 0.0)
        kept = [{key: row[key] for key in KEPT} for row in rows.values()]
        (FOLDER / path.name).write_text(json.dumps(kept, indent=0) + '\n')


def worse(golden: Row, row: Row | None) -> str:
    """Say how much worse a figure is than the golden one; empty where it is not."""
    before = golden['ours']
    if before is None:
        return ''
    if row is None or row['ours'] is None:
        return f'{before:.4g} -> missing'
    now = row['ours']
    room = max(golden['spread'] or 0.0, LEAST * abs(before), ROUNDING)
    lost = now - before if golden['better'] == 'low' else before - now
    return f'{before:.4g} -> {now:.4g} {golden["unit"]} (spread {room:.2g})' if lost > room else ''


def main(argv: list[str]) -> int:
    """Compare or write."""
    results = Path(argv[0])
    if '--write' in argv:
        write(results, Path(argv[2]) if len(argv) > 2 else None)
        return 0
    count, bad = 0, 0
    for path in sorted(FOLDER.glob('*.json')):
        now = rows_of(results / path.name) if (results / path.name).exists() else {}
        for golden in json.loads(path.read_bytes()):
            count += 1
            if text := worse(golden, now.get(golden['what'])):
                bad += 1
                print(f'{path.stem}: {golden["what"]}: {text}')
    print(f'{bad} of {count} figures are worse than the golden ones')
    return int(bad > 0)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
