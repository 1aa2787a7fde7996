# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A replay repeats a live run: its baselines, tares, failures and classes."""

import json
import queue
import shutil
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from reference import enrolled_skin
from reference import made_bags as make
from reference.failing_frames import fail_at
from tactile_ros.action import Enrol
from tactile_ros.conditioning.baseline import tare_means, tare_runs
from tactile_ros.enrolment import ClassChange
from tactile_ros.evaluation import replay as replaying
from tactile_ros.evaluation.fleet import evaluate_bag
from tactile_ros.evaluation.recording_files import (
    LiveContacts,
    LoadedRecording,
    load,
    read_changes,
)
from tactile_ros.evaluation.replay import (
    BaselineQueue,
    as_live,
    batch_of,
    compare,
    gathered,
    replay,
    with_known_rests,
    with_tare_rows,
)
from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.nodes.enrolment_server import Enrolment, EnrolRequest
from tactile_ros.physics.temperature import plausible_temperature
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import (
    STATE_FIELDS,
    ContactState,
    ContactStates,
    Frame,
    Layout,
    Recording,
    TaxelStatus,
)

STEP_NS = 20_000_000


@pytest.fixture(scope='module')
def spatial() -> Recording:
    """Some touches with the tare row before each."""
    return load_sensor('reskin_board').recordings()['spatial'].select(slice(0, 1200))


@pytest.fixture
def fitted(spatial: Recording) -> Pipeline:
    return load_sensor('reskin_board').pipeline(estimator='ridge').fit(spatial)


@pytest.fixture
def live(fitted: Pipeline, tmp_path: Path) -> Callable[..., LoadedRecording]:
    """Loaded bags of live runs of the fitted pipeline."""

    def run(*what: object) -> LoadedRecording:
        make.record(tmp_path / 'bag', fitted, *what)
        (loaded,) = load(tmp_path / 'bag').recordings
        return loaded

    return run


def live_frames(spatial: Recording, touches: int) -> list[Frame]:
    """Resting readings with a little noise, then a touch, over and over."""
    rng = np.random.default_rng(4)
    rows = np.concatenate([[2 * k] * 8 + [2 * k + 1] * 3 for k in range(touches)])
    values = spatial.values[rows] + rng.normal(0, 1e-7, (len(rows), 5, 3))
    return [Frame(10**9 + i * STEP_NS, i, one) for i, one in enumerate(values)]


Live = Callable[..., LoadedRecording]


def test_replay_gives_the_live_contacts(spatial: Recording, fitted: Pipeline, live: Live) -> None:
    loaded = live(live_frames(spatial, 60), {11 * k + 6 for k in range(0, 60, 3)})
    fresh = load_sensor('reskin_board').pipeline(estimator='ridge').fit(spatial)
    replayed = replay(loaded, fresh)
    assert len(loaded.baselines) > 5
    assert np.isfinite(loaded.contacts.states.position[:, :2]).any()
    assert replayed.agreement.frames == 660
    assert replayed.agreement.largest <= 1e-12
    assert replayed.problems == ()
    assert replay(loaded, fresh).agreement.largest == replayed.agreement.largest
    without = replay(replace(loaded, baselines=()), fresh).agreement
    assert without.largest > 1e-6
    other = load_sensor('reskin_board').pipeline(estimator='ridge')
    foreign = replay(loaded, other.fit(spatial.select(slice(0, 600))))
    assert f'the calibration {other.digest[:12]} is not that of the bag' in foreign.problems[0]
    assert foreign.agreement.largest > 0


def test_replay_of_a_bag_begun_amid_a_run_says_so(
    spatial: Recording, fitted: Pipeline, live: Live
) -> None:
    loaded = live([replace(one, sequence=one.sequence + 74) for one in live_frames(spatial, 3)])
    assert replay(loaded, fitted).problems == ()
    early = replace(loaded.baselines[0], sequence=0)  # latched: that of the first frame
    (said,) = replay(replace(loaded, baselines=(early,)), fitted).problems
    assert said.startswith('begun amid a run: contacts differ')


def test_replay_leaves_out_and_counts_frames_that_the_node_did_not_see(
    spatial: Recording, fitted: Pipeline, live: Live
) -> None:
    replayed = replay(live(live_frames(spatial, 20), {16}, {0, 1, 2, 30, 31}), fitted)
    assert replayed.agreement.largest <= 1e-12
    assert replayed.agreement.without_contacts == 5
    assert not replayed.states.valid[[0, 1, 2, 30, 31]].any()
    assert '5 frames without contacts were left out' in replayed.problems[0]


@pytest.mark.parametrize('chip_c', [-273.15, 327.67, 0.0])
def test_temperatures_that_no_chip_can_have_are_counted_and_not_used(
    spatial: Recording, fitted: Pipeline, live: Live, chip_c: float
) -> None:
    loaded = live(live_frames(spatial, 5))
    chips = np.full(loaded.recording.values.shape[:2], chip_c)
    chips[:3] = 25.0
    warm = replace(loaded, recording=replace(loaded.recording, temperature_c=chips))
    said = f'{len(chips) - 3} frames of which every chip says a temperature that none can have'
    assert any(text.startswith(said) for text in replay(warm, fitted).problems)
    np.testing.assert_array_equal(np.isnan(plausible_temperature(chips))[:, 0], chips[:, 0] != 25)


def test_recording_with_tare_rows_runs_as_a_batch_and_is_timed(
    spatial: Recording, fitted: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = count(0, 7_000)
    monkeypatch.setattr(replaying, 'perf_counter_ns', lambda: next(clock))
    replayed = replay(LoadedRecording('spatial', spatial), fitted)
    batch = fitted.process_batch(spatial)
    for name in STATE_FIELDS:
        np.testing.assert_array_equal(getattr(replayed.states, name), getattr(batch, name), name)
    assert replayed.agreement is None
    assert replayed.us_single == 7.0
    assert replayed.us_batch == pytest.approx(7.0 / len(spatial))
    shear = load_sensor('reskin_board').recordings()['shear']
    with pytest.raises(ValueError, match=r'must have shape \(5, 3\)'):
        replay(LoadedRecording('shear', shear), fitted)


def states(samples: int, **known: np.ndarray) -> ContactStates:
    return ContactStates.assemble(samples, 5, known)


def test_differences_are_the_largest_of_each_attribute() -> None:
    force = np.arange(12.0).reshape(4, 3)
    one = states(4, force=force)
    other = states(2, force=force[[1, 3]] + np.array([[0, 0, 0], [0, -0.5, 0]]))
    agreement = compare(other, np.array([1, 3]), one, 4)
    assert agreement.differences['force'] == 0.5
    assert agreement.largest == 0.5
    assert (agreement.frames, agreement.without_contacts) == (2, 2)
    assert agreement.differences['position'] == 0
    # a value that only one side has, and lists of patches of other lengths
    assert compare(states(4), np.arange(4), one, 4).largest == np.inf
    half = replace(one, force=np.where(np.arange(4)[:, None] == 2, np.nan, force + 0.25))
    words = str(compare(half, np.arange(4), one, 4))
    assert words.endswith('force 0.25 in 4 frames; in 1 of them one alone has an estimate')
    two = states(1, contacts_id=np.array([[4, -1]]), contacts_position=np.full((1, 2, 3), np.nan))
    one = states(1, contacts_id=np.array([[4]]), contacts_position=np.full((1, 1, 3), np.nan))
    patches = compare(one, np.array([0]), two, 1).differences
    assert patches['contacts_id'] == patches['contacts_position'] == 0


@pytest.mark.parametrize('fails_live', [True, False])
def test_a_frame_that_fails_costs_itself_alone(
    fails_live: bool, spatial: Recording, fitted: Pipeline, live: Live, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    frames, failing = live_frames(spatial, 30), [0, 20, 21, 100, 329]
    stamps = [frames[row].stamp_ns for row in failing]
    fresh = deepcopy(fitted)
    if fails_live:
        fail_at(monkeypatch, fitted, stamps)
    loaded = live(frames, {60, 200})
    if not fails_live:
        fail_at(monkeypatch, fitted, stamps)
    slow = replay(loaded, deepcopy(fresh))
    (answer,) = evaluate_bag(tmp_path / 'bag', {'c': fresh})[0].answers
    for problems in (slow.problems, answer.problems):
        assert problems[0].startswith('5 frames cannot be estimated and count as lost (')
    assert np.flatnonzero(~slow.states.valid).tolist() == failing
    assert (slow.states.taxel_status[failing] & TaxelStatus.ERROR).all()
    assert np.isfinite(answer.us_single)
    for agreement in (slow.agreement, answer.agreement):
        assert agreement.frames == 330
        assert (agreement.largest <= 1e-12) == fails_live


def test_a_live_run_without_tracking_is_replayed_without(
    spatial: Recording, fitted: Pipeline
) -> None:
    digest = fitted.digest
    loaded = LoadedRecording('x', spatial, calibrations=(digest,))
    assert as_live(loaded.calibrations, fitted) is fitted
    fitted.config = replace(fitted.config, track_baseline=False)
    still = LoadedRecording('x', spatial, calibrations=(fitted.digest,))
    fitted.config = replace(fitted.config, track_baseline=True)
    found = as_live(still.calibrations, fitted)
    assert not found.config.track_baseline
    assert found.digest == still.calibrations[0]
    assert fitted.digest == digest
    assert not replay(still, fitted).problems
    foreign = LoadedRecording('x', spatial, calibrations=('0' * 64,))
    assert as_live(foreign.calibrations, fitted) is fitted


LAYOUT = Layout(np.zeros((1, 3)), ('p',), '1')


def counted(sequence: list[int], stamped: bool = True) -> Recording:
    """Frames whose counter begins anew where it goes back."""
    rows = np.arange(len(sequence))
    stamps = 1000 + 10 * rows if stamped else None
    stream = np.cumsum(np.diff(sequence, prepend=sequence[0]) < 0)
    return Recording.from_arrays(
        LAYOUT, np.zeros((len(rows), 1, 1)), stamps, sequence=np.array(sequence), stream=stream
    )


def baseline_frame(stamp_ns: int | None, sequence: int, level: float = 0.0) -> Frame:
    return Frame(stamp_ns, sequence, np.full((1, 1), level))


@pytest.mark.parametrize(
    ('baselines', 'expected'),
    [
        ([(1000, 0)], {0: 0}),  # in use when the run began
        ([(1020, 3)], {3: 0}),  # a tare of frames up to 2
        ([(1010, 3)], {3: 0}),  # frame 2 was processed and not averaged
        ([(1060, 3)], {7: 0}),  # the first of the run, after the counter began anew
        ([(1000, 0), (1040, 0), (1060, 3)], {0: 0, 4: 1, 7: 2}),
        ([(1020, 3), (9999, 1)], {3: 0, 5: 1}),  # of no frame: by its sequence
        ([(1020, 3), (1020, 3)], {3: 1}),  # the last of two
        ([(1070, 4)], {}),  # for a frame that never came
    ],
)
def test_a_baseline_is_of_the_stream_of_its_stamp(
    baselines: list[tuple[int, int]], expected: dict[int, int]
) -> None:
    recording = counted([0, 1, 2, 3, 0, 1, 2, 3])
    told = [baseline_frame(*one, level=i) for i, one in enumerate(baselines)]
    found = BaselineQueue().by_row(recording, np.arange(8), told)
    assert {row: int(one.values[0, 0]) for row, one in found.items()} == expected


def test_without_stamps_sequences_alone_tell() -> None:
    recording = replace(counted([0, 1, 2, 0, 1, 2]), stamp_ns=None)
    told = [baseline_frame(None, 1, 0.0), baseline_frame(None, 0, 1.0)]
    assert sorted(BaselineQueue().by_row(recording, np.arange(6), told)) == [1, 3]


SPEC = enrolled_skin.SPEC
PATIENCE_S = 300.0


class Run:
    """A live run without ROS: frames, states, what was announced."""

    def __init__(self, path: Path, taught: Path) -> None:
        shutil.copyfile(taught, path)
        self.first = SPEC.load(path)
        self.path = path
        self.presses = enrolled_skin.new_head()
        self.frames: list[Frame] = []
        self.states: list[ContactState] = []
        self.baselines: list[Frame] = []
        self.told: list[str] = []
        self.stage = ContactLoop(SPEC.load(path), 10, True, self.baselines.append)
        self.classes = Enrolment(
            self.stage, str(path), SPEC.load, self.first.digest, self._announce
        )
        self._announce()

    def _announce(self, change: ClassChange | None = None) -> None:
        told = {} if change is None else change.announcement()
        self.told.append(json.dumps({'sha256': self.stage.pipeline.digest, **told}))

    def press(self, number: int) -> None:
        for row in enrolled_skin.press_of(self.presses, number):
            self.frames.append(enrolled_skin.frame_of(len(self.frames), row))
            self.states.append(self.stage.process([self.frames[-1]])[0])

    def learn(self, label: str, numbers: tuple[int, ...], replace: bool = False) -> Enrol.Result:
        ended: queue.Queue[Enrol.Result] = queue.Queue()
        self.classes.begin(
            EnrolRequest(label, len(numbers), PATIENCE_S, replace), lambda *_: None, ended.put
        )
        for number in numbers:
            self.press(number)
        return ended.get(timeout=PATIENCE_S)

    def loaded(self) -> LoadedRecording:
        rows = np.arange(len(self.frames))
        recording = Recording.from_arrays(
            self.presses.layout, [f.values for f in self.frames],
            stamp_ns=[f.stamp_ns for f in self.frames], sequence=rows,
        )  # fmt: skip
        columns = {
            name: np.array([getattr(state, name) for state in self.states])
            for name, (shape, _, _) in STATE_FIELDS.items() if shape[:1] != ('k',)
        }  # fmt: skip
        states = ContactStates.assemble(len(rows), 20, columns)
        return LoadedRecording(
            'run', recording, LiveContacts(rows, states, rows), tuple(self.baselines),
            tuple(dict.fromkeys(json.loads(text)['sha256'] for text in self.told)),
            read_changes(self.told),
        )  # fmt: skip


@pytest.fixture(scope='module')
def run(tmp_path_factory: pytest.TempPathFactory, taught_skin: Path) -> Run:
    made = Run(tmp_path_factory.mktemp('run') / 'skin.npz', taught_skin)
    made.press(0)
    assert made.learn('mug', (1, 2)).success
    made.press(3)
    assert made.classes.forget('mug')[0]
    made.press(4)
    assert made.learn('cup', (5,)).success
    made.press(6)
    return made


def test_a_replay_learns_and_forgets_where_the_live_run_did(run: Run) -> None:
    loaded = run.loaded()
    # with the calibration that it began with, and with the one that it left
    for pipeline in (run.first, SPEC.load(run.path)):
        before = pipeline.digest
        replayed = replay(loaded, pipeline)
        assert replayed.problems == ()
        for name in ('label', 'label_probability', 'in_contact', 'status'):
            assert replayed.agreement.differences[name] == 0, name
        assert 5 in replayed.states.label
        assert pipeline.digest == before
    changed = [(change.label, len(change.presses)) for change in loaded.changes]
    assert changed == [('mug', 2), ('mug', 0), ('cup', 1)]
    other = replay(replace(loaded, changes=()), run.first)
    assert 5 not in other.states.label
    assert 'several calibrations' in other.problems[0]
    late = loaded.recording.select(slice(300, None))
    rows, blank = np.arange(len(late)), ContactStates.assemble(len(late), 20, {})
    part = replace(loaded, recording=late, contacts=LiveContacts(rows, blank, rows))
    assert any("'mug' could not be learned" in text for text in replay(part, run.first).problems)


def test_presses_are_added_and_replaced_unless_the_file_changed(
    tmp_path: Path, taught_skin: Path
) -> None:
    run = Run(tmp_path / 'skin.npz', taught_skin)
    assert run.learn('mug', (1,)).success
    for numbers, anew, size in (((2,), False, 2), ((4,), True, 1)):
        assert run.learn('mug', numbers, replace=anew).index == 5
        recogniser = SPEC.load(run.path).estimation.recogniser_  # type: ignore[attr-defined]
        assert len(recogniser.enrolled_.label) == size
    taken = run.learn('0', (5,))
    assert "label of enrol must be new; '0' is known from the fit" in taken.message
    run.first.save(run.path)
    content = run.path.read_bytes()
    assert 'changed since it was read' in run.learn('cup', (1,)).message
    assert run.path.read_bytes() == content


@pytest.mark.parametrize(
    'text',
    ['', '[]', '{}', '{"enrolled": 3}', '{"enrolled": "mug"}', 'nan', '{"enrolled": "mug", '
     '"sha256": "x", "presses": [1]}', '[' * 10_000],
)  # fmt: skip
def test_announcements_that_make_no_sense_tell_no_change(text: str) -> None:
    assert read_changes([text]) == ()


BOARD = load_sensor('reskin_board')
PRESSES, REST, LONG, TARED = 12, 11, 60, 10
TARE_STEP_NS = 10_000_000


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
        BOARD.layout(BOARD.config()), values, stamp_ns=TARE_STEP_NS * (1 + np.arange(count)),
        sequence=np.arange(count), status=np.zeros((count, 5), np.uint8), truth={'force': force},
    )  # fmt: skip
    return recording, np.flatnonzero(row == REST)


def lived(
    recording: Recording, before: np.ndarray, unheard: Sequence[int] = (), contacts: bool = True
) -> LoadedRecording:
    """The same after a run without a calibration that was tared before some rows."""
    told: list[Frame] = []
    parts: list[ContactStates] = []
    stage = ContactLoop(BOARD.pipeline(), TARED, False, told.append)
    rows = np.setdiff1d(np.arange(len(recording)), unheard)
    for row in rows:
        if row in before:
            assert stage.tare()[0]
        parts.append(batch_of(stage.process([recording.frame(int(row))])[0]))
    states = gathered(parts, np.arange(len(rows)), len(rows), 5)
    live = LiveContacts(rows, states, recording.stamp_ns[rows]) if contacts else None
    return LoadedRecording('x', recording, live, tuple(told))


@pytest.mark.parametrize(
    ('case', 'back'),
    [
        ('contacts', 0), ('no contacts', 0), ('two streams', 0), ('unheard', 4),
        ('error', 2), ('stale', 5), ('silent', 2), ('all stale', 5),
    ],
)  # fmt: skip
def test_tare_rows_are_the_undamaged_frames_of_each_tare(case: str, back: int) -> None:
    recording, before = presses(0)
    row, half = before - back, len(recording) // 2
    if case == 'two streams':
        number = np.arange(len(recording))
        sequence, stream = np.where(number < half, number, number - half), number >= half
        recording = replace(recording, sequence=sequence, stream=stream.astype(int))
    if case in ('error', 'stale', 'all stale'):
        recording.status[row, slice(5) if case == 'all stale' else 1] = 8 if case == 'error' else 1
    elif case == 'silent':
        recording.values[row, 1] = 0.0
    run = lived(recording, before, row if case == 'unheard' else (), case != 'no contacts')
    found, told = with_tare_rows(run)
    assert not told
    if back in (0, 4):
        reach = TARED + (case == 'unheard')
        wanted = np.concatenate([row - reach + np.arange(reach) for row in before])
        assert np.flatnonzero(found.tare).tolist() == wanted.tolist()
        return
    means = tare_means(recording.values, tare_runs(found.tare, found.restarts)[0])
    levels = np.stack([b.values for b in run.baselines])
    usable = [0, 2, 3, 4]  # a chip that is silent for one frame is left out of that frame alone
    assert means.shape == levels.shape == (PRESSES, 5, 3)
    assert np.abs(means - levels)[:, usable].max() < 2e-7


@pytest.mark.parametrize('always', [False, True], ids=['force', 'all and an offset'])
def test_tare_under_load_is_no_rest(always: bool) -> None:
    recording, before = presses(0)
    if always:  # truth that is always there says nothing of a touch
        count = len(recording)
        force = recording.truth['force'] + [0.05, 0.0, 0.08]  # a load cell's own offset, and noise
        force[:, 2] += np.random.default_rng(3).normal(0, 0.03, count)
        truth = {'position': np.zeros((count, 3)), 'label': np.ones(count, int), 'force': force}
        recording = replace(recording, truth=truth)
    also = np.append(before, before[3] + LONG // 2)
    tared, sentence = with_tare_rows(lived(recording, also))
    assert sentence == '12 of 13 tares can be used; 1 under load'
    assert np.count_nonzero(tared.tare) == PRESSES * TARED
    tared, sentence = with_tare_rows(lived(recording, before + LONG // 2))
    assert tared.tare is None
    assert sentence.endswith('12 under load')


def test_tares_that_tell_nothing_new_change_nothing() -> None:
    recording, before = presses(0)
    run = lived(recording, before)
    others = tuple(replace(b, stamp_ns=1) for b in run.baselines)
    tared, sentence = with_tare_rows(replace(run, baselines=others))
    assert tared.tare is None
    assert sentence.startswith('0 of 12 tares can be used; 12 of frames that are')
    assert with_tare_rows(LoadedRecording('x', recording)) == (recording, '')
    rested = replace(recording, tare=np.isin(np.arange(len(recording)), before))
    assert with_tare_rows(replace(run, recording=rested))[0] is rested
    touched = (recording.truth['force'][:, 2] > 0).astype(int)
    knowing = replace(recording, truth={**recording.truth, 'in_contact': touched})
    kept, told = with_tare_rows(lived(knowing, before[:2]))
    assert kept.tare is None
    assert told == 'tares of fewer than 30 frames in all are left out beside in_contact'
    tared, _ = with_tare_rows(run)
    first, second, third = with_known_rests([tared, knowing, recording])
    assert (first, third) == (tared, recording)
    assert np.array_equal(second.tare, touched == 0)
    assert with_known_rests([knowing, recording]) == [knowing, recording]


def test_press_between_two_frames_of_a_tare_is_no_rest() -> None:
    recording, before = presses(0)
    row = np.arange(len(recording)) % (REST + LONG)
    recording.status[row > REST, 0] = 2  # clipped all the press long
    found, told = with_tare_rows(lived(replace(recording, truth={}), before[1:] - REST + 5))
    assert not told
    assert np.count_nonzero(found.tare) == (PRESSES - 1) * 5
    assert not (found.tare & (row >= REST)).any()


def test_a_load_cell_and_tares_are_enough_to_calibrate() -> None:
    learned, before = presses(0, drift=0.3)
    fresh, again = presses(1, drift=0.3)
    errors = []
    for fit, judged in (
        (with_tare_rows(lived(learned, before))[0], with_tare_rows(lived(fresh, again))[0]),
        (learned, fresh),
    ):
        pipeline = BOARD.pipeline(estimator='ridge').fit(fit)
        pressed = np.arange(len(fresh)) % (REST + LONG) >= REST  # since the tare of its press
        off = pipeline.process_batch(judged).force[pressed, 2] - fresh.truth['force'][pressed, 2]
        errors.append(float(np.sqrt(np.nanmean(off**2))))
        assert pipeline.rest_.tared == (fit is not learned)
    assert errors[0] < 0.02
    assert errors[1] > 0.1
