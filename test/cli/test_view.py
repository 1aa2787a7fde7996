# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile view`: what it refuses before anybody looks, and what it plays."""

from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from reference.failing_frames import fail_at
from tactile_ros.cli import view
from tactile_ros.cli.main import main
from tactile_ros.evaluation.recording_files import LoadedRecording, load_recording
from tactile_ros.sensors import load_sensor


@pytest.mark.parametrize(
    ('words', 'code', 'said'),
    [
        (['a.npz', '--sensor', 'gradiometer'], 2, 'name a recording or --sensor'),
        (['--board', '/dev/ttyACM0'], 2, '--board needs the --sensor'),
        (['a.npz', '--speed', '-1'], 2, '--speed and --seconds must be 0 or more'),
        (['a.npz', '--port=-1'], 2, '--port must be 0 to 65535; received -1'),
        (['a.npz', '--port=65536'], 2, '--port must be 0 to 65535; received 65536'),
        (['a.npz', '--loop', '--speed', '0'], 2, '--loop needs a recording and a --speed above 0'),
        (['--loop'], 2, '--loop needs a recording'),
        (['--seconds', '-1'], 2, '--seconds must be 0 or more'),
        (['a.npz', '--mcap', __file__], 1, 'exists already'),
        (['--sensor', 'no_such'], 2, 'sensor must be one of five_wire_skin, gradiometer'),
        (['no_such'], 1, 'no_such does not exist; name a bag, .npz or .csv'),
        ([__file__], 1, 'is no bag'),
        (['--sensor', 'gradiometer', '--calibration', 'none.npz'], 1, 'none.npz does not exist'),
    ],
)
def test_wrong_use_is_refused_before_an_address_is_told(
    words: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['view', *words]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_frame_that_cannot_be_estimated_is_told_and_shown_as_lost(
    board_files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pipeline = load_sensor('reskin_board').load(board_files / 'a.npz')
    few = load_recording(board_files / 'presses.npz').select(slice(0, 20))
    fail_at(monkeypatch, pipeline, few.stamp_ns[7])
    shown = list(view.played(LoadedRecording('few', few), pipeline))
    assert [state.valid for _, _, state in shown] == [row != 7 for row in range(20)]
    assert 'few: 1 frames cannot be estimated and count as lost' in capsys.readouterr().err


def test_a_csv_has_the_layout_of_the_calibration(
    board_files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    presses = load_recording(board_files / 'presses.npz')
    names = [f'{channel}_{taxel}' for taxel in range(5) for channel in presses.layout.channels]
    rows = presses.values[:2].reshape(2, -1)
    np.savetxt(tmp_path / 'b.csv', rows, '%.9g', ',', header=','.join(names), comments='')
    words = ['view', str(tmp_path / 'b.csv'), '--port=0', '--no-open', '--speed=0', '--seconds=0']
    assert main(words) == 1
    assert 'name the sensor or a calibration' in capsys.readouterr().err
    assert main([*words, '--calibration', str(board_files / 'a.npz')]) == 0
    words = ['view', '--sensor', 'gradiometer', *words[2:], '--calibration']
    assert main([*words, str(board_files / 'a.npz')]) == 1
    assert "must be of gradiometer; it is of 'reskin_board'" in capsys.readouterr().err
    words[2], config = 'reskin_board', load_sensor('reskin_board').config(positions=np.eye(4, 3))
    load_sensor('reskin_board').pipeline(config).save(tmp_path / 'four.npz')
    assert main([*words, str(tmp_path / 'four.npz'), '--seconds=0.5']) == 0  # a twin of four chips


def test_a_twin_says_about_how_long_it_learns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(view, 'PATIENCE_S', 0.0)
    board = load_sensor('reskin_board')
    few = board.recordings()['spatial'].select(slice(0, 800))
    spec = SimpleNamespace(presses=lambda *_: few, pipeline=lambda c: board.pipeline(c, 'ridge'))
    assert view.fitted(spec, board.config(), 1).calibrated
    assert 'calibrating on simulated presses, about' in capsys.readouterr().err


def test_a_page_says_while_a_twin_is_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[dict[str, object] | None] = []
    learn = Event()
    monkeypatch.setattr(view.PageServer, 'guide', lambda _, stated: told.append(stated))
    monkeypatch.setattr(view, 'fitted', lambda spec, config, _: learn.wait(60) and spec.pipeline())
    monkeypatch.setattr(view.LivePipeline, 'process', lambda *_: learn.set())
    monkeypatch.setattr(view.PageServer, 'show', lambda *_: None)
    words = ['view', '--sensor', 'reskin_board', '--no-open', '--port', '0', '--seconds', '1']
    assert main(words) == 0
    assert [stated and stated['text'] for stated in told] == [view.LEARNING, None]
