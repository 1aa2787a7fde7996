"""Ages of messages: by their stamps where clocks agree, by their arrival otherwise."""

from __future__ import annotations

import pytest

from tactile_ros.nodes.grip_loop import StampAge

WALL_NS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


def age(ages: StampAge, stamp_ns: int, at_s: float, wall_ns: int = WALL_NS) -> float:
    """Age (s) of a message that comes `at_s` after the start."""
    now_s = 100.0 + at_s
    measured_s = ages.measured_s(stamp_ns, wall_ns + round(at_s * SECOND), now_s)
    return now_s - measured_s


def test_a_queue_that_keeps_frames_back_makes_them_old() -> None:
    ages = StampAge()
    assert age(ages, WALL_NS - 5_000_000, 0.0) == pytest.approx(0.005, abs=1e-6)
    assert age(ages, WALL_NS, 3.0) == pytest.approx(3.0, abs=1e-6)
    assert ages.agrees


@pytest.mark.parametrize('stamp_ns', [0, WALL_NS - 3600 * SECOND, WALL_NS + SECOND])
def test_another_clock_counts_from_arrival(stamp_ns: int) -> None:
    ages = StampAge()
    for k in range(3):
        assert age(ages, stamp_ns + k * SECOND, float(k)) == 0.0
    assert not ages.agrees


@pytest.mark.parametrize('jump', [-3600, -1, 2, 3600])
def test_a_wall_clock_that_jumps_makes_no_frame_old(jump: int) -> None:
    ages = StampAge()
    age(ages, WALL_NS - 5_000_000, 0.0)
    jumped = WALL_NS + jump * SECOND
    for k in range(1, 4):
        # the first was stamped before the jump, the others after it
        stamp_ns = (WALL_NS if k == 1 else jumped) + k * 10_000_000 - 5_000_000
        assert age(ages, stamp_ns, 0.01 * k, jumped) <= 0.005 + 1e-6
    assert ages.agrees


def test_a_stamp_a_little_ahead_is_of_now() -> None:
    ages = StampAge()
    assert age(ages, WALL_NS + 1_000_000, 0.0) == 0.0
    assert ages.agrees


@pytest.mark.parametrize('back', [0.5, 0.9])
def test_a_clock_that_steps_back_a_little_makes_messages_old_and_is_named(back: float) -> None:
    ages = StampAge()
    age(ages, WALL_NS - 5_000_000, 0.0)
    for k in range(1, 4):
        late = age(ages, WALL_NS + k * 10_000_000 - round(back * SECOND), 0.01 * k)
        assert late == pytest.approx(back, abs=1e-6)
        assert ages.back_s == pytest.approx(back, abs=0.05)
    age(ages, WALL_NS + 35_000_000, 0.04)
    assert ages.back_s == 0.0


def test_a_clock_that_steps_far_back_counts_from_arrival_again() -> None:
    ages = StampAge()
    age(ages, WALL_NS - 5_000_000, 0.0)
    assert age(ages, WALL_NS - 3600 * SECOND, 0.01) == 0.0
    assert ages.back_s == pytest.approx(3600, abs=1)
