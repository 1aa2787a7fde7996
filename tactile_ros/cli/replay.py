# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Evaluate recordings against their truth, without ROS, and against the live run.

example:
  tactile replay bags/place --calibration place.npz
  tactile replay bags/* --calibration a.npz --calibration b.npz --save out/compared
  tactile replay bags/* --calibration a.npz --scheduler tcp://10.0.0.1:8786
  tactile replay bags/place --calibration place.npz --json
  tactile replay spatial --calibration place.npz --report out/page.html
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
from typing import TYPE_CHECKING

from tactile_ros.cli import calibrate
from tactile_ros.cli.console import (
    Progress,
    add_overwrite,
    refuse_no_pictures,
    refuse_unwritable,
    show,
    working,
)
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import fleet
from tactile_ros.evaluation.fleet import Job, open_calibration
from tactile_ros.evaluation.report import (
    PAGE_MARK,
    Dataset,
    Result,
    environment,
    for_drawing,
    provenance,
    table,
)
from tactile_ros.evaluation.truth import DEFAULT_TRUTH

if TYPE_CHECKING:
    from tactile_ros.evaluation.fleet import Outcome
    from tactile_ros.evaluation.recording_files import LoadedRecording
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
    parser.add_argument('--truth', action='append', default=[], help='topic that tells the truth')
    parser.add_argument(
        '--tolerance', type=partial(seconds, low=0.0),
        help='of truth by time (s); default: half a step',
    )  # fmt: skip
    parser.add_argument(
        '--delay', type=seconds, help='of truth on topics of its own (s); default: estimated'
    )
    parser.add_argument('--save', type=Path, help='write PATH.json and PATH.npz')
    parser.add_argument(
        '--jobs', type=int, default=os.cpu_count() or 1, help='recordings at a time'
    )
    parser.add_argument('--scheduler', default='', help='address of a Dask scheduler')
    parser.add_argument('--report', type=Path, help='write a self-contained HTML report')
    parser.add_argument('--png', type=Path, help='folder of its drawings as PNG, where wanted')
    add_overwrite(parser)
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def run(options: argparse.Namespace) -> int:
    """Replay every recording through every calibration, print the table, write what is asked."""
    if options.jobs < 1:
        raise ValueError(f'--jobs must be 1 or more; received {options.jobs}')
    pipelines = [open_calibration(path) for path in options.calibration]
    if options.report:
        refuse_unwritable(options.report, PAGE_MARK, overwrite=options.overwrite)
    if options.save:
        refuse_unwritable(options.save)
        for end, mark in fleet.MARKS.items():
            saved = options.save.with_name(options.save.name + end)
            refuse_unwritable(saved, mark, overwrite=options.overwrite)
    if options.png:
        refuse_no_pictures(options.png)
    command = shlex.join(['tactile', 'replay', *map(str, sys.argv[2:])])
    recordings = list(dict.fromkeys(options.recordings))
    alone = working('replaying') if len(recordings) == 1 else nullcontext()
    with alone, Progress(len(recordings)) as progress:
        outcomes = fleet.run_jobs(
            [_job(name, options) for name in recordings],
            options.jobs,
            options.scheduler,
            lambda outcome: progress.step(outcome.job.recording, outcome.failure),
        )
    failed = [outcome.failure for outcome in outcomes if outcome.failure]
    if len(failed) == len(outcomes):
        raise RecordingError('; '.join(failed))
    print_outcomes(outcomes, as_json=options.json)
    if options.save:
        files = fleet.save(options.save, outcomes, command, environment())
        print(f'saved: {files[0]}, {files[1]}', file=sys.stderr)
    if options.report or options.png:
        _report(options, pipelines, outcomes, command)
    for sentence in failed:
        print(f'  left out: {sentence}', file=sys.stderr)
    return 1 if failed else 0


def _job(name: str, options: argparse.Namespace) -> Job:
    """One recording as the options want it judged."""
    return Job(
        name,
        tuple(str(path) for path in options.calibration),
        tuple(options.truth) or DEFAULT_TRUTH,
        None if options.tolerance is None else round(options.tolerance * 1e9),
        None if options.delay is None else round(options.delay * 1e9),
    )


def print_outcomes(outcomes: list[Outcome], *, as_json: bool) -> None:
    """Print the table of all recordings, and what must be known about each."""
    columns, rows = fleet.table(outcomes)
    said = sys.stderr if as_json else sys.stdout
    show(columns, rows, as_json=as_json)
    for one in (one for outcome in outcomes for one in outcome.results):
        sentences = [f'{topic}: {how}' for topic, how in one.association.items()]
        for found in one.answers:
            if found.agreement is not None:
                which = f'{found.calibration}: ' if len(one.answers) > 1 else ''
                worst = found.agreement.largest
                sentences.append(f'{which}replay and live contacts differ by at most {worst:.1g}')
            sentences += found.problems
        for sentence in dict.fromkeys([*sentences, *one.problems]):
            print(f'  {one.source or one.name}: {sentence}', file=said)


def _report(
    options: argparse.Namespace,
    pipelines: list[Pipeline],
    outcomes: list[Outcome],
    command: str,
) -> None:
    """Write the report and its pictures, as far as they are asked for."""
    from tactile_ros.evaluation.report import write_pictures, write_report

    datasets = [for_drawing(one) for outcome in outcomes for one in outcome.results]
    failed = [f'Left out: {outcome.failure}' for outcome in outcomes if outcome.failure]
    notes = dict.fromkeys(said for p in pipelines for said in calibrate.sentences(p.report))
    named = dict(zip((path.name for path in options.calibration), pipelines, strict=True))
    facts = provenance(options.recordings, named)
    result = Result('Replay', command, facts, tuple(datasets), (*failed, *notes))
    if options.report:
        write_report(options.report, result)
        print(f'report: {options.report}', file=sys.stderr)
    if options.png:
        for picture in write_pictures(options.png, result):
            print(f'picture: {picture}', file=sys.stderr, flush=True)


def evaluate(
    loaded: LoadedRecording, pipelines: list[Pipeline], summary: str = '', name: str = ''
) -> Dataset:
    """Answers of every pipeline of the recording's shape, the first one's agreement with live."""
    found = fleet.evaluate(loaded, {str(i): one for i, one in enumerate(pipelines)})
    first = found.answers[0]
    return replace(
        found,
        name=name or loaded.name,
        summary=summary,
        agreement=first.agreement,
        problems=(*found.problems, *first.problems),
    )


def print_result(result: Result, *, as_json: bool = False) -> None:
    """Print the summary table, and how far replay and live run agree."""
    columns, rows = table(result)
    said = sys.stderr if as_json else sys.stdout
    show(columns, rows, as_json=as_json)
    for sentence in result.sentences:
        print(f'  {sentence}', file=said)
