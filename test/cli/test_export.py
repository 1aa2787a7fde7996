# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile export` on small bags."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import pytest

from benchmarks.replay import Messages
from tactile_ros.cli.main import main
from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    recording = load_sensor('reskin_board').recordings()['spatial'].select(slice(0, 20))
    messages = Messages(recording)
    layout = messages.layout()
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write('/finger/layout', layout.__msgtype__, 1, messages.cdr(layout), True)
        for row in range(20):
            stamp = 10_000_000 * (row + 1)
            frame = messages.frame(Frame(stamp, row, recording.values[row]))
            writer.write('/finger/frame', frame.__msgtype__, stamp, messages.cdr(frame))
    return tmp_path / 'bag'


def test_tables_are_written_with_rows_and_speed_shown(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    assert main(['export', str(bag), '--csv', str(out), '--json']) == 0
    printed = capsys.readouterr()
    (row,) = json.loads(printed.out)
    assert row == {'bag': 'bag', 'sensor': 'finger', 'frames': 20, 'contacts': 0, 'forces': 0}
    assert 'MB/s' in printed.err
    assert main(['export', str(bag), '--csv', str(out)]) == 1
    assert 'exists already' in capsys.readouterr().err


def test_a_torn_bag_is_exported_as_far_as_it_goes_and_named(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn = tmp_path / 'torn.mcap'
    torn.write_bytes((bag / 'bag_0.mcap').read_bytes()[:-3000])
    assert main(['export', str(torn), '--csv', str(tmp_path / 'out')]) == 1
    assert 'left out: torn.mcap: torn.mcap' in capsys.readouterr().err
    assert (tmp_path / 'out' / 'torn' / 'finger' / 'frames.csv').is_file()


def test_the_folder_at_hand_has_its_name_and_no_name_colours_a_terminal(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bag)
    assert main(['export', '.', '--csv', str(tmp_path / '\x1b[31m')]) == 0
    assert (tmp_path / '\x1b[31m' / 'bag' / 'finger' / 'frames.csv').is_file()
    assert '\x1b' not in capsys.readouterr().err
    assert main(['export', 'gone', '--csv', str(tmp_path / 'out')]) == 1
    assert capsys.readouterr().err == 'tactile export: gone does not exist\n'


def test_wrong_use_is_refused_in_a_sentence(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = ['--lerobot', str(tmp_path / 'out')]
    assert main(['export', str(bag), str(bag), *out]) == 2
    assert 'different names' in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(['export', str(bag), *out, '--fps', '0'])
    assert 'must be 1 to' in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    assert main(['export', str(bag), *out]) == 1
    assert 'pip install pyarrow' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
