"""Many recordings: in one process, in several and on a cluster with the same numbers."""

from __future__ import annotations

import json
import os
import shutil
import signal
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.evaluation import fleet
from tactile_ros.evaluation.fleet import Job, Outcome, merged, save, table, tally, tally_all
from tactile_ros.evaluation.recording_files import save_recording
from tactile_ros.evaluation.result import environment
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    """Two calibrations, two bags, a file, and what is no recording."""
    place = tmp_path_factory.mktemp('fleet')
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial'].select(slice(0, 900))
    spec.pipeline(estimator='ridge').fit(spatial).save(place / 'a.npz')
    spec.pipeline(estimator='ridge').fit(spatial.select(slice(0, 500))).save(place / 'b.npz')
    write_bag(place / 'one', n=40)
    write_bag(place / 'two', n=30, lost=(4, 5))
    save_recording(spatial.select(slice(0, 200)), place / 'rows.npz')
    (place / 'broken').mkdir()
    return place


def jobs_of(folder: Path, *names: str) -> list[Job]:
    calibrations = (str(folder / 'a.npz'), str(folder / 'b.npz'))
    return [Job(str(folder / name), calibrations) for name in names]


def numbers(outcomes: list[Outcome]) -> list[object]:
    """Everything but times."""
    return [
        [
            (one.name, one.frames, one.dropped, one.problems, answer.calibration, answer.classes,
             {n: (t.errors.total, t.errors.squares, t.errors.bins.tolist(), t.inside)
              for n, t in answer.targets.items()})
            for one in outcome.tallies for answer in one.answers
        ] or 'failed'
        for outcome in outcomes
    ]  # fmt: skip


def test_a_failed_recording_is_an_outcome_and_the_rest_is_merged(folder: Path) -> None:
    heard: list[str] = []
    jobs = jobs_of(folder, 'one', 'broken', 'two', 'rows.npz', 'missing')
    found = tally_all(jobs, done=lambda outcome: heard.append(outcome.job.recording))
    assert heard == [job.recording for job in jobs]
    assert [bool(outcome.failure) for outcome in found] == [False, True, False, False, True]
    assert 'holds no bag' in found[1].failure
    assert 'does not exist' in found[4].failure
    whole = merged(found)
    assert whole is not None
    assert whole.frames == 40 + 28 + 200
    assert whole.dropped == 2
    assert [answer.calibration for answer in whole.answers] == ['a', 'b']
    twice = replace(jobs[0], calibrations=(str(folder / 'a.npz'), str(folder / 'again' / 'a.npz')))
    (folder / 'again').mkdir(exist_ok=True)
    shutil.copy(*twice.calibrations)
    (one,) = tally(twice).tallies
    assert [answer.calibration for answer in one.answers] == list(twice.calibrations)
    columns, rows = table(found)
    assert len(rows) == 4 * 2
    assert {row[columns.index('calibration')] for row in rows} == {'a', 'b'}


def test_the_result_is_saved_with_what_can_be_added_up(folder: Path, tmp_path: Path) -> None:
    found = tally_all(jobs_of(folder, 'rows.npz', 'broken', 'two'))
    text, arrays = save(tmp_path / 'out', found, 'tactile replay', environment())
    document = json.loads(text.read_text())
    parts = [one['answers'][0]['targets']['position'] for one in document['recordings']]
    whole = document['all']['answers'][0]['targets']['position']
    assert sum(int(part['sum'], 16) for part in parts) == int(whole['sum'], 16)
    assert list(document['failed']) == [str(folder / 'broken')]
    with np.load(arrays, allow_pickle=False) as stored:
        assert stored['0/0/position'].sum() == parts[0]['count'] > 0
        assert len(stored['bin_edges']) == len(stored['0/0/position']) - 1


def test_processes_find_the_same(folder: Path) -> None:
    jobs = jobs_of(folder, 'one', 'broken', 'two')
    together = tally_all(jobs, workers=2)
    assert numbers(together) == numbers(tally_all(jobs))
    assert [bool(outcome.failure) for outcome in together] == [False, True, False]


def test_a_killed_process_gives_its_jobs_back() -> None:
    heard: list[object] = []
    kill = signal.SIGKILL
    assert fleet._pool([kill], 1, heard.append, signal.raise_signal) == [kill]  # type: ignore[list-item]
    assert heard == []


def test_a_process_that_dies_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = [Job('deadly', ()), Job('good', ())]
    lost = {'deadly'}

    def pool(asked: list[Job], workers: int, heard: Callable[[Outcome], None]) -> list[Job]:
        if len(asked) > 1:
            return asked  # the pool broke: nobody knows whose fault it was
        if asked[0].recording in lost:
            return asked
        heard(Outcome(asked[0]))
        return []

    monkeypatch.setattr(fleet, '_pool', pool)
    found = tally_all(jobs, workers=2)
    assert found[0].failure == 'deadly: the process that read it died'
    assert not found[1].failure


@pytest.mark.slow
def test_a_dask_cluster_of_two_processes_finds_the_same(folder: Path) -> None:
    distributed = pytest.importorskip('distributed')
    jobs = jobs_of(folder, 'one', 'broken', 'two', 'rows.npz')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        heard: list[Outcome] = []

        def done(outcome: Outcome) -> None:
            if not heard:  # one of the two dies: its jobs go to the other
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
            heard.append(outcome)

        found = tally_all(jobs, scheduler=cluster.scheduler_address, done=done)
    assert len(heard) == len(jobs)
    assert numbers(found) == numbers(tally_all(jobs))
