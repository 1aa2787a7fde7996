"""One finger of a hand: its joints, how it closes, which sensors it carries."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_ros.types import Array, admit_name
from tactile_ros.types.config_fields import admit, array, number, text_of, texts, whole

TELLS = 0.1  # of the fastest joint's motion, below which a joint tells no closure


@dataclass(frozen=True)
class Finger:
    """What a hand's file says about one finger.

    Its closure goes from 0, the open posture, straight to the pre-grasp posture and from there
    along the synergy `closing` to 1, at even speed in joint space. A hand whose joints are
    synergies has such a finger too.

    Raises
    ------
    ValueError
        If lengths differ or nothing closes.
    """

    joints: tuple[str, ...] = texts(('joint',), 'names of its joints')
    open: Array = array([0.0], 'posture when open', 'rad', (-1,), -10.0, 10.0)
    pre_grasp: Array = array([0.0], 'posture from which it closes', 'rad', (-1,), -10.0, 10.0)
    closing: Array = array([1.0], 'motion from pre_grasp to closed', 'rad', (-1,), -10.0, 10.0)
    lever: Array = array(
        [0.0], 'torque of each joint per force at the pad; 0: no cap', 'm', (-1,), 0.0, 1.0
    )
    free_effort: float = number(0.08, 'torque that moves a joint free of load', 'N m', 0.0, 10.0)
    side: int = whole(0, '1, and -1 for what opposes it, a thumb say; 0: not told', -1, 1)
    sensors: tuple[str, ...] = texts(('finger',), 'namespaces of its sensors')
    frame: str = text_of('', 'link of the pad in robot_description, z out of the skin')

    def __post_init__(self) -> None:
        """Hold every value to its range and length."""
        if np.size(self.lever) == 1 and len(self.joints) > 1:
            object.__setattr__(self, 'lever', np.repeat(np.ravel(self.lever), len(self.joints)))
        admit(self)
        for name in ('open', 'pre_grasp', 'closing', 'lever'):
            if len(getattr(self, name)) != len(self.joints):
                msg = (
                    f'{name} of Finger must have one number for each of its {len(self.joints)} '
                    f'joints; received {len(getattr(self, name))}'
                )
                raise ValueError(msg)
        if not self.closing.any():
            msg = 'closing of Finger must move at least one joint; received zeros'
            raise ValueError(msg)
        for name in self.sensors:
            admit_name('sensors of Finger', name)

    @cached_property
    def corner(self) -> float:
        """Closure of the pre-grasp posture."""
        before = float(np.linalg.norm(self.pre_grasp - self.open))
        return before / (before + float(np.linalg.norm(self.closing)))

    @cached_property
    def slope(self) -> Array:
        """Motion of the joints (n,) per closure beyond the pre-grasp posture."""
        per_closure: Array = self.closing / (1.0 - self.corner)
        return per_closure

    @cached_property
    def opening(self) -> Array:
        """Motion of the joints (n,) per closure before the pre-grasp posture."""
        return (self.pre_grasp - self.open) / self.corner if self.corner else self.slope

    def posture(self, closure: float) -> Array:
        """Joint positions (n,) at a closure, before any limit."""
        slope = self.opening if closure < self.corner else self.slope
        return self.pre_grasp + slope * (closure - self.corner)

    def closure_of(self, position: Array) -> float:
        """Closure whose posture lies nearest to joint positions (n,); beyond 0 and 1 too."""
        lines, lengths = self._lines
        first, second = ((position - self.pre_grasp) @ lines).tolist()
        before, after = min(first / lengths[0], 0.0), max(second / lengths[1], 0.0)
        # squared distances to both lines, without the part that they share
        far = lengths[0] * before**2 - 2.0 * before * first
        near = lengths[1] * after**2 - 2.0 * after * second
        beyond: float = before if far < near else after
        return self.corner + beyond

    def shortfall(self, closure: float, wanted: Array, sent: Array) -> float:
        """How much less closure joints (n,) have that were sent instead of those of a closure.

        That of the joint which comes closest: where one follows, the finger still closes. Joints
        that hardly move on the way tell nothing of it.
        """
        slope = self._slopes[closure >= self.corner]
        left, least = (wanted - sent).tolist(), TELLS * max(map(abs, slope))
        behind = [one / per for one, per in zip(left, slope, strict=True) if abs(per) > least]
        return float(min(behind, key=abs))

    @cached_property
    def _slopes(self) -> tuple[list[float], list[float]]:
        """Motion of each joint per closure before the pre-grasp posture, and beyond it."""
        return self.opening.tolist(), self.slope.tolist()

    @cached_property
    def _lines(self) -> tuple[Array, list[float]]:
        """Both directions of the path (n, 2), and their squared lengths."""
        lines = np.stack([self.opening, self.slope], axis=1)
        return lines, np.einsum('ni,ni->i', lines, lines).tolist()

    def fastest(self, velocity: Array) -> float:
        """Closure per second at which the first joint reaches its speed (n,)."""
        steepest = np.maximum(np.abs(self.slope), np.abs(self.opening))
        moving = steepest > 0
        return float((velocity[moving] / steepest[moving]).min())

    @cached_property
    def is_capped(self) -> bool:
        """Whether a lever is told for any joint."""
        return bool(self.lever.any())

    def caps(self, force: float) -> Array:
        """Largest torques (n,) that hold a force at the pad (N); NaN where no lever is told."""
        return self.lever * force + self._free_caps

    @cached_property
    def _free_caps(self) -> Array:
        """Largest torques (n,) without a force; NaN where no lever is told."""
        return np.where(self.lever > 0, self.free_effort, np.nan)
