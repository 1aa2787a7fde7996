# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""tactile view of a recording: what a calibration says of it, and of which frames it cannot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.cli import view
from tactile_ros.cli.main import main
from tactile_ros.evaluation.recording_files import LoadedRecording
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

    from tactile_ros.types import Columns, Signals


def test_a_frame_that_cannot_be_estimated_is_told_and_shown_as_lost(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial']
    pipeline = spec.pipeline(estimator='ridge').fit(spatial.select(slice(0, 400)))
    few = spatial.select(slice(400, 420))
    kind = type(pipeline.estimation)
    healthy = kind.estimate

    def estimate(self: object, signals: Signals, memory: object) -> Columns:
        if (signals.values == few.values[7]).all(axis=(1, 2)).any():
            msg = 'Singular matrix'
            raise np.linalg.LinAlgError(msg)
        return healthy(self, signals, memory)

    monkeypatch.setattr(kind, 'estimate', estimate)
    shown = list(view.played(LoadedRecording('few', few), pipeline))
    assert [state.valid for _, _, state in shown] == [row != 7 for row in range(20)]
    assert 'few: 1 frames cannot be estimated and count as lost' in capsys.readouterr().err


@pytest.mark.parametrize('port', [-1, 65536])
def test_a_port_that_cannot_be_is_refused(port: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['view', '--sensor', 'reskin_board', f'--port={port}']) == 2
    assert f'--port must be 0 to 65535; received {port}' in capsys.readouterr().err


def test_a_csv_has_the_layout_of_the_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial'].select(slice(0, 400))
    spec.pipeline(estimator='ridge').fit(spatial).save(tmp_path / 'a.npz')
    names = [f'{channel}_{taxel}' for taxel in range(5) for channel in spatial.layout.channels]
    rows = spatial.values[:2].reshape(2, -1)
    np.savetxt(tmp_path / 'b.csv', rows, '%.9g', ',', header=','.join(names), comments='')
    words = ['view', str(tmp_path / 'b.csv'), '--port=0', '--no-open', '--speed=0', '--seconds=0']
    assert main(words) == 1
    assert 'name it or a calibration' in capsys.readouterr().err
    assert main([*words, '--calibration', str(tmp_path / 'a.npz')]) == 0
