# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Show a calibration file: sensor, estimators, errors, how it was set.

Errors are those of held-out groups, as `tactile calibrate` printed them when the file was made.
Fields of the config are listed where they are not the defaults.

example:
  tactile calibration show out/mine.npz
  tactile calibration show out/mine.npz --json
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.cli.calibrate import COLUMNS, report_rows, sentences
from tactile_ros.cli.console import as_objects, show
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    import argparse

    from tactile_ros.pipeline import Pipeline

MOST_SHOWN = 60  # characters of a value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile calibration`."""
    parser.add_argument('what', choices=('show',), help='what is done with the file')
    parser.add_argument('file', type=Path, help='calibration file (.npz)')
    parser.add_argument('--json', action='store_true', help='print it as JSON')


def run(options: argparse.Namespace) -> int:
    """Print what the file holds."""
    pipeline = open_calibration(options.file)
    stated, rows = stated_of(pipeline), report_rows(pipeline)
    notes, config = sentences(pipeline.report), changed_fields(pipeline)
    if options.json:
        targets = as_objects(COLUMNS, rows)
        told = {**stated, 'targets': targets, 'notes': notes, 'config': config}
        print(json.dumps(told, indent=2))
        return 0
    for name, value in {**stated, **config}.items():
        print(f'{name:12} {value}')
    show(COLUMNS, rows, title='errors on held-out groups; metres and newton')
    for sentence in notes:
        print(sentence)
    return 0


def stated_of(pipeline: Pipeline) -> dict[str, str]:
    """Sensor, size, classes and digest of a pipeline, in words."""
    taxels, channels = pipeline.layout.shape
    return {
        'sensor': pipeline.sensor,
        'taxels': f'{taxels} of {channels} channel{"s" if channels > 1 else ""}',
        'estimates': ', '.join(f'{t} by {name}' for t, name in pipeline.estimators.items()),
        'classes': ', '.join(pipeline.label_names) or 'none',
        'rest': 'known: it can be tared' if pipeline.rest_.tared else 'unknown: it takes no tare',
        'SHA-256': pipeline.digest,
    }


def changed_fields(pipeline: Pipeline) -> dict[str, str]:
    """Fields of the config that are not the defaults of its sensor, shortened."""
    config, usual = pipeline.config, load_sensor(pipeline.sensor).config()
    found = {}
    for name in (entry.name for entry in fields(config)):  # type: ignore[arg-type]
        value, default = getattr(config, name), getattr(usual, name)
        if repr(value) != repr(default):
            told = np.asarray(value).tolist() if isinstance(value, np.ndarray) else value
            text = str(told)
            found[name] = text if len(text) <= MOST_SHOWN else f'{text[:MOST_SHOWN]}...'
    return found
