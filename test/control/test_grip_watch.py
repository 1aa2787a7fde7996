"""What may be used for control."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_ros.control import GripConfig, GripInput
from tactile_ros.control.grip_force import GripWatch, refuse_step

CONFIG = GripConfig()
GOOD = GripInput(
    np.array([1.0, 2.0]), np.array([0.1, 0.2]), np.array([True, True]),
    np.zeros(2, np.int8), np.array([0.01, 0.02]), np.array([0.3, 0.3]), 0.03,
)  # fmt: skip


def judged(config: GripConfig = CONFIG, **change: object) -> tuple[str, GripWatch]:
    watch = GripWatch(config, 2)
    given = dataclasses.replace(GOOD, **change)  # type: ignore[arg-type]
    return watch.judge(given, given.normal.tolist(), [True, True]), watch


def test_good_inputs_pass_with_the_oldest_age() -> None:
    why, watch = judged()
    assert not why
    assert watch.good == [True, True]
    assert watch.age == 0.03


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'age': np.array([0.2, 0.0])}, 'finger 0 is stale (0.200 s)'),
        ({'age': np.array([0.0, -0.5])}, 'finger 1 is stale (-0.500 s)'),
        ({'age': np.array([np.nan, 0.0])}, 'finger 0 is stale (nan s)'),
        ({'valid': np.array([True, False])}, 'finger 1 says that it is not valid'),
        ({'normal': np.array([np.nan, 1.0])}, 'finger 0 gives a force that is not a number'),
        ({'normal': np.array([1.0, np.inf])}, 'finger 1 gives a force that is not a number'),
        ({'closure_age': 0.2}, 'joint states are stale (0.200 s)'),
        ({'closure': np.array([0.3, np.nan])}, 'closure of drive 1 is not a number'),
        ({'blocked': 'no order yet'}, 'no order yet'),
        ({'blocked': 'no order yet', 'age': np.full(2, np.inf)}, 'no order yet'),
    ],
)
def test_each_refusal_has_its_sentence(change: dict[str, object], sentence: str) -> None:
    why, _ = judged(dataclasses.replace(CONFIG, fewest_fingers=2), **change)
    assert why == sentence


def test_one_finger_of_two_is_enough_unless_told() -> None:
    why, watch = judged(valid=np.array([True, False]))
    assert not why
    assert watch.good == [True, False]


def test_a_hand_without_joint_states_may_be_allowed() -> None:
    config = dataclasses.replace(CONFIG, closure_required=False)
    assert not judged(config, closure_age=np.inf, closure=np.full(2, np.nan))[0]
    assert judged(config, blocked='no order yet')[0] == 'no order yet'


@pytest.mark.parametrize('dt', [0.0, -0.01, np.nan, np.inf, 0.2])
def test_time_steps_that_cannot_be(dt: float) -> None:
    assert refuse_step(dt, 0.1).startswith('time step must be above 0 and at most 0.100 s')
    assert not refuse_step(0.01, 0.1)
