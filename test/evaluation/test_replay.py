from __future__ import annotations

from array import array
from copy import deepcopy
from dataclasses import replace
from itertools import count
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.evaluation.recording_files import LiveContacts, LoadedRecording, load
from tactile_ros.evaluation.replay import Follower, as_live, compare, replay
from tactile_ros.evaluation.sensor_tally import tally_bag
from tactile_ros.messages import fill_contacts
from tactile_ros.nodes.contact_loop import ContactStage
from tactile_ros.sensors import load_sensor
from tactile_ros.types import STATE_FIELDS, ContactStates, Frame, Recording, TaxelStatus

if TYPE_CHECKING:
    from pathlib import Path

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Columns, Signals

STEP_NS = 20_000_000


@pytest.fixture(scope='module')
def spatial() -> Recording:
    """Some touches with the tare row before each."""
    return load_sensor('reskin_board').recordings()['spatial'].select(slice(0, 1200))


@pytest.fixture
def fitted(spatial: Recording) -> Pipeline:
    return load_sensor('reskin_board').pipeline(estimator='ridge').fit(spatial)


def stored(make: SimpleNamespace, message: object) -> bytes:
    """CDR of a message whose arrays were filled for rclpy."""
    for name, value in vars(message).items():
        if isinstance(value, array):
            setattr(message, name, np.array(value))
    return make.cdr(message)


def record(
    path: Path,
    make: SimpleNamespace,
    pipeline: Pipeline,
    frames: list[Frame],
    tares: dict[int, bool],
    unseen: frozenset[int] = frozenset(),
) -> Path:
    """A live run: every frame through the stage, tares after some, all of it into a bag."""
    with BagWriter(path) as bag:
        log = count(1)

        def put(leaf: str, message: object) -> None:
            bag.write(f'/{leaf}', message.__msgtype__, next(log), stored(make, message))

        def on_baseline(frame: Frame) -> None:
            put('baseline', make.frame(frame.sequence, frame.values, frame.stamp_ns))

        stage = ContactStage(pipeline, 5, tare_in_contact=False, on_baseline=on_baseline)
        stage.reset()
        put('layout', make.layout())
        put('calibration', make.String(data=f'{{"sha256": "{pipeline.digest}"}}'))
        for i, frame in enumerate(frames):
            put('frame', make.frame(frame.sequence, frame.values, frame.stamp_ns))
            if i in unseen:
                continue
            state = stage.process(frame)
            message = make.contacts(frame.sequence, frame.stamp_ns)
            fill_contacts(message, state, lambda: make.contacts(0, 0).contacts[0])
            put('contacts', message)
            if i in tares:
                stage.tare()
    return path


def live_frames(spatial: Recording, touches: int, counter: int = 0) -> list[Frame]:
    """Resting readings with a little noise, then a touch, over and over."""
    rng = np.random.default_rng(4)
    frames = []
    for k in range(touches):
        for values in [spatial.values[2 * k]] * 8 + [spatial.values[2 * k + 1]] * 3:
            noisy = values + rng.normal(0, 1e-7, values.shape)
            number = len(frames)
            frames.append(Frame(10**9 + number * STEP_NS, counter + number, noisy))
    return frames


def test_a_replay_gives_the_live_contacts(
    spatial: Recording, fitted: Pipeline, make: SimpleNamespace, tmp_path: Path
) -> None:
    frames = live_frames(spatial, 60)
    tares = {11 * k + 6: True for k in range(0, 60, 3)}
    path = record(tmp_path / 'bag', make, fitted, frames, tares)
    (loaded,) = load(path).recordings
    fresh = load_sensor('reskin_board').pipeline(estimator='ridge').fit(spatial)
    found = replay(loaded, fresh)
    assert len(loaded.baselines) > 5
    assert np.isfinite(loaded.contacts.states.position[:, :2]).any()
    assert found.agreement.frames == 660
    assert found.agreement.largest <= 1e-12
    assert found.problems == ()
    again = replay(loaded, fresh)
    assert again.agreement.largest == found.agreement.largest


def test_without_its_baselines_a_replay_differs_and_says_where(
    spatial: Recording, fitted: Pipeline, make: SimpleNamespace, tmp_path: Path
) -> None:
    frames = live_frames(spatial, 20)
    path = record(tmp_path / 'bag', make, fitted, frames, {6: True, 50: True})
    (loaded,) = load(path).recordings
    fresh = load_sensor('reskin_board').pipeline(estimator='ridge').fit(spatial)
    found = replay(replace(loaded, baselines=()), fresh)
    assert found.agreement.largest > 1e-6
    assert found.agreement.worst in STATE_FIELDS


def test_frames_that_the_node_did_not_see_are_left_out_and_counted(
    spatial: Recording, fitted: Pipeline, make: SimpleNamespace, tmp_path: Path
) -> None:
    frames = live_frames(spatial, 20)
    unseen = frozenset({0, 1, 2, 30, 31})
    path = record(tmp_path / 'bag', make, fitted, frames, {16: True}, unseen)
    (loaded,) = load(path).recordings
    found = replay(loaded, fitted)
    assert found.agreement.largest <= 1e-12
    assert found.agreement.without_contacts == 5
    assert not found.states.valid[[0, 1, 2, 30, 31]].any()
    assert '5 frames without contacts were left out' in found.problems[0]


def test_frames_that_failed_live_count_as_lost_in_the_replay(
    spatial: Recording, fitted: Pipeline, make: SimpleNamespace, tmp_path: Path
) -> None:
    frames = live_frames(spatial, 20)
    healthy = fitted.estimation.estimate
    failing = {frames[k].stamp_ns for k in (9, 40, 41, 150)}

    def estimate(signals: Signals, memory: object) -> Columns:
        if (np.isin(signals.stamp_ns, list(failing)) & signals.good).any():
            msg = 'nobody foresaw this'
            raise RuntimeError(msg)
        return healthy(signals, memory)

    fitted.estimation.estimate = estimate
    path = record(tmp_path / 'bag', make, fitted, frames, {16: True, 60: True})
    fresh = load_sensor('reskin_board').pipeline(estimator='ridge').fit(spatial)
    (loaded,) = load(path).recordings
    found = replay(loaded, fresh)
    assert found.agreement.frames == len(frames)
    assert found.agreement.largest <= 1e-12
    assert np.flatnonzero(~found.states.valid).tolist() == [9, 40, 41, 150]
    (tally,) = tally_bag(path, {'c': fresh}, ('truth/contacts',))
    assert tally.answers[0].agreement.largest <= 1e-12
    assert tally.answers[0].agreement.frames == len(frames)


def test_a_restarted_sensor_is_a_new_stream(
    spatial: Recording, fitted: Pipeline, make: SimpleNamespace, tmp_path: Path
) -> None:
    first, second = live_frames(spatial, 10), live_frames(spatial, 12)
    later = [
        replace(frame, stamp_ns=frame.stamp_ns + 10**11, values=frame.values * 1.01)
        for frame in second
    ]
    tares = {6: True, 50: True, len(first) + 6: True}
    path = record(tmp_path / 'bag', make, fitted, first + later, tares)
    (loaded,) = load(path).recordings
    assert len(np.unique(loaded.recording.stream)) == 2
    assert replay(loaded, fitted).agreement.largest <= 1e-12


def test_a_calibration_that_is_not_the_bags_is_named(
    spatial: Recording, fitted: Pipeline, make: SimpleNamespace, tmp_path: Path
) -> None:
    path = record(tmp_path / 'bag', make, fitted, live_frames(spatial, 5), {})
    (loaded,) = load(path).recordings
    other = load_sensor('reskin_board').pipeline(estimator='ridge')
    other.fit(spatial.select(slice(0, 600)))
    found = replay(loaded, other)
    assert f'the calibration {other.digest[:12]} is not that of the bag' in found.problems[0]
    assert found.agreement.largest > 0


def test_a_recording_with_tare_rows_runs_as_a_batch_and_is_timed(
    spatial: Recording, fitted: Pipeline
) -> None:
    clock = count(0, 7_000)
    found = replay(LoadedRecording('spatial', spatial), fitted, lambda: next(clock))
    batch = fitted.process_batch(spatial)
    for name in STATE_FIELDS:
        np.testing.assert_array_equal(getattr(found.states, name), getattr(batch, name), name)
    assert found.agreement is None
    assert found.us_per_frame == 7.0
    assert found.us_batch == pytest.approx(7.0 / len(spatial))


def test_another_board_is_refused(spatial: Recording, fitted: Pipeline) -> None:
    shear = load_sensor('reskin_board').recordings()['shear']
    with pytest.raises(ValueError, match=r'must have shape \(5, 3\)'):
        replay(LoadedRecording('shear', shear), fitted)


def states(samples: int, **known: np.ndarray) -> ContactStates:
    return ContactStates.assemble(samples, 5, known)


def test_differences_are_the_largest_of_each_attribute() -> None:
    force = np.arange(12.0).reshape(4, 3)
    one = states(4, force=force)
    other = states(2, force=force[[1, 3]] + np.array([[0, 0, 0], [0, -0.5, 0]]))
    found = compare(other, np.array([1, 3]), one, 4)
    assert found.differences['force'] == 0.5
    assert (found.largest, found.worst) == (0.5, 'force')
    assert (found.frames, found.without_contacts) == (2, 2)
    assert found.differences['position'] == 0


def test_a_value_that_only_one_side_knows_is_an_infinite_difference() -> None:
    one = states(2, force=np.zeros((2, 3)))
    assert compare(states(2), np.array([0, 1]), one, 2).largest == np.inf


def test_lists_of_patches_may_have_any_length() -> None:
    two = states(1, contacts_id=np.array([[4, -1]]), contacts_position=np.full((1, 2, 3), np.nan))
    one = states(1, contacts_id=np.array([[4]]), contacts_position=np.full((1, 1, 3), np.nan))
    found = compare(one, np.array([0]), two, 1)
    assert found.differences['contacts_id'] == 0
    assert found.differences['contacts_position'] == 0


@pytest.mark.parametrize('fails_live', [True, False])
def test_a_frame_that_fails_costs_itself_alone(
    fails_live: bool, spatial: Recording, fitted: Pipeline, make: SimpleNamespace, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    frames, failing = live_frames(spatial, 30), [0, 20, 21, 100, 329]
    stamps = [frames[row].stamp_ns for row in failing]
    kind, fresh = type(fitted.estimation), deepcopy(fitted)
    healthy = kind.estimate

    def estimate(self: object, signals: Signals, memory: object) -> Columns:
        """Fails when it has changed its memory."""
        known = healthy(self, signals, memory)
        if np.isin(signals.stamp_ns, stamps).any():
            msg = 'Singular matrix'
            raise np.linalg.LinAlgError(msg)
        return known

    if fails_live:
        monkeypatch.setattr(kind, 'estimate', estimate)
    path = record(tmp_path / 'bag', make, fitted, frames, {60: True, 200: True})
    monkeypatch.setattr(kind, 'estimate', estimate)
    (loaded,) = load(path).recordings
    slow = replay(loaded, deepcopy(fresh))
    (answer,) = tally_bag(path, {'c': fresh})[0].answers
    said = '5 frames cannot be estimated and count as lost (LinAlgError: Singular matrix)'
    assert said in slow.problems
    assert said in answer.problems
    assert np.flatnonzero(~slow.states.valid).tolist() == failing
    assert (slow.states.taxel_status[failing] & TaxelStatus.ERROR).all()
    assert np.isfinite(answer.us_single)
    for agreement in (slow.agreement, answer.agreement):
        assert agreement.frames == 330
        assert (agreement.largest <= 1e-12) == fails_live


def plain(spatial: Recording) -> Recording:
    """Rest and touch in turn as one stream without a live run; rests are its tares."""
    rows = np.arange(330)
    part = spatial.select(slice(0, len(rows)))
    return replace(part, stamp_ns=10**9 + rows * STEP_NS, sequence=rows, stream=0 * rows)


def fail_at(
    monkeypatch: pytest.MonkeyPatch, pipeline: Pipeline, stamps: object
) -> list[int]:
    """Let the estimator fail at frames; rows it saw."""
    kind, seen = type(pipeline.estimation), []
    healthy = kind.estimate

    def estimate(self: object, signals: Signals, memory: object) -> Columns:
        seen.append(len(signals.good))
        if np.isin(signals.stamp_ns, stamps).any():
            msg = 'Singular matrix'
            raise np.linalg.LinAlgError(msg)
        return healthy(self, signals, memory)

    monkeypatch.setattr(kind, 'estimate', estimate)
    return seen


def test_a_frame_that_fails_costs_itself_alone_without_a_live_run_too(
    spatial: Recording, fitted: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, failing = plain(spatial), [1, 21, 101, 103, 329]  # touches
    others = np.setdiff1d(np.arange(len(recording)), failing)
    wanted = fitted.process_batch(recording).position[others]
    fail_at(monkeypatch, fitted, recording.stamp_ns[failing])
    found = replay(LoadedRecording('plain', recording), fitted)
    said = '5 frames cannot be estimated and count as lost (LinAlgError: Singular matrix)'
    assert found.problems == (said,)
    assert np.flatnonzero(~found.states.valid).tolist() == failing
    assert (found.states.taxel_status[failing] & TaxelStatus.ERROR).all()
    assert np.isfinite(wanted[:, 0]).sum() > 100
    np.testing.assert_allclose(found.states.position[others], wanted, rtol=0, atol=1e-12)
    assert np.isfinite(found.us_per_frame)


def test_where_every_frame_fails_all_are_lost_and_other_boards_are_refused(
    spatial: Recording, fitted: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = plain(spatial)
    fail_at(monkeypatch, fitted, recording.stamp_ns)
    found = replay(LoadedRecording('plain', recording), fitted)
    assert found.problems[0].startswith('330 frames cannot be estimated')
    assert not found.states.valid.any()
    with pytest.raises(ValueError, match='received Bx, By, Bz in count'):
        fitted.process_batch(
            replace(recording, layout=replace(recording.layout, unit='count'))
        )


def test_a_bag_of_which_every_frame_fails_takes_a_few_times_its_frames(
    spatial: Recording, fitted: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = plain(spatial)
    seen = fail_at(monkeypatch, fitted, recording.stamp_ns)
    rows = np.arange(len(recording))
    piece = SimpleNamespace(recording=recording, rows=rows, baselines={}, live=None)
    assert not Follower(fitted)(piece).valid.any()
    assert sum(seen) < 6 * len(recording)


def test_an_empty_live_run_compares_nothing(spatial: Recording, fitted: Pipeline) -> None:
    none = np.zeros(0, np.int64)
    loaded = LoadedRecording('x', spatial, LiveContacts(none, states(0), none, 0))
    found = replay(loaded, fitted)
    assert found.agreement.frames == 0
    assert np.isnan(found.us_per_frame)


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
