# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Scenes of grasps: a magnet by a balloon, things in many poses, loads that grow or slip.

Balloon, as in figure 10 of [3]: a soft hand holds it at a force that one gradiometer tells, while
a magnet, 3 mT at 50 mm, comes from 100 to 14 mm. Grasps: a thing between thumb and fingers, then a
pull. Loads: two fingers hold a cube by friction; its mass grows from 0.1 to 0.5 kg, or the
friction of both pads is halved; a pad that slides has 15 % less friction than one that sticks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.signal import medfilt
from scipy.spatial.transform import Rotation

from reference.hand_world import HandWorld, Rig
from tactile_ros.control import GripPhase
from tactile_ros.nodes.grip_loop import Decision
from tactile_ros.physics.magnetics import SCALE, dipole_field
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.simulation.hands import OPEN, REACH, HandModel, on_half_cylinder
from tactile_ros.types import Array, Bools, Frame

FAR, NEAR = 0.1, 0.014  # m
FIELD, AT = 3e-3, 0.05  # T at m
COMES, CLOSES = 20.0, 8.0  # s
FORCE = 1.0  # N
SOFT, LOSSES = 100.0, 3.0  # of each side of a balloon (N/m, N s/m)
FROM = np.array([0.8, 0.0, -0.6])  # of the magnet, in sensor axes: above the finger and behind it
MOMENT = FIELD * AT**3 / (2 * SCALE)  # A m2, along its way
RELEASED, CRUSHED = 0.1, 3.0  # of the force that was asked for
MAGNET = """
    <body name="magnet" mocap="true">
      <geom type="cylinder" size="0.006 0.006" rgba="0.5 0.5 0.55 1" contype="0" conaffinity="0"/>
    </body>"""

CUBE, SPHERE = 0.057, 0.06  # m: edge of a Rubik's cube, diameter of a printed sphere
MOUSE = (0.1, 0.06, 0.038)  # m: length, width and height of a wireless mouse
BALLOON = 0.07  # m
# holds an object named `object` where it is, until it is switched off
STILL = '<equality><weld body1="world" body2="object" solref="0.02 1"/></equality>'
SOLIDS = {  # shape, lengths (m), colour
    'cube': ('box', (CUBE,) * 3, '0.2 0.45 0.75 1'),
    'sphere': ('sphere', (SPHERE,), '0.85 0.75 0.3 1'),
    'mouse': ('ellipsoid', MOUSE, '0.3 0.6 0.45 1'),
}


def solid(
    kind: str,
    mass: float,
    place: Iterable[float] = (0.0, 0.0, 0.0),
    turn: Iterable[float] = (1.0, 0.0, 0.0, 0.0),
) -> str:
    """MJCF of a stiff `object`, free to move: a 'cube', a 'sphere', or a 'mouse' on its side.

    It begins at `place` (m), turned by a quaternion (w, x, y, z); mass in kg.
    """
    shape, lengths, colour = SOLIDS[kind]
    size = _words(0.5 * length for length in lengths)
    return f"""
    <body name="object" pos="{_words(place)}" quat="{_words(turn)}">
      <freejoint name="object"/>
      <geom name="object" type="{shape}" size="{size}" mass="{mass}" rgba="{colour}"/>
    </body>"""


def balloon(stiffness: float, damping: float, place: Iterable[float]) -> str:
    """MJCF of a balloon named `object`, held at `place` (m), whose sides give way along x.

    Stiffness and damping are those of each side (N/m, N s/m); it weighs 5 g.
    """
    radius = BALLOON / 2
    sides = ''.join(
        f"""
      <body name="{name}_side" pos="{sign * 0.5 * radius} 0 0">
        <joint name="{name}_side" type="slide" axis="{-sign} 0 0" stiffness="{stiffness}"
          damping="{damping}"/>
        <geom name="{name}_side" type="ellipsoid" size="{0.5 * radius} {radius} {radius}"
          mass="0.002" rgba="0.9 0.3 0.35 0.8"/>
      </body>"""
        for name, sign in (('left', -1), ('right', 1))
    )
    return f"""
    <body name="object" pos="{_words(place)}" gravcomp="1">
      <joint name="object" type="slide" axis="1 0 0" damping="0.05"/>
      <geom name="object" type="ellipsoid" size="{0.72 * radius} {radius} {radius}"
        mass="0.001" rgba="0.9 0.3 0.35 0.8" contype="0" conaffinity="0"/>{sides}
    </body>"""


def _words(numbers: Iterable[float]) -> str:
    return ' '.join(f'{number:.9f}' for number in numbers)


@dataclass(frozen=True)
class Held:
    """A balloon and a magnet."""

    distance: Array  # (s,) of the magnet from the sensor (m); decreasing
    force: Array  # (s,) true force of the thumb (N)
    valid: Bools  # (s,) whether the reading may be used for control
    seconds: float  # simulated (s)

    def error_until(self, distance: float) -> float:
        """Largest error of the true force (N) while the magnet is at least so far (m)."""
        far = self.distance >= distance
        return float(np.abs(self.force[far] - FORCE).max())

    @property
    def invalid_from(self) -> float:
        """Distance (m) below which no reading is valid any more; NaN: there is none."""
        last = int(np.flatnonzero(self.valid)[-1]) if self.valid.any() else -1
        return float(self.distance[last + 1]) if last + 1 < len(self.valid) else np.nan

    @property
    def fate(self) -> str:
        """Fate of the balloon."""
        lost = (self.force < RELEASED * FORCE) | (self.force > CRUSHED * FORCE)
        if not lost.any():
            return 'held'
        first = int(np.argmax(lost))
        how = 'released' if self.force[first] < FORCE else 'crushed'
        return f'{how} at {1e3 * self.distance[first]:.0f} mm'


class BalloonScene:
    """The hand, the balloon and the magnet.

    Parameters
    ----------
    rig : Rig
        The soft hand, with the thumb's gradiometer alone.
    read : callable or None
        From a frame to the force (3,) (N); None: the pipeline.
    """

    def __init__(self, rig: Rig, read: Callable[[Frame], Array] | None = None) -> None:
        thing = balloon(SOFT, LOSSES, (0.0, REACH, 0.0)) + MAGNET
        self.world = HandWorld(rig, thing, field=self._field)
        (self._finger,) = rig.tips
        self._begins = np.inf
        self._rows: list[tuple[float, float, bool]] = []
        if read is not None:
            self.world.read_force = lambda tip, _: (read(tip.frame), True)

    @property
    def distance(self) -> float:
        """Distance of the magnet from the sensor (m)."""
        share = min(max((self.world.time - self._begins) / COMES, 0.0), 1.0)
        return FAR + share * (NEAR - FAR)

    def _field(self, elements: Array, axes: Array) -> Array:
        """Field (t, 3) (T) of the magnet in sensor axes; none before it comes."""
        place = elements.mean(axis=0) + axes @ (self.distance * FROM)
        self.world.data.mocap_pos[0] = place
        if not np.isfinite(self._begins):
            return np.zeros_like(elements)
        moment = axes @ (MOMENT * FROM)
        return np.asarray(dipole_field(elements, place[None], moment[None]) @ axes)

    def hold(self) -> Held:
        """Close on the balloon, and let the magnet come."""
        world, stage = self.world, self.world.stage
        stage.enable()
        world.run(0.08)
        stage.grasp(FORCE, [], 0.0, False)
        world.run(CLOSES)
        self._begins = world.time
        world.run(COMES, self._watch)
        rows = np.array(self._rows, np.float64)
        return Held(rows[:, 0], rows[:, 1], rows[:, 2] > 0, world.time)

    def _watch(self, world: HandWorld, _: Decision) -> None:
        """Keep a row."""
        pad = world.pads[self._finger]
        valid = world.read_force(world.tips[self._finger], pad.state)[1]
        self._rows.append((self.distance, float(pad.force[2]), valid))


KINDS = tuple(SOLIDS)
MASS = 0.1  # kg
GRAVITY = 9.81
PULL, RISE = 2.0, 0.2  # N; s
TILT, ASIDE = np.deg2rad(12.0), 6e-3  # of the grasp's axis; m, across it
GRASP_CLOSES, SETTLES, AFTER, PULLED = 8.0, 2.0, 0.5, 1.2  # s; the first at most
AWAY = 0.015  # m, beyond which an object has left its place
PRESSING = 0.1  # N
SMOOTHED = 3  # control steps, by whose median a force is judged
SETTLED = 0.05  # of the target
STEADY = 1.0  # s at the end, whose mean is the steady force


@dataclass(frozen=True)
class Grasped:
    """Course of a grasp."""

    touched: bool  # whether all fingers touched and the hand came to hold
    held: bool  # whether the object stayed through the pull
    contacts: list[Touched]  # of every pad that tells places, while the object was held
    overshoot: float  # true force of all fingers together, shares of the target
    steady: float
    settled: float  # time from load until it stays within 5 % (s)
    trace: Array  # (s, 1 + 2 f) time (s), true normal forces and targets of all fingers (N)
    seconds: float  # simulated (s)


@dataclass(frozen=True)
class Touched:
    """A contact that lasts."""

    place: Array  # (3,) the true one, and that of the mean of 25 frames (m); NaN untouched
    estimated: Array
    cov: Array  # (3, 3) of the latter, as stated (m2)


def random_pose(hand: HandModel, kind: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Place (3,) (m) and turn (4,) (w, x, y, z) of an object between thumb and fingers."""
    axis = np.array(hand.across) / np.linalg.norm(hand.across)
    level = np.linalg.svd(axis[None])[2][1:]
    place = np.array(hand.centre) + level.T @ rng.uniform(-ASIDE, ASIDE, 2)
    if kind == 'sphere':
        return place, np.array([1.0, 0.0, 0.0, 0.0])
    tilt = rng.uniform(-TILT, TILT, 2)
    along = axis + level.T @ np.tan(tilt)
    along /= np.linalg.norm(along)
    side = np.cross(along, rng.normal(size=3))
    side /= np.linalg.norm(side)
    turn = Rotation.from_matrix(np.column_stack([side, along, np.cross(side, along)]))
    return place, np.roll(turn.as_quat(), 1)


class GraspScene:
    """One object in the hand.

    Parameters
    ----------
    rig : Rig
        With any hand.
    kind : str
        Of the object.
    seed : int
        Of its pose and the pull.
    """

    def __init__(self, rig: Rig, kind: str, seed: int) -> None:
        rng = np.random.default_rng([seed, KINDS.index(kind)])
        self._config = next(iter(rig.tips.values())).skin.config
        thing = solid(kind, MASS, *random_pose(rig.hand, kind, rng))
        self.world = HandWorld(rig, thing, STILL, self._on_pad)
        direction = rng.normal(size=3)
        self._pulls = PULL * direction / np.linalg.norm(direction)
        self._object = self.world.data.body('object').id
        self._handed_over = np.inf
        self._rows: list[list[float]] = []
        self._phases: list[GripPhase] = []

    def _on_pad(self, place: Array) -> Array:
        """Contact of a crowned pad on the half cylinder, if it is one."""
        if isinstance(self._config, MagnetPadConfig):
            return on_half_cylinder(place, self._config.radius, self._config.length)
        return place

    def grasp(self, force: float) -> Grasped:
        """Grasp at a force (N), of the thumb, and pull."""
        world, stage = self.world, self.world.stage
        stage.enable()
        world.run(0.05)
        stage.grasp(force, [], 0.0, False)
        world.run(GRASP_CLOSES, self._until_engaged)
        world.before_step = self._outside
        world.data.eq_active[0] = 0
        world.run(GRASP_CLOSES, self._until_hold)
        touched = bool(self._phases[-1] == GripPhase.HOLD)
        world.run(SETTLES, self._watch)
        contacts = [
            Touched(pad.place, state.position, state.position_cov)
            for name, pad in world.pads.items()
            if (state := world.tips[name].lasting()) is not None
        ]
        start = world.data.body('object').xpos.copy()
        self._handed_over = world.time
        world.run(PULLED)
        stayed = float(np.linalg.norm(world.data.body('object').xpos - start)) < AWAY
        trace = np.array(self._rows)
        return Grasped(touched, stayed, contacts, *self._settling(trace), trace, world.time)

    def _watch(self, world: HandWorld, decided: Decision) -> None:
        """Keep a row."""
        forces = [float(pad.force[2]) for pad in world.pads.values()]
        self._rows.append([world.time, *forces, *decided.made.target_force.tolist()])
        self._phases.append(decided.made.phase)

    def _until_engaged(self, world: HandWorld, decided: Decision) -> bool:
        """Watch until all pads press, or the hand holds what it has."""
        pressing = all(pad.force[2] > PRESSING for pad in world.pads.values())
        loads = decided.made.phase >= GripPhase.LOAD and pressing
        return self._until_hold(world, decided) or loads

    def _until_hold(self, world: HandWorld, decided: Decision) -> bool:
        """Watch until the hand holds."""
        self._watch(world, decided)
        return decided.made.phase >= GripPhase.HOLD

    def _outside(self) -> None:
        """Force that bears the object's weight until it is handed over, and that pulls it then."""
        since = self.world.time - self._handed_over
        given = min(max(since / RISE, 0.0), 1.0)
        pulled = min(max(since - AFTER, 0.0) / RISE, 1.0)
        force = self.world.data.xfrc_applied[self._object]
        force[:3] = pulled * self._pulls
        force[2] += (1.0 - given) * MASS * GRAVITY

    def _settling(self, trace: Array) -> tuple[float, float, float]:
        """Overshoot, steady error and settling time of the sum of all forces."""
        count = (trace.shape[1] - 1) // 2
        begins = int(np.argmax(np.array(self._phases) >= GripPhase.LOAD))
        final = trace[-1, 1 + count :].sum()
        if not final > 0:
            return np.nan, np.nan, np.nan
        total = trace[:, 1 : 1 + count].sum(axis=1)
        # the engine loses the contact of two ellipsoids for single steps
        share = medfilt(total, SMOOTHED) / final - 1.0
        steady = abs(float(share[trace[:, 0] > trace[-1, 0] - STEADY].mean()))
        off = np.flatnonzero(np.abs(share) > SETTLED)
        settled = trace[min(off[-1] + 1, len(trace) - 1), 0] - trace[begins, 0]
        return float(share[begins:].max()), steady, float(settled)


CHANGES = ('heavier', 'slippery')
FINGERS = 2
FRICTION = (0.5, 1.0)  # of objects before anything changes
KINETIC, SLIDES = 0.85, 2e-3  # of the friction at rest; m/s
HANDED_OVER = 0.5  # s
LOAD_CLOSES, CARRIES = 1.5, 3.5  # s
START_GAP = 2e-3  # m, of the pads from the cube at the start
LOST = 0.45 * CUBE


@dataclass(frozen=True)
class Handling:
    """Course of events for an object in the hand."""

    friction: float  # coefficient before and from `change` on
    later_friction: float
    mass: float  # before, and after it has grown (kg)
    later_mass: float
    change: float  # when it changes after the hand-over begins, and how long it takes to grow (s)
    growth: float

    @classmethod
    def draw(cls, kind: str, seed: int) -> Handling:
        """One of a kind, 'heavier' or 'slippery'."""
        rng = np.random.default_rng([seed, CHANGES.index(kind)])
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
    """Course of a hold."""

    held: bool  # whether the object was still in the hand at the end
    # true normal force of a finger from the hand-over to the end or the drop (N)
    mean_force: float
    slid: float  # how far the object came down (m)
    # (s, 5) time (s), true normal and tangential force and target of the left finger (N),
    # way down (m)
    trace: Array
    seconds: float  # simulated (s)


class LoadScene:
    """The parallel hand of a rig, the cube, and what happens to it."""

    def __init__(self, rig: Rig, handling: Handling) -> None:
        self.handling = handling
        self.world = HandWorld(rig, solid('cube', handling.mass), STILL)
        self.world.before_step = self._load
        self._object = self.world.data.body('object').id
        self._inertia = self.world.model.body_inertia[self._object] / handling.mass
        self._pads = [self.world.model.geom(pad).id for pad in rig.hand.pads.values()]
        self._begins = np.inf
        self._rows: list[list[float]] = []
        self.world.put(np.full(FINGERS, OPEN - 0.5 * CUBE - START_GAP))

    def carry(self, force: float, adapt: bool) -> Carried:
        """Close at a force (N), take the object over, and hold it through what happens."""
        stage, world = self.world.stage, self.world
        stage.enable()
        world.run(0.05)
        stage.grasp(force, [], 0.0, adapt)
        world.run(LOAD_CLOSES)
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

    def _watch(self, world: HandWorld, decided: Decision) -> bool:
        """Keep a row; the end, where the object is lost."""
        x, y, z = world.pads['left'].force.tolist()
        fallen = -float(world.data.body('object').xpos[2])
        target = float(decided.made.target_force[0])
        self._rows.append([world.time - self._begins, z, float(np.hypot(x, y)), target, fallen])
        return fallen > LOST
