# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""When a tare is taken, from which frames, and which baseline is announced."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from reference.failing_frames import fail_at
from tactile_ros.nodes.contact_loop import ContactLoop, TimeCheck
from tactile_ros.sensors import load_sensor
from tactile_ros.types import (
    STATE_FIELDS,
    ContactState,
    ContactStates,
    Frame,
    FrameStatus,
    Layout,
    TaxelStatus,
)

DAMAGED = np.array([8], np.uint8)


class ToyPipeline:
    """Touched above 1 from the baseline."""

    layout, sensor = Layout(np.zeros((1, 3)), ('p',), '1'), 'toy'
    baseline_temperature_c = None
    rest_ = SimpleNamespace(scale=np.full((1, 1), 2.0))

    def __init__(self, baseline: float) -> None:
        self.baseline = np.full((1, 1), baseline)
        self.tare_frames = self.failures = self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def tare(self, frames: list[Frame]) -> None:
        self.tare_frames = len(frames)
        self.baseline = np.mean([f.values for f in frames], axis=0)

    def process(self, frame: Frame) -> object:
        touched = np.abs(frame.values - self.baseline).max() > 1.0
        contact = np.array([-1 if np.isnan(self.baseline).any() else int(touched)])
        bad = frame.status is not None and bool(frame.status.any())
        known = {
            'in_contact': contact,
            'valid': np.array([not bad]),
            'status': np.array([bad * int(FrameStatus.BAD_TAXELS)]),
        }
        return ContactStates.assemble(1, 1, known)[0]


class Toy(ContactLoop):
    """Loop of a toy with a way to feed values, and the baselines that it announced."""

    def __init__(self, baseline: float = 0.0, frames: int = 3, in_contact: bool = False) -> None:
        self.announced: list[tuple[int, float]] = []
        super().__init__(
            ToyPipeline(baseline), frames, in_contact,  # type: ignore[arg-type]
            lambda f: self.announced.append((f.sequence, float(f.values[0, 0]))),
        )  # fmt: skip
        self.fed = 0

    def feed(self, *values: float, status: np.ndarray | None = None) -> None:
        for value in values:
            self.process([Frame(self.fed, self.fed, np.full((1, 1), float(value)), status=status)])
            self.fed += 1

    def refusal(self) -> str:
        """Sentence of a tare that is refused."""
        before = self.pipeline.baseline.copy()
        done, message = self.tare()
        assert not done
        np.testing.assert_array_equal(self.pipeline.baseline, before)
        return message


@pytest.mark.parametrize('stamp_ns', [0, -5, 10**15 + 365 * 86_400 * 10**9])
def test_time_check_replaces_a_stamp_that_cannot_be(stamp_ns: int) -> None:
    check, now_ns = TimeCheck(), 10**15
    good = check.admit(Frame(now_ns - 5, 1, np.zeros((2, 3))), now_ns)
    assert (good.stamp_ns, good.status) == (now_ns - 5, None)
    frame = check.admit(Frame(stamp_ns, 2, np.zeros((2, 3))), now_ns)
    assert frame.stamp_ns == now_ns
    assert (frame.status == TaxelStatus.STALE).all()
    assert [check.report(), check.report()] == ['1 stamps replaced', '']


def test_time_check_believes_stamps_before_a_simulated_clock_says_anything() -> None:
    check, stamp_ns = TimeCheck(), 10**15
    frame = check.admit(Frame(stamp_ns, 1, np.zeros((2, 3))), 0)
    assert (frame.stamp_ns, frame.status, check.report()) == (stamp_ns, None, '')


def test_time_check_counts_time_that_goes_back_and_frames_sent_twice() -> None:
    check = TimeCheck()
    for stamp_ns, sequence in ((100, 1), (200, 2), (200, 2), (150, 3)):
        frame = Frame(stamp_ns, sequence, np.zeros((2, 3)))
        assert check.admit(frame, 1000).stamp_ns == stamp_ns
    assert check.report() == '1 stamps backwards, 1 sequences repeated'


def test_the_first_tare_is_taken_whatever_touches_unless_frames_differ_by_a_touch() -> None:
    loop = Toy(np.nan)
    loop.feed(5, 5, 8)
    assert loop.tare() == (True, 'baseline of 3 frames, from sequence 3 on')
    assert loop.announced == [(3, 6.0)]
    loop = Toy(np.nan, frames=2)
    loop.feed(0, 9)
    assert 'the last 2 vary by more than a touch at taxels [0]' in loop.refusal()


def test_frames_before_a_contact_are_no_rest_after_it() -> None:
    loop = Toy()
    loop.feed(0)
    loop.tare()
    loop.feed(0.9, 9)
    assert 'while something touches' in loop.refusal()
    assert loop.statistics.tare_state.startswith('refused: tare is refused while something')
    loop.feed(0.2, 0.4)
    assert loop.tare() == (True, 'baseline of 2 frames, from sequence 5 on')
    assert loop.announced[-1] == (5, pytest.approx(0.3))
    # a contact ends the rest also when its frames are damaged
    loop.feed(0.9)
    loop.feed(9, status=DAMAGED)
    loop.feed(0.2)
    assert loop.tare() == (True, 'baseline of 1 frames, from sequence 8 on')


def test_a_tare_needs_undamaged_frames() -> None:
    loop = Toy()
    assert 'none came yet' in loop.refusal()
    loop.feed(0, 0, status=DAMAGED)
    assert 'without damage' in loop.refusal()
    loop.feed(0.0, 0.3, 0.6)
    loop.set_tare_frames(1)
    assert loop.tare()[0]
    assert loop.announced[-1] == (5, pytest.approx(0.6))


def test_a_taxel_that_was_dead_in_the_fit_or_is_stale_does_not_hinder_a_tare() -> None:
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial'].select(slice(0, 200))
    dead = np.where(np.arange(5)[:, None] == 2, np.nan, spatial.values)
    pipeline = spec.pipeline(estimator='ridge').fit(replace(spatial, values=dead))
    announced: list[Frame] = []
    loop = ContactLoop(pipeline, 3, False, announced.append)

    def feed(sequence: int, values: np.ndarray, stale: int = 0) -> bool:
        bits = (np.arange(5) < stale) * np.uint8(TaxelStatus.STALE)
        return bool(loop.process([Frame(sequence, sequence, values, status=bits)])[0].valid)

    assert not feed(0, spatial.values[0], 5)
    assert not loop.tare()[0]
    assert not feed(1, spatial.values[0], 1)
    assert loop.tare()[0]
    assert feed(2, spatial.values[0])
    np.testing.assert_allclose(announced[-1].values, dead[0])
    # what is announced can be taken back, as a replay does
    pipeline.tare([announced[-1]])
    np.testing.assert_allclose(pipeline.baseline, dead[0])
    # a chip that lived in the fit is damage
    loop.reset()
    feed(9, np.where(np.arange(5)[:, None] == 1, np.nan, spatial.values[0]))
    assert not loop.tare()[0]


def test_every_stream_begins_with_its_baseline_if_there_is_one() -> None:
    loop = Toy(2.0)
    loop.feed(2, 2)
    assert loop.announced == [(0, 2.0)]
    # together, and yet a stream that begins anew is one
    frames = [Frame(k, k, np.full((1, 1), 2.0)) for k in (4, 5, 0, 1)]
    assert len(loop.process(frames)) == 4
    assert loop.announced == [(0, 2.0), (0, 2.0)]
    assert loop.pipeline.resets == 1
    assert (loop.statistics.frames, loop.statistics.sequence) == (2, 1)
    for baseline in (np.nan, 0.0):
        loop = Toy(baseline)
        loop.feed(0, 0)
        assert loop.announced == []


def test_a_doubled_or_older_message_does_not_lift_the_guard() -> None:
    loop = Toy()
    loop.feed(0, 0, 0)
    assert loop.tare()[0]
    loop.feed(5, 5)
    assert not loop.tare()[0]
    for again in (4, 2):
        loop.process([Frame(again, again, np.full((1, 1), 5.0))])
        assert loop.is_touching
        assert not loop.tare()[0]
    # activation does: nobody can tell a day's drift from a touch then
    loop.reset()
    loop.process([Frame(9, 9, np.full((1, 1), 5.0))])
    assert loop.tare()[0]


def test_a_frame_that_fails_is_an_error_and_memory_begins_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spec = load_sensor('reskin_board')
    recording = spec.recordings()['normal_1'].select(slice(0, 4000, 8))
    pipeline = spec.pipeline(estimator='ridge').fit(recording)
    frames = [recording.frame(k) for k in range(100)]
    frames = [replace(f, sequence=k, stamp_ns=1 + 10**7 * k) for k, f in enumerate(frames)]
    failing = {10, 11, 40, 99}
    fail_at(monkeypatch, pipeline, [frames[k].stamp_ns for k in failing])
    wanted: list[ContactState] = []
    for size in (1, 13, 70):
        said: list[str] = []
        other = copy(pipeline)
        loop = ContactLoop(other, 3, True, lambda _: None, said.append)
        loop.reset()
        pieces = [frames[k : k + size] for k in range(0, len(frames), size)]
        states = [state for piece in pieces for state in loop.process(piece)]
        assert np.isfinite([state.force[2] for state in states]).sum() == 96
        wanted = wanted or states
        for k, state in enumerate(states):
            if k in failing:
                assert not state.valid
                assert state.status & FrameStatus.BAD_TAXELS
                assert (state.taxel_status & TaxelStatus.ERROR).all()
                assert not state.contacts
            for name in STATE_FIELDS:
                if k not in failing or not name.startswith('contacts_'):
                    pair = getattr(state, name), getattr(wanted[k], name)
                    np.testing.assert_allclose(*pair, rtol=1e-9, atol=1e-12, err_msg=name)
        assert other.failures == len(failing)
        assert 'cannot be estimated (LinAlgError: Singular matrix)' in said[0]
