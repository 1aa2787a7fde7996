# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Show a calibration file: sensor, estimators, errors, how it was set.

Errors are those of held-out groups, as `tactile calibrate` printed them when the file was made.
Fields of the config are listed where they are not the defaults.

example:
  tactile calibration show out/place.npz
  tactile calibration show out/mine.npz --json
"""

from __future__ import annotations

import argparse
import json
from dataclasses import fields
from pathlib import Path

import numpy as np

from tactile_ros.cli.calibrate import COLUMNS, report_rows, sentences
from tactile_ros.cli.console import as_objects, show
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor

MOST_SHOWN = 60  # characters of a value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile calibration`."""
    parser.add_argument('what', choices=('show',), metavar='show', help='print what it holds')
    parser.add_argument('file', type=Path, help='calibration file (.npz)')
    parser.add_argument('--json', action='store_true', help='print it as JSON')


def run(options: argparse.Namespace) -> int:
    """Print what the file holds."""
    pipeline = open_calibration(options.file)
    taxels, channels = pipeline.layout.shape
    stated = {
        'sensor': pipeline.sensor,
        'taxels': f'{taxels} of {channels} channel{"s" if channels > 1 else ""}',
        'estimates': ', '.join(f'{t} by {name}' for t, name in pipeline.estimators.items()),
        'classes': ', '.join(pipeline.label_names) or 'none',
        'rest': 'known: it can be tared' if pipeline.rest_.tared else 'unknown: it takes no tare',
        'SHA-256': pipeline.digest,
    }
    rows, notes, config = report_rows(pipeline), sentences(pipeline.report), _changed(pipeline)
    if options.json:
        targets = as_objects(COLUMNS, rows)
        found = {**stated, 'targets': targets, 'notes': notes, 'config': config}
        print(json.dumps(found, indent=2))
        return 0
    for name, value in {**stated, **config}.items():
        print(f'{name:12} {value}')
    show(COLUMNS, rows, title='errors on held-out groups; metres and newton')
    for sentence in notes:
        print(sentence)
    return 0


def _changed(pipeline: Pipeline) -> dict[str, str]:
    """Fields of the config that are not the defaults of its sensor, shortened."""
    config, usual = pipeline.config, load_sensor(pipeline.sensor).config()
    found = {}
    for name in (entry.name for entry in fields(config)):  # type: ignore[arg-type]
        value = getattr(config, name)
        if repr(value) != repr(getattr(usual, name)):
            text = str(value.tolist() if isinstance(value, np.ndarray) else value)
            found[name] = text if len(text) <= MOST_SHOWN else f'{text[:MOST_SHOWN]}...'
    return found
