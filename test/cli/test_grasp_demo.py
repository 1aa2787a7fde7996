# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile demo grasp` where something is missing; what it shows is tested in test/simulation."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from tactile_ros.cli import bench
from tactile_ros.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_without_mujoco_it_says_so_and_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    assert main(['demo', 'grasp', '--output', str(tmp_path / 'out')]) == 1
    said = capsys.readouterr().err
    assert 'simulated hands need MuJoCo: pip install mujoco' in said
    assert not (tmp_path / 'out').exists()


def test_without_the_sources_it_says_where_the_scenes_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, 'folder', lambda: None)
    assert main(['demo', 'grasp', '--output', str(tmp_path)]) == 1
    assert 'are not installed; run `tactile demo grasp` from a clone' in capsys.readouterr().err
