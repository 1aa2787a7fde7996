# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile export` on small bags."""

import sys
from pathlib import Path

import pytest

from tactile_ros.cli.main import main
from tactile_ros.sensors import load_sensor


def test_a_torn_bag_is_exported_as_far_as_it_goes_and_named(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn, out = tmp_path / 'torn.mcap', tmp_path / 'out'
    torn.write_bytes((bag / 'bag_0.mcap').read_bytes()[:-3000])
    assert main(['export', str(torn), '--csv', str(out)]) == 1
    printed = capsys.readouterr()
    assert 'left out: torn.mcap: torn.mcap' in printed.err
    assert 'MB/s' in printed.err
    assert (out / 'torn' / 'finger' / 'frames.csv').is_file()
    assert main(['export', str(bag), '--csv', str(out)]) == 1
    assert 'exists already' in capsys.readouterr().err


def test_the_folder_at_hand_has_its_name_and_no_name_colours_a_terminal(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bag)
    assert main(['export', '.', '--csv', str(tmp_path / '\x1b[31m')]) == 0
    assert (tmp_path / '\x1b[31m' / 'bag' / 'finger' / 'frames.csv').is_file()
    assert '\x1b' not in capsys.readouterr().err


def test_wrong_use_is_refused_in_a_sentence(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = ['--lerobot', str(tmp_path / 'out')]
    assert main(['export', str(bag), str(bag), *out]) == 2
    assert 'different names' in capsys.readouterr().err
    assert main(['export', str(bag), '--csv', str(bag / 'sub')]) == 1
    assert f'{bag}/sub is inside {bag}; name a folder outside it' in capsys.readouterr().err
    assert main(['export', 'gone', *out]) == 1
    assert capsys.readouterr().err == 'tactile export: gone does not exist\n'
    with pytest.raises(SystemExit):
        main(['export', str(bag), *out, '--fps', '0'])
    assert 'must be 1 to' in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    assert main(['export', str(bag), *out]) == 1
    assert 'pip install pyarrow' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def test_a_shipped_recording_is_exported_by_its_name(tmp_path: Path) -> None:
    assert main(['export', 'normal_1', '--csv', str(tmp_path / 'out')]) == 0
    lines = (tmp_path / 'out/normal_1/sensor/frames.csv').read_text().splitlines()
    shipped = load_sensor('reskin_board').recordings()['normal_1']
    assert len(lines) == 1 + len(shipped)
    row = dict(zip(lines[0].split(','), lines[-1].split(','), strict=True))
    assert float(row['Bz_4']) == shipped.values[-1, 4, 2]
