"""What a step of the law tells, from the parts that decided it."""

from __future__ import annotations

from math import inf, nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.control.grip_state import GripPhase, GripStep

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from tactile_ros.control.fingers import Fingers
    from tactile_ros.control.grip_drives import GripDrives
    from tactile_ros.control.grip_targets import GripTargets
    from tactile_ros.control.grip_watch import GripWatch
    from tactile_ros.types import Array


class GripParts(NamedTuple):
    """What a law consists of."""

    moved: GripDrives
    fingers: Fingers
    targets: GripTargets
    watch: GripWatch


def told(
    parts: GripParts,
    normal: Sequence[float],
    phase: GripPhase,
    send: bool,
    refusal: str,
    settled: bool,
) -> GripStep:
    """Record of a step.

    Parameters
    ----------
    parts : GripParts
        After the step.
    normal : sequence of float, length f
        Forces that were given (N); those of no use become NaN.
    phase, send, refusal, settled
        As in GripStep.

    Returns
    -------
    GripStep
        With arrays of its own.
    """
    age = parts.watch.age
    by_finger, by_drive, bits = _tables(parts, normal)
    step = GripStep.__new__(GripStep)
    # all at once: a frozen __init__ sets them one by one
    vars(step).update(
        phase=phase,
        closure=by_drive[0],
        send=send,
        limited=send and any([law.limited for law in parts.moved.laws]),
        refusal=refusal,
        target_force=by_finger[0],
        force=by_finger[1],
        friction=by_finger[2],
        slip_margin=by_finger[3],
        load=by_finger[4],
        slipping=bits[0],
        touching=bits[1],
        stiffness=by_drive[1],
        stiffness_std=by_drive[2],
        settled=settled,
        input_age=age if age < inf else nan,
        shut=_shut(parts),
        disagreement=parts.moved.disagreement,
    )
    return step


def _shut(parts: GripParts) -> bool:
    """Whether every drive that feels, and one at least, can close no further."""
    feeling = parts.fingers.feeling
    for law, feels in zip(parts.moved.laws, feeling, strict=True):
        if feels and law.command < law.config.closure_high and not law.stopped:
            return False
    return any(feeling)


def _tables(
    parts: GripParts, normal: Sequence[float]
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Numbers by finger (5, f) and by drive (3, a), and bits (2, f).

    One flat list for all numbers of a kind: arrays are what a report costs.
    """
    good, slips = parts.watch.good, parts.fingers.slips
    known = [force if ok else nan for force, ok in zip(normal, good, strict=True)]
    touches = [touch and ok for touch, ok in zip(parts.fingers.touching, good, strict=True)]
    by_finger = parts.targets.now + known
    by_finger += [slip.friction for slip in slips]
    by_finger += [slip.margin for slip in slips]
    by_finger += [slip.load for slip in slips]
    by_drive = [law.command for law in parts.moved.laws]
    by_drive += [one.value for one in parts.moved.stiffness]
    by_drive += [one.std for one in parts.moved.stiffness]
    bits = [slip.slipping for slip in slips] + touches
    return (
        np.array(by_finger).reshape(5, -1),
        np.array(by_drive).reshape(3, -1),
        np.array(bits).reshape(2, -1),
    )
