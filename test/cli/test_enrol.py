"""tactile enrol: from a recording, by name and back, and from a running node."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.cli.main import main
from tactile_ros.evaluation.archive import save_recording
from tactile_ros.evaluation.class_changes import presses_in
from tactile_ros.evaluation.loaded import LoadedRecording
from tactile_ros.types import Frame, Recording
from test.reference import enrolled_skin

if TYPE_CHECKING:
    from pathlib import Path

SPEC = enrolled_skin.SPEC


def test_from_a_recording_and_back(
    own_skin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = SPEC.load(own_skin).digest
    presses = enrolled_skin.new_head(2)
    save_recording(presses, tmp_path / 'mugs.npz')
    words = ['enrol', 'mug', '--calibration', str(own_skin)]
    assert main([*words, '--from', str(tmp_path / 'mugs.npz')]) == 0
    assert (
        "'mug' learned from 2 presses; it takes 0 % of 8 known presses" in capsys.readouterr().out
    )
    assert SPEC.load(own_skin).label_names[-1] == 'mug'
    assert main([*words, '--forget']) == 0
    assert "'mug' forgotten" in capsys.readouterr().out
    assert SPEC.load(own_skin).digest == before


def test_what_cannot_be_is_said_and_changes_nothing(
    own_skin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = own_skin.read_bytes()
    rest = enrolled_skin.new_head(1).select(slice(0, 70))
    save_recording(rest, tmp_path / 'rest.npz')
    file = ['--calibration', str(own_skin)]
    for words, sentence in (
        (['mug', '--from', str(tmp_path / 'rest.npz'), *file], 'found none'),
        (['mug', '--forget', *file], "received 'mug'"),
        (['mug', '--from', 'nowhere', *file], 'nowhere does not exist'),
        (['mug', '--from', 'nowhere'], '--from needs --calibration'),
        (['mug', *file], '--calibration needs --from'),
    ):
        assert main(['enrol', *words]) != 0
        assert sentence in capsys.readouterr().err
    assert own_skin.read_bytes() == content


def test_presses_of_a_live_run_are_found_as_it_found_them(taught_skin: Path) -> None:
    recording = enrolled_skin.new_head(3)
    live = Recording.from_arrays(
        recording.layout, recording.values, stamp_ns=recording.stamp_ns,
        sequence=recording.sequence,
    )  # fmt: skip
    level = Frame(0, 0, recording.values[:40].mean(axis=0))
    found = presses_in(LoadedRecording('run', live, baselines=(level,)), SPEC.load(taught_skin))
    assert [len(press.frames) for press in found] == [10, 10, 10]
    touched = recording.truth['in_contact'] == 1
    for number, press in enumerate(found):
        rows = [frame.sequence for frame in press.frames]
        assert touched[rows].all()
        assert (recording.truth['repetition'][rows] == number).all()
        assert np.allclose(press.baseline, level.values, atol=5e-6)
