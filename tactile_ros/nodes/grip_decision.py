"""What one step of a grip came to, and what a grasp that is held does not know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.control import GraspProgress, GripStep
    from tactile_ros.types import GripCommand


@dataclass(frozen=True)
class Decision:
    """What one step came to.

    Attributes
    ----------
    made : GripStep
        Of the law.
    command : GripCommand or None
        What is to be sent; None: nothing.
    limited : bool
        The law or the guard changed what was wanted.
    refusal : str
        Why the law's own command was not sent; empty: it was.
    ended : GraspProgress or None
        The grasp that ended in this step.
    lost : str
        Why what was held after its grasp is held no more, in the step that finds it; else empty.
    """

    made: GripStep
    command: GripCommand | None
    limited: bool
    refusal: str
    ended: GraspProgress | None
    lost: str


def doubts(made: GripStep, dark: Mapping[str, bool], most: float) -> str:
    """What is added to the sentence of a grasp that is held.

    Parameters
    ----------
    made : GripStep
        The step that ended it.
    dark : mapping of str to bool
        Fingers that take part without a force, and whether one ever came.
    most : float
        Share of the force by which two sides may disagree.

    Returns
    -------
    str
        Empty where all is known.
    """
    unheard = [name for name, heard in dark.items() if not heard]
    unknown = [name for name, heard in dark.items() if heard]
    told = f'; nothing was ever heard of {", ".join(unheard)}' if unheard else ''
    if unknown:
        told += f'; the force of {", ".join(unknown)} is not known'
    if made.disagreement > most:  # false of NaN
        told += f'; the two sides disagree by {made.disagreement:.0%}: a sensor may be wrong'
    return told
