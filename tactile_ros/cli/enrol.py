# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Learn a class from a few presses, live or from a recording, or forget one by name.

Live, contact_node collects the presses: press, hold a moment, release, as often as was asked for.
From a recording, every press of a bag is one, and of other files every window. The class is kept
in the calibration file, which is written beside itself and renamed.

example:
  tactile enrol mug --presses 3
  tactile enrol mug --namespace thumb --replace
  tactile enrol mug --from out/my_bag --calibration skin.npz
  tactile enrol mug --forget
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tactile_ros.cli.console import note, refuse_unwritable, working
from tactile_ros.enrolment import Allowed, learn, recording_of, window_of
from tactile_ros.errors import RecordingError, TactileError
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.evaluation.recording_files import find
from tactile_ros.evaluation.replay import presses_in
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile enrol`."""
    parser.add_argument('label', help='name of the class')
    parser.add_argument('--presses', type=int, help='how many (default: 3 live, all of a bag)')
    parser.add_argument('--replace', action='store_true', help='forget its presses of before')
    parser.add_argument('--forget', action='store_true', help='undo the enrolment of that name')
    parser.add_argument('--timeout', type=float, default=60.0, help='live: longest wait (s)')
    parser.add_argument('--namespace', default='', help='live: namespace of the sensor')
    parser.add_argument('--from', dest='recording', help='bag, .npz or .csv instead of live')
    parser.add_argument('--calibration', type=Path, help='file to change, where not live')
    parser.add_argument(
        '--most-lost', type=float, default=Allowed.lost,
        help='not live: share of the presses of known classes that it may take',
    )  # fmt: skip
    parser.add_argument(
        '--most-lost-there', type=float, default=Allowed.lost_there,
        help='not live: share of the other classes that it may take where it was pressed',
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Learn or forget, and say what it costs."""
    if options.calibration is None:
        if options.recording:
            raise ValueError('--from needs --calibration, the file that learns')
        return _live(options)
    if bool(options.recording) == options.forget:
        raise ValueError('--calibration needs --from, a recording to learn from, or --forget')
    refuse_unwritable(options.calibration)
    pipeline = open_calibration(options.calibration)
    with working(f'learning {options.label}'):
        if options.forget:
            pipeline.forget(options.label)
            said = f'{options.label!r} forgotten; classes are {", ".join(pipeline.label_names)}'
        else:
            said = _learned(options, pipeline)
    pipeline.save(options.calibration)
    print(f'{said}; written to {options.calibration}')
    print(f'SHA-256 {pipeline.digest}')
    return 0


def _learned(options: argparse.Namespace, pipeline: Pipeline) -> str:
    window_of(pipeline)
    spec = load_sensor(pipeline.sensor)
    loaded = find(options.recording, spec, pipeline.layout)
    note(f'{options.recording}: {problem}' for problem in loaded.sentences)
    found = loaded.recordings
    if len(found) != 1:
        names = ', '.join(one.name for one in found)
        raise RecordingError(f'{options.recording} must hold one sensor; it holds {names}')
    recording = found[0].recording
    if found[0].baselines and recording.layout.shape == pipeline.layout.shape:  # a bag
        presses = presses_in(found[0], open_calibration(options.calibration))
        if not presses:
            raise RecordingError(f'{options.recording} holds no press that begins and ends')
        recording = recording_of(recording.layout, presses[: options.presses or None])
    allowed = Allowed(options.most_lost, options.most_lost_there)
    return learn(pipeline, options.label, recording, options.replace, allowed)


def _live(options: argparse.Namespace) -> int:
    from tactile_ros.nodes.enrolment_server import EnrolmentClient, EnrolRequest

    with EnrolmentClient(options.namespace) as client:
        if options.forget:
            done, said = client.forget(options.label)
        else:
            presses = 3 if options.presses is None else options.presses
            with working('looking for a node that learns'):
                client.wait_for_enrol()
            print(f'press, hold a moment, release: {presses} times', file=sys.stderr)
            asked = EnrolRequest(options.label, presses, options.timeout, options.replace)
            learned = client.enrol(asked, lambda _, heard: print(heard, file=sys.stderr))
            done, said = learned.success, learned.message
    if not done:
        raise TactileError(said)
    print(said)
    return 0
