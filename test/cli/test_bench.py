# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile bench` and `tactile report`: side by side, as JSON, and where nothing is there."""

import argparse
import json
import subprocess
from pathlib import Path

import pytest

from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.cli import bench, console
from tactile_ros.cli.main import main


def test_without_benches_the_other_commands_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('tactile_ros.cli.bench.folder', lambda: None)
    assert main(['list']) == 0
    capsys.readouterr()
    for words in (['bench', 'all'], ['demo', 'grasp']):
        assert main(words) == 1
        (said,) = capsys.readouterr().err.splitlines()
        assert 'the benches are not installed; run `tactile' in said


def test_benches_side_by_side_measure_latency_last_and_tell_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 3 * (command[4] == 'roads'), f'{command[4]}\n')

    monkeypatch.setattr(bench.subprocess, 'run', run)
    options = argparse.Namespace(jobs=1, figures=None)
    chosen = ['fidelity', 'latency', 'reskin', 'roads']
    for extent, order in (
        ('normal', ['reskin', 'fidelity', 'roads', 'latency']),
        ('quick', ['reskin', 'fidelity', 'latency', 'roads']),
    ):
        assert bench._side_by_side(chosen, extent, tmp_path, options) == 3  # the first failure's
        assert capsys.readouterr().out.split('\n')[:4] == order


def test_benches_as_json_are_alone_on_stdout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Made:
        @staticmethod
        def run(extent: str, command: str) -> BenchResult:
            return BenchResult('roads', command, [1], [Row(f'of {extent}', 'mm', 1.0, aim=0.5)])

    monkeypatch.setattr(bench, 'load_bench', lambda _: Made)
    words = ['bench', 'roads', '--quick', '--results', str(tmp_path)]
    assert main([*words, '--json']) == 0
    (listed,) = json.loads(capsys.readouterr().out)
    assert listed == json.loads((tmp_path / 'roads.json').read_text())
    assert listed['rows'][0]['what'] == 'of quick'
    assert main(words) == 0
    assert '  seeds [1]; ' in capsys.readouterr().out
    (tmp_path / 'roads.json').write_text('mine')
    assert main(words) == 1
    assert 'roads.json is a file of another kind' in capsys.readouterr().err
    assert (tmp_path / 'roads.json').read_text() == 'mine'
    assert main([*words, '--overwrite']) == 0
    # a report of it has nothing to draw
    monkeypatch.setattr(console, 'check_png', lambda: None)
    assert main(['report', str(tmp_path), '--png', str(tmp_path / 'png')]) == 0
    assert 'no picture: these results have nothing to draw' in capsys.readouterr().err


def test_benches_beside_each_other_hear_their_own_nodes_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', '95')
    names = bench.names()
    domains = [int(bench.domain_of(name, names)['ROS_DOMAIN_ID']) for name in names]
    assert len(set(domains)) == len(names)
    assert 0 <= min(domains) <= max(domains) < 102
    monkeypatch.delenv('ROS_DOMAIN_ID')
    assert bench.domain_of(names[0], names)['ROS_DOMAIN_ID'] == '1'
