"""Pick and place as in [4]: parts drawn at random, gripped, recognised by touch, sorted.

A part lies under the gripper at a place and turn that nobody knows. The gripper takes its tare,
closes, holds, and asks the pipeline, frame by frame as on a robot. The part is put where the
answer says: a washer onto the stack of its type, if its hole meets the pin; a tube into a deposit
of its shape, if it is turned rightly. What is not recognised is put aside: a failure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Frame, Recording

if TYPE_CHECKING:
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.simulation.taxel_scene import TaxelScene, TaxelSkin
    from tactile_ros.types import Array, ContactState, Layout, Outline

STEP_NS = 10_000_000
REST, CLOSE, HOLD = 10, 10, 5  # frames
PIN_CLEARANCE = 0.5e-3  # m
DEPOSIT_CLEARANCE = np.deg2rad(5.0)


@dataclass(frozen=True)
class Picked:
    """One part as it was gripped and what was said of it.

    Attributes
    ----------
    part : int
        Which of the parts.
    pose : ndarray, shape (3,)
        x, y (m) and yaw (rad).
    loads : ndarray, shape (t,)
        Of the taxels (N).
    state : ContactState
        At the end of the hold.
    placed : bool
        Whether it went where it belongs.
    """

    part: int
    pose: Array
    loads: Array
    state: ContactState
    placed: bool


def even_loads(
    layout: Layout, areas: Array, skin: TaxelSkin, rng: np.random.Generator, top: float
) -> Recording:
    """Equilibration: the whole array pressed evenly by a bladder, up to a load of a taxel (N)."""
    share = np.sqrt(rng.uniform(0, 1, (150, 1)))
    share[:20] = 0
    force = top * share * areas / areas.mean()
    pressed = (share[:, 0] > 0).astype(np.int8)
    return Recording.from_arrays(
        layout, skin.read(force, rng), truth={'taxel_force': force, 'in_contact': pressed}
    )


def turn_between(found: float, true: float, order: int) -> float:
    """Angle between two turns of an object with a symmetry of an order (rad); 0: any turn.

    Examples
    --------
    >>> round(turn_between(0.1, 0.1 + np.pi, 2), 6)
    0.0
    """
    if order == 0:
        return 0.0
    sector = 2 * np.pi / order
    return float(abs((found - true + sector / 2) % sector - sector / 2))


def is_placed(part: Outline, pose: Array, state: ContactState) -> bool:
    """Whether a part that is put down as the state says comes to lie where it belongs."""
    if part.bend is None:
        miss = float(np.linalg.norm(state.object_pose[:2, 3] - pose[:2]))
        return bool(miss <= PIN_CLEARANCE)
    return bool(turn_between(float(state.yaw), float(pose[2]), 1) <= DEPOSIT_CLEARANCE)


class Gripper:
    """A gripper with an array, and what it thinks of parts.

    Parameters
    ----------
    config : TaxelArrayConfig
        Of the array; its `objects` are the parts.
    scene, skin : TaxelScene, TaxelSkin
        The world.
    pipeline : Pipeline
        Fitted.
    force : tuple of float
        Least and largest force of a grip (N).
    play : float
        How far a part may lie from the middle, along x and along y (m).
    """

    def __init__(
        self,
        config: TaxelArrayConfig,
        scene: TaxelScene,
        skin: TaxelSkin,
        pipeline: Pipeline,
        force: tuple[float, float],
        play: float,
    ) -> None:
        self.config, self.scene, self.skin, self.pipeline = config, scene, skin, pipeline
        self.force, self.play = force, play

    def pick(self, rng: np.random.Generator) -> Picked:
        """Draw a part, grip it, and put it where the answer says."""
        part = int(rng.integers(len(self.config.objects)))
        pose = np.append(rng.uniform(-self.play, self.play, 2), rng.uniform(-np.pi, np.pi))
        outline = self.config.objects[part]
        loads = self.scene.loads(outline, pose, rng.uniform(*self.force))
        state = self._held(loads, rng)
        right = int(state.label) == part
        return Picked(part, pose, loads, state, right and is_placed(outline, pose, state))

    def _held(self, loads: Array, rng: np.random.Generator) -> ContactState:
        """State at the end of a grip, its frames one after the other."""
        share = np.concatenate([np.zeros(REST), np.linspace(0.1, 1, CLOSE), np.ones(HOLD)])
        values = self.skin.read(share[:, None] * loads, rng)
        frames = [Frame((i + 1) * STEP_NS, i, row) for i, row in enumerate(values)]
        self.pipeline.reset()
        self.pipeline.tare(frames[:REST])
        for frame in frames[REST:]:
            state = self.pipeline.process(frame)
        return state
