# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Compare calibrations, estimators or live runs on the same frames, with p-values.

Each competitor is a calibration file, a bag (the contacts of its live run), or the name of an
estimator, which judges every fifth group of the recordings by a fit to the others. All are
compared with the first, in the frames that both estimate. A calibration that was fitted to the
same recordings knows them: its errors there say little.

example:
  tactile compare ridge grid_knn --sensor reskin_board --on spatial
  tactile compare a.npz b.npz --on spatial --json
  tactile compare bags/place a.npz -o out/compared.html
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from functools import partial
from pathlib import Path

from tactile_ros.cli.console import add_overwrite, note, refuse_unwritable, show, working
from tactile_ros.errors import plain
from tactile_ros.evaluation import compare
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.evaluation.recording_files import LoadedRecording, find, load
from tactile_ros.evaluation.report import PAGE_MARK, write_comparison
from tactile_ros.evaluation.truth import DEFAULT_TRUTH
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.registry import fit_layout

MARKS = {'.html': PAGE_MARK, '.svg': b'<svg'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile compare`."""
    parser.add_argument('competitors', nargs='+', help='calibrations, bags, or estimators')
    parser.add_argument(
        '--on', nargs='+', metavar='RECORDING',
        help='bags, .npz, .csv, or shipped names; default: the first bag among the competitors',
    )  # fmt: skip
    parser.add_argument('--sensor', help='key of the sensor, where only estimators are named')
    parser.add_argument('--truth', action='append', default=[], help='topic with the truth')
    parser.add_argument('--seed', type=int, default=0, help='seed of resamples and swaps (0)')
    parser.add_argument('-o', '--output', type=Path, help='page (.html) or drawing (.svg)')
    add_overwrite(parser)
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def run(options: argparse.Namespace) -> int:
    """Judge every competitor, compare each with the first, print and draw."""
    names, output = options.competitors, options.output
    if len({*map(os.path.realpath, names)}) < max(len(names), 2):
        raise ValueError(f'compare needs two competitors or more, each once; received {names}')
    if len({*map(os.path.realpath, options.on or ())}) < len(options.on or ()):
        raise ValueError(f'--on must name each recording once; received {", ".join(options.on)}')
    if options.seed < 0:
        raise ValueError(f'--seed must be 0 or more; received {options.seed}')
    if output:
        if output.suffix not in MARKS:
            raise ValueError(f'{output} must end in .html or .svg')
        refuse_unwritable(output, MARKS[output.suffix], overwrite=options.overwrite)
    first, *others = judged(options)
    with working('comparing'):
        found = [one for other in others for one in compare.compare(first, other, options.seed)]
    limits = [sentence for one in found for sentence in one.sentences]
    rows = [compare.row_of(one) for one in found]
    show(compare.COLUMNS, rows, as_json=options.json, notes=(*limits, *compare.NOTES))
    if output:
        command = shlex.join(['tactile', 'compare', *map(str, sys.argv[2:])])
        print(plain(f'written: {write_comparison(output, found, command)}'), file=sys.stderr)
    return 0


def last_names(paths: list[str]) -> dict[str, str]:
    """Last parts of paths, as many as tell them apart; the paths themselves where none do."""
    parts = [Path(path).parts for path in paths]
    tails = (['/'.join(one[-n:]) for one in parts] for n in range(1, max(map(len, parts)) + 1))
    return dict(zip(paths, next((t for t in tails if len({*t}) == len(t)), paths), strict=True))


def judged(options: argparse.Namespace) -> list[compare.Competitor]:
    """Estimates of every competitor, each file read once."""
    names, truth = options.competitors, tuple(options.truth) or DEFAULT_TRUTH
    pipelines = {name: open_calibration(name) for name in names if name.endswith('.npz')}
    bags = {
        name: load(name, None, truth).recordings
        for name in names
        if name not in pipelines and Path(name).exists()
    }
    sensors = [options.sensor, *(one.sensor for one in pipelines.values())]
    sensors += [one.recording.layout.sensor for bag in bags.values() for one in bag]
    if not any(sensors):
        raise ValueError(f'{names[0]} is no file; to compare estimators by name, add --sensor')
    spec = load_sensor(next(filter(None, sensors)))
    layout = next((one.layout for one in pipelines.values()), spec.layout(spec.config()))
    loaded: list[LoadedRecording] = [*next(iter(bags.values()), ())] if not options.on else []
    for name in options.on or ():
        with working(f'reading {name}'):
            inside = find(name, spec, layout, truth)
        loaded += inside.recordings
        note(f'{name}: {problem}' for problem in inside.sentences)
    if not loaded:
        raise ValueError('name the recordings to compare on: --on RECORDING')
    config = fit_layout(spec.config(), loaded[0].recording.layout)
    found = []
    for name, short in last_names(names).items():
        with working(f'judging {name}'):
            if name in bags:
                found.append(compare.live(short, bags[name]))
            elif name in pipelines:
                found.append(compare.judge(short, pipelines[name], loaded))
            elif name in spec.estimator_names:
                found.append(compare.held_out(short, partial(spec.pipeline, config, name), loaded))
            else:
                known = ', '.join(spec.estimator_names)
                raise ValueError(f'{name} is no file and no estimator of {spec.key} ({known})')
    return found
