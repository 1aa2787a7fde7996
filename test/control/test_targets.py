# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Targets: balanced, and raised by slip and load."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.control.config import GripConfig
from tactile_ros.control.slip_margin import SlipMargin
from tactile_ros.control.targets import (
    AHEAD,
    LOADING,
    MOST,
    GripTargets,
    shared,
)

CONFIG = GripConfig(friction_low=0.3)
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


NOISE = CONFIG.force_noise


def slips(slipping: bool = False, load: float = 0.5) -> list[SlipMargin]:
    made = SlipMargin(CONFIG)
    made.step(2.0, load, int(slipping), NOISE, 0.01)
    return [made]


def run(
    targets: GripTargets, seen: list[SlipMargin], steps: int, framed: bool = True
) -> float:
    for _ in range(steps):
        targets.grow(seen, [framed], targets.now, full=False, dt=0.01)
    return targets.now[0]


def test_targets_grow_at_their_rate() -> None:
    targets = GripTargets(CONFIG, [0])
    targets.ask([2.0], [True], adapt=False)
    targets.touch([0.3])
    assert targets.now == [0.3]
    grown = 0.3 + LOADING / CONFIG.loop_time * 0.01
    assert run(targets, slips(), 1) == pytest.approx(grown)
    assert run(targets, slips(), 20) == 2.0


def test_slip_raises_only_where_it_may_and_to_a_limit() -> None:
    still, adapting = GripTargets(CONFIG, [0]), GripTargets(CONFIG, [0])
    still.ask([1.0], [True], adapt=False)
    adapting.ask([1.0], [True], adapt=True)
    seen = slips(slipping=True)
    assert run(still, seen, 500) == 1.0
    assert run(adapting, seen, 500) == pytest.approx(MOST)


@pytest.mark.parametrize(('load', 'framed', 'raised'), [
    (0.6, True, 2.0), (0.6, False, 1.2), (2.0, False, 1.2),
])  # fmt: skip
def test_load_asks_for_its_margin_up_to_a_factor(
    load: float, framed: bool, raised: float
) -> None:
    targets = GripTargets(CONFIG, [0])
    targets.ask([2.0], [True], adapt=True)
    assert run(targets, slips(load=load), 200, framed) == pytest.approx(2.0 * raised, rel=0.01)


def test_a_raise_waits_for_the_force_and_stops_where_a_drive_is_full() -> None:
    targets = GripTargets(CONFIG, [0])
    targets.ask([2.0], [True], adapt=True)
    seen = slips(load=1.0)
    for _ in range(300):
        targets.grow(seen, [True], [2.5], full=False, dt=0.01)
    assert targets.now[0] == pytest.approx(2.5 + 2.0 * AHEAD)
    for _ in range(300):
        targets.grow(seen, [True], [10.0], full=True, dt=0.01)
    assert targets.now[0] == pytest.approx(2.5 + 2.0 * AHEAD)


def test_one_false_word_of_slip_fades_and_the_asked_force_comes_back() -> None:
    targets = GripTargets(CONFIG, [0])
    targets.ask([2.0], [True], adapt=True)
    (seen,) = made = slips(load=0.25)
    run(targets, made, 20)
    seen.step(2.0, 0.25, 1, NOISE, 0.01)
    assert run(targets, made, 1) > 2.0
    seen.step(2.0, 0.25, 0, NOISE, 0.01)
    raised = run(targets, made, 40)
    assert raised >= 1.9 * 2.0
    for _ in range(6000):
        seen.step(2.0, 0.25, 0, NOISE, 0.01)
        run(targets, made, 1)
    assert targets.now[0] - 2.0 <= 0.01 * (raised - 2.0)
