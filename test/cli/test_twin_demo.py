# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The demo of a simulated sensor, cut short: calibration, graph, bag, replay, table and report."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.cli import demo
from tactile_ros.cli.main import main
from tactile_ros.evaluation.recording_files import load
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

    from tactile_ros.pipeline import Pipeline

pytestmark = pytest.mark.ros
ROUNDING = 1e-12  # frames that waited are estimated together, as many as waited
PLACED = 1e-9  # of objects that are placed: a descent passes rounding on


def apart(said: str) -> float:
    """Largest difference of replay and live contacts."""
    (told,) = re.findall(r'replay and live contacts differ by at most (\S+)', said)
    return float(told)


# two processes, one, two behind a bus of chips, and objects that are recognised
@pytest.mark.parametrize('sensor', ['five_wire_skin', 'gradiometer', 'magnet_pad', 'taxel_array'])
def test_a_twin_goes_through_the_real_graph(
    sensor: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(demo, 'MOST_ROWS', 300)
    run_twin = demo.run_twin
    monkeypatch.setattr(
        'tactile_ros.cli.demo.run_twin',
        lambda key, output, seed, as_json: run_twin(
            key, output, seed, 4.0, as_json=as_json
        ),
    )
    assert main(['demo', '--sensor', sensor, '--output', str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert 'what it does in that world alone' in said
    assert apart(said) < (PLACED if sensor == 'taxel_array' else ROUNDING)
    loaded = load(tmp_path / 'bags' / sensor).recordings[0]
    assert loaded.name == sensor
    truth = loaded.recording.truth
    assert np.count_nonzero(truth['in_contact'] == 1) > 10  # of 4 s in which presses fill 2.3
    assert set(np.unique(truth['session'])) <= {-1, 0}
    told = np.isfinite(truth['force'][:, 2])
    assert told.mean() > 0.9
    if sensor == 'taxel_array':
        said_of = loaded.contacts.states
        assert set(np.unique(truth['label'])) == {-1, 0, 1}
        held = (truth['label'] >= 0)[loaded.contacts.rows]
        right = said_of.label == truth['label'][loaded.contacts.rows]
        assert right[held].mean() > 0.9
    assert '<svg' in (tmp_path / 'report.html').read_text()


def test_a_new_head_is_taught_while_the_twin_of_a_skin_plays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def of_presses(key: str, seed: int, path: Path) -> Pipeline:
        """Heads by presses alone: their templates take longer than all the rest."""
        spec = load_sensor(key)
        config = replace(spec.config(), objects=())
        train = spec.presses(config, 1, 40)
        known = {name: train.truth[name] for name in ('label', 'in_contact', 'repetition')}
        spec.pipeline(config).fit(replace(train, truth=known)).save(path)
        return spec.load(path)

    monkeypatch.setattr(demo, 'fit_twin', of_presses)
    assert demo.run_twin('multipole_skin', tmp_path, 0, 17.0) == ['multipole_skin']
    said = capsys.readouterr()
    assert "enrolling it as 'bar_20x6'" in said.err
    assert apart(said.out) < ROUNDING
    assert re.search('bar_20x6 after it: [1-9].* windows named rightly', said.out)
    loaded = load(tmp_path / 'bags' / 'multipole_skin').recordings[0]
    (change,) = loaded.changes
    assert change.label == 'bar_20x6'
    live, stamps = loaded.contacts, loaded.recording.stamp_ns
    since = stamps[live.rows] > change.after_ns
    truth, named = loaded.recording.truth['label'][live.rows], live.states.label
    new = len(load_sensor('multipole_skin').config().objects)
    assert not (named[~since] == new).any()
    assert (named[since & (truth == new)] == new).sum() >= 2


def test_the_calibration_is_of_other_presses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, 'MOST_ROWS', 500)
    pipeline = demo.fit_twin('taxel_array', 1, tmp_path / 'c.npz')
    assert pipeline.calibrated
    assert np.isfinite(pipeline.baseline).all()


def test_a_sensor_that_is_none_is_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(['demo', '--sensor', 'none', '--output', str(tmp_path / 'x')]) == 2
    assert 'sensor must be one of' in capsys.readouterr().err
    assert not (tmp_path / 'x').exists()
