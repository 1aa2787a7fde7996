"""The fake hand moves as late, as slowly and as far as it is told to."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.hands.joints import MockHand
from tactile_ros.types import JointLimits

LIMITS = JointLimits(np.zeros(2), np.ones(2), np.array([100.0, 0.5]), np.ones(2))


def test_a_position_loop_follows_with_its_lag_and_its_speed() -> None:
    hand = MockHand(LIMITS, np.zeros(2), lag_s=0.1)
    hand.command(np.array([0.8, 0.8]))
    for _ in range(100):
        position = hand.step(0.001)
    assert position[0] == pytest.approx(0.8 * (1 - np.exp(-1)), rel=1e-9)
    assert position[1] == pytest.approx(0.05)


def test_a_command_acts_after_the_dead_time_and_arrives_at_the_horizon() -> None:
    hand = MockHand(LIMITS, np.zeros(2), dead_time_s=0.1)
    hand.command(np.array([0.4, 0.0]), 0.2)
    track = [hand.step(0.01)[0] for _ in range(40)]
    assert track[8] == 0
    assert track[19] == pytest.approx(0.22, abs=0.03)
    assert track[30] == pytest.approx(0.4, abs=1e-6)


def test_it_stops_at_its_limits() -> None:
    hand = MockHand(LIMITS, np.full(2, 5.0))
    np.testing.assert_array_equal(hand.position, [1.0, 1.0])
    hand.command(np.array([-3.0, 9.0]))
    for _ in range(500):
        position = hand.step(0.01)
    np.testing.assert_allclose(position, [0.0, 1.0], atol=1e-9)
