"""Grasps of things in random poses, as [2] made with its pad on an Allegro Hand.

An object is held where it is until all fingers touch, and its weight is borne until the force has
settled; then it is handed over, and a force pulls it in a random direction. What is judged: which
cell of a pad is touched, how the force settles, and whether the object stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, sqrt
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import medfilt
from scipy.spatial.transform import Rotation

from tactile_ros.control import GripPhase
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.simulation.allegro_hand import on_half_cylinder
from tactile_ros.simulation.hand_world import HandWorld
from tactile_ros.simulation.objects import STILL, solid

if TYPE_CHECKING:
    from tactile_ros.simulation.hand_model import HandModel
    from tactile_ros.simulation.hand_world import Decided, Rig
    from tactile_ros.types import Array

KINDS = ('cube', 'sphere', 'mouse')
MASS = 0.1  # kg
GRAVITY = 9.81
PULL, RISE = 2.0, 0.2  # N; s
TILT, ASIDE = np.deg2rad(12.0), 6e-3  # of the grasp's axis; m, across it
CLOSES, SETTLES, AFTER, PULLED = 8.0, 2.0, 0.5, 1.2  # s; the first at most
AWAY = 0.015  # m, beyond which an object has left its place
PRESSING = 0.1  # N
SMOOTHED = 3  # control steps, by whose median a force is judged
SETTLED = 0.05  # of the target
STEADY = 1.0  # s at the end, whose mean is the steady force


@dataclass(frozen=True)
class Grasped:
    """How a grasp went.

    Attributes
    ----------
    touched : bool
        Whether all fingers touched and the hand came to hold.
    held : bool
        Whether the object stayed through the pull.
    contacts : list of Touched
        Of every pad that tells places, while the object was held.
    overshoot, steady : float
        True force of all fingers together, shares of the target.
    settled : float
        Time from load until it stays within 5 % (s).
    trace : ndarray, shape (s, 1 + 2 f)
        Time (s), true normal forces and targets of all fingers (N).
    seconds : float
        Simulated (s).
    """

    touched: bool
    held: bool
    contacts: list[Touched]
    overshoot: float
    steady: float
    settled: float
    trace: Array
    seconds: float


@dataclass(frozen=True)
class Touched:
    """A contact that lasts.

    Attributes
    ----------
    place, told : ndarray, shape (3,)
        The true one, and what the mean of 25 frames tells (m); NaN untouched.
    cov : ndarray, shape (3, 3)
        Of the latter, as it says of itself (m2).
    """

    place: Array
    told: Array
    cov: Array


@dataclass(frozen=True)
class Named:
    """Which cell of a pad is touched.

    Attributes
    ----------
    true, told : int
        The nearest one, and the pad's answer; -1 untouched.
    error : float
        Of the place (m).
    chance : float
        That noise alone carries the place into another cell.
    """

    true: int
    told: int
    error: float
    chance: float


def named(touched: Touched, cells: Array) -> Named:
    """Judge a contact by cells (n, 3) (m)."""
    true, told = (
        int(((cells - at) ** 2).sum(axis=1).argmin()) if np.isfinite(at).all() else -1
        for at in (touched.place, touched.told)
    )
    error = float(np.linalg.norm(touched.told - touched.place))
    known = true >= 0 and np.isfinite(touched.cov).all()
    return Named(true, told, error, mistaken(cells, touched.place, touched.cov) if known else 1.0)


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
    return place, _quaternion(np.column_stack([side, along, np.cross(side, along)]))


def _quaternion(turn: Array) -> Array:
    """Of a rotation matrix (3, 3)."""
    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    return np.array([w, x, y, z])


def mistaken(cells: Array, place: Array, cov: Array) -> float:
    """Chance that a place with errors of a covariance is taken for another cell.

    Parameters
    ----------
    cells : ndarray, shape (n, 3)
        Centres (m).
    place : ndarray, shape (3,)
        The true one (m).
    cov : ndarray, shape (3, 3)
        Of the error (m2).

    Returns
    -------
    float
        Across the nearest border alone, as one normal error tells.

    Examples
    --------
    >>> pair = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    >>> mistaken(pair, np.array([0.0, 0.3, 0.0]), np.eye(3))
    0.5
    """
    near = cells[np.argsort(((cells - place) ** 2).sum(axis=1))[:2]]
    across = (near[1] - near[0]) / np.linalg.norm(near[1] - near[0])
    border = float(across @ (near.mean(axis=0) - place))
    sigma = float(np.sqrt(across @ cov @ across))
    return 0.5 * erfc(border / sigma / sqrt(2.0)) if sigma > 0 else float(border < 0)


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
        self._rng = np.random.default_rng([seed, KINDS.index(kind)])
        self._config = next(iter(rig.tips.values())).skin.config
        place, turn = random_pose(rig.hand, kind, self._rng)
        thing = solid(kind, MASS, tuple(place), tuple(turn))
        self.world = HandWorld(rig, thing, STILL, self._on_pad)
        direction = self._rng.normal(size=3)
        self._pulls = PULL * direction / np.linalg.norm(direction)
        self._object = self.world.data.body('object').id
        self._handed_over = np.inf
        self._rows: list[list[float]] = []
        self._phases: list[GripPhase] = []

    def _on_pad(self, place: Array, _: Array) -> Array:
        """Where a crowned pad's contact lies on the half cylinder, if it is one."""
        if isinstance(self._config, MagnetPadConfig):
            return on_half_cylinder(place, self._config.radius, self._config.length)
        return place

    def grasp(self, force: float) -> Grasped:
        """Grasp at a force (N), of the thumb, and pull."""
        world, stage = self.world, self.world.stage
        stage.enable()
        world.run(0.05)
        stage.grasp(force, [], 0.0, False)
        world.run(CLOSES, self._until_engaged)
        world.before_step = self._outside
        world.data.eq_active[0] = 0
        world.run(CLOSES, self._until_hold)
        touched = bool(self._phases[-1] == GripPhase.HOLD)
        world.run(SETTLES, self._watch)
        contacts = self._contacts()
        start = world.data.body('object').xpos.copy()
        self._handed_over = world.time
        world.run(PULLED)
        away = float(np.linalg.norm(world.data.body('object').xpos - start))
        trace = np.array(self._rows)
        stayed = away < AWAY
        settling = self._settling(trace)
        return Grasped(touched, stayed, contacts, *settling, trace, world.time)

    def _watch(self, world: HandWorld, decided: Decided) -> None:
        """Keep a row."""
        forces = [float(felt.force[2]) for felt in world.felt.values()]
        self._rows.append([world.time, *forces, *decided.made.target_force.tolist()])
        self._phases.append(decided.made.phase)

    def _until_engaged(self, world: HandWorld, decided: Decided) -> bool:
        """Watch until all pads press, or the hand holds what it has."""
        pressing = all(felt.force[2] > PRESSING for felt in world.felt.values())
        loads = decided.made.phase >= GripPhase.LOAD and pressing
        return self._until_hold(world, decided) or loads

    def _until_hold(self, world: HandWorld, decided: Decided) -> bool:
        """Watch until the hand holds."""
        self._watch(world, decided)
        return decided.made.phase >= GripPhase.HOLD

    def _outside(self) -> None:
        """What bears the object's weight until it is handed over, and what pulls it then."""
        since = self.world.time - self._handed_over
        given = min(max(since / RISE, 0.0), 1.0)
        pulled = min(max(since - AFTER, 0.0) / RISE, 1.0)
        force = self.world.data.xfrc_applied[self._object]
        force[:3] = pulled * self._pulls
        force[2] += (1.0 - given) * MASS * GRAVITY

    def _contacts(self) -> list[Touched]:
        """Contacts of all pads, as they last."""
        found = []
        for name, felt in self.world.felt.items():
            state = self.world.tips[name].lasting()
            if state is not None:
                found.append(Touched(felt.place, state.position, state.position_cov))
        return found

    def _settling(self, trace: Array) -> tuple[float, float, float]:
        """Overshoot, steady error and settling time of the sum of all forces."""
        count = (trace.shape[1] - 1) // 2
        phases = np.array(self._phases)
        begins = int(np.argmax(phases >= GripPhase.LOAD))
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
