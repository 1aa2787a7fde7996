# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Ends of a grasp and of what is held after it, and the config of a grip."""

import dataclasses

import numpy as np
import pytest

from tactile_ros.control import (
    GraspOutcome,
    GraspSequence,
    GripConfig,
    GripPhase,
    GripStep,
    qb_softhand,
)

CONFIG = GripConfig()
MADE = GripStep(
    GripPhase.CLOSE, np.array([0.3]), np.array([np.nan]), True, False, '', '', '',
    np.array([2.0]), np.array([0.0]), np.array([np.nan]), np.array([np.nan]), np.array([False]),
    np.array([False]), np.array([60.0]), False, 0.0, False,
)  # fmt: skip
TOUCHED = np.array([True])
STEPS = {
    'closing': MADE,
    'loading': dataclasses.replace(MADE, touching=TOUCHED, phase=GripPhase.LOAD),
    'held': dataclasses.replace(MADE, touching=TOUCHED, phase=GripPhase.HOLD, settled=True),
    'lost': dataclasses.replace(MADE, phase=GripPhase.HOLD),
    'shut': dataclasses.replace(MADE, shut=True),
    'shut on it': dataclasses.replace(MADE, shut=True, touching=TOUCHED),
    'stale': dataclasses.replace(MADE, phase=GripPhase.FAULT, refusal='finger 0 is stale'),
    'contradicted': dataclasses.replace(MADE, phase=GripPhase.FAULT, fault='thumb reads nothing'),
    'opens': dataclasses.replace(MADE, phase=GripPhase.RELEASE),
    'open': dataclasses.replace(MADE, phase=GripPhase.IDLE),
}
END = GraspOutcome


@pytest.mark.parametrize(
    ('steps', 'outcome', 'message'),
    [
        ({'closing': 100, 'loading': 10, 'held': 1}, END.HELD, 'held at the asked force'),
        ({'closing': 100, 'loading': 10, 'lost': 25}, END.SLIPPED, 'the object was lost'),
        ({'loading': 10, 'lost': 15, 'shut on it': 5, 'closing': 1}, None, 'close'),
        ({'closing': 100, 'shut': 25}, END.NO_OBJECT, 'closed without touching anything'),
        ({'closing': 100, 'shut on it': 100}, None, 'close'),
        ({'closing': 310}, END.TIMEOUT, 'not held within 3 s'),
        ({'closing': 10, 'stale': 110}, END.FAULT, 'finger 0 is stale'),
        ({'stale': 50, 'closing': 1}, None, 'close'),
        ({'contradicted': 1}, END.FAULT, 'thumb reads nothing'),
        ({'closing': 10, 'opens': 1}, END.FAULT, 'the grip was released'),
        ({'closing': 10, 'held': 1, 'lost': 100}, END.HELD, 'held at the asked force'),
    ],
)
def test_grasp_sequence_ends(
    steps: dict[str, int], outcome: GraspOutcome | None, message: str
) -> None:
    sequence = GraspSequence(CONFIG, timeout=3.0)
    for name, count in steps.items():
        for _ in range(count):
            progress = sequence.step(STEPS[name], 0.01)
    assert (progress.outcome, progress.message) == (outcome, message)


@pytest.mark.parametrize(
    ('last', 'outcome', 'message'),
    [('opens', END.TIMEOUT, 'not open within 2 s'), ('open', END.NO_OBJECT, 'the hand is open')],
)
def test_grasp_sequence_ends_an_opening(last: str, outcome: GraspOutcome, message: str) -> None:
    sequence = GraspSequence(CONFIG, 2.0, opens=True)
    for _ in range(201):
        progress = sequence.step(STEPS[last], 0.01)
    assert (progress.outcome, progress.message) == (outcome, message)


@pytest.mark.parametrize('timeout', [-1.0, float('nan'), float('inf')])
def test_grasp_sequence_refuses_a_timeout(timeout: float) -> None:
    with pytest.raises(ValueError, match='timeout of a grasp must be 0 or more seconds'):
        GraspSequence(CONFIG, timeout)


@pytest.mark.parametrize(
    ('steps', 'lost'),
    [
        ([('held', 500)], False),
        ([('held', 5), ('lost', 15), ('held', 1), ('lost', 15)], False),
        ([('held', 5), ('lost', 25)], True),
        ([('held', 5), ('stale', 500)], False),
        ([('held', 5), ('lost', 15), ('stale', 50), ('lost', 10)], True),
    ],
)
def test_grasp_sequence_judges_what_is_held_as_long_as_it_is(
    steps: list[tuple[str, int]], lost: bool
) -> None:
    kept = GraspSequence(CONFIG)
    for name, count in steps:
        for _ in range(count):
            why = kept.judge(STEPS[name], 0.01)
    assert why == ('the object was lost' if lost else '')


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'dead_time': -1.0}, 'dead_time of GripConfig must be a number from 0 to 1; received -1'),
        ({'safe_action': 'close'}, "must be one of hold, open; received 'close'"),
        ({'force_noise': float('nan')}, 'force_noise of GripConfig must be a number'),
        ({'stiffness_low': 400.0}, 'stiffness_low of GripConfig must be below stiffness_high'),
    ],
)  # fmt: skip
def test_grip_config_refuses_in_one_sentence(change: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence.replace('.', r'\.')):
        dataclasses.replace(GripConfig(), **change)


def test_grip_config_stale_age_is_at_least_three_periods() -> None:
    assert GripConfig().stale_age == 0.1
    assert GripConfig(input_rate_hz=10.0).stale_age == pytest.approx(0.3)
    assert qb_softhand().stale_age == pytest.approx(3 / 25)
