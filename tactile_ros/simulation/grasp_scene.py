"""Grasps of things that lie in the hand in random poses, as [2] made with its pad on an Allegro Hand.

An object is held where it is until the hand has it; then it is let go, and a force pulls it in a
random direction. What is judged: which cell of a pad is touched, how the force settles, and
whether the object stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.control import GripPhase
from tactile_ros.simulation.allegro_hand import ACROSS, CENTRE, on_half_cylinder, turned
from tactile_ros.simulation.hand_world import HandWorld
from tactile_ros.simulation.objects import solid

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.simulation.fingertip import Fingertip
    from tactile_ros.simulation.hand_model import HandModel
    from tactile_ros.simulation.hand_world import Decided, GraspStage
    from tactile_ros.types import Array, Integers

KINDS = ('cube', 'sphere', 'mouse')
MASS = 0.1  # kg
PULL, PULLED, RISE = 2.0, 0.6, 0.1  # N; s
TILT, ASIDE = np.deg2rad(12.0), 6e-3  # of the grasp's axis; m, across it
CLOSES, SETTLES, AFTER = 2.5, 2.0, 0.5  # s
AWAY = 0.015  # m, beyond which an object has left its place
SETTLED = 0.05  # of the target
STILL = '<equality><weld name="still" body1="world" body2="object" solref="0.02 1"/></equality>'


@dataclass(frozen=True)
class Grasped:
    """How a grasp went.

    Attributes
    ----------
    touched : bool
        Whether all fingers touched and the hand came to hold.
    held : bool
        Whether the object stayed through the pull.
    true_cell, told_cell : ndarray of int, shape (f,)
        Cells that are touched, nearest to the contact, and what the pads say.
    place_error : ndarray, shape (f,)
        Distance of the told place from the true one (m).
    edge : ndarray, shape (f,)
        How much nearer the second cell would have been (m): small at a border.
    overshoot, steady : float
        Worst of all fingers, shares of the target.
    settled : float
        Time from load until all forces stay within 5 % (s).
    trace : ndarray, shape (s, 1 + 2 f)
        Time (s), true normal forces and targets of all fingers (N).
    """

    touched: bool
    held: bool
    true_cell: Integers
    told_cell: Integers
    place_error: Array
    edge: Array
    overshoot: float
    steady: float
    settled: float
    trace: Array


def random_pose(kind: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Place (3,) (m) and turn (4,) (w, x, y, z) of an object between thumb and fingers."""
    axis = turned(np.array(ACROSS)) / np.linalg.norm(ACROSS)
    level = np.linalg.svd(axis[None])[2][1:]
    place = turned(np.array(CENTRE)) + level.T @ rng.uniform(-ASIDE, ASIDE, 2)
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
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    return np.array([w, x, y, z])


class GraspScene:
    """One object in a hand with magnet pads.

    Parameters
    ----------
    hand : HandModel
        The Allegro-like one.
    tips : mapping of str to Fingertip
        Magnet pads, tared.
    stage : GraspStage
        Of the same hand.
    rate_hz : float
        Of the stage (Hz).
    kind : str
        Of the object.
    seed : int
        Of its pose and the pull.
    """

    def __init__(
        self,
        hand: HandModel,
        tips: Mapping[str, Fingertip],
        stage: GraspStage,
        rate_hz: float,
        kind: str,
        seed: int,
    ) -> None:
        self._rng = np.random.default_rng([seed, KINDS.index(kind)])
        self.config = next(iter(tips.values())).skin.config
        place, turn = random_pose(kind, self._rng)
        thing = solid(kind, MASS, tuple(place), tuple(turn))
        self.world = HandWorld(hand, thing, tips, stage, rate_hz, STILL, place=self._on_pad)
        self._start = place
        self._rows: list[list[float]] = []
        self._phases: list[GripPhase] = []

    def _on_pad(self, place: Array, _: Array) -> Array:
        return on_half_cylinder(place, self.config.radius, self.config.length)

    def grasp(self, force: float) -> Grasped:
        """Grasp at a force (N), of the thumb, and pull."""
        world, stage = self.world, self.world.stage
        stage.enable()
        world.run(0.05)
        stage.grasp(force, [], 0.0, False)
        world.run(CLOSES, self._until_hold)
        touched = bool(self._phases[-1] == GripPhase.HOLD)
        world.run(SETTLES, self._watch)
        judged = self._cells()
        world.data.eq_active[0] = 0
        world.run(AFTER)
        self._start = world.data.body('object').xpos.copy()
        self._pull()
        away = float(np.linalg.norm(world.data.body('object').xpos - self._start))
        trace = np.array(self._rows)
        return Grasped(touched, away < AWAY, *judged, *self._settling(trace), trace)

    def _watch(self, world: HandWorld, decided: Decided) -> None:
        """Keep a row."""
        forces = [float(felt.force[2]) for felt in world.felt.values()]
        self._rows.append([world.time, *forces, *decided.made.target_force.tolist()])
        self._phases.append(decided.made.phase)

    def _until_hold(self, world: HandWorld, decided: Decided) -> bool:
        self._watch(world, decided)
        return decided.made.phase == GripPhase.HOLD

    def _pull(self) -> None:
        """A force on the object that rises, in a random direction."""
        world = self.world
        direction = self._rng.normal(size=3)
        pull = PULL * direction / np.linalg.norm(direction)
        body, begins = world.data.body('object').id, world.time

        def before_step() -> None:
            share = min((world.time - begins) / RISE, 1.0)
            world.data.xfrc_applied[body, :3] = share * pull

        world.before_step = before_step
        world.run(PULLED)

    def _cells(self) -> tuple[Integers, Integers, Array, Array]:
        """Cells that are touched and told, errors of the places, and how near borders are."""
        felt = list(self.world.felt.values())
        count = len(felt)
        true, told = np.full(count, -1), np.full(count, -1)
        error, edge = np.full((2, count), np.nan)
        for i, one in enumerate(felt):
            told[i] = int(one.state.cell)
            if not np.isfinite(one.place).all():
                continue
            far = np.sort(np.linalg.norm(self.config.cells - one.place, axis=1))
            true[i] = np.linalg.norm(self.config.cells - one.place, axis=1).argmin()
            error[i] = np.linalg.norm(one.state.position - one.place)
            edge[i] = far[1] - far[0]
        return true, told, error, edge

    def _settling(self, trace: Array) -> tuple[float, float, float]:
        """Overshoot, steady error and settling time, each the worst of all fingers."""
        count = (trace.shape[1] - 1) // 2
        phases = np.array(self._phases)
        if not (phases == GripPhase.HOLD).any():
            return np.nan, np.nan, np.nan
        begins = int(np.argmax(phases == GripPhase.LOAD))
        final = trace[-1, 1 + count :]
        share = trace[:, 1 : 1 + count] / final - 1.0
        steady = np.abs(share[-len(share) // 5 :].mean(axis=0)).max()
        off = np.flatnonzero((np.abs(share) > SETTLED).any(axis=1))
        settled = trace[min(off[-1] + 1, len(trace) - 1), 0] - trace[begins, 0]
        return float(share[begins:].max()), float(steady), float(settled)
