"""What diagnostics say of a grip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_ros.control import GripConfig, GripForce, GripInput, GripPhase
from tactile_ros.nodes.grip_loop import Decision
from tactile_ros.nodes.grip_node import GripTally


def idle() -> Decision:
    """A step of a law that nobody asked for anything."""
    law, zero = GripForce(GripConfig(), (0, 1)), np.zeros(2)
    given = GripInput(zero, zero, zero == 0, zero.astype(np.int8), zero, zero, 0.0)
    return Decision(law.step(given, 0.01), None, False, '', None, '')


def told(phase: GripPhase, refusal: str, disagreement: float = np.nan) -> tuple[bytes, str]:
    """Level and sentence after a step."""
    tally, step = GripTally(), idle()
    made = replace(step.made, phase=phase, disagreement=disagreement)
    tally.note(replace(step, made=made, refusal=refusal))
    status = tally.status('hand', GripConfig(), True, False, [])
    return status.level, status.message


def test_the_worst_is_told() -> None:
    assert told(GripPhase.HOLD, '') == (DiagnosticStatus.OK, 'HOLD, 1 steps a second')
    level, sentence = told(GripPhase.HOLD, '', 0.9)
    assert (level, sentence) == (
        DiagnosticStatus.WARN, 'HOLD, 1 steps a second; the two sides disagree by 90%',
    )  # fmt: skip
    assert told(GripPhase.IDLE, 'the object was lost; a new grasp is needed')[0] == (
        DiagnosticStatus.WARN
    )
    assert told(GripPhase.FAULT, 'finger 0 is stale')[0] == DiagnosticStatus.ERROR


def test_what_was_never_heard_is_named() -> None:
    tally = GripTally()
    assert tally.status('hand', GripConfig(), True, False, ['ring']).message == (
        'nothing came of ring'
    )
