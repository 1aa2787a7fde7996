# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Compare with published figures and simple methods, then time; write json.

example:
  tactile bench devices --quick
  tactile bench reskin
  tactile bench fidelity --figures docs/images
  tactile bench all --jobs 2
  tactile bench roads --quick --json
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import tactile_ros
from tactile_ros.cli.console import add_overwrite, refuse_unwritable, show
from tactile_ros.errors import MissingPackageError

LONGEST = (  # which begin
    'devices', 'grasp', 'hands', 'gradiometer', 'taxel_array', 'magnet_pad', 'reskin',
    'multipole_skin', 'replay',
)  # fmt: skip
UNDISTURBED = ('latency',)  # which run after the others, unless it shall be quick
MARK = b'"bench"'  # key of every file of results
DOMAINS = 102  # whose ports no other program of a Linux machine is given
ALONE = 'import sys; from tactile_ros.cli.main import main; sys.exit(main(sys.argv[1:]))'


def folder() -> Path | None:
    """Folder of the benches: beside the sources, or in the share folder of an installation."""
    package = Path(tactile_ros.__file__).resolve().parent
    installed = [p / 'share' / 'tactile_ros' / 'benchmarks' for p in package.parents]
    places = (package.parent / 'benchmarks', *installed)
    return next((place for place in places if place.is_dir()), None)


def names() -> list[str]:
    """Names of all benches; none where they are not installed."""
    place = folder()
    return [] if place is None else sorted(path.stem for path in place.glob('[!_]*.py'))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile bench`."""
    parser.add_argument('name', help=f'all, or one of: {", ".join(names()) or "none here"}')
    extent = parser.add_mutually_exclusive_group()
    extent.add_argument('--quick', action='store_true', help='fewer seeds and repetitions')
    extent.add_argument('--full', action='store_true', help='every seed')
    parser.add_argument('--jobs', type=int, default=1, help='benches of `all` at a time')
    parser.add_argument('--results', type=Path, help='folder of the json files')
    parser.add_argument('--figures', type=Path, help='folder of the plots (SVG), where wanted')
    parser.add_argument('--json', action='store_true', help='print the tables as JSON')
    add_overwrite(parser)


def load(name: str, needed_by: str) -> ModuleType:
    """Import `benchmarks.<name>`; its worlds are the packages `benchmarks` and `reference`.

    Raises MissingPackageError if the benches, or a package that they import, are not installed.
    """
    place = folder()
    if place is None:
        msg = f'the benches are not installed; run {needed_by} from a clone of the sources'
        raise MissingPackageError(msg)
    for path in (str(place.parent), str(place.parent / 'test')):
        if path not in sys.path:
            sys.path.append(path)
    try:
        return importlib.import_module(f'benchmarks.{name}')
    except ImportError as error:
        raise MissingPackageError(f'{needed_by} needs {error.name or name}: {error}') from error


def load_bench(name: str) -> ModuleType:
    """Module of a bench."""
    if folder() and name not in names():
        raise ValueError(f'bench must be all or one of {", ".join(names())}; received {name!r}')
    return load(name, f'`tactile bench {name}`')


def run(options: argparse.Namespace) -> int:
    """Run the benches, print their tables and write their json."""
    if options.jobs < 1:
        raise ValueError(f'--jobs must be 1 or more; received {options.jobs}')
    results = options.results or Path('benchmarks') / 'results'
    extent = 'quick' if options.quick else 'full' if options.full else 'normal'
    chosen = names() if options.name == 'all' else [options.name]
    benches = {name: load_bench(name) for name in chosen or ['all']}
    for name in benches:
        refuse_unwritable(results / f'{name}.json', MARK, overwrite=options.overwrite)
        if options.figures:
            refuse_unwritable(options.figures / f'{name}.svg')
    if options.jobs > 1 and len(benches) > 1 and not options.json:
        return _side_by_side([*benches], extent, results, options)
    columns = load('harness.rows', '`tactile bench`').COLUMNS
    listed = []
    for name, bench in benches.items():
        began, spent_s = time.perf_counter(), own_processor_s()
        print(f'bench {name} ({extent}) ...', file=sys.stderr, flush=True)
        try:
            result = bench.run(extent, shlex.join(['tactile', *_words(name, extent)]))
        except ImportError as error:
            raise MissingPackageError(f'bench {name} needs {error.name}: {error}') from error
        drawn = result.draw(options.figures) if options.figures else []
        path, seconds = result.write(results), time.perf_counter() - began
        spent_s = own_processor_s() - spent_s
        listed.append(json.loads(path.read_bytes()))
        if not options.json:
            took = f'{seconds:.0f} s ({spent_s:.0f} s of a processor)'
            notes = [*result.notes, *(f'drawn: {one}' for one in drawn)]
            notes.append(f'seeds {result.seed}; {took}; written to {path}')
            rows = [row.cells() for row in result.rows]
            show(columns, rows, title=f'{result.bench}: {result.command}', notes=notes)
    if options.json:
        print(json.dumps(listed, indent=2))
    return 0


def own_processor_s() -> float:
    """Processor time of this process and of those that it waited for (s)."""
    found = os.times()
    return found.user + found.system + found.children_user + found.children_system


def _words(name: str, extent: str) -> list[str]:
    return ['bench', name, *([] if extent == 'normal' else [f'--{extent}'])]


def domain_of(name: str, chosen: Sequence[str]) -> dict[str, str]:
    """Environment of a bench: a ROS domain of its own, or recorders would hear each other's."""
    first = int(os.environ.get('ROS_DOMAIN_ID') or 0)
    return {**os.environ, 'ROS_DOMAIN_ID': str((first + 1 + chosen.index(name)) % DOMAINS)}


def _side_by_side(
    chosen: list[str], extent: str, results: Path, options: argparse.Namespace
) -> int:
    """Run every bench in a process of its own, several at a time; the first failure's code."""
    drawn = ['--figures', str(options.figures)] if options.figures else []

    def one(name: str) -> subprocess.CompletedProcess[str]:
        words = [*_words(name, extent), '--results', str(results), '--overwrite', *drawn]
        command = [sys.executable, '-c', ALONE, *words]
        return subprocess.run(
            command, stdout=subprocess.PIPE, text=True, check=False, env=domain_of(name, chosen)
        )

    last = [name for name in chosen if name in UNDISTURBED and extent != 'quick']
    first = sorted(set(chosen) - set(last), key=lambda name: (name not in LONGEST, name))
    codes = []
    for names, jobs in ((first, options.jobs), (last, 1)):
        with ThreadPoolExecutor(jobs) as pool:
            for done in pool.map(one, names):
                print(done.stdout, end='', flush=True)
                codes.append(done.returncode)
    but = f', but {", ".join(last)}, which ran alone after the others' if last else ''
    print(f'{options.jobs} benches ran at a time: times are those of a busy machine{but}')
    return next((code for code in codes if code), 0)
