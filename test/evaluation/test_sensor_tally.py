"""A bag judged piece by piece beside the same bag held in memory as a whole."""

from __future__ import annotations

import json
from array import array
from copy import copy
from dataclasses import astuple, replace
from itertools import count
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.cli.replay import evaluate
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import sensor_pieces
from tactile_ros.evaluation.answer_tally import AnswerTally
from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.evaluation.figures import figures_of
from tactile_ros.evaluation.fleet import Job, tally
from tactile_ros.evaluation.metrics import frames_dropped
from tactile_ros.evaluation.recording_files import load
from tactile_ros.evaluation.replay import replay
from tactile_ros.evaluation.sensor_pieces import ClassesChangedError
from tactile_ros.evaluation.sensor_tally import tally_bag
from tactile_ros.evaluation.tallied import dataset_of
from tactile_ros.evaluation.truth import Association
from tactile_ros.messages import fill_contacts
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import SimpleNamespace

    from tactile_ros.evaluation.result import Dataset
    from tactile_ros.evaluation.sensor_tally import SensorTally
    from tactile_ros.pipeline import Pipeline

STEP_NS = 20_000_000
TRUTH = ('truth/contacts', 'wrench', 'label')
FRAMES = 330


@pytest.fixture(scope='module')
def pipeline() -> Pipeline:
    spec = load_sensor('reskin_board')
    return spec.pipeline(estimator='ridge').fit(spec.recordings()['spatial'].select(slice(0, 900)))


class LiveRun:
    """A live run with all that happens: tares, lost and unseen frames, a restart, three truths."""

    def __init__(self, path: Path, make: SimpleNamespace, pipeline: Pipeline) -> None:
        self.make, self.pipeline = make, copy(pipeline)  # its tares are its own
        self.spatial = load_sensor('reskin_board').recordings()['spatial']
        self.rng = np.random.default_rng(5)
        with BagWriter(path) as self.bag:
            self.put('/layout', make.layout(), 1)
            self.put('/calibration', make.String(data=pipeline.digest), 1)
            self.pipeline.reset()
            for k in range(FRAMES):
                self.step(k)

    def put(self, topic: str, message: object, log_ns: int) -> None:
        for name, value in vars(message).items():
            if isinstance(value, array):
                setattr(message, name, np.array(value))
        self.bag.write(topic, message.__msgtype__, log_ns, self.make.cdr(message))

    def step(self, k: int) -> None:
        restarted = k >= 200
        number = k - 200 if restarted else k
        touch = k // 11 * 2 + (k % 11 >= 8)
        values = self.spatial.values[touch] + self.rng.normal(0, 1e-7, (5, 3))
        log_ns = 10**9 + k * STEP_NS
        frame = Frame(log_ns + (3600 * 10**9 if not restarted else 0), number, values)
        if restarted and number == 0:
            self.pipeline.reset()
        if k % 33 == 5:
            rest = self.make.frame(number, values, frame.stamp_ns)
            self.put('/baseline', rest, log_ns)
            self.pipeline.tare([frame])
        if k % 50 != 49:
            self.put('/frame', self.make.frame(number, values, frame.stamp_ns), log_ns + 1)
        if k % 40 != 39 and k % 50 != 49:
            state = self.pipeline.process(frame)
            message = self.make.contacts(number, frame.stamp_ns)
            fill_contacts(message, state, lambda: self.make.contacts(0, 0).contacts[0])
            self.put('/contacts', message, log_ns + 5_000_000)
        self.truth(k, touch, frame, log_ns)

    def truth(self, k: int, touch: int, frame: Frame, log_ns: int) -> None:
        place = self.spatial.truth['position'][touch]
        message = self.make.contacts(frame.sequence, frame.stamp_ns, place)
        message.in_contact = int(k % 11 >= 8)
        self.put('/truth/contacts', message, log_ns + 7_000_000)
        push = self.make.Vector3(x=0.0, y=0.0, z=float(touch % 2))
        none = self.make.Vector3(x=np.nan, y=np.nan, z=np.nan)
        for late in (0, 7_000_000, 14_000_000):
            wrench = self.make.WrenchStamped(
                header=self.make.header(frame.stamp_ns + late),
                wrench=self.make.Wrench(force=push, torque=none),
            )
            self.put('/wrench', wrench, log_ns + late)
        if k % 60 == 3:
            self.put('/label', self.make.String(data=('mug', 'nut')[k % 2]), log_ns)


@pytest.fixture(scope='module')
def bag(
    tmp_path_factory: pytest.TempPathFactory, make: SimpleNamespace, pipeline: Pipeline
) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'live'
    LiveRun(path, make, pipeline)
    return path


def judged(path: Path, pipeline: Pipeline, **options: object) -> SensorTally:
    clock = count(0, 1000)
    (found,) = tally_bag(path, {'c': pipeline}, TRUTH, clock_ns=lambda: next(clock), **options)
    return found


def same(one: SensorTally, other: SensorTally) -> None:
    """Counts are equal, figures up to the rounding of products of one row and of many."""
    assert (one.frames, one.dropped) == (other.frames, other.dropped)
    for a, b in zip(one.answers, other.answers, strict=True):
        assert a.agreement is not None
        assert b.agreement is not None
        assert a.agreement.frames == b.agreement.frames
        assert max(a.agreement.largest, b.agreement.largest) <= 1e-12
        assert a.classes == b.classes
        assert list(a.targets) == list(b.targets)
        for name, target in a.targets.items():
            found = b.targets[name]
            assert target.errors.spread.count == found.errors.spread.count
            assert (target.inside, target.missed, target.invalid) == (
                found.inside, found.missed, found.invalid,
            )  # fmt: skip
            one_spread, other_spread = target.errors.spread, found.errors.spread
            for figure in ('mean', 'rms', 'p95'):
                value = pytest.approx(getattr(other_spread, figure), rel=1e-12, nan_ok=True)
                assert getattr(one_spread, figure) == value
    assert sorted(one.problems) == sorted(other.problems)


@pytest.fixture
def in_pieces(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, int], None]:
    def change(frames: int, horizon_ns: int) -> None:
        monkeypatch.setattr(sensor_pieces, 'PIECE', frames)
        monkeypatch.setattr(sensor_pieces, 'HORIZON_NS', horizon_ns)

    return change


@pytest.mark.parametrize('frames', [1, 7, 64, 200])
def test_pieces_of_any_length_are_the_whole(
    bag: Path, pipeline: Pipeline, in_pieces: Callable[[int, int], None], frames: int
) -> None:
    whole = judged(bag, pipeline)
    in_pieces(frames, 300_000_000)
    same(judged(bag, pipeline), whole)


def test_the_whole_is_what_the_road_through_memory_finds(bag: Path, pipeline: Pipeline) -> None:
    found = judged(bag, pipeline)
    (loaded,) = load(bag, None, TRUTH).recordings
    slow = replay(loaded, pipeline)
    assert found.frames == len(loaded.recording) == FRAMES - 6
    assert found.dropped == frames_dropped(loaded.recording.sequence, loaded.recording.restarts)
    (answer,) = found.answers
    assert answer.agreement is not None
    assert answer.agreement.largest <= 1e-12
    assert slow.agreement is not None
    assert answer.agreement.without_contacts == slow.agreement.without_contacts > 0
    expected = AnswerTally.of(loaded.recording.truth, slow.states)
    assert answer.targets['position'].errors.count == expected.targets['position'].errors.count
    for name in ('position', 'force_z'):
        fast, reference = answer.targets[name], expected.targets[name]
        assert (fast.missed, fast.invalid) == (reference.missed, reference.invalid)
        if fast.errors.count:
            assert fast.errors.spread.rms == pytest.approx(reference.errors.spread.rms, rel=1e-9)
    assert answer.classes['in_contact'] == expected.classes['in_contact']
    assert answer.classes['in_contact'].right > 100


@pytest.mark.parametrize('frames', [7, 4096])
def test_the_report_of_pieces_is_that_of_the_bag_in_memory(
    bag: Path, pipeline: Pipeline, in_pieces: Callable[[int, int], None], frames: int
) -> None:
    (loaded,) = load(bag, None, TRUTH).recordings
    whole = evaluate(loaded, [copy(pipeline)])
    in_pieces(frames, 300_000_000)
    pieces = dataset_of(judged(bag, pipeline, drawn=True))
    assert (pieces.frames, pieces.dropped) == (whole.frames, whole.dropped)
    assert np.array_equal(pieces.latency_s, whole.latency_s)
    (told,) = (text for text in pieces.problems if text.startswith('no latency'))
    assert told in whole.problems  # its frames are an hour ahead of the recorder
    assert np.array_equal(pieces.chips, whole.chips)
    (mine,), (theirs,) = pieces.answers, whole.answers
    assert [target.name for target in mine.targets] == [target.name for target in theirs.targets]
    for one, other in zip(mine.targets, theirs.targets, strict=True):
        for name in ('truth', 'estimate', 'error', 'variance'):
            found, expected = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15)
        for name in ('rows', 'time_s', 'groups'):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
        assert (one.missed, one.invalid) == (other.missed, other.invalid)
        assert astuple(one.coverage) == pytest.approx(astuple(other.coverage), nan_ok=True)
        assert astuple(one.spread) == pytest.approx(astuple(other.spread), rel=1e-9, nan_ok=True)
    drawn, expected = (captions(one) for one in (pieces, whole))
    assert drawn == expected
    assert len(drawn) > 3


def captions(dataset: Dataset) -> list[tuple[str, str]]:
    """Headlines and findings, but for times."""
    untimed = (replace(answer, us_single=1.0) for answer in dataset.answers)
    figures = figures_of(replace(dataset, answers=tuple(untimed)), {'ridge': 'c0'})
    return [(figure.title, figure.caption) for figure in figures]


def test_a_tolerance_is_kept_and_told(bag: Path, pipeline: Pipeline) -> None:
    found = judged(bag, pipeline)
    assert found.association['/wrench'] == 'within 10 ms, 0 ms late'
    assert found.association['/label'].startswith('holds')
    narrow = judged(bag, pipeline, association=Association(1))
    assert narrow.association['/wrench'] == 'within 1e-06 ms, 0 ms late'
    wide = found.answers[0].targets['force_z']
    assert narrow.answers[0].targets['force_z'].missed == wide.missed
    lost = [problem for problem in narrow.problems if '/wrench' in problem]
    assert lost == [f'{2 * FRAMES + 6} messages of /wrench belong to no frame']


def test_labels_count_as_the_pipeline_numbers_them(bag: Path, pipeline: Pipeline) -> None:
    assert 'label' not in judged(bag, pipeline).answers[0].classes  # it knows no mug


def test_a_bag_of_another_board_is_refused(write_bag: Callable[..., Path], tmp_path: Path) -> None:
    spec = load_sensor('reskin_board')
    other = spec.pipeline()
    path = write_bag(tmp_path / 'bag')
    if other.layout.shape == (5, 3):
        other = load_sensor('gradiometer').pipeline()
    with pytest.raises(RecordingError, match='which no calibration is for'):
        tally_bag(path, {'c': other})


def test_contacts_without_a_frame_are_counted_once(
    make: SimpleNamespace,
    pipeline: Pipeline,
    tmp_path: Path,
    in_pieces: Callable[[int, int], None],
) -> None:
    path = tmp_path / 'bag'
    with BagWriter(path) as bag:
        bag.write('/layout', 'tactile_ros/msg/TactileLayout', 1, make.cdr(make.layout()))
        for k in range(40):
            frame = make.frame(k, np.zeros(15), k * STEP_NS + 1)
            about = make.contacts(k if k % 10 else 1000 + k, k * STEP_NS + 1)
            bag.write('/frame', frame.__msgtype__, k * STEP_NS + 2, make.cdr(frame))
            bag.write('/contacts', about.__msgtype__, k * STEP_NS + 3, make.cdr(about))
    in_pieces(6, 100_000_000)
    found = judged(path, pipeline)
    assert '4 contacts are about frames that were not recorded' in found.problems
    (answer,) = found.answers
    assert answer.agreement is not None
    assert (answer.agreement.frames, answer.agreement.without_contacts) == (36, 4)


def test_a_run_that_learned_a_class_is_held_in_memory(
    make: SimpleNamespace, pipeline: Pipeline, tmp_path: Path
) -> None:
    path = tmp_path / 'bag'
    told = {'sha256': 'a' * 64, 'enrolled': 'mug', 'presses': [[1, 2]], 'after_ns': 5}
    with BagWriter(path) as bag:
        bag.write('/layout', 'tactile_ros/msg/TactileLayout', 1, make.cdr(make.layout()))
        for k in range(9):
            frame = make.frame(k, np.zeros(15), k * STEP_NS + 1)
            bag.write('/frame', frame.__msgtype__, k * STEP_NS + 2, make.cdr(frame))
        text = make.String(data=json.dumps(told))
        bag.write('/calibration', text.__msgtype__, 9 * STEP_NS, make.cdr(text))
    with pytest.raises(ClassesChangedError):
        judged(path, pipeline)
    pipeline.save(tmp_path / 'c.npz')
    outcome = tally(Job(str(path), (str(tmp_path / 'c.npz'),)))
    assert outcome.failure == ''
    assert outcome.tallies[0].frames == 9


def test_what_is_cut_off_is_judged_as_far_as_it_goes(
    bag: Path, pipeline: Pipeline, tmp_path: Path
) -> None:
    data = next(bag.glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(data[: len(data) // 2])
    found = judged(cut, pipeline)
    assert 100 < found.frames < FRAMES
    assert any('cut off' in problem for problem in found.problems)


def test_an_empty_bag_holds_no_frames(pipeline: Pipeline, tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag'):
        pass
    with pytest.raises(RecordingError, match='holds no frames that could be read'):
        judged(tmp_path / 'bag', pipeline)
