# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Evaluate recordings against their truth, without ROS, and against the live run.

example:
  tactile replay spatial --calibration out/place.npz --report out/page.html
  tactile replay bags/* --calibration a.npz --calibration b.npz --save out/compared
  tactile replay bags/* --calibration a.npz --scheduler tcp://10.0.0.1:8786
  tactile replay bags/place --calibration place.npz --json
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

from tactile_ros.cli import calibrate, console
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import fleet, report
from tactile_ros.evaluation.fleet import Job, Outcome, open_calibration
from tactile_ros.evaluation.truth import DEFAULT_TRUTH
from tactile_ros.pipeline import Pipeline

MOST_S = 86_400  # of a time beside recordings


def seconds(text: str, low: float = -MOST_S) -> float:
    """A time of the command line (s)."""
    value = float(text)
    if not low <= value <= MOST_S:
        raise argparse.ArgumentTypeError(f'must be {low:g} to {MOST_S} s; received {text}')
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile replay`."""
    parser.add_argument('recordings', nargs='+', help='bags, .npz, .csv, or shipped names')
    parser.add_argument(
        '--calibration', type=Path, action='append', required=True,
        help='calibration file; several are compared in one table',
    )  # fmt: skip
    parser.add_argument('--truth', action='append', default=[], help='topic with the truth')
    parser.add_argument(
        '--tolerance', type=partial(seconds, low=0.0),
        help='most time from truth to frame (s); default: half a step',
    )  # fmt: skip
    parser.add_argument(
        '--delay', type=seconds, help='of truth after frames (s); default: estimated'
    )
    parser.add_argument('--save', type=Path, help='write PATH.json and PATH.npz')
    parser.add_argument(
        '--jobs', type=int, default=os.cpu_count() or 1, help='recordings at a time'
    )
    parser.add_argument('--scheduler', default='', help='address of a Dask scheduler')
    parser.add_argument('--report', type=Path, help='write a self-contained HTML report')
    parser.add_argument('--png', type=Path, help='folder of its drawings as PNG, where wanted')
    console.add_overwrite(parser)
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def run(options: argparse.Namespace) -> int:
    """Replay every recording through every calibration, print the table, write what is asked."""
    if options.jobs < 1:
        raise ValueError(f'--jobs must be 1 or more; received {options.jobs}')
    pipelines = [open_calibration(path) for path in options.calibration]
    if options.report:
        console.refuse_unwritable(options.report, report.PAGE_MARK, overwrite=options.overwrite)
    if options.save:
        console.refuse_unwritable(options.save)
        for end, mark in fleet.MARKS.items():
            saved = options.save.with_name(options.save.name + end)
            console.refuse_unwritable(saved, mark, overwrite=options.overwrite)
    if options.png:
        console.refuse_no_pictures(options.png)
    command = shlex.join(['tactile', 'replay', *map(str, sys.argv[2:])])
    calibrations = tuple(map(str, options.calibration))
    given = (options.tolerance, options.delay)
    tolerance_ns, delay_ns = (None if s is None else round(s * 1e9) for s in given)
    truth = tuple(options.truth) or DEFAULT_TRUTH
    job = Job('', calibrations, truth, tolerance_ns, delay_ns, options.report is not None)
    jobs = [replace(job, recording=name) for name in dict.fromkeys(options.recordings)]
    alone = console.working('replaying') if len(jobs) == 1 else nullcontext()
    with alone, console.Progress(len(jobs)) as progress:
        outcomes = fleet.run_jobs(
            jobs, options.jobs, options.scheduler,
            lambda outcome: progress.step(outcome.job.recording, outcome.failure),
        )  # fmt: skip
    failed = [outcome.failure for outcome in outcomes if outcome.failure]
    if len(failed) == len(outcomes):
        raise RecordingError('; '.join(failed))
    notes = [text for outcome in outcomes for one in outcome.results for text in one.sentences]
    console.show(*fleet.table(outcomes), as_json=options.json, notes=notes)
    if options.save:
        files = fleet.save(options.save, outcomes, command, report.environment())
        print(f'saved: {files[0]}, {files[1]}', file=sys.stderr)
    if options.report or options.png:
        _report(options, pipelines, outcomes, command)
    console.note(f'left out: {sentence}' for sentence in failed)
    return 1 if failed else 0


def _report(
    options: argparse.Namespace, pipelines: list[Pipeline], outcomes: list[Outcome], command: str
) -> None:
    datasets = [report.for_drawing(one) for outcome in outcomes for one in outcome.results]
    failed = [f'Left out: {outcome.failure}' for outcome in outcomes if outcome.failure]
    notes = dict.fromkeys(said for p in pipelines for said in calibrate.sentences(p.report))
    named = dict(zip((path.name for path in options.calibration), pipelines, strict=True))
    facts = report.provenance(options.recordings, named)
    result = report.Result('Replay', command, facts, tuple(datasets), (*failed, *notes))
    if options.report:
        report.write_report(options.report, result)
        print(f'report: {options.report}', file=sys.stderr)
    if options.png:
        for picture in report.write_pictures(options.png, result):
            print(f'picture: {picture}', file=sys.stderr, flush=True)
