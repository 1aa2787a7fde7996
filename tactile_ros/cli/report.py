# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Gather results of benches on one HTML page: aims held and missed, speed, error.

Reads benchmarks/results/*.json, or the files and folders that are named (results of benches and
saved replays), with the drawings that lie beside them. The page needs no network and no script.
`--png` writes its drawings as pictures, rendered by resvg;
`--markdown` prints the table of the README instead of that of the benches.

example:
  tactile report
  tactile report benchmarks/results -o out/report.html --json
  tactile report --markdown
  tactile report benchmarks/results/reskin.json -o out/reskin.html --png out/pictures
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_ros.cli import bench, console
from tactile_ros.errors import TactileError
from tactile_ros.evaluation.report import PAGE_MARK

if TYPE_CHECKING:
    from benchmarks.harness.rows import BenchFile

RESULTS = Path('benchmarks') / 'results'
COLUMNS = ('bench', 'figures', 'aims', 'held', 'missed', 'what is missed')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile report`."""
    parser.add_argument(
        'results', nargs='*', type=Path, default=[RESULTS],
        help=f'json files of benches and replays, or folders of them ({RESULTS})',
    )  # fmt: skip
    parser.add_argument('-o', '--output', type=Path, help='the page (report.html beside them)')
    parser.add_argument('--png', type=Path, help='folder of the drawings as PNG, where wanted')
    console.add_overwrite(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument('--json', action='store_true', help='print the table as JSON')
    form.add_argument('--markdown', action='store_true', help='print the table of the README')


def run(options: argparse.Namespace) -> int:
    """Gather, write the page, print one row for each bench; 1 where a file could not be read."""
    first = options.results[0]
    output = options.output or (first if first.is_dir() else first.parent) / 'report.html'
    console.refuse_unwritable(output, PAGE_MARK, overwrite=options.overwrite)
    if options.png:
        console.refuse_no_pictures(options.png)
    page = bench.load('harness.package_page', '`tactile report`')
    files, problems = bench.load('harness.rows', '`tactile report`').gather(options.results)
    if not files:
        raise TactileError(f'{"; ".join(problems)}; `tactile bench all` makes results')
    command = shlex.join(['tactile', 'report', *map(str, options.results), '-o', str(output)])
    page.write_package_report(output, files, problems, command)
    if options.markdown:
        lines, missing = page.markdown(files)
        print('\n'.join(lines))
        console.note(f'not among the results: {row}' for row in missing)
    else:
        rows = [row_of(file, page.title_of(file.result.bench)) for file in files]
        console.show(COLUMNS, rows, as_json=options.json)
    console.note(f'left out: {problem}' for problem in problems)
    print(f'report: {output}', file=sys.stderr)
    if options.png:
        picture = None
        for picture in page.write_pictures(options.png, files):
            print(f'picture: {picture}', file=sys.stderr, flush=True)
        if picture is None:
            print('no picture: these results have nothing to draw', file=sys.stderr)
    return int(bool(problems))


def row_of(file: BenchFile, title: str) -> tuple[str | int, ...]:
    """A bench in a row of the table."""
    rows = file.result.rows
    aims = [row for row in rows if row.held is not None]
    missed = [row.what.strip() for row in aims if not row.held]
    return (
        title, len(rows), len(aims), len(aims) - len(missed), len(missed),
        '; '.join(missed[:2]) + ('; ...' if len(missed) > 2 else ''),
    )  # fmt: skip
