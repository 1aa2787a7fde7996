# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""An object that hangs between two fingers by friction: it grows heavier, or slippery.

One drive closes both fingers alike. Friction is Coulomb's behind a tangential spring (the skin):
the object sticks until the spring would carry more than mu times the normal force, then slides.
The law is told forces of one finger with noise; all else it has to find out. What happens is drawn
as in the scene of MuJoCo; the physics is another.
"""

from collections import deque

import numpy as np

from reference.hand_scenes import FINGERS, GRAVITY, KINETIC, Handling
from tactile_ros.control import GripInput, GripStep

FINE = 5e-4  # s
DROPPED = 0.02  # m


class LoadWorld:
    """Fingers that have just closed on the object; lifted over the first half second.

    Parameters
    ----------
    load : Handling
        What will happen.
    seed : int
        Of the noise.
    force : float
        At which they have closed (N).
    """

    def __init__(self, load: Handling, seed: int, force: float) -> None:
        self.load = load
        self.rng = np.random.default_rng(seed)
        self.stiffness, self.contact = 60.0, 0.3
        self.closure = self.command = self.contact + force / self.stiffness
        self.queue: deque[float] = deque([self.closure] * round(0.02 / FINE))
        self.time = self.fall = self.speed = self.stuck = 0.0
        self.carried = 0.0
        self.sliding = False
        self.normal = force

    @property
    def dropped(self) -> bool:
        """Whether it has slid out of the hand."""
        return self.stuck > DROPPED

    def given(self) -> GripInput:
        """What the law is told now."""
        noise = 0.01 * self.rng.normal(size=3)
        return GripInput(
            normal=np.array([self.normal + noise[0]]),
            tangential=np.array([abs(self.carried / FINGERS + noise[1])]),
            valid=np.ones(1, bool),
            slip=np.full(1, -1, np.int8),
            age=np.zeros(1),
            closure=np.array([self.closure + 0.01 * noise[2]]),
            closure_age=0.0,
        )

    def advance(self, made: GripStep, period: float) -> None:
        """One period of the law."""
        if made.send:
            self.command = float(made.closure[0])
        for _ in range(round(period / FINE)):
            self._fine()

    def _fine(self) -> None:
        load, self.time = self.load, self.time + FINE
        self.queue.append(self.command)
        self.closure += FINE / 0.05 * (self.queue.popleft() - self.closure)
        self.normal = self.stiffness * max(self.closure - self.contact, 0.0)
        grown = min(max((self.time - load.change) / load.growth, 0.0), 1.0)
        mass = load.mass + grown * (load.later_mass - load.mass)
        friction = load.friction if self.time < load.change else load.later_friction
        weight = mass * GRAVITY * min(self.time / 0.5, 1.0)
        most = FINGERS * friction * self.normal
        skin, damping = 4000.0, 2.0 * np.sqrt(4000.0 * mass) * 0.3
        self.carried = skin * (self.fall - self.stuck) + damping * self.speed
        self.sliding = abs(self.carried) > (KINETIC if self.sliding else 1.0) * most
        if self.sliding:
            most *= KINETIC
            sign = 1.0 if self.carried > 0 else -1.0
            self.carried = sign * most
            self.stuck = self.fall - (self.carried - damping * self.speed) / skin
        self.speed += FINE * (weight - self.carried) / mass
        self.fall += FINE * self.speed
