"""How a grasp ends."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_ros.control import GraspOutcome, GraspSequence, GripConfig, GripPhase, GripStep

CONFIG = GripConfig()
MADE = GripStep(
    GripPhase.CLOSE, np.array([0.3]), True, False, '', np.array([2.0]), np.array([0.0]),
    np.array([np.nan]), np.array([np.nan]), np.array([np.nan]), np.array([False]),
    np.array([False]), np.array([60.0]), np.array([1.0]), False, 0.0,
    False,
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


def test_a_fault_says_why() -> None:
    sequence = GraspSequence(CONFIG)
    for _ in range(110):
        progress = sequence.step(dataclasses.replace(MADE, **FAULT), 0.01)  # type: ignore[arg-type]
    assert progress.message == 'finger 0 is stale (0.2 s)'


@pytest.mark.parametrize('timeout', [-1.0, float('nan'), float('inf')])
def test_a_timeout_that_cannot_be(timeout: float) -> None:
    with pytest.raises(ValueError, match='timeout of a grasp must be 0 or more seconds'):
        GraspSequence(CONFIG, timeout)
