"""A programme of presses: what touches when, and recordings made of it."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.presses import (
    BLOCK,
    REST_S,
    TARE_S,
    Programme,
    Touches,
    growing_loads,
    playing,
    recorded,
    thinned,
)
from tactile_ros.types import Layout

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
