"""The state of a skin read from its resting reading, and how strange a reading is."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.kernel_ridge import RestingState
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
    alike = np.corrcoef(found.along(rests)[runs == 0, 0], state[runs == 0])[0, 1]
    assert abs(alike) > 0.99


def test_another_day_moves_the_state_by_no_more_than_the_slack() -> None:
    rests, _, runs = setting_runs()
    state = RestingState(slack=0.25).fit(rests, runs)
    seen = state.along(rests)
    far = state.along(rests + 1e-3 * WAY * np.array([[1.0]]))
    assert np.ptp(far) == 0
    edge = min(abs(far[0, 0] - seen.min()), abs(far[0, 0] - seen.max()))
    assert edge == pytest.approx(0.25 * np.ptp(seen))


def test_readings_that_were_seen_are_not_strange_and_far_ones_are() -> None:
    rests, _, runs = setting_runs()
    state = RestingState().fit(rests, runs)
    np.testing.assert_allclose(state.strangeness(rests), 0.0, atol=1e-9)
    across = np.array([0.0, 0.0, 1.0])
    steps = np.array([[0.1], [0.5], [1.0], [5.0]]) * state.width_
    share = state.strangeness(rests[:1] + steps * across)
    assert (np.diff(share) > 0).all()
    np.testing.assert_allclose(share, 1 - np.exp(-((steps[:, 0] / state.width_) ** 2)), atol=0.02)


def test_one_resting_reading_tells_nothing() -> None:
    rest = np.full((5, 3), 2e-3)
    state = RestingState().fit(rest, np.zeros(5, np.int64))
    assert state.along(rest + 1e-4).tolist() == [[0.0]] * 5
    assert state.strangeness(rest).tolist() == [1.0] * 5


def test_a_reading_that_two_runs_share_tells_neither() -> None:
    rests = np.array([[0.0, 1], [2, 1], [2, 1], [5, 1]])
    own, shared = np.array([0, 0, 0, 1]), np.array([0, 0, 1, 1])
    assert RestingState().fit(rests, own).strangeness(rests).tolist() == [0.0] * 4
    assert RestingState().fit(rests, shared).strangeness(rests).tolist() == [1.0] * 4


def test_no_rest_at_all_is_always_strange() -> None:
    none = np.zeros((4, 3))
    state = RestingState().fit(none, np.zeros(4, np.int64))
    along, strangeness = state.read(none)
    assert not along.any()
    assert strangeness.tolist() == [1.0] * 4


def test_a_row_gives_the_numbers_of_a_batch_and_units_do_not_matter() -> None:
    rests, _, runs = setting_runs()
    state, micro = RestingState().fit(rests, runs), RestingState().fit(1e6 * rests, runs)
    fresh = rests + 3e-5
    along, strangeness = state.read(fresh)
    for i in range(3):
        one = state.read(fresh[i : i + 1])
        np.testing.assert_allclose(one[0], along[i : i + 1], rtol=1e-9)
        np.testing.assert_allclose(one[1], strangeness[i : i + 1], rtol=1e-6)
    np.testing.assert_allclose(micro.along(1e6 * fresh), 1e6 * along, rtol=1e-6)
    np.testing.assert_allclose(micro.strangeness(1e6 * fresh), strangeness, rtol=1e-6)


def test_a_second_fit_forgets_the_first_and_a_fit_comes_first() -> None:
    rests, _, runs = setting_runs()
    state = RestingState().fit(rests, runs)
    state.read(rests)
    again = state.fit(rests[:5] + 1e-3, runs[:5]).read(rests)
    np.testing.assert_array_equal(
        again[1], RestingState().fit(rests[:5] + 1e-3, runs[:5]).strangeness(rests)
    )
    with pytest.raises(NotCalibratedError, match='RestingState'):
        RestingState().read(rests)
