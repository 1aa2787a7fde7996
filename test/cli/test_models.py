# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Models and terms are named where a user looks: by `calibrate`, and in the report of a replay."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from tactile_ros.cli.calibrate import sentences
from tactile_ros.cli.main import main
from tactile_ros.enrolment import thinned
from tactile_ros.evaluation.recording_files import save_recording
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from pathlib import Path


def test_models_terms_and_lacks_are_told() -> None:
    report = {
        'force_xyz': {'held_out_rmse': 1.0},
        'model: 27 dipoles': {'worst_error': 1.234e-7, 'noise': 4e-6},
        'term: tilt': {'costs': 4.567, 'buys': 33.1},
        'not told: temperature': {},
        'found: change of the field at rest': {'per degree': -1.2e-3, 'sigma': 3.6e-4},
        'not told: loads (N)': {'least': 1.5, 'most': 9.96},
    }
    assert sentences(report) == [
        'model: 27 dipoles; it errs by 1.2e-07 at most, noise is 4e-06',
        'term: tilt; estimated it widens errors 4.57 times, left out it would 33.1 times',
        'not told: temperature',
        'found: change of the field at rest; per degree -0.0012, sigma 0.00036',
        'not told: loads (N); least 1.5, most 9.96',
    ]


@pytest.mark.parametrize('flags', [[], ['--json']])
def test_calibrate_and_replay_name_the_model(
    flags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = load_sensor('gradiometer')
    presses = tmp_path / 'presses.npz'
    save_recording(thinned(spec.presses(spec.config(), 1, 12), 50.0), presses)
    out, page = tmp_path / 'c.npz', tmp_path / 'r.html'
    command = ['calibrate', 'gradiometer', str(presses), '-o', str(out), *flags]
    assert main([*command, '--estimator', 'inversion']) == 0
    printed = capsys.readouterr()
    said = printed.err if flags else printed.out
    assert 'model: cubic table' in said
    assert 'term: uniform stray field; estimated it widens errors 1.' in said
    assert 'not told: force beyond' in said
    if flags:
        assert {row['target'].split('_')[0] for row in json.loads(printed.out)} >= {'force'}
        assert 'model' not in printed.out
        return
    assert main(['replay', str(presses), '--calibration', str(out), '--report', str(page)]) == 0
    assert 'model: cubic table' in page.read_text()
