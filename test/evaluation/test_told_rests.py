"""Rests that the tares of a live run tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_ros.evaluation.loaded import LoadedRecording
from tactile_ros.evaluation.told_rests import with_rests
from tactile_ros.nodes.contact_stage import ContactStage
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame, Recording

SPEC = load_sensor('reskin_board')
PRESSES, REST, LONG, TARED = 12, 11, 60, 10
STEP_NS = 10_000_000


def presses(seed: int, drift: float = 0.0) -> tuple[Recording, np.ndarray]:
    """Presses of some forces after rests, of which a load cell alone tells, and the rests."""
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
        sequence=np.arange(count), truth={'force': force},
    )  # fmt: skip
    return recording, row == REST


def lived(recording: Recording, before: np.ndarray) -> LoadedRecording:
    """The same after a run without a calibration that was tared before some rows."""
    told: list[Frame] = []
    stage = ContactStage(SPEC.pipeline(), TARED, False, told.append)
    for row in range(len(recording)):
        if before[row]:
            assert stage.tare()[0]
        stage.process(recording.frame(row))
    return LoadedRecording('x', recording, baselines=tuple(told))


def test_the_frames_of_a_tare_are_its_rests() -> None:
    recording, before = presses(0)
    found = with_rests(lived(recording, before))
    wanted = np.concatenate([row - TARED + np.arange(TARED) for row in np.flatnonzero(before)])
    assert found.tare is not None
    assert np.flatnonzero(found.tare).tolist() == wanted.tolist()


def test_damaged_frames_are_passed_over_and_dead_taxels_are_not_asked() -> None:
    recording, before = presses(0)
    status = np.zeros((len(recording), 5), np.uint8)
    values = recording.values.copy()
    values[:, 4] = np.nan
    first = int(np.flatnonzero(before)[0])
    status[first - 3, 1] = 8
    damaged = replace(recording, values=values, status=status)
    run = lived(recording, before)
    taken = [row for row in range(first - TARED - 1, first) if row != first - 3]
    told = [
        replace(b, values=recording.values[taken].mean(axis=0)) if b.sequence == first else b
        for b in run.baselines
    ]
    blind = tuple(replace(b, values=np.where(np.arange(5)[:, None] == 4, np.nan, b.values))
                  for b in told)  # fmt: skip
    found = with_rests(replace(run, recording=damaged, baselines=blind)).tare
    assert found is not None
    assert np.flatnonzero(found)[:TARED].tolist() == taken
    assert found.sum() == PRESSES * TARED


@pytest.mark.parametrize('off', [1e-8, np.nan])
def test_a_baseline_that_no_frames_have_tells_nothing(off: float) -> None:
    recording, before = presses(0)
    run = lived(recording, before)
    others = tuple(replace(b, values=b.values + off) for b in run.baselines)
    assert with_rests(replace(run, baselines=others)).tare is None
    assert with_rests(LoadedRecording('x', recording)).tare is None
    lost = recording.select(slice(int(np.flatnonzero(before)[-1]), None))
    assert with_rests(replace(run, recording=lost)).tare is None


def test_what_has_tare_rows_stays() -> None:
    recording, before = presses(0)
    known = replace(recording, tare=before)
    assert with_rests(replace(lived(recording, before), recording=known)) is known


def test_a_load_cell_and_tares_are_enough_to_calibrate() -> None:
    learned, before = presses(0, drift=0.3)
    run = lived(learned, before)
    without = SPEC.pipeline(estimator='ridge').fit(learned)
    ours = SPEC.pipeline(estimator='ridge').fit(with_rests(run))
    assert not without.rest_.tared
    assert ours.rest_.tared
    fresh, rests = presses(1, drift=0.3)
    judged = with_rests(lived(fresh, rests))

    pressed = np.arange(len(fresh)) % (REST + LONG) >= REST  # since the tare of its press

    def error(found: np.ndarray) -> float:
        off = found[pressed, 2] - fresh.truth['force'][pressed, 2]
        return float(np.sqrt(np.nanmean(off**2)))

    assert error(ours.process_batch(judged).force) < 0.02
    assert error(without.process_batch(fresh).force) > 0.1
