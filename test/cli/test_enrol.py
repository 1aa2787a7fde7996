# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile enrol`: from a recording, by name and back; presses of a live run."""

from pathlib import Path

import numpy as np
import pytest

from reference import enrolled_skin
from reference.failing_frames import fail_at
from tactile_ros.cli.main import main
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.recording_files import LoadedRecording, save_recording
from tactile_ros.evaluation.replay import presses_in
from tactile_ros.types import Frame, Recording

SPEC = enrolled_skin.SPEC


def test_from_a_recording_and_back(
    own_skin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = SPEC.load(own_skin).digest
    save_recording(enrolled_skin.new_head(2), tmp_path / 'mugs.npz')
    words = ['enrol', 'mug', '--calibration', str(own_skin)]
    assert main([*words, '--from', str(tmp_path / 'mugs.npz')]) == 0
    said = capsys.readouterr().out
    assert "'mug' learned from 2 presses; it takes 0 % of 8 known presses" in said
    assert SPEC.load(own_skin).label_names[-1] == 'mug'
    assert main([*words, '--forget']) == 0
    assert "'mug' forgotten" in capsys.readouterr().out
    assert SPEC.load(own_skin).digest == before


def test_what_cannot_be_is_said_and_changes_nothing(
    own_skin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = own_skin.read_bytes()
    save_recording(enrolled_skin.new_head(1).select(slice(0, 70)), tmp_path / 'rest.npz')
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


def live_run(recording: Recording) -> LoadedRecording:
    """Presses as a bag holds them, with the baseline of a tare."""
    live = Recording.from_arrays(
        recording.layout, recording.values, stamp_ns=recording.stamp_ns,
        sequence=recording.sequence,
    )  # fmt: skip
    level = Frame(0, 0, recording.values[:40].mean(axis=0))
    return LoadedRecording('run', live, baselines=(level,))


@pytest.mark.parametrize('failing', [slice(3, 6), slice(None)])
def test_frames_that_fail_are_told_where_no_press_is_left(
    failing: slice, taught_skin: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, pipeline = live_run(enrolled_skin.new_head(2)), SPEC.load(taught_skin)
    stamps = run.recording.stamp_ns[failing]
    fail_at(monkeypatch, pipeline, stamps)
    if failing.start:  # at rest
        assert len(presses_in(run, pipeline)) == 2
    else:
        said = f'{len(stamps)} frames cannot be estimated .* Singular matrix'
        with pytest.raises(RecordingError, match=said):
            presses_in(run, pipeline)


def test_presses_of_a_live_run_are_found_as_it_found_them(taught_skin: Path) -> None:
    recording = enrolled_skin.new_head(3)
    found = presses_in(live_run(recording), SPEC.load(taught_skin))
    assert [len(press.frames) for press in found] == [10, 10, 10]
    for number, press in enumerate(found):
        rows = [frame.sequence for frame in press.frames]
        assert (recording.truth['in_contact'][rows] == 1).all()
        assert (recording.truth['repetition'][rows] == number).all()
        assert np.allclose(press.baseline, recording.values[:40].mean(axis=0), atol=5e-6)
