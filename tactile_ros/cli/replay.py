"""Evaluate recordings against their truth, without ROS; compare with what was said live.

example:
  tactile replay out/demo/place --calibration out/demo/place.npz
  tactile replay out/demo/place --calibration out/demo/place.npz --report out/place.html --json
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import calibration as files
from tactile_ros.cli import models
from tactile_ros.cli.destination import refuse_unwritable
from tactile_ros.cli.sources import find
from tactile_ros.cli.table import show, show_json
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.benchmark import environment
from tactile_ros.evaluation.metrics import frames_dropped
from tactile_ros.evaluation.replay import replay
from tactile_ros.evaluation.result import Answer, Dataset, Result, answer, table, unjudged
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    import argparse

    from tactile_ros.evaluation.loaded import LoadedRecording
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile replay`."""
    parser.add_argument('recordings', nargs='+', help='bags, .npz, .csv, or shipped names')
    parser.add_argument(
        '--calibration', type=Path, action='append', required=True,
        help='calibration file; several are compared in one table',
    )  # fmt: skip
    parser.add_argument('--truth', action='append', default=[], help='topic that tells the truth')
    parser.add_argument('--report', type=Path, help='write a self-contained HTML report')
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def run(options: argparse.Namespace) -> int:
    """Replay every recording through every calibration, print the table, write the report."""
    pipelines = [open_calibration(path) for path in options.calibration]
    spec, layout = load_sensor(pipelines[0].sensor), pipelines[0].layout
    if options.report:
        refuse_unwritable(options.report)
    datasets, failed = [], []
    for name in options.recordings:
        try:
            found, problems = find(name, spec, layout, options.truth)
        except RecordingError as error:
            failed.append(str(error))
            continue
        for problem in problems:
            print(f'  {name}: {problem}', file=sys.stderr)
        for one in found:
            try:
                datasets.append(evaluate(one, pipelines))
            except RecordingError as error:
                failed.append(str(error))
    if not datasets:
        raise RecordingError('; '.join(failed))
    command = shlex.join(['tactile', 'replay', *map(str, sys.argv[2:])])
    notes = dict.fromkeys(said for p in pipelines for said in models.sentences(p.report))
    result = Result('Replay', command, environment(), tuple(datasets), tuple(notes))
    print_result(result, as_json=options.json)
    if options.report:
        from tactile_ros.evaluation.report import write_report

        write_report(options.report, result)
        print(f'report: {options.report}', file=sys.stderr)
    for sentence in failed:
        print(f'  left out: {sentence}', file=sys.stderr)
    return 1 if failed else 0


def open_calibration(path: Path) -> Pipeline:
    """Pipeline of whatever sensor the file is of."""
    sensor = str(files.read(path).get('sensor.scalar', ''))
    return load_sensor(sensor).load(path)


def evaluate(
    loaded: LoadedRecording, pipelines: list[Pipeline], summary: str = '', name: str = ''
) -> Dataset:
    """Answers of every pipeline of the recording's shape, the first one's agreement with live."""
    answers: list[Answer] = []
    agreement, problems = None, list(loaded.problems)
    for pipeline in pipelines:
        if pipeline.layout.shape != loaded.recording.layout.shape:
            continue
        replayed = replay(loaded, pipeline)
        label = ', '.join(dict.fromkeys(pipeline.estimators.values())) or 'not calibrated'
        answers.append(answer(label, loaded, replayed))
        problems += unjudged(answers[-1], replayed.states)
        if len(answers) == 1:
            agreement = replayed.agreement
            problems += replayed.problems
    if not answers:
        shape = loaded.recording.layout.shape
        msg = f'{loaded.name} has {shape} taxels and channels, which no calibration is for'
        raise RecordingError(msg)
    recording = loaded.recording
    live = loaded.contacts
    stamps = recording.stamp_ns
    delay: Array = np.zeros(0)
    if live is not None and stamps is not None:
        delay = np.asarray((live.log_ns - stamps[live.rows]) * 1e-9, np.float64)
    time_s = np.full(len(recording), np.nan) if stamps is None else (stamps - stamps[0]) * 1e-9
    return Dataset(
        name=name or loaded.name,
        summary=summary,
        answers=tuple(answers),
        frames=len(recording),
        dropped=frames_dropped(recording.sequence, recording.restarts),
        time_s=time_s,
        chips=recording.layout.positions,
        latency_s=delay,
        agreement=agreement,
        problems=tuple(problems),
    )


def print_result(result: Result, *, as_json: bool = False) -> None:
    """Print the summary table, and how far replay and live run agree."""
    columns, rows = table(result)
    said = sys.stderr if as_json else sys.stdout
    (show_json if as_json else show)(columns, rows)
    for dataset in result.datasets:
        if dataset.agreement is not None:
            worst = dataset.agreement.largest
            text = f'replay and live contacts differ by at most {worst:.1g}'
            print(f'  {dataset.name}: {text}', file=said)
        for problem in dataset.problems:
            print(f'  {dataset.name}: {problem}', file=said)
