"""PI of one drive: bumpless, limited, and not wound up."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.control.config import GripConfig
from tactile_ros.control.force_pi import DriveLaw

CONFIG = GripConfig(closure_low=0.1, closure_high=0.9)
NEAR = 1e-12


@given(
    st.floats(0.1, 0.9),
    st.lists(
        st.tuples(st.floats(-10, 10), st.floats(5, 300), st.floats(1e-4, 0.1), st.booleans()),
        max_size=40,
    ),
)
def test_limits_and_rate_hold_whatever_comes(
    start: float, steps: list[tuple[float, float, float, bool]]
) -> None:
    law = DriveLaw(CONFIG)
    law.seat(start)
    last = law.command
    for error, stiffness, dt, regulated in steps:
        now = law.regulate(error, stiffness, dt) if regulated else law.move(error, dt)
        assert 0.1 <= now <= 0.9
        assert abs(now - last) <= CONFIG.closure_rate * dt + NEAR
        last = now


@given(st.floats(0.1, 0.9), st.floats(-0.5, 0.5), st.floats(5, 300))
def test_the_first_step_has_no_bump(start: float, error: float, stiffness: float) -> None:
    law = DriveLaw(CONFIG)
    law.seat(start)
    moved = abs(law.regulate(error, stiffness, 1e-6) - start)
    assert moved <= 1e-4 * abs(error) + NEAR


def test_a_change_of_gain_has_no_bump() -> None:
    law = DriveLaw(CONFIG)
    law.seat(0.5)
    law.regulate(0.2, 100.0, 0.01)
    before = law.regulate(0.2, 100.0, 1e-9)
    assert law.regulate(0.2, 10.0, 1e-9) == pytest.approx(before, abs=1e-6)


def test_saturation_does_not_wind_up() -> None:
    """After ten seconds against a limit the command leaves it as soon as the error turns."""
    law = DriveLaw(CONFIG)
    law.seat(0.5)
    for _ in range(1000):
        law.regulate(1.0, 20.0, 0.01)
    assert law.command == 0.9
    assert law.limited
    left = [law.regulate(-1.0, 20.0, 0.01) for _ in range(5)]
    assert left[0] < 0.9
    assert np.all(np.diff(left) < 0)


def test_slow_hands_get_slow_loops() -> None:
    quick = DriveLaw(CONFIG)
    slow = DriveLaw(dataclasses.replace(CONFIG, dead_time=0.2))
    for law in (quick, slow):
        law.seat(0.5)
        for _ in range(5):
            law.regulate(0.5, 50.0, 0.01)
    assert slow.command - 0.5 < 0.5 * (quick.command - 0.5)


def test_retreat_starts_from_where_the_drive_is() -> None:
    law = DriveLaw(CONFIG)
    law.seat(0.5)
    law.retreat(0.495)
    assert law.regulate(0.0, 50.0, 0.01) == pytest.approx(0.495)
    law.seat(0.5)
    law.retreat(0.6)  # a drive that is ahead of its command is not followed
    assert law.regulate(0.0, 50.0, 0.01) == pytest.approx(0.5)


def test_between_forces_a_drive_goes_as_far_as_the_last_asked_and_no_further() -> None:
    law = DriveLaw(CONFIG)
    law.seat(0.5)
    law.regulate(0.0, 5.0, 0.01)
    first = law.regulate(0.5, 5.0, 0.01)  # more than the rate allows
    assert first == pytest.approx(0.51)
    path = [law.follow(0.01) for _ in range(30)]
    assert path[0] == pytest.approx(0.52)
    assert np.all(np.diff(path) >= 0)
    assert np.ptp(path[-5:]) == 0.0
    assert path[-1] - 0.5 < 0.5 / 5.0  # never more than the error asks for
    law.stay()
    assert law.follow(0.01) == path[-1]


def test_time_without_a_force_is_integrated_once() -> None:
    late, often = DriveLaw(CONFIG), DriveLaw(CONFIG)
    for law in (late, often):
        law.seat(0.5)
        law.regulate(0.01, 50.0, 0.01)
    for _ in range(3):
        last = often.regulate(0.01, 50.0, 0.01)
    assert late.regulate(0.01, 50.0, 0.01, unseen=0.02) == pytest.approx(last, abs=1e-12)
