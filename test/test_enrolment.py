# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Presses in a stream: where they begin and end, what is kept of them, what a class may cost."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference import enrolled_skin
from tactile_ros import enrolment
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame, Layout

PLACES = np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
PROGRAMME = enrolment.Programme(PLACES, np.array([[0, 0, 1.0], [0, 0, 2.0], [0.5, 0, 3.0]]))
LAYOUT = Layout(np.zeros((2, 3)), ('a',), '1', rate_hz=100.0)


def reading(touches: enrolment.Touches) -> np.ndarray:
    return np.repeat(touches.force[:, None, 2:], 2, axis=1)


def truth(touches: enrolment.Touches) -> dict[str, np.ndarray]:
    return {'position': touches.position, 'force': touches.force}


def test_rest_rise_hold_fall_pause_and_again() -> None:
    second = enrolment.REST_S + PROGRAMME.period_s
    times = np.array([0.0, 0.9, second + 0.15, second + 0.5, second + 0.8, second + 1.0])
    touches = PROGRAMME.at(times)
    assert touches.press.tolist() == [-1, -1, 1, 1, 1, -1]
    np.testing.assert_allclose(touches.force[:, 2], [0, 0, 1, 2, 2 / 3, 0], atol=1e-9)
    assert np.isnan(touches.position[[0, 1, 5]]).all()
    np.testing.assert_array_equal(touches.position[3], PLACES[1])
    again = PROGRAMME.at(times + 3 * PROGRAMME.duration_s)
    np.testing.assert_allclose(again.force, touches.force, atol=1e-9)
    assert PROGRAMME.duration_s == pytest.approx(enrolment.REST_S + 3 * PROGRAMME.period_s)


def test_recorded_is_the_programme_in_blocks_with_truth_noise_and_limits() -> None:
    seen = []

    def watched_reading(touches: enrolment.Touches) -> np.ndarray:
        seen.append(len(touches.press))
        return reading(touches)

    fast = Layout(np.zeros((2, 3)), ('a',), '1', rate_hz=500.0)
    plain = enrolment.recorded(fast, PROGRAMME, watched_reading, truth, 0.0, seed=7)
    assert max(seen) == enrolment.BLOCK
    touched = plain.truth['in_contact'] == 1
    assert len(plain) == round(500 * PROGRAMME.duration_s)
    assert plain.tare.sum() == round(500 * enrolment.TARE_S)
    assert not (plain.tare & touched).any()
    assert (np.diff(plain.stamp_ns) == 2_000_000).all()
    np.testing.assert_array_equal(plain.values[:, 1, 0], plain.truth['force'][:, 2])
    assert not plain.truth['force'][~touched].any()
    assert set(plain.truth['repetition'][touched]) == {0, 1, 2}
    assert set(plain.truth['session']) == {7}
    one, same, other = (
        enrolment.recorded(fast, PROGRAMME, reading, truth, 0.1, s) for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.values, same.values)
    assert (one.values != other.values).any()
    assert abs((one.values - plain.values).std() - 0.1) < 0.01
    clipped = enrolment.recorded(fast, PROGRAMME, reading, truth, 0.1, 1, (0.0, 1.0))
    assert (clipped.values.min(), clipped.values.max()) == (0.0, 1.0)


def test_recordings_are_played_in_a_circle_and_thinned() -> None:
    recording = enrolment.recorded(LAYOUT, PROGRAMME, reading, truth, 0.0, seed=0)
    signal, last = enrolment.playing(recording), len(recording) - 1
    for row in (0, 150, last, last + 151):
        np.testing.assert_array_equal(signal(row / 100.0), recording.values[row % (last + 1)])
    thin = enrolment.thinned(recording, 20.0)
    assert (len(thin), thin.tare.sum()) == (-(-len(recording) // 5), 10)
    assert len(enrolment.thinned(recording, 1000.0)) == len(recording)


def test_loads_grow_within_their_bounds() -> None:
    loads = enrolment.growing_loads(60, 1.0, 10.0, np.random.default_rng(0))
    assert loads.min() >= 1.0
    assert loads.max() <= 10.0
    assert (np.diff(loads[:6]) > 0).all()


BASE = np.full((2, 3), 5.0)


def watched(
    contact: list[int], size: list[float], window: int = 3
) -> list[tuple[int, enrolment.Press]]:
    """Presses with the frame at which each ended."""
    watch = enrolment.PressWatch(window)
    found = []
    for i, (touch, far) in enumerate(zip(contact, size, strict=True)):
        press = watch(Frame(10 * i, i, BASE + far), touch, BASE)
        found += [(i, press)] if press is not None else []
    return found


HELD = enrolment.LONGEST * 3


@pytest.mark.parametrize(
    ('contact', 'size', 'window', 'ends'),
    [
        ([0, 1, 1, 1, 1, 1, 1, 0, 0], [0, 1, 2, 4, 9, 5, 1, 0, 0], 3, [7]),  # with its release
        ([1, 1, 1, 1, 0, 0], [1] * 6, 3, []),  # it began before anybody watched
        ([1, 1, 0, 1, 1, 1, 0], [1] * 7, 3, [6]),
        ([0] + [1] * 2 * HELD + [0], [1] * (2 * HELD + 2), 3, [HELD]),  # held: after a while, once
        ([0, 1, 0, 1, 1, 1, 1, 1, 1, 0, 1, 0, 0], [1] * 13, 4, [9]),  # contact that flickers
    ],
)
def test_a_press_is_found_where_it_ends(
    contact: list[int], size: list[float], window: int, ends: list[int]
) -> None:
    found = watched(contact, size, window)
    assert [end for end, _ in found] == ends
    if ends == [7]:  # its strongest window is kept
        assert [frame.sequence for frame in found[0][1].frames] == [3, 4, 5]


def test_frames_that_nobody_can_judge_belong_to_the_press() -> None:
    nan = float('nan')
    clipped = watched([0, 1, -1, -1, -1, 1, 0], [0, 1, 9, 9, 9, 1, 0])
    assert [frame.sequence for frame in clipped[0][1].frames] == [2, 3, 4]
    # all of it clipped is a press too, a single bad reading at rest is none
    assert len(watched([0, -1, -1, -1, 0], [0, nan, nan, nan, 0])) == 1
    assert watched([0, -1, 0, 0], [0, nan, 0, 0]) == []


def test_sensors_without_classes_learn_none() -> None:
    with pytest.raises(ValueError, match='learns no classes'):
        enrolment.window_of(load_sensor('gradiometer').pipeline())


def test_each_press_is_a_stream_after_its_baseline() -> None:
    presses = [press for _, press in watched([0, 1, 1, 1, 0, 1, 1, 1, 0], [0, 1, 2, 3] * 2 + [0])]
    made = enrolment.recording_of(Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T'), presses)
    np.testing.assert_array_equal(made.tare, [True, False, False, False] * 2)
    np.testing.assert_array_equal(made.stream, [0] * 4 + [1] * 4)
    np.testing.assert_array_equal(made.values[made.tare], [BASE, BASE])


def test_a_class_states_what_it_costs_and_is_refused_where_it_is_too_much(
    taught_skin: Path,
) -> None:
    pipeline = enrolled_skin.SPEC.load(taught_skin)
    before = pipeline.digest
    # other presses of the known heads at their places, in other noise
    known = enrolled_skin.SPEC.presses(pipeline.config, 1).select(slice(0, 80 + 8 * 96))
    noise = 4e-6 * np.random.default_rng(9).normal(size=known.values.shape)
    test = replace(known, values=known.values + noise)
    label = pipeline.process_batch(test).label
    said = enrolment.learn(pipeline, 'mug', enrolled_skin.new_head().select(slice(0, 80 + 3 * 96)))
    assert "'mug' learned from 3 presses; it takes 0 % of 8 known presses, 31.2 % at most" in said
    stated = pipeline.report['enrolled mug']
    # many windows of one press are one press: nothing lost of eight says little
    assert stated['known_presses_lost_at_most'] == pytest.approx(1 - 0.05 ** (1 / 8))
    assert 0 <= stated['lost_there'] < 0.01
    named = label >= 0
    assert named.sum() > 30
    lost = pipeline.process_batch(test).label[named] == len(pipeline.label_names) - 1
    assert lost.mean() <= stated['known_presses_lost_at_most']
    pipeline.forget('mug')
    assert pipeline.digest == before
    # presses of heads that are known already, under another name
    with pytest.raises(ValueError, match='must take at most'):
        enrolment.learn(pipeline, 'again', known)
