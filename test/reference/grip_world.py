# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A hand that grips an object, plainly: drives with dead time and lag, fingers as springs.

Fingers are springs against a rigid object that may slide between two of them. The slow counterpart
of what a law is told by a real hand; physics is integrated far finer than the law's period.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from tactile_ros.control import GripInput, GripStep
from tactile_ros.types import Array

FINE = 1e-3  # s


@dataclass
class GripWorld:
    """Two fingers of one hand, or one, on an object."""

    stiffness: float = 60.0  # of one finger on the object (N per closure)
    contact: float = 0.3  # closure at which each finger touches
    dead_time: float = 0.02  # s
    lag: float = 0.05  # s
    rate_hz: float = 100.0  # of the law
    noise: float = 0.01  # N
    gains: tuple[float, ...] = (1.0,)  # of the sensor of each finger
    free: bool = False  # two fingers push the object until their forces agree
    seed: int = 0
    place: float = 0.0
    queue: deque[Array] = field(default_factory=deque)

    def __post_init__(self) -> None:
        """Open, at rest."""
        self.rng = np.random.default_rng(self.seed)
        self.closure = np.zeros(len(self.gains))
        self.command = np.zeros(len(self.gains))
        self.queue.extend([self.closure.copy()] * max(round(self.dead_time / FINE), 1))

    @property
    def force(self) -> Array:
        """True normal force of each finger, shape (f,) (N)."""
        deep = self.closure - self.contact
        if self.free:
            deep = deep - np.array([1.0, -1.0]) * self.place
        return self.stiffness * np.maximum(deep, 0.0)

    def given(self) -> GripInput:
        """Input of the law now."""
        count = len(self.gains)
        felt = self.force * np.array(self.gains) + self.noise * self.rng.normal(size=count)
        return GripInput(
            normal=felt, tangential=np.zeros(count), valid=np.ones(count, bool),
            slip=np.zeros(count, np.int8), age=np.zeros(count),
            closure=self.closure + 1e-4 * self.rng.normal(size=count), closure_age=0.0,
        )  # fmt: skip

    def advance(self, made: GripStep) -> None:
        """One period of the law with its command."""
        if made.send:
            self.command = made.closure.copy()
        for _ in range(round(1.0 / self.rate_hz / FINE)):
            self.queue.append(self.command)
            self.closure = self.closure + FINE / self.lag * (self.queue.popleft() - self.closure)
            if self.free:
                self._slide()

    def _slide(self) -> None:
        """Move a free object to where both fingers press alike; untouched it stays."""
        deep = self.closure - self.contact
        middle = 0.5 * (deep[0] - deep[1])
        if deep[0] + deep[1] > 0:
            self.place = middle
        else:
            self.place = float(np.clip(self.place, deep[0], -deep[1]))
