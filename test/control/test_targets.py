"""Targets: balanced, and raised by slip and load."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.control.config import GripConfig
from tactile_ros.control.slip_margin import SlipMargin
from tactile_ros.control.targets import GripTargets, balanced, shared

CONFIG = GripConfig(friction_low=0.3, margin=0.3)
FINGERS = st.lists(
    st.tuples(st.floats(0.2, 10), st.sampled_from([-1, 0, 1]), st.booleans()), min_size=1
)


@given(FINGERS)
def test_shares_balance_and_never_exceed_what_was_asked(
    fingers: list[tuple[float, int, bool]],
) -> None:
    asked, sides, used = (list(column) for column in zip(*fingers, strict=True))
    made = shared(asked, sides, used)
    assert all(m <= a + 1e-12 for m, a in zip(made, asked, strict=True))
    assert all(m == 0.0 for m, u in zip(made, used, strict=True) if not u)
    sums = [sum(m for m, s in zip(made, sides, strict=True) if s == side) for side in (1, -1)]
    if min(sums) > 0:
        assert sums[0] == pytest.approx(sums[1])


@given(st.lists(st.tuples(st.floats(-10, 10), st.sampled_from([-1, 0, 1])), min_size=1))
def test_regulated_errors_leave_no_net_force(fingers: list[tuple[float, int]]) -> None:
    errors, sides = (list(column) for column in zip(*fingers, strict=True))
    made = balanced(errors, sides, [1.0] * len(sides), np.inf)
    if 1 in sides and -1 in sides:
        assert np.dot(made, sides) == pytest.approx(0.0, abs=1e-9)
    else:
        assert made == errors
    for before, after, side in zip(errors, made, sides, strict=True):
        assert side != 0 or before == after


@given(st.lists(st.tuples(st.floats(-10, 10), st.sampled_from([-1, 1])), min_size=2))
def test_balance_adds_to_a_finger_no_more_than_its_share(fingers: list[tuple[float, int]]) -> None:
    errors, sides = (list(column) for column in zip(*fingers, strict=True))
    targets = shared([2.0] * len(sides), sides, [True] * len(sides))
    made = balanced(errors, sides, targets, 0.2)
    for before, after, target in zip(errors, made, targets, strict=True):
        assert after - before <= 0.2 * target + 1e-9 or len(set(sides)) == 1
    if len(set(sides)) == 2:
        free = balanced(errors, sides, targets, np.inf)
        eased = np.subtract(free, made)
        assert (eased >= -1e-9).all()
        assert np.dot(eased, sides) == pytest.approx(0.0, abs=1e-6)


def slips(count: int = 1, slipping: bool = False) -> list[SlipMargin]:
    made = [SlipMargin(CONFIG) for _ in range(count)]
    for one in made:
        one.step(2.0, 0.5, int(slipping), 0.01)
    return made


def run(targets: GripTargets, felt: list[SlipMargin], steps: int) -> float:
    for _ in range(steps):
        targets.grow(felt, 0.01)
    return targets.now[0]


def test_targets_grow_at_their_rate() -> None:
    targets = GripTargets(CONFIG, [0])
    targets.ask([2.0], [True], adapt=False)
    targets.touch()
    assert targets.now == [CONFIG.touch_force]
    assert run(targets, slips(), 1) == pytest.approx(CONFIG.touch_force + CONFIG.load_rate * 0.01)
    assert run(targets, slips(), 20) == 2.0


def test_slip_raises_only_where_it_may_and_to_a_limit() -> None:
    still, adapting = GripTargets(CONFIG, [0]), GripTargets(CONFIG, [0])
    still.ask([1.0], [True], adapt=False)
    adapting.ask([1.0], [True], adapt=True)
    felt = slips(slipping=True)
    assert run(still, felt, 500) == 1.0
    assert run(adapting, felt, 25) > 1.0
    assert run(adapting, felt, 500) == pytest.approx(CONFIG.raise_high)


def test_load_asks_for_its_margin_before_anything_slips() -> None:
    targets = GripTargets(CONFIG, [0])
    targets.ask([2.0], [True], adapt=True)
    felt = SlipMargin(CONFIG)
    felt.step(2.0, 0.55, 0, 0.01)  # margin 0.08 with the assumed friction
    wanted = 0.55 / (0.3 * 0.7)
    assert run(targets, [felt], 100) == pytest.approx(wanted)


def test_one_false_word_of_slip_fades_and_the_asked_force_comes_back() -> None:
    targets = GripTargets(CONFIG, [0])
    targets.ask([2.0], [True], adapt=True)
    felt = SlipMargin(CONFIG)
    for _ in range(100):
        felt.step(2.0, 0.25, 0, 0.01)
    run(targets, [felt], 20)
    felt.step(2.0, 0.25, 1, 0.01)
    assert run(targets, [felt], 1) > 2.0
    felt.step(2.0, 0.25, 0, 0.01)
    raised = run(targets, [felt], 20)
    assert raised >= 1.9 * 2.0
    for seconds, left in ((10.0, 0.4), (60.0, 0.01)):
        for _ in range(round(100 * seconds)):
            felt.step(2.0, 0.25, 0, 0.01)
            targets.grow([felt], 0.01)
        assert targets.now[0] - 2.0 <= left * (raised - 2.0)


def test_slips_that_come_again_fade_ever_slower() -> None:
    targets = GripTargets(CONFIG, [0])
    targets.ask([2.0], [True], adapt=True)
    for _ in range(5):
        run(targets, slips(slipping=True), 2)
        run(targets, slips(), 10)
    raised = run(targets, slips(), 10)
    assert run(targets, slips(), 1000) - 2.0 >= 0.9 * (raised - 2.0)
