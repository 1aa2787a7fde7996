# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Targets: balanced, and raised by slip and load."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.control.config import Drive, GripConfig
from tactile_ros.control.finger import Finger
from tactile_ros.control.force_pi import ForcePi
from tactile_ros.control.grasp_sequence import FingerInput
from tactile_ros.control.targets import AHEAD, LOADING, MOST, GripTargets, shared

CONFIG = GripConfig(friction_low=0.3)
NOISE = CONFIG.force_noise
FINGERS = st.lists(
    st.tuples(st.floats(0.2, 10), st.sampled_from([-1, 0, 1]), st.booleans()), min_size=1
)


@given(FINGERS)
def test_shared_balances_and_never_exceeds_what_was_asked(
    fingers: list[tuple[float, int, bool]],
) -> None:
    asked, sides, used = (list(column) for column in zip(*fingers, strict=True))
    made = shared(asked, sides, used)
    assert all(m <= a + 1e-12 for m, a in zip(made, asked, strict=True))
    assert all(m == 0.0 for m, u in zip(made, used, strict=True) if not u)
    sums = [sum(m for m, s in zip(made, sides, strict=True) if s == side) for side in (1, -1)]
    if min(sums) > 0:
        assert sums[0] == pytest.approx(sums[1])


class Run:
    """Targets of one finger, and what it feels."""

    def __init__(self, asked: float, adapt: bool = True, load: float = 0.5) -> None:
        self.finger, self.load = Finger(CONFIG, ForcePi(CONFIG, Drive(5.0, 300.0))), load
        self.targets = GripTargets(CONFIG, [self.finger])
        self.targets.begin([asked], adapt)
        self.finger.touching, self.finger.why = True, ''
        self.feel()

    def feel(self, slips: bool = False, framed: bool = True) -> None:
        """One step of forces under the load."""
        self.finger.given = FingerInput(2.0, self.load, True, int(slips), 0.0, framed=framed)
        self.finger.slip.step(2.0, self.load, int(slips), NOISE, 0.01)

    def grow(self, steps: int, force: float | None = None, settled: bool = False) -> float:
        """Target after steps with a force; None: it follows the target."""
        for _ in range(steps):
            self.finger.normal = self.finger.target if force is None else force
            self.targets.grow(settled, 0.01)
        return self.finger.target


def test_a_raise_ends_where_its_drive_gives_no_more() -> None:
    run = Run(1.0, load=0.4)  # which wants 2.7 N
    made = []
    for _ in range(100):
        # its limit is felt only while more is asked for than it gives
        run.finger.law.full = run.finger.target > 2.2
        made.append(run.grow(1, force=min(run.finger.target, 2.1)))
    assert max(made[-50:]) - min(made[-50:]) < 0.3


def test_grip_targets_say_that_other_fingers_press() -> None:
    fingers = [Finger(CONFIG, ForcePi(CONFIG, Drive(5.0, 300.0)), side=s) for s in (1, 1, -1)]
    targets = GripTargets(CONFIG, fingers)
    targets.begin([2.0] * 3, adapt=False)
    for finger in fingers[::2]:
        finger.touching = True
    assert targets.share()
    assert [finger.asked for finger in fingers] == [2.0, 0.0, 2.0]
    assert not targets.share()
    fingers[1].touching = True
    assert targets.share()
    assert [finger.asked for finger in fingers] == [1.0, 1.0, 2.0]
    fingers[2].touching = False  # one side alone shares nothing
    assert not targets.share()


def test_grip_targets_grow_at_their_rate() -> None:
    run = Run(2.0, adapt=False)
    run.finger.target = 0.3
    assert run.grow(1) == pytest.approx(0.3 + LOADING / CONFIG.loop_time * 0.01)
    assert run.grow(20) == 2.0


@pytest.mark.parametrize(('adapt', 'raised'), [(False, 1.0), (True, MOST)])
def test_grip_targets_are_raised_by_slip_where_they_may_and_to_a_limit(
    adapt: bool, raised: float
) -> None:
    run = Run(1.0, adapt)
    run.feel(slips=True)
    assert run.grow(500) == pytest.approx(raised)


@pytest.mark.parametrize(('load', 'framed', 'raised'), [
    (0.6, True, 2.0), (0.6, False, 1.2), (2.0, False, 1.2),
])  # fmt: skip
def test_grip_targets_are_raised_by_load_up_to_a_factor(
    load: float, framed: bool, raised: float
) -> None:
    run = Run(2.0, load=load)
    run.feel(framed=framed)
    assert run.grow(200) == pytest.approx(2.0 * raised, rel=0.01)


def test_grip_targets_wait_for_the_force_and_stop_where_a_drive_is_full() -> None:
    run = Run(2.0, load=1.0)
    assert run.grow(300, 2.5) == pytest.approx(2.5 + 2.0 * AHEAD)
    run.finger.law.full = True
    assert run.grow(300, 2.5) < 2.5 + 2.0 * AHEAD
    assert run.grow(300, 2.5, settled=True) == pytest.approx(4.0)


def test_grip_targets_forget_one_false_word_of_slip() -> None:
    run = Run(2.0, load=0.25)
    run.grow(20)
    run.feel(slips=True)
    assert run.grow(1) > 2.0
    run.feel()
    raised = run.grow(40)
    assert raised >= 1.9 * 2.0
    for _ in range(6000):
        run.feel()
        run.grow(1)
    assert run.finger.target - 2.0 <= 0.01 * (raised - 2.0)


def test_a_finger_that_bounces_neither_ends_a_raise_nor_gives_its_share_away() -> None:
    run = Run(1.0, load=0.4)
    made = run.grow(100)
    run.finger.touching, run.finger.steady = True, 0.02  # again, and its filter begins at 0.1 N
    run.finger.law.full = True
    assert run.grow(3, force=0.1) > 0.98 * made
    run.finger.steady = 1.0
    assert run.grow(100, force=0.1) < 0.5 * made
    fingers = [Finger(CONFIG, ForcePi(CONFIG, Drive(5.0, 300.0)), side=s) for s in (1, 1, -1)]
    targets = GripTargets(CONFIG, fingers)
    targets.begin([2.0] * 3, adapt=False)
    for finger in fingers:
        finger.touching = finger is not fingers[1]
    fingers[1].steady = 0.02
    assert not targets.share()
    fingers[1].steady = 0.1
    assert targets.share()


def test_a_weaker_finger_of_other_drives_does_not_end_a_raise_for_good() -> None:
    made = []
    for full in (0, 1):
        fingers = [Finger(CONFIG, ForcePi(CONFIG, Drive(5.0, 300.0)), side=s) for s in (1, -1)]
        targets = GripTargets(CONFIG, fingers)
        targets.begin([1.0] * 2, adapt=True)
        for finger in fingers:
            finger.touching, finger.why = True, ''
            finger.given = FingerInput(2.0, 0.4, True, 0, 0.0, framed=True)
            finger.slip.step(2.0, 0.4, 0, NOISE, 0.01)
        fingers[full].law.full = True
        for weak in (2.0, 0.5, 2.0):  # of the first, for a moment
            for _ in range(20):
                fingers[0].normal, fingers[1].normal = weak, 2.5
                targets.grow(settled=False, dt=0.01)
        made.append(fingers[1].target)
    assert made[0] < 1.5
    assert made[1] > 2.3
