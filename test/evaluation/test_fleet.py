# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Many recordings: in one process, in several and on a cluster with the same numbers."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from copy import copy
from dataclasses import astuple, replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from reference import made_bags as make
from tactile_ros.evaluation import fleet, recording_files, replay
from tactile_ros.evaluation.metrics import ROWS, frames_dropped
from tactile_ros.evaluation.recording_files import ClassesChangedError, load, save_recording
from tactile_ros.evaluation.report import Dataset, environment, for_drawing
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two calibrations, two bags, a file, and what is no recording."""
    place = tmp_path_factory.mktemp('fleet')
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial'].select(slice(0, 900))
    spec.pipeline(estimator='ridge').fit(spatial).save(place / 'a.npz')
    spec.pipeline(estimator='ridge').fit(spatial.select(slice(0, 500))).save(place / 'b.npz')
    make.write_bag(place / 'one', n=40)
    make.write_bag(place / 'two', n=30, lost=(4, 5))
    save_recording(spatial.select(slice(0, 200)), place / 'rows.npz')
    save_recording(spatial.select(slice(300, 400)), place / 'more.npz')
    (place / 'broken').mkdir()
    return place


def jobs_of(folder: Path, *names: str) -> list[fleet.Job]:
    calibrations = (str(folder / 'a.npz'), str(folder / 'b.npz'))
    return [fleet.Job(str(folder / name), calibrations) for name in names]


def test_a_failed_recording_is_an_outcome_and_the_rest_is_merged(folder: Path) -> None:
    heard: list[str] = []
    jobs = jobs_of(folder, 'one', 'broken', 'two', 'rows.npz', 'missing', 'more.npz')
    found = fleet.run_jobs(jobs, done=lambda outcome: heard.append(outcome.job.recording))
    assert heard == [job.recording for job in jobs]
    assert [bool(outcome.failure) for outcome in found] == [False, True, False, False, True, False]
    assert 'holds no bag' in found[1].failure
    assert 'does not exist' in found[4].failure
    whole = fleet.pooled(found)
    assert whole.frames == 40 + 28 + 200 + 100
    assert whole.dropped == 2
    assert [answer.calibration for answer in whole.answers] == ['a', 'b']
    twice = replace(jobs[0], calibrations=(str(folder / 'a.npz'), str(folder / 'again' / 'a.npz')))
    (folder / 'again').mkdir(exist_ok=True)
    shutil.copy(*twice.calibrations)
    (one,) = fleet.run_job(twice).results
    assert [answer.calibration for answer in one.answers] == list(twice.calibrations)
    columns, rows = fleet.table(found)
    assert len(rows) == 5 * 2
    assert {row[columns.index('calibration')] for row in rows} == {'a', 'b'}
    text, arrays = fleet.save(folder / 'saved', found, 'tactile replay', environment())
    document = json.loads(text.read_text())
    parts = [one['answers'][0]['targets']['position'] for one in document['recordings']]
    pool = document['all']['answers'][0]['targets']['position']
    for name in ('count', 'sum', 'sum_of_squares'):
        assert sum(part[name] for part in parts) == pytest.approx(pool[name], rel=1e-12)
    assert list(document['failed']) == [str(folder / name) for name in ('broken', 'missing')]
    with np.load(arrays, allow_pickle=False) as stored:
        assert stored['2/0/position'].sum() == parts[2]['count'] > 0
        assert len(stored['bin_edges']) == len(stored['2/0/position']) - 1


def numbers(outcomes: list[fleet.Outcome]) -> list[object]:
    """Everything but times."""
    return [
        (one.name, one.frames, one.dropped, one.problems, answer.calibration, answer.hits,
         repr([(t.name, t.spread, t.coverage) for t in answer.targets]))
        for outcome in outcomes for one in outcome.results for answer in one.answers
    ]  # fmt: skip


def test_a_killed_process_gives_its_jobs_back_and_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    heard: list[object] = []
    kill = signal.SIGKILL
    assert fleet._pool([kill], 1, heard.append, signal.raise_signal) == [kill]  # type: ignore[list-item]
    assert heard == []
    jobs = [fleet.Job('deadly', ()), fleet.Job('good', ())]

    def pool(
        asked: list[fleet.Job], workers: int, heard: Callable[[fleet.Outcome], None]
    ) -> list[fleet.Job]:
        if len(asked) > 1 or asked[0].recording == 'deadly':
            return asked  # the pool broke: nobody knows whose fault it was
        heard(fleet.Outcome(asked[0]))
        return []

    monkeypatch.setattr(fleet, '_pool', pool)
    dead, good = fleet.run_jobs(jobs, workers=2)
    assert dead.failure == 'deadly: the process that read it died'
    assert not good.failure


@pytest.mark.slow
def test_a_dask_cluster_of_two_processes_finds_the_same(folder: Path) -> None:
    distributed = pytest.importorskip('distributed')
    jobs = jobs_of(folder, 'one', 'broken', 'two', 'rows.npz')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        heard: list[fleet.Outcome] = []

        def done(outcome: fleet.Outcome) -> None:
            if not heard:  # one of the two dies: its jobs go to the other
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
            heard.append(outcome)

        found = fleet.run_jobs(jobs, scheduler=cluster.scheduler_address, done=done)
    assert len(heard) == len(jobs)
    assert numbers(found) == numbers(fleet.run_jobs(jobs))


STEP_NS = 20_000_000
TRUTH = ('truth/contacts', 'wrench', 'label')
FRAMES = 330


@pytest.fixture(scope='module')
def pipeline() -> Pipeline:
    spec = load_sensor('reskin_board')
    return spec.pipeline(estimator='ridge').fit(spec.recordings()['spatial'].select(slice(0, 900)))


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory, pipeline: Pipeline) -> Path:
    """A live run with all that happens: tares, lost and unseen frames, a restart, three truths."""
    spatial, rng = load_sensor('reskin_board').recordings()['spatial'], np.random.default_rng(5)
    touch = [k // 11 * 2 + (k % 11 >= 8) for k in range(FRAMES)]
    frames = [
        Frame(10**9 + k * STEP_NS + (3600 * 10**9 if k < 200 else 0), k % 200,
              spatial.values[touch[k]] + rng.normal(0, 1e-7, (5, 3)))
        for k in range(FRAMES)
    ]  # fmt: skip

    def truth(k: int, frame: Frame, put: Callable[..., None]) -> None:
        place = spatial.truth['position'][touch[k]]
        message = make.contacts(frame.sequence, frame.stamp_ns, place)
        message.in_contact = int(k % 11 >= 8)
        put('truth/contacts', message, 7_000_000)
        for late in (0, 7_000_000, 14_000_000):
            put('wrench', make.wrench(frame.stamp_ns + late, (0, 0, touch[k] % 2)), late)
        if k % 60 == 3:
            put('label', make.new('String', data=('mug', 'nut')[k % 2]))

    path = tmp_path_factory.mktemp('bags') / 'live'
    tares, unseen, lost = range(5, FRAMES, 33), range(39, FRAMES, 40), range(49, FRAMES, 50)
    make.record(path, copy(pipeline), frames, tares, unseen, lost, truth)
    return path


def judged(path: Path, pipeline: Pipeline, **options: object) -> Dataset:
    clock = count(0, 1000)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(replay, 'perf_counter_ns', lambda: next(clock))
        (found,) = fleet.evaluate_bag(path, {'c': pipeline}, TRUTH, **options)
    return found


def same(one: Dataset, other: Dataset) -> None:
    """Counts are equal, figures up to the rounding of products of one row and of many."""
    assert (one.frames, one.dropped) == (other.frames, other.dropped)
    assert np.array_equal(one.latency_s, other.latency_s)
    for a, b in zip(one.answers, other.answers, strict=True):
        assert a.agreement.frames == b.agreement.frames
        assert a.agreement.without_contacts == b.agreement.without_contacts > 0
        assert max(a.agreement.largest, b.agreement.largest) <= 1e-12
        assert a.hits == b.hits
        assert a.hits['in_contact']['right'] > 100
        assert 'label' not in a.hits  # the pipeline knows no mug
        for mine, theirs in zip(a.targets, b.targets, strict=True):
            assert (mine.name, mine.missed) == (theirs.name, theirs.missed)
            for name in ('spread', 'coverage'):
                figures, others = astuple(getattr(mine, name)), astuple(getattr(theirs, name))
                assert figures == pytest.approx(others, rel=1e-9, nan_ok=True)
            for name in ROWS:
                columns = getattr(mine, name), getattr(theirs, name)
                np.testing.assert_allclose(*columns, rtol=1e-9, atol=1e-15)


@pytest.fixture
def in_pieces(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, int], None]:
    def change(frames: int, horizon_ns: int) -> None:
        monkeypatch.setattr(recording_files, 'PIECE', frames)
        monkeypatch.setattr(recording_files, 'HORIZON_NS', horizon_ns)

    return change


@pytest.mark.parametrize('frames', [1, 7, 200])
def test_pieces_of_any_length_are_the_bag_in_memory(
    bag: Path, pipeline: Pipeline, in_pieces: Callable[[int, int], None], frames: int
) -> None:
    (loaded,) = load(bag, None, TRUTH).recordings
    whole = for_drawing(fleet.evaluate(loaded, {'c': copy(pipeline)}))
    in_pieces(frames, 300_000_000)
    pieces = for_drawing(judged(bag, pipeline))
    same(pieces, whole)
    assert pieces.frames == len(loaded.recording) == FRAMES - 6
    assert pieces.dropped == frames_dropped(loaded.recording.sequence, loaded.recording.restarts)
    (told,) = (text for text in pieces.problems if text.startswith('no latency'))
    assert told in whole.problems  # its frames are an hour ahead of the recorder


def test_a_run_is_also_judged_after_its_first_tare_alone(bag: Path, pipeline: Pipeline) -> None:
    (answer,) = judged(bag, pipeline, untared=True).answers
    tared, untared = (one.target('position').spread for one in (answer, answer.untared))
    assert tared.count > 50
    assert untared.mean != tared.mean
    assert answer.untared.agreement is None
    assert answer.contact is not None  # truth says in_contact
    (loaded,) = load(bag, None, TRUTH).recordings
    whole = fleet.evaluate(fleet.with_first_tare(loaded), {'c': copy(pipeline)}).answers[0]
    assert whole.target('position').spread.mean == pytest.approx(untared.mean, rel=1e-9)


def test_contacts_without_a_frame_are_counted_once(
    pipeline: Pipeline, tmp_path: Path,
    in_pieces: Callable[[int, int], None],
) -> None:  # fmt: skip
    path = tmp_path / 'bag'
    with make.Bag(path) as bag:
        bag.put('/layout', make.layout(), 1)
        for k in range(40):
            frame = make.frame(k, np.zeros(15), k * STEP_NS + 1)
            about = make.contacts(k if k % 10 else 1000 + k, k * STEP_NS + 1)
            bag.put('/frame', frame, k * STEP_NS + 2)
            bag.put('/contacts', about, k * STEP_NS + 3)
    in_pieces(6, 100_000_000)
    found = judged(path, pipeline)
    assert '4 contacts are about frames that were not recorded' in found.problems
    (answer,) = found.answers
    assert (answer.agreement.frames, answer.agreement.without_contacts) == (36, 4)


def test_a_run_that_learned_a_class_is_held_in_memory(pipeline: Pipeline, tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    told = {'sha256': 'a' * 64, 'enrolled': 'mug', 'presses': [[1, 2]], 'after_ns': 5}
    with make.Bag(path) as bag:
        bag.put('/layout', make.layout(), 1)
        for k in range(9):
            frame = make.frame(k, np.zeros(15), k * STEP_NS + 1)
            bag.put('/frame', frame, k * STEP_NS + 2)
        bag.put('/calibration', make.new('String', data=json.dumps(told)), 9 * STEP_NS)
    with pytest.raises(ClassesChangedError):
        judged(path, pipeline)
    pipeline.save(tmp_path / 'c.npz')
    outcome = fleet.run_job(fleet.Job(str(path), (str(tmp_path / 'c.npz'),)))
    assert outcome.failure == ''
    assert outcome.results[0].frames == 9
