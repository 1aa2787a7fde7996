"""Rests that the tares of a live run tell."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.cli import calibrate
from tactile_ros.cli.main import main
from tactile_ros.conditioning.baseline import tare_means, tare_runs
from tactile_ros.evaluation.recording_files import LiveContacts, LoadedRecording
from tactile_ros.evaluation.replay import batch_of, gathered, with_known_rests, with_tare_rows
from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, Frame, Recording

SPEC = load_sensor('reskin_board')
PRESSES, REST, LONG, TARED = 12, 11, 60, 10
STEP_NS = 10_000_000


def presses(seed: int, drift: float = 0.0) -> tuple[Recording, np.ndarray]:
    """Presses after rests, of which a load cell alone tells, and the rows that they begin at."""
    rng = np.random.default_rng(seed)
    count = PRESSES * (REST + LONG)
    row = np.arange(count) % (REST + LONG)
    push = rng.uniform(0.5, 3.0, PRESSES)[np.arange(count) // (REST + LONG)]
    push = push * np.sin(np.pi * np.clip((row - REST) / LONG, 0, 1))
    way = np.random.default_rng(1).normal(size=(5, 3)) * 1e-4
    walk = drift * np.cumsum(rng.normal(size=PRESSES))[np.arange(count) // (REST + LONG)]
    values = 1e-4 + (push + walk)[:, None, None] * way + rng.normal(0, 2e-7, (count, 5, 3))
    force = np.column_stack([np.full((count, 2), np.nan), push])
    recording = Recording.from_arrays(
        SPEC.layout(SPEC.config()), values, stamp_ns=STEP_NS * (1 + np.arange(count)),
        sequence=np.arange(count), status=np.zeros((count, 5), np.uint8), truth={'force': force},
    )  # fmt: skip
    return recording, np.flatnonzero(row == REST)


def lived(
    recording: Recording, before: np.ndarray, unheard: tuple[int, ...] = (), contacts: bool = True
) -> LoadedRecording:
    """The same after a run without a calibration that was tared before some rows."""
    told: list[Frame] = []
    parts: list[ContactStates] = []
    stage = ContactLoop(SPEC.pipeline(), TARED, False, told.append)
    rows = np.setdiff1d(np.arange(len(recording)), unheard)
    for row in rows:
        if row in before:
            assert stage.tare()[0]
        parts.append(batch_of(stage.process(recording.frame(int(row)))))
    states = gathered(parts, np.arange(len(rows)), len(rows), 5)
    live = LiveContacts(rows, states, recording.stamp_ns[rows], 0) if contacts else None
    return LoadedRecording('x', recording, live, tuple(told))


def serving(recording: Recording) -> np.ndarray:
    """Baseline of every run of tare rows."""
    run, _ = tare_runs(recording.tare, recording.restarts)
    return tare_means(recording.values, run)


@pytest.mark.parametrize('contacts', [True, False])
def test_the_frames_of_a_tare_are_its_rests(contacts: bool) -> None:
    recording, before = presses(0)
    found, told = with_tare_rows(lived(recording, before, contacts=contacts))
    wanted = np.concatenate([row - TARED + np.arange(TARED) for row in before])
    assert not told
    assert np.flatnonzero(found.tare).tolist() == wanted.tolist()


def test_streams_that_begin_anew_have_rests_of_their_own() -> None:
    recording, before = presses(0)
    half = before[PRESSES // 2] - REST
    number = np.arange(len(recording))
    again = replace(
        recording,
        sequence=np.where(number < half, number, number - half),
        stream=(number >= half).astype(int),
    )
    found, told = with_tare_rows(lived(again, before))
    assert not told
    assert np.count_nonzero(found.tare) == PRESSES * TARED


@pytest.mark.parametrize('what', ['error', 'stale taxel', 'silent chip', 'all stale'])
@pytest.mark.parametrize('back', [2, 5])
def test_frames_of_which_something_is_wrong_do_not_hide_a_tare(what: str, back: int) -> None:
    recording, before = presses(0)
    row = before - back
    if what == 'error':
        recording.status[row, 1] = 8
    elif what == 'stale taxel':
        recording.status[row, 1] = 1
    elif what == 'all stale':
        recording.status[row] = 1
    else:
        recording.values[row, 1] = 0.0
    run = lived(recording, before)
    found, told = with_tare_rows(run)
    assert not told
    levels = np.stack([b.values for b in run.baselines])
    assert levels.shape == (PRESSES, 5, 3)
    usable = [0, 2, 3, 4]  # a chip that is silent for one frame is left out of that frame alone
    assert np.abs(serving(found) - levels)[:, usable].max() < 2e-7


def test_a_frame_that_the_node_never_heard_hides_no_tare() -> None:
    recording, before = presses(0)
    found, told = with_tare_rows(lived(recording, before, tuple((before - 4).tolist())))
    assert not told
    assert len(serving(found)) == PRESSES


def test_a_tare_under_load_is_no_rest_and_is_told() -> None:
    recording, before = presses(0)
    also = np.append(before, before[3] + LONG // 2)
    found, told = with_tare_rows(lived(recording, also))
    assert told == '12 of 13 tares tell when nothing touched; 1 under load'
    assert np.count_nonzero(found.tare) == PRESSES * TARED


def test_a_baseline_of_frames_that_are_not_in_the_bag_is_no_rest() -> None:
    recording, before = presses(0)
    run = lived(recording, before)
    others = tuple(replace(b, stamp_ns=1) for b in run.baselines)
    found, told = with_tare_rows(replace(run, baselines=others))
    assert found.tare is None
    assert told.startswith('0 of 12 tares tell when nothing touched; 12 of frames that are not in')
    assert with_tare_rows(LoadedRecording('x', recording)) == (recording, '')


def test_what_has_tare_rows_stays() -> None:
    recording, before = presses(0)
    known = replace(recording, tare=np.isin(np.arange(len(recording)), before))
    assert with_tare_rows(replace(lived(recording, before), recording=known))[0] is known


def test_truth_that_is_always_there_puts_no_tare_under_load() -> None:
    recording, before = presses(0)
    count = len(recording)
    force = recording.truth['force'] + [0.05, 0.0, 0.08]  # a load cell's own offset, and noise
    force[:, 2] += np.random.default_rng(3).normal(0, 0.03, count)
    always = {'position': np.zeros((count, 3)), 'label': np.ones(count, int), 'force': force}
    run = lived(replace(recording, truth=always), np.append(before, before[3] + LONG // 2))
    found, told = with_tare_rows(run)
    assert told == '12 of 13 tares tell when nothing touched; 1 under load'
    assert np.count_nonzero(found.tare) == PRESSES * TARED
    mid = with_tare_rows(lived(replace(recording, truth=always), before + LONG // 2))
    assert mid[0].tare is None
    assert mid[1].endswith('12 under load')


def test_a_press_between_two_frames_of_a_tare_is_no_rest() -> None:
    recording, before = presses(0)
    row = np.arange(len(recording)) % (REST + LONG)
    recording.status[row > REST, 0] = 2  # clipped all the press long
    run = replace(recording, truth={})
    found, told = with_tare_rows(lived(run, before[1:] - REST + 5))
    assert not told
    assert np.count_nonzero(found.tare) == (PRESSES - 1) * 5
    assert not (found.tare & (row >= REST)).any()


def test_of_tares_that_meet_the_newest_serves() -> None:
    recording, _ = presses(0)
    values = np.random.default_rng(5).normal(1e-4, 1e-6, (200, 5, 3))
    count = np.arange(200)
    resting = Recording.from_arrays(
        recording.layout, values, stamp_ns=STEP_NS * (1 + count), sequence=count
    )
    run = lived(resting, np.arange(TARED, 200, TARED))
    found, told = with_tare_rows(run)
    assert not told
    assert np.array_equal(serving(found)[-1], tare_means(values[180:190], np.zeros(10, int))[0])


def test_few_tares_say_less_than_a_truth_that_knows_every_rest() -> None:
    recording, before = presses(0)
    touched = (recording.truth['force'][:, 2] > 0).astype(int)
    knowing = replace(recording, truth={**recording.truth, 'in_contact': touched})
    kept, told = with_tare_rows(lived(knowing, before[:2]))
    assert kept.tare is None
    assert told == 'tares of fewer than 30 frames in all are not heeded beside in_contact'
    assert with_tare_rows(lived(knowing, before))[0].tare is not None


def test_where_one_recording_has_tare_rows_others_have_their_rests() -> None:
    recording, before = presses(0)
    touched = (recording.truth['force'][:, 2] > 0).astype(int)
    knowing = replace(recording, truth={'in_contact': touched})
    tared, _ = with_tare_rows(lived(recording, before))
    assert with_known_rests([knowing, recording]) == [knowing, recording]
    first, second, third = with_known_rests([tared, knowing, recording])
    assert first is tared
    assert third is recording
    assert np.array_equal(second.tare, touched == 0)


def test_a_load_cell_and_tares_are_enough_to_calibrate() -> None:
    learned, before = presses(0, drift=0.3)
    without = SPEC.pipeline(estimator='ridge').fit(learned)
    ours = SPEC.pipeline(estimator='ridge').fit(with_tare_rows(lived(learned, before))[0])
    assert not without.rest_.tared
    assert ours.rest_.tared
    fresh, again = presses(1, drift=0.3)
    judged, _ = with_tare_rows(lived(fresh, again))
    pressed = np.arange(len(fresh)) % (REST + LONG) >= REST  # since the tare of its press

    def error(found: np.ndarray) -> float:
        off = found[pressed, 2] - fresh.truth['force'][pressed, 2]
        return float(np.sqrt(np.nanmean(off**2)))

    assert error(ours.process_batch(judged).force) < 0.02
    assert error(without.process_batch(fresh).force) > 0.1


def test_the_command_line_learns_the_rests_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, before = presses(0)
    run = lived(recording, np.append(before, before[3] + LONG // 2))
    monkeypatch.setattr(calibrate, 'find', lambda *_: ([run], []))
    file = tmp_path / 'force.npz'
    asked = ['calibrate', 'reskin_board', 'bag', '-o', str(file), '--estimator', 'ridge']
    assert main(asked) == 0
    said = capsys.readouterr()
    assert 'bag: 12 of 13 tares tell when nothing touched; 1 under load' in said.out
    assert 'cannot be tared' not in said.err
    assert main([*asked, '--json']) == 0
    json.loads(capsys.readouterr().out)
    assert SPEC.load(file).rest_.tared
