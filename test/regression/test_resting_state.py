# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""State of a skin from its resting reading, and the variance of gains that a reading leaves."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.sensors.regression import RestingState
from tactile_ros.types import Array, Integers

WAY = np.array([3.0, -4.0, 0.0]) / 5


def setting_runs(shift: float = 0.0) -> tuple[Array, Array, Integers]:
    """Rests (T) that move along one way in two runs, the second shifted across it; states."""
    rng = np.random.default_rng(0)
    state = np.tile(100e-6 * (1 - np.exp(-np.arange(10) / 3)), 2)
    runs = np.repeat(np.arange(2), 10)
    rests = 5e-3 + state[:, None] * WAY + 1e-6 * rng.normal(size=(20, 3))
    rests[:, 2] += shift * runs
    return rests, state, runs


@pytest.mark.parametrize('shift', [0.0, 2e-3])
def test_the_way_is_the_one_within_runs(shift: float) -> None:
    rests, state, runs = setting_runs(shift)
    found = RestingState().fit(rests, runs)
    assert abs(found.direction_ @ WAY) == pytest.approx(1.0, abs=2e-3)
    alike = np.corrcoef(found.predict(rests)[0][runs == 0, 0], state[runs == 0])[0, 1]
    assert abs(alike) > 0.99


def test_another_day_moves_the_state_by_no_more_than_the_slack() -> None:
    rests, _, runs = setting_runs()
    state = RestingState().fit(rests, runs)
    seen = state.predict(rests)[0]
    far = state.predict(rests + 1e-3 * WAY)[0]
    assert np.ptp(far) == 0
    edge = min(abs(far[0, 0] - seen.min()), abs(far[0, 0] - seen.max()))
    assert edge == pytest.approx(0.25 * np.ptp(seen))


def test_readings_of_the_fit_leave_no_variance_and_far_ones_all() -> None:
    rests, _, runs = setting_runs()
    state = RestingState().fit(rests, runs)
    np.testing.assert_allclose(state.predict(rests)[1], 0.0, atol=1e-9)
    across = np.array([0.0, 0.0, 1.0])
    steps = np.array([[0.1], [0.5], [1.0], [5.0]]) * state.width_
    share = state.predict(rests[:1] + steps * across)[1]
    assert (np.diff(share) > 0).all()
    np.testing.assert_allclose(share, 1 - np.exp(-((steps[:, 0] / state.width_) ** 2)), atol=0.02)


def test_one_resting_reading_has_no_way_and_another_leaves_all() -> None:
    rest = np.full((5, 3), 2e-3)
    state = RestingState().fit(rest, np.zeros(5, np.int64))
    assert state.predict(rest + 1e-4)[0].tolist() == [[0.0]] * 5
    assert state.predict(rest)[1].tolist() == [0.0] * 5
    np.testing.assert_allclose(state.predict(rest + 1e-4)[1], 1.0)
    none = RestingState().fit(np.zeros((4, 3)), np.zeros(4, np.int64)).predict(np.zeros((4, 3)))
    assert not none[0].any()
    assert not none[1].any()


def test_a_reading_that_two_runs_share_leaves_all_variance() -> None:
    rests = np.array([[0.0, 1], [2, 1], [2, 1], [5, 1]])
    own, shared = np.array([0, 0, 0, 1]), np.array([0, 0, 1, 1])
    np.testing.assert_allclose(RestingState().fit(rests, own).predict(rests)[1], 0.0, atol=1e-9)
    assert RestingState().fit(rests, shared).predict(rests)[1].tolist() == [1.0] * 4


def test_a_row_gives_the_numbers_of_a_batch_and_units_do_not_matter() -> None:
    rests, _, runs = setting_runs()
    state, micro = RestingState().fit(rests, runs), RestingState().fit(1e6 * rests, runs)
    fresh = rests + 3e-5
    along, share = state.predict(fresh)
    for i in range(3):
        one = state.predict(fresh[i : i + 1])
        np.testing.assert_allclose(one[0], along[i : i + 1], rtol=1e-9)
        np.testing.assert_allclose(one[1], share[i : i + 1], rtol=1e-6)
    np.testing.assert_allclose(micro.predict(1e6 * fresh)[0], 1e6 * along, rtol=1e-6)
    np.testing.assert_allclose(micro.predict(1e6 * fresh)[1], share, rtol=1e-6)
    with pytest.raises(NotCalibratedError, match='RestingState'):
        RestingState().predict(rests)
