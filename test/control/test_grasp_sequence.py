# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""How a grasp ends."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_ros.control import (
    GraspOutcome,
    GraspSequence,
    GripConfig,
    GripPhase,
    GripStep,
)

CONFIG = GripConfig()
MADE = GripStep(
    GripPhase.CLOSE, np.array([0.3]), np.array([np.nan]), True, False, '', '', '',
    np.array([2.0]), np.array([0.0]), np.array([np.nan]), np.array([np.nan]), np.array([False]),
    np.array([False]), np.array([60.0]), False, 0.0, False,
)  # fmt: skip
CLOSING = {}
TOUCHES = {'touching': np.array([True])}
LOADING = {**TOUCHES, 'phase': GripPhase.LOAD}
HELD = {**TOUCHES, 'phase': GripPhase.HOLD, 'settled': True}
LOST = {'phase': GripPhase.HOLD}
SHUT = {'shut': True}
FAULT = {'phase': GripPhase.FAULT, 'refusal': 'finger 0 is stale (0.2 s)'}
OPENS = {'phase': GripPhase.RELEASE}


@pytest.mark.parametrize(
    ('steps', 'outcome'),
    [
        ([(CLOSING, 100), (LOADING, 10), (HELD, 1)], GraspOutcome.HELD),
        ([(CLOSING, 100), (LOADING, 10), (LOST, 25)], GraspOutcome.SLIPPED),
        ([(CLOSING, 100), (LOADING, 10), (LOST, 15), (LOADING, 5)], None),
        ([(CLOSING, 100), (SHUT, 25)], GraspOutcome.NO_OBJECT),
        ([(CLOSING, 100), ({**SHUT, **TOUCHES}, 100)], None),
        ([(CLOSING, 310)], GraspOutcome.TIMEOUT),
        ([(CLOSING, 10), (FAULT, 110)], GraspOutcome.FAULT),
        ([(CLOSING, 10), (FAULT, 50), (CLOSING, 1), (FAULT, 60)], None),
        ([(CLOSING, 10), (OPENS, 1)], GraspOutcome.FAULT),
        ([(CLOSING, 10), (HELD, 1), (LOST, 100)], GraspOutcome.HELD),
    ],
)
def test_outcomes(
    steps: list[tuple[dict[str, object], int]], outcome: GraspOutcome | None
) -> None:
    sequence = GraspSequence(CONFIG, timeout=3.0)
    for change, count in steps:
        for _ in range(count):
            progress = sequence.step(dataclasses.replace(MADE, **change), 0.01)  # type: ignore[arg-type]
    assert progress.outcome == outcome
    assert progress.message


def test_a_contradicted_sensor_ends_a_grasp_at_once() -> None:
    bad = dataclasses.replace(MADE, phase=GripPhase.FAULT, fault='thumb reads nothing')
    progress = GraspSequence(CONFIG).step(bad, 0.01)
    assert (progress.outcome, progress.message) == (GraspOutcome.FAULT, 'thumb reads nothing')


def test_a_fault_says_why() -> None:
    sequence = GraspSequence(CONFIG)
    for _ in range(110):
        progress = sequence.step(dataclasses.replace(MADE, **FAULT), 0.01)  # type: ignore[arg-type]
    assert progress.message == 'finger 0 is stale (0.2 s)'


@pytest.mark.parametrize('timeout', [-1.0, float('nan'), float('inf')])
def test_a_timeout_that_cannot_be(timeout: float) -> None:
    with pytest.raises(ValueError, match='timeout of a grasp must be 0 or more seconds'):
        GraspSequence(CONFIG, timeout)


@pytest.mark.parametrize(('opens', 'change'), [(False, CLOSING), (True, OPENS)])
def test_a_goal_ends_at_its_timeout(opens: bool, change: dict[str, object]) -> None:
    sequence = GraspSequence(CONFIG, 2.0, opens)
    for _ in range(201):
        progress = sequence.step(dataclasses.replace(MADE, **change), 0.01)  # type: ignore[arg-type]
    assert progress.outcome == GraspOutcome.TIMEOUT
    assert progress.message.endswith('within 2 s')


@pytest.mark.parametrize(
    ('steps', 'lost'),
    [
        ([(HELD, 500)], False),
        ([(HELD, 5), (LOST, 15), (HELD, 1), (LOST, 15)], False),
        ([(HELD, 5), (LOST, 25)], True),
        ([(HELD, 5), (FAULT, 500)], False),
        ([(HELD, 5), (LOST, 15), (FAULT, 50), (LOST, 10)], True),
    ],
)
def test_what_is_held_is_judged_as_long_as_it_is(
    steps: list[tuple[dict[str, object], int]], lost: bool
) -> None:
    kept = GraspSequence(CONFIG)
    for change, count in steps:
        for _ in range(count):
            why = kept.judge(dataclasses.replace(MADE, **change), 0.01)  # type: ignore[arg-type]
    assert why == ('the object was lost' if lost else '')
