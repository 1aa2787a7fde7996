"""When a grasp is over, and how it ended: held, slipped, no object, timeout or fault."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.control.grip_force import GraspOutcome, GripPhase, GripStep

if TYPE_CHECKING:
    from tactile_ros.control.config import GripConfig

OPENED = (GripPhase.IDLE, GripPhase.RELEASE)
LOST = 'the object was lost'
ENDS = (
    (GraspOutcome.FAULT, 'the grip was released'),
    (GraspOutcome.FAULT, ''),  # the refusal says it
    (GraspOutcome.SLIPPED, LOST),
    (GraspOutcome.NO_OBJECT, 'closed without touching anything'),
    (GraspOutcome.HELD, 'held at the asked force'),
    (GraspOutcome.TIMEOUT, 'not held within {:g} s'),
)


@dataclass(frozen=True)
class GraspProgress:
    """Where a grasp stands.

    Attributes
    ----------
    outcome : GraspOutcome or None
        None: it goes on.
    message : str
        One sentence.
    """

    outcome: GraspOutcome | None
    message: str


class GraspSequence:
    """Judge the steps of one grasp.

    Parameters
    ----------
    config : GripConfig
        Times after which a fault or a lost object ends it.
    timeout : float
        Longest time until it is held (s); 0: `grasp_time` of the config.

    Raises
    ------
    ValueError
        If the timeout is below 0 or not finite.
    """

    def __init__(self, config: GripConfig, timeout: float = 0.0) -> None:
        if not 0.0 <= timeout < float('inf'):
            msg = f'timeout of a grasp must be 0 or more seconds; received {timeout}'
            raise ValueError(msg)
        self.config = config
        self._timeout = timeout or config.grasp_time
        self._elapsed = self._faulty = self._empty = self._closed = 0.0
        self._had = False
        self.progress = GraspProgress(None, 'closing')

    def step(self, made: GripStep, dt: float) -> GraspProgress:
        """Take in a step of the law; after the end nothing changes any more.

        Parameters
        ----------
        made : GripStep
            Of the law, from the step after `grasp` on.
        dt : float
            Since the last step (s).

        Returns
        -------
        GraspProgress
            Outcome, or None while it goes on.
        """
        if self.progress.outcome is None:
            self._count(made, max(dt, 0.0))
            self.progress = self._judged(made)
        return self.progress

    def _count(self, made: GripStep, dt: float) -> None:
        """Times of the conditions that end a grasp."""
        faulty = made.phase == GripPhase.FAULT
        touching = bool(made.touching.any())
        self._elapsed += dt
        self._faulty = self._faulty + dt if faulty else 0.0
        if faulty:
            return
        self._had = self._had or (touching and made.phase in (GripPhase.LOAD, GripPhase.HOLD))
        self._empty = 0.0 if touching else self._empty + dt
        self._closed = self._closed + dt if made.shut and not touching else 0.0

    def _judged(self, made: GripStep) -> GraspProgress:
        """The first condition that holds."""
        config = self.config
        conditions = (
            made.phase in OPENED,
            self._faulty > config.fault_time,
            self._had and self._empty > config.lost_time,
            self._closed > config.lost_time,
            made.settled,
            self._elapsed >= self._timeout,
        )
        if True not in conditions:
            return GraspProgress(None, made.phase.name.lower())
        first = conditions.index(True)
        outcome, sentence = ENDS[first]
        return GraspProgress(outcome, sentence.format(self._timeout) or made.refusal)


class Opening:
    """Judge the steps of an opening as `GraspSequence` does those of a grasp.

    Parameters
    ----------
    config : GripConfig
        Time after which a fault ends it.
    timeout : float
        Longest time (s); 0: `grasp_time` of the config.
    """

    def __init__(self, config: GripConfig, timeout: float) -> None:
        self._config, self._timeout = config, timeout or config.grasp_time
        self._elapsed = self._faulty = 0.0

    def step(self, made: GripStep, dt: float) -> GraspProgress:
        """Take in a step of the law."""
        self._elapsed += dt
        self._faulty = self._faulty + dt if made.phase == GripPhase.FAULT else 0.0
        if made.phase == GripPhase.IDLE:
            return GraspProgress(GraspOutcome.NO_OBJECT, 'the hand is open')
        if self._faulty > self._config.fault_time:
            return GraspProgress(GraspOutcome.FAULT, made.refusal)
        if self._elapsed >= self._timeout:
            return GraspProgress(GraspOutcome.TIMEOUT, f'not open within {self._timeout:g} s')
        return GraspProgress(None, 'opening')


class Keeping:
    """Judge what is held after its grasp has ended, as long as the grip holds.

    Parameters
    ----------
    config : GripConfig
        Time untouched after which an object is lost.
    """

    def __init__(self, config: GripConfig) -> None:
        self._config = config
        self._empty = 0.0

    def restart(self) -> None:
        """Something else is held."""
        self._empty = 0.0

    def step(self, made: GripStep, dt: float) -> str:
        """Take in a step of the law; why nothing is held any more, or empty.

        What fingers felt last counts while their forces are not known: the law says so itself.
        """
        if made.phase != GripPhase.FAULT:
            self._empty = 0.0 if made.touching.any() else self._empty + dt
        return LOST if self._empty > self._config.lost_time else ''
