# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Fit a sensor's estimators to recordings with truth; write a calibration file.

Errors are printed for held-out groups (places, press cycles, sessions), never for rows that were
learned from.

example:
  tactile calibrate reskin_board spatial -o out/place.npz
  tactile calibrate reskin_board normal_1 normal_2 -o out/force.npz --estimator ridge
  tactile calibrate reskin_board my_bag/ -o out/mine.npz --config my_board.yaml
  tactile calibrate --live --sensor anyskin --port /dev/ttyACM0 --truth weights:50,200 -o my.npz
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from tactile_ros.calibration import MARK
from tactile_ros.cli import console, guided
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.recording_files import find
from tactile_ros.evaluation.replay import check_learned, left_out, with_known_rests, with_tare_rows
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.registry import fit_layout
from tactile_ros.types import Recording, Report

KINDS = ('model: ', 'term: ', 'not learned: ', 'found: ')
COLUMNS = (
    'target', 'estimator', 'held-out mean', 'held-out RMSE', 'in 1 sigma (%)', 'groups', 'rows',
)  # fmt: skip
UNTARED = (
    'not learned: when nothing touched, so this calibration takes readings as they are: it cannot '
    'be tared, and a replay leaves tares out; tares of a contact_node without a calibration '
    'in the same bag would show it (of four frames or more), tare rows, or in_contact 0 at rest '
    '(--truth may be given twice)'
)


def sentences(report: Report) -> list[str]:
    """Sentences of a report on models, terms and what could not be estimated."""
    said = []
    for name, found in report.items():
        if name.startswith('model: '):
            figures = (
                f'it errs by {found["worst_error"]:.2g} at most, noise is {found["noise"]:.2g}'
            )
        elif name.startswith('term: '):
            figures = f'estimated it widens errors {found["costs"]:.3g} times, '
            figures += f'left out it would {found["buys"]:.3g} times'
        elif name.startswith(KINDS) or 'held_out_found' in found:
            figures = ', '.join(f'{what} {value:.3g}' for what, value in found.items())
        else:
            continue
        said.append(f'{name}; {figures}' if figures else name)
    return said


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile calibrate`."""
    parser.add_argument('sensor', nargs='?', help='key of the sensor, see `tactile list`')
    parser.add_argument('recordings', nargs='*', help='bags, .npz, .csv, or shipped names')
    parser.add_argument('-o', '--output', type=Path, required=True, help='calibration file (.npz)')
    console.add_overwrite(parser)
    parser.add_argument('--config', type=Path, help='yaml with fields of the sensor config')
    parser.add_argument('--estimator', help='one estimator instead of the best')
    parser.add_argument(
        '--truth', action='append', default=[],
        help=f'topic with the truth; with --live: {guided.SOURCES}',
    )  # fmt: skip
    parser.add_argument('--json', action='store_true', help='print the table as JSON')
    guided.add_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Load, fit, save, and print the errors on held-out groups."""
    key = options.sensor or options.key
    if key is None or bool(options.recordings) == options.live:
        raise ValueError('calibrate needs a sensor and recordings, or --live --sensor KEY alone')
    spec = load_sensor(key)
    config = console.read_config(spec, options.config)
    console.refuse_unwritable(options.output, MARK, overwrite=options.overwrite)
    if options.live:
        print_fit(guided.run(options, spec, config), options)
        return 0
    loaded: list[Recording] = []
    for name in options.recordings:
        with console.working(f'reading {name}'):
            found = find(name, spec, spec.layout(config), options.truth)
        problems = found.sentences
        for one in found.recordings:
            recording, problem = with_tare_rows(one)
            loaded.append(recording)
            where = f'{one.name}: ' if len(found.recordings) > 1 else ''
            problems += [where + problem] * bool(problem)
        aside = sys.stderr if options.json else sys.stdout
        console.note((f'{name}: {problem}' for problem in problems), aside)
    if not any(recording.truth for recording in loaded):
        raise RecordingError(f'{", ".join(options.recordings)} hold no truth to calibrate with')
    began = time.perf_counter()
    pipeline = spec.pipeline(fit_layout(config, loaded[0].layout), options.estimator)
    known = with_known_rests(loaded)

    def part() -> None:
        some = [one.select(slice(0, -(-len(one) // console.SHARE))) for one in known]
        spec.pipeline(pipeline.config, options.estimator).fit(*some)

    with console.working(f'fitting {spec.key}', part=part):
        pipeline.fit(*known)
    check_learned(pipeline, known)
    pipeline.save(options.output)
    print_fit(pipeline, options, time.perf_counter() - began)
    return 0


def print_fit(pipeline: Pipeline, options: argparse.Namespace, seconds: float = 0.0) -> None:
    """Print errors on held-out groups, what else a fit found, and how long it took (s)."""
    console.show(COLUMNS, report_rows(pipeline), as_json=options.json)
    for sentence in filter(None, (left_out(pipeline), '' if pipeline.rest_.tared else UNTARED)):
        print(sentence, file=sys.stderr)
    for sentence in (*slip_sentence(pipeline), *sentences(pipeline.report)):
        print(sentence, file=sys.stderr if options.json else sys.stdout)
    if not options.json:
        took = f'fitted in {seconds:.1f} s; ' if seconds else ''
        print(f'{took}metres and newton; written to {options.output}')
        print(f'SHA-256 {pipeline.digest}')
        console.note_if_busy()


def slip_sentence(pipeline: Pipeline) -> list[str]:
    """Accuracy of slip on held-out sequences; empty where it is not learned."""
    found = pipeline.report.get('slip')
    if found is None:
        return []
    return [
        f'slip: balanced accuracy {found["held_out_balanced_accuracy"]:.3f}, sequences held out; '
        f'{found["missed"]:.0f} of {found["sequences_that_slip"]:.0f} missed, '
        f'{found["false_alarms"]:.0f} of {found["sequences_that_hold"]:.0f} false alarms'
    ]


def report_rows(pipeline: Pipeline) -> list[tuple[str | float | int | None, ...]]:
    """One row per target: what the fit measured on groups that it had held out."""
    return [
        (
            target,
            pipeline.estimators.get(target.split('_')[0], ''),
            found.get('held_out_mean'),
            found.get('held_out_rmse'),
            100 * found.get('inside_one_sigma', float('nan')),
            int(found.get('groups', 0)),
            int(found.get('rows', 0)),
        )
        for target, found in pipeline.report.items()
        if target != 'left_out' and not target.startswith(KINDS)
    ]
