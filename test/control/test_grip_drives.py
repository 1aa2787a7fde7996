"""Drives that approach: none meets the object faster than its hand can react in fact."""

from __future__ import annotations

import dataclasses
from types import ModuleType

import numpy as np
import pytest

from tactile_ros.control import GripConfig, GripForce, GripPhase, qb_softhand
from tactile_ros.control.force_pi import IMPACT

TARGET = 2.0
TOLD = {'dead_time': 0.02, 'lag': 0.05}
QB = {'dead_time': 0.1, 'lag': 0.1}
PHASES = (0.3, 0.302, 0.304)  # of the touch in a period of the law


def approach(config: GripConfig) -> float:
    """Speed of an approach, as told (1/s)."""
    reaction = config.dead_time + 1.5 * config.slowest_period + config.lag
    return IMPACT * TARGET / (reaction * config.stiffness_high)


def met(
    world: object, config: GripConfig, told: bool = True, hangs: float = 0.0
) -> tuple[float, float]:
    """Largest force in targets, and when the object was met (s)."""
    law = GripForce(config, (0,))
    law.enable()
    law.grasp(TARGET, adapt=False)
    forces, periods = [], 0
    while len(forces) < 4 * config.rate_hz:
        felt = world.given()  # type: ignore[attr-defined]
        closure = felt.closure - hangs * min(10 * periods / config.rate_hz, 1.0)
        if not told and periods:
            closure = np.full(1, np.nan)
        made = law.step(dataclasses.replace(felt, closure=closure), 1 / config.rate_hz)
        assert made.send
        world.advance(made)  # type: ignore[attr-defined]
        if made.phase == GripPhase.CLOSE:
            periods += 1
            assert periods < 60 * config.rate_hz
        else:
            forces.append(world.force[0])  # type: ignore[attr-defined]
    return max(forces) / TARGET, periods / config.rate_hz


# before an approach looked at how far its drive is behind: 1.2 and 1.3 of the target, 9.7 and 9.9
# where the drive moves at half the speed of the approach; 1.8, 1.8, 6.7 and 7.2 on the slow hand
@pytest.mark.parametrize(
    ('config', 'told', 'dead', 'lag', 'slow', 'most'),
    [
        (GripConfig(), TOLD, 2.0, 1.0, np.inf, 1.10),
        (GripConfig(), TOLD, 2.0, 2.0, np.inf, 1.15),
        (GripConfig(), TOLD, 1.0, 1.0, 0.5, 1.25),
        (GripConfig(), TOLD, 2.0, 2.0, 0.5, 1.25),
        (qb_softhand(), QB, 2.0, 1.0, np.inf, 1.50),
        (qb_softhand(), QB, 2.0, 2.0, np.inf, 1.25),
        (qb_softhand(), QB, 1.0, 1.0, 0.5, 1.45),
        (qb_softhand(), QB, 2.0, 2.0, 0.5, 1.60),
    ],
)
def test_a_drive_twice_as_slow_as_told_meets_the_stiffest_object_softly(
    worlds: ModuleType, config: GripConfig, told: dict[str, float], dead: float, lag: float,
    slow: float, most: float,
) -> None:  # fmt: skip
    hand = {
        'rate_hz': config.rate_hz, 'dead_time': dead * told['dead_time'],
        'lag': lag * told['lag'], 'speed': slow * approach(config),
        'stiffness': config.stiffness_high,
    }  # fmt: skip
    for contact in PHASES:
        most_met, _ = met(worlds.GripWorld(contact=contact, **hand), config)
        assert most_met < most


def test_a_drive_that_is_as_told_approaches_as_fast_as_told(worlds: ModuleType) -> None:
    config = GripConfig()
    world = worlds.GripWorld(stiffness=300.0)
    most_met, after = met(world, config)
    assert after == pytest.approx(0.3 / approach(config), rel=0.1)
    assert most_met < 1.01


def test_a_drive_is_slowed_only_as_far_as_the_stiffest_object_asks(worlds: ModuleType) -> None:
    config = GripConfig(stiffness_high=60.0)
    hand = {'stiffness': 60.0, 'lag': 0.1}
    _, after = met(worlds.GripWorld(**hand), config)
    assert after == pytest.approx(0.3 / config.closing_rate + 0.1, rel=0.1)
    # at half the speed of the approach; 2.9 and more before what it lacks counted
    for contact in (0.3, 0.6):
        most_met, _ = met(worlds.GripWorld(contact=contact, speed=0.125, **hand), config)
        assert most_met < 1.8 < IMPACT


def test_joints_that_hang_behind_their_targets_are_slowed_to_half_and_no_less(
    worlds: ModuleType,
) -> None:
    config = GripConfig()
    _, after = met(worlds.GripWorld(stiffness=300.0), config, hangs=0.1)
    assert after == pytest.approx(2 * 0.3 / approach(config), rel=0.1)


def test_a_touch_turns_a_drive_back_whose_closure_is_not_measured(worlds: ModuleType) -> None:
    """By its model: the command steps back at the touch and does not wait for an error."""
    config = GripConfig(closure_required=False, contact_on=0.29)
    law, world = GripForce(config, (0,)), worlds.GripWorld(stiffness=300.0, noise=0.0)
    law.enable()
    law.grasp(TARGET, adapt=False)
    before = law.step(world.given(), 0.01)
    blind = np.full(1, np.nan)
    while True:
        world.advance(before)
        felt = dataclasses.replace(world.given(), closure=blind)
        made = law.step(felt, 0.01)
        if made.touching[0]:
            break
        before = made
    ahead = approach(config) * (config.dead_time + config.lag)
    assert before.closure - made.closure > 0.5 * ahead
    assert world.closure[0] < made.closure[0] + 2e-3
