# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Waiting for a recording, without nodes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from tactile_ros.cli import record
from tactile_ros.errors import RecordingError, TactileError
from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.nodes.graph import Graph, Process


def running(*alive: bool) -> SimpleNamespace:
    """Processes that say one after the other whether they live, then do."""
    answers = iter(alive)
    graph = Graph((Process('record', {}), Process('sensor_node', {})))
    return SimpleNamespace(graph=graph, is_alive=lambda _: next(answers, True))


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Bags that were looked into; frames are in the third look."""
    seen: list[Path] = []

    def load(bag: Path) -> None:
        seen.append(bag)
        if len(seen) < 3:
            msg = 'holds no frames'
            raise RecordingError(msg)

    monkeypatch.setattr(record, 'load', load)
    monkeypatch.setattr(record, 'LOOK_S', 0.0)
    return seen


def test_frames_are_waited_for(looks: list[Path]) -> None:
    record.wait_for_frames(running(), Path('bag'))
    assert looks == [Path('bag')] * 3


def test_nobody_waits_for_what_has_ended(looks: list[Path]) -> None:
    record.wait_for_frames(running(True, True, True, False), Path('bag'))
    assert looks == [Path('bag')]


def test_no_frame_is_told(looks: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record, 'FIRST_FRAME_S', -1.0)
    with pytest.raises(TactileError, match='no frame came within -1 s: holds no frames'):
        record.wait_for_frames(running(), Path('bag'))
    assert len(looks) == 1


def test_a_bag_without_a_message_is_a_failure(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with BagWriter(bag):
        pass
    with pytest.raises(TactileError, match='nothing was heard in /thumb'):
        record.refuse_empty(bag, 'thumb')
    with BagWriter(tmp_path / 'other') as other:
        other.write('/label', 'std_msgs/msg/String', 1, b'\0' * 8)
    record.refuse_empty(tmp_path / 'other', '')
