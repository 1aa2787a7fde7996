# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Presses in a stream: where they begin and end, what is kept of them, what a class may cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from reference import enrolled_skin
from tactile_ros.enrolment import (
    BLOCK,
    LONGEST,
    REST_S,
    TARE_S,
    PressWatch,
    Programme,
    Touches,
    growing_loads,
    learn,
    playing,
    recorded,
    recording_of,
    thinned,
    window_of,
)
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame, Layout

if TYPE_CHECKING:
    from tactile_ros.enrolment import Press

PLACES = np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
PROGRAMME = Programme(PLACES, np.array([[0, 0, 1.0], [0, 0, 2.0], [0.5, 0, 3.0]]))
LAYOUT = Layout(np.zeros((2, 3)), ('a',), '1', rate_hz=100.0)


def reading(touches: Touches) -> np.ndarray:
    return np.repeat(touches.force[:, None, 2:], 2, axis=1)


def truth(touches: Touches) -> dict[str, np.ndarray]:
    return {'position': touches.position, 'force': touches.force}


def test_rest_rise_hold_fall_pause_and_again() -> None:
    second = REST_S + PROGRAMME.period_s
    times = np.array([0.0, 0.9, second + 0.15, second + 0.5, second + 0.8, second + 1.0])
    touches = PROGRAMME.at(times)
    assert touches.press.tolist() == [-1, -1, 1, 1, 1, -1]
    np.testing.assert_allclose(touches.force[:, 2], [0, 0, 1, 2, 2 / 3, 0], atol=1e-9)
    assert np.isnan(touches.position[[0, 1, 5]]).all()
    np.testing.assert_array_equal(touches.position[3], PLACES[1])
    again = PROGRAMME.at(times + 3 * PROGRAMME.duration_s)
    np.testing.assert_allclose(again.force, touches.force, atol=1e-9)
    assert PROGRAMME.duration_s == pytest.approx(REST_S + 3 * PROGRAMME.period_s)


def test_a_recording_knows_what_touched() -> None:
    recording = recorded(LAYOUT, PROGRAMME, reading, truth, 0.0, seed=7)
    touched = recording.truth['in_contact'] == 1
    assert len(recording) == round(100 * PROGRAMME.duration_s)
    assert recording.tare.sum() == round(100 * TARE_S)
    assert not (recording.tare & touched).any()
    assert (np.diff(recording.stamp_ns) == 10_000_000).all()
    np.testing.assert_array_equal(recording.values[:, 1, 0], recording.truth['force'][:, 2])
    assert not recording.truth['force'][~touched].any()
    assert set(recording.truth['repetition'][touched]) == {0, 1, 2}
    assert set(recording.truth['session']) == {7}


def test_noise_has_its_seed_and_its_size() -> None:
    one, same, other = (recorded(LAYOUT, PROGRAMME, reading, truth, 0.1, s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.values, same.values)
    assert (one.values != other.values).any()
    plain = recorded(LAYOUT, PROGRAMME, reading, truth, 0.0, 1)
    assert abs((one.values - plain.values).std() - 0.1) < 0.01
    clipped = recorded(LAYOUT, PROGRAMME, reading, truth, 0.1, 1, (0.0, 1.0))
    assert clipped.values.min() == 0.0
    assert clipped.values.max() == 1.0


def test_playing_gives_the_rows_again_and_again() -> None:
    recording = recorded(LAYOUT, PROGRAMME, reading, truth, 0.0, seed=0)
    signal = playing(recording)
    for row in (0, 150, len(recording) - 1, len(recording) + 150):
        wanted = recording.values[row % len(recording)]
        np.testing.assert_array_equal(signal(row / 100.0), wanted)


def test_blocks_of_a_model_are_joined() -> None:
    seen = []

    def slow(touches: Touches) -> np.ndarray:
        seen.append(len(touches.press))
        return reading(touches)

    fast = Layout(np.zeros((2, 3)), ('a',), '1', rate_hz=500.0)
    recording = recorded(fast, PROGRAMME, slow, truth, 0.0, seed=0)
    assert max(seen) <= BLOCK
    assert len(seen) > 1
    np.testing.assert_array_equal(recording.values[:, 0, 0], recording.truth['force'][:, 2])


def test_thinned_keeps_rests_and_touches() -> None:
    recording = recorded(LAYOUT, PROGRAMME, reading, truth, 0.0, seed=0)
    thin = thinned(recording, 20.0)
    assert len(thin) == -(-len(recording) // 5)
    assert thin.tare.sum() == 10
    assert len(thinned(recording, 1000.0)) == len(recording)


def test_loads_grow_within_their_bounds() -> None:
    loads = growing_loads(60, 1.0, 10.0, np.random.default_rng(0))
    assert loads.min() >= 1.0
    assert loads.max() <= 10.0
    assert (np.diff(loads[:6]) > 0).all()


TEST_LESSON_LAYOUT = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T')
BASE = np.full((2, 3), 5.0)


def watched(contact: list[int], size: list[float], window: int = 3) -> list[tuple[int, Press]]:
    """Presses with the frame at which each ended."""
    watch = PressWatch(window)
    found = []
    for i, (touch, far) in enumerate(zip(contact, size, strict=True)):
        press = watch(Frame(10 * i, i, BASE + far), touch, BASE)
        found += [(i, press)] if press is not None else []
    return found


def test_a_press_ends_with_its_release_and_keeps_its_strongest_window() -> None:
    found = watched([0, 1, 1, 1, 1, 1, 1, 0, 0], [0, 1, 2, 4, 9, 5, 1, 0, 0])
    assert [end for end, _ in found] == [7]
    assert [frame.sequence for frame in found[0][1].frames] == [3, 4, 5]


def test_what_began_before_anybody_watched_is_no_press() -> None:
    assert watched([1, 1, 1, 1, 0, 0], [1] * 6) == []
    assert len(watched([1, 1, 0, 1, 1, 1, 0], [1] * 7)) == 1


def test_a_press_that_is_held_counts_after_a_while_and_once() -> None:
    frames = 2 * LONGEST * 3
    found = watched([0] + [1] * frames + [0], [1.0] * (frames + 2))
    assert [end for end, _ in found] == [LONGEST * 3]


def test_frames_that_nobody_can_judge_belong_to_the_press() -> None:
    nan = float('nan')
    clipped = watched([0, 1, -1, -1, -1, 1, 0], [0, 1, 9, 9, 9, 1, 0])
    assert [frame.sequence for frame in clipped[0][1].frames] == [2, 3, 4]
    # all of it clipped is a press too, a single bad reading at rest is none
    assert len(watched([0, -1, -1, -1, 0], [0, nan, nan, nan, 0])) == 1
    assert watched([0, -1, 0, 0], [0, nan, 0, 0]) == []


def test_contact_that_flickers_is_no_press() -> None:
    contact = [0, 1, 0, 1, 1, 1, 1, 1, 1, 0, 1, 0, 0]
    found = watched(contact, [1.0] * len(contact), window=4)
    assert [end for end, _ in found] == [9]


def test_each_press_is_a_stream_after_its_baseline() -> None:
    presses = [press for _, press in watched([0, 1, 1, 1, 0, 1, 1, 1, 0], [0, 1, 2, 3] * 2 + [0])]
    made = recording_of(TEST_LESSON_LAYOUT, presses)
    assert made.tare is not None
    assert made.tare.tolist() == [True, False, False, False] * 2
    assert made.stream is not None
    assert made.stream.tolist() == [0] * 4 + [1] * 4
    np.testing.assert_array_equal(made.values[made.tare], [BASE, BASE])


def test_sensors_without_classes_learn_none() -> None:
    with pytest.raises(ValueError, match='learns no classes'):
        window_of(load_sensor('gradiometer').pipeline())


def test_a_class_that_would_cost_too_much_is_refused_and_a_cheap_one_stated() -> None:
    pipeline = enrolled_skin.five_heads()
    before = pipeline.digest
    presses = enrolled_skin.new_head().select(slice(0, 80 + 3 * 96))
    said = learn(pipeline, 'mug', presses)
    assert "'mug' learned from 3 presses; it takes 0 % of 8 known presses, 31.2 % at most" in said
    stated = pipeline.report['enrolled mug']
    # many windows of one press are one press: nothing lost of eight says little
    assert stated['known_presses_lost_at_most'] == pytest.approx(1 - 0.05 ** (1 / 8))
    assert 0 <= stated['lost_there'] < 0.01
    pipeline.forget('mug')
    assert pipeline.digest == before
    # presses of heads that are known already, under another name
    known = enrolled_skin.SPEC.presses(pipeline.config, 1).select(slice(0, 80 + 8 * 96))
    with pytest.raises(ValueError, match='must take at most'):
        learn(pipeline, 'again', known)


def test_known_classes_keep_what_was_stated() -> None:
    # other presses of the known heads at their places, in other noise, before and after
    pipeline = enrolled_skin.five_heads()
    rows = slice(0, 80 + 8 * 96)
    config = pipeline.config
    test = enrolled_skin.SPEC.presses(config, 1, noise=0.0).select(rows)
    noisy = test.values + 4e-6 * np.random.default_rng(9).normal(size=test.values.shape)
    test.values[:] = noisy
    before = pipeline.process_batch(test).label
    learn(pipeline, 'mug', enrolled_skin.new_head().select(slice(0, 80 + 3 * 96)))
    after = pipeline.process_batch(test).label
    named = before >= 0
    assert named.sum() > 30
    lost = float((after[named] == len(pipeline.label_names) - 1).mean())
    assert lost <= pipeline.report['enrolled mug']['known_presses_lost_at_most']
