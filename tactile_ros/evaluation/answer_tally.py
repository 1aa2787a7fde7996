"""What one pipeline's answers were worth, as statistics that merge exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from tactile_ros.evaluation.metrics import TARGETS, given_targets, judge
from tactile_ros.evaluation.tally import ClassTally, Magnitudes, TargetTally

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from tactile_ros.evaluation.replay import Agreement
    from tactile_ros.types import ContactStates

Tally = TypeVar('Tally', TargetTally, ClassTally)
CLASSES = ('cell', 'label', 'in_contact', 'slip')


@dataclass(frozen=True)
class AnswerTally:
    """One pipeline on one sensor, or on several together.

    Attributes
    ----------
    name, calibration : str
        Of the estimators; of the calibration file.
    targets, classes : dict
        Errors and hits by name, of whatever truth could judge.
    given : tuple of str
        Targets that were estimated somewhere.
    frames, nanoseconds : int
        Processed in batches, and the time that took.
    us_single : float
        Time per frame, one by one (microseconds): the median of some.
    agreement : Agreement or None
        With the live run; None: there was none.
    problems : tuple of str
        What must be known about it, as sentences.
    """

    name: str
    calibration: str
    targets: Mapping[str, TargetTally] = field(default_factory=dict)
    classes: Mapping[str, ClassTally] = field(default_factory=dict)
    given: tuple[str, ...] = ()
    frames: int = 0
    nanoseconds: int = 0
    us_single: float = float('nan')
    agreement: Agreement | None = None
    problems: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, truth: Mapping[str, npt.NDArray[np.generic]], states: ContactStates
    ) -> AnswerTally:
        """What states (s) are worth beside truth (s, ...), without a name."""
        targets, classes = tally_targets(truth, states), tally_classes(truth, states)
        return cls('', '', targets, classes, given_targets(states))

    def __add__(self, other: AnswerTally) -> AnswerTally:
        """Of both together; there is no median of medians, so the first that is known stays."""
        agreement = self.agreement
        if agreement is None or other.agreement is None:
            agreement = agreement or other.agreement
        else:
            agreement = agreement + other.agreement
        return replace(
            self,
            targets=_merged(self.targets, other.targets),
            classes=_merged(self.classes, other.classes),
            given=tuple(dict.fromkeys([*self.given, *other.given])),
            frames=self.frames + other.frames,
            nanoseconds=self.nanoseconds + other.nanoseconds,
            us_single=other.us_single if math.isnan(self.us_single) else self.us_single,
            agreement=agreement,
            problems=tuple(dict.fromkeys([*self.problems, *other.problems])),
        )

    @property
    def us_batch(self) -> float:
        """Time per frame in batches (microseconds); NaN: nothing was processed."""
        return self.nanoseconds / self.frames / 1000 if self.frames else float('nan')

    @property
    def shear(self) -> Magnitudes:
        """Errors of force along x and y, components pooled."""
        parts = (self.targets.get(name) for name in ('force_x', 'force_y'))
        return sum((part.errors for part in parts if part is not None), Magnitudes())


def _merged(one: Mapping[str, Tally], other: Mapping[str, Tally]) -> dict[str, Tally]:
    """Tallies of both by name, in the order of the names of truth."""
    merged = dict(one)
    for name, tally in other.items():
        merged[name] = merged[name] + tally if name in merged else tally
    return {name: merged[name] for name in (*TARGETS, *CLASSES) if name in merged}


def tally_targets(
    truth: Mapping[str, npt.NDArray[np.generic]], states: ContactStates
) -> dict[str, TargetTally]:
    """Errors of everything that truth (s, ...) tells by components."""
    found = {}
    for name, (unit, key, _) in TARGETS.items():
        if key not in truth:
            continue
        seen = judge(name, truth, states)
        if not len(seen.rows):
            continue
        error, variance = seen.error.ravel(), seen.variance.ravel()
        judged = np.isfinite(error) & np.isfinite(variance)
        inside = np.abs(error[judged]) <= np.sqrt(variance[judged])
        found[name] = TargetTally(
            name,
            unit,
            Magnitudes.of(np.sqrt((seen.error**2).sum(axis=1))),
            int(inside.sum()),
            int(judged.sum()),
            seen.missed,
            seen.invalid,
        )
    return found


def tally_classes(
    truth: Mapping[str, npt.NDArray[np.generic]], states: ContactStates
) -> dict[str, ClassTally]:
    """Hits of everything that truth (s,) tells by number; a frame that is not valid abstains."""
    found = {}
    for name in CLASSES:
        if name not in truth:
            continue
        told = np.asarray(truth[name])
        rows = told >= 0
        if not rows.any():
            continue
        answer = np.where(states.valid, getattr(states, name), -1)[rows]
        right = int((answer == told[rows]).sum())
        abstained = int((answer < 0).sum())
        found[name] = ClassTally(name, right, len(answer) - right - abstained, abstained)
    return found
