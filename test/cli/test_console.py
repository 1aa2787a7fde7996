# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Progress on the terminal, and configs from yaml."""

import io
import re
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.cli import console
from tactile_ros.cli.console import SHARE, Progress, TimeEstimate, read_config, working
from tactile_ros.files import MOST_YAML_BYTES
from tactile_ros.sensors import load_sensor


class Heard(io.StringIO):
    """A stream that tells when something was written."""

    def __init__(self, tty: bool) -> None:
        super().__init__()
        self.tty, self.written = tty, threading.Event()

    def isatty(self) -> bool:
        return self.tty

    def write(self, text: str) -> int:
        count = super().write(text)
        self.written.set()
        return count


def spend(seconds: float = 0.02) -> None:
    """Work of a processor."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def test_working_says_what_takes_long() -> None:
    quick, file, terminal = Heard(tty=False), Heard(tty=False), Heard(tty=True)
    with working('fitting', quick, patience_s=60.0):
        pass
    for stream in (file, terminal):
        with working('fitting', stream, patience_s=0.0):
            assert stream.written.wait(60.0)
    assert (quick.getvalue(), file.getvalue()) == ('', 'fitting ...\n')
    assert terminal.getvalue().startswith('\rfitting ... ')
    assert terminal.getvalue().endswith('\r\033[K')


def test_working_says_how_long_all_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('tactile_ros.cli.console.STEP_S', 0.01)
    monkeypatch.setattr('os.sched_getaffinity', lambda _: {0, 1})
    stream = Heard(tty=False)
    with working('fitting', stream, patience_s=0.0, part=spend):
        while ' s of about ' not in stream.getvalue():
            assert stream.written.wait(60.0)
            stream.written.clear()
    assert re.fullmatch(
        r'fitting \.\.\.\nfitting \.\.\. \d+ s of about \d+ s\n', stream.getvalue()
    )


def fail() -> None:
    raise ValueError


@pytest.mark.parametrize(('work', 'share_s'), [(spend, 0.02), (fail, 0.0)])
def test_time_estimate_is_that_of_the_part(work: object, share_s: float) -> None:
    with TimeEstimate(work) as estimate:  # type: ignore[arg-type]
        estimate._beside.join(120.0)
        assert estimate._beside.exitcode == 0
        assert share_s * SHARE <= estimate.expected_s <= 10 * share_s * SHARE


def test_progress_is_a_bar_on_a_terminal_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('rich')
    with Progress(1) as progress:
        progress.step('one')
    assert capsys.readouterr().err == ''
    monkeypatch.setattr(sys.stderr, 'isatty', lambda: True)
    with Progress(2) as progress:
        progress.step('one')
        progress.step('two', 'it is empty')
    said = capsys.readouterr().err
    assert 'two failed: it is empty' in said
    assert '[1/2]' not in said


def test_times_of_a_busy_machine_are_doubted(capsys: pytest.CaptureFixture[str]) -> None:
    console.note_if_busy(0.0)
    assert not capsys.readouterr().err
    console.note_if_busy(1000.0)
    assert 'times mean little' in capsys.readouterr().err


def test_config_changes_fields_and_refuses_others(tmp_path: Path) -> None:
    spec = load_sensor('reskin_board')
    path = tmp_path / 'board.yaml'
    path.write_text('rate_hz: 2.5e2\nsaturation: [0.0066, 0.0066, 0.0106]\n')  # a text, says yaml
    config = read_config(spec, path)
    assert config.rate_hz == 250.0
    assert np.allclose(config.saturation, [0.0066, 0.0066, 0.0106])
    refused = {
        'nonsense: 1\n': "must map .*rate_hz.*received .'nonsense'",
        '- 1\n': r'must map .*received \[1\]',
        '!!python/object/apply:os.system ["true"]\n': 'is no plain yaml',
        'rate_hz: [1.0, 2.0]\n': 'rate_hz of ReskinBoardConfig must be a number from',
        'rate_hz: fast\n': 'rate_hz of ReskinBoardConfig must be a number from .*received fast',
        'positions: far\n': 'positions of ReskinBoardConfig must be numbers',
        'positions: [[1, 2], [3]]\n': r'config .*board.yaml: ',
        '#' * (MOST_YAML_BYTES + 1): f'at most {MOST_YAML_BYTES} bytes',
    }
    for text, words in refused.items():
        path.write_text(text)
        with pytest.raises(ValueError, match=words):
            read_config(spec, path)
    for path in (tmp_path, tmp_path / 'none.yaml'):
        with pytest.raises(ValueError, match=rf'config {path} must be a yaml file; there is none'):
            read_config(spec, path)
