"""An object in the hand grows heavier, or its surface slippery: who holds it, and how hard.

Two fingers with gradiometers hold a cube by friction. It is handed over within half a second;
then its mass grows from 0.1 to 0.5 kg, or the friction of both pads is halved at once. A pad that
slides has 15 % less friction than one that sticks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.simulation.hand_world import HandWorld
from tactile_ros.simulation.objects import CUBE, STILL, solid
from tactile_ros.simulation.parallel_hand import OPEN

if TYPE_CHECKING:
    from tactile_ros.simulation.hand_world import Decided, Rig
    from tactile_ros.types import Array

KINDS = ('heavier', 'slippery')
GRAVITY = 9.81
FINGERS = 2
FRICTION = (0.5, 1.0)  # of objects before anything changes
KINETIC, SLIDES = 0.85, 2e-3  # of the friction at rest; m/s
HANDED_OVER = 0.5  # s
CLOSES, CARRIES = 1.5, 3.5  # s
NEAR = 2e-3  # m, of the pads from the cube at the start
LOST = 0.45 * CUBE


@dataclass(frozen=True)
class Handling:
    """What happens to an object in the hand.

    Attributes
    ----------
    friction, later_friction : float
        Coefficient before and from `change` on.
    mass, later_mass : float
        Before, and after it has grown (kg).
    change, growth : float
        When it changes after the hand-over begins, and how long it takes to grow (s).
    """

    friction: float
    later_friction: float
    mass: float
    later_mass: float
    change: float
    growth: float

    @classmethod
    def draw(cls, kind: str, seed: int) -> Handling:
        """One of a kind, 'heavier' or 'slippery'."""
        rng = np.random.default_rng([seed, KINDS.index(kind)])
        friction, change = rng.uniform(*FRICTION), rng.uniform(1.0, 2.0)
        growth = rng.uniform(0.3, 1.5)
        if kind == 'heavier':
            return cls(friction, friction, 0.1, 0.5, change, growth)
        mass = rng.uniform(0.1, 0.5)
        return cls(friction, 0.5 * friction, mass, mass, change, growth)

    @property
    def needed(self) -> float:
        """Normal force of a finger that holds it throughout, without dynamics (N)."""
        early = self.mass / self.friction
        return GRAVITY / FINGERS * max(early, self.later_mass / self.later_friction)


@dataclass(frozen=True)
class Carried:
    """How a hold went.

    Attributes
    ----------
    held : bool
        Whether the object was still in the hand at the end.
    mean_force : float
        True normal force of a finger from the hand-over to the end or the drop (N).
    slid : float
        How far the object came down (m).
    trace : ndarray, shape (s, 5)
        Time (s), true normal and tangential force and target of the left finger (N), way down (m).
    seconds : float
        Simulated (s).
    """

    held: bool
    mean_force: float
    slid: float
    trace: Array
    seconds: float


class LoadScene:
    """The hand, the cube, and what happens to it.

    Parameters
    ----------
    rig : Rig
        With the parallel hand.
    handling : Handling
        What happens.
    """

    def __init__(self, rig: Rig, handling: Handling) -> None:
        self.handling = handling
        self.world = HandWorld(rig, solid('cube', handling.mass), STILL)
        self.world.before_step = self._load
        self._object = self.world.data.body('object').id
        self._inertia = self.world.model.body_inertia[self._object] / handling.mass
        self._pads = [self.world.model.geom(pad).id for pad in rig.hand.pads.values()]
        self._begins = np.inf
        self._rows: list[list[float]] = []
        self.world.put(np.full(FINGERS, OPEN - 0.5 * CUBE - NEAR))

    def carry(self, force: float, adapt: bool) -> Carried:
        """Close at a force (N), take the object over, and hold it through what happens."""
        stage, world = self.world.stage, self.world
        stage.enable()
        world.run(0.05)
        stage.grasp(force, [], 0.0, adapt)
        world.run(CLOSES)
        world.data.eq_active[0] = 0
        self._begins = world.time
        world.run(CARRIES, self._watch)
        trace = np.array(self._rows)
        slid = float(trace[-1, 4])
        return Carried(slid < LOST, float(trace[:, 1].mean()), slid, trace, world.time)

    def _load(self) -> None:
        """Mass, support and friction of this instant."""
        world, handling = self.world, self.handling
        since = world.time - self._begins
        grown = min(max((since - handling.change) / handling.growth, 0.0), 1.0)
        mass = handling.mass + grown * (handling.later_mass - handling.mass)
        world.model.body_mass[self._object] = mass
        world.model.body_inertia[self._object] = mass * self._inertia
        support = 1.0 - min(max(since / HANDED_OVER, 0.0), 1.0)
        world.data.xfrc_applied[self._object, 2] = support * mass * GRAVITY
        friction = handling.friction if since < handling.change else handling.later_friction
        slides = abs(world.data.qvel[-6 + 2]) > SLIDES
        world.model.geom_friction[self._pads, 0] = friction * (KINETIC if slides else 1.0)

    def _watch(self, world: HandWorld, decided: Decided) -> bool:
        """Keep a row; the end, where the object is lost."""
        felt = world.felt['left'].force
        fallen = -float(world.data.body('object').xpos[2])
        target = float(decided.made.target_force[0])
        across = float(np.hypot(felt[0], felt[1]))
        self._rows.append([world.time - self._begins, float(felt[2]), across, target, fallen])
        return fallen > LOST
