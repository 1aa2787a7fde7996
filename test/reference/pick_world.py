# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pick and place as in [4]: parts drawn at random, gripped, recognised by touch, sorted.

A part lies under the gripper at a place and turn that nobody knows. The gripper takes its tare,
closes, holds, and asks the pipeline, frame by frame as on a robot. The part is put where the
answer says: a washer onto the stack of its type, if its hole meets the pin; a tube into a deposit
of its shape, if it is turned rightly. What is not recognised is put aside: a failure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.physics.coverage import inside, part_pressure, washer
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors.taxel_array.config import (
    TaxelArrayConfig,
    grid_positions,
    radial_positions,
    sectors,
)
from tactile_ros.types import Array, ContactState, Frame, Integers, Layout, Outline, Recording

RINGS = ((6, 2.5e-3), (12, 7.5e-3), (24, 12.5e-3), (30, 17.5e-3))  # taxels, inner radius (m)
PITCH = 5e-3
WASHERS = ((16e-3, 8e-3), (14e-3, 6.5e-3), (12e-3, 5e-3), (18e-3, 9e-3), (10e-3, 4e-3))  # m
TUBES = tuple(Outline(f'tube_{bend}', (), 9e-3, np.deg2rad(bend)) for bend in (90, 135))


def magnet_gripper() -> TaxelArrayConfig:
    """72 taxels in four rings, and washers of five types."""
    shapes = [o for count, r in RINGS for o in sectors(count, r, r + PITCH)]
    areas = [np.full(n, np.pi * ((r + PITCH) ** 2 - r**2) / n) for n, r in RINGS]
    return TaxelArrayConfig(
        positions=np.concatenate([radial_positions(n, r, r + PITCH) for n, r in RINGS]),
        areas=np.concatenate(areas),
        taxel_outlines=tuple(Outline(f'taxel_{i}', o.loops) for i, o in enumerate(shapes)),
        force_range=np.array([0.0, 8.0]),
        objects=tuple(washer(f'washer_{i}', *pair) for i, pair in enumerate(WASHERS)),
    )


def suction_cup() -> TaxelArrayConfig:
    """16 sectors, and angle tubes of two bends."""
    return TaxelArrayConfig(taxel_outlines=sectors(), objects=TUBES)


def jaw() -> TaxelArrayConfig:
    """2000 taxels of 1 mm, and a part without symmetry."""
    corners = np.array([[-8, -6], [10, -6], [10, 0], [-2, 0], [-2, 8], [-8, 8.0]])
    return TaxelArrayConfig(
        positions=grid_positions(40, 50, 1e-3),
        areas=np.full(2000, 1e-6),
        force_range=np.array([0.0, 1.0]),
        objects=(Outline('angle', (1e-3 * corners,)),),
    )


SIDE = 30  # points along each side of the box around a taxel
REST_OUTPUT = 0.002  # fraction that taxels read at rest, at most


@dataclass(frozen=True)
class TaxelSkin:
    """How t taxels answer to loads.

    Attributes
    ----------
    gain, half_load, power : ndarray, shape (t,)
        Largest output (fraction), load of half of it (N), and exponent.
    broken : ndarray of int, shape (n,)
        Taxels that read nothing, whatever bears on them.
    noise : float
        Of an output (fraction).
    steps : int
        Of the converter.
    """

    gain: Array
    half_load: Array
    power: Array
    broken: Integers
    noise: float = 5e-4
    steps: int = 1023

    @classmethod
    def drawn(
        cls, taxels: int, half_load: float, rng: np.random.Generator, broken: int = 0
    ) -> TaxelSkin:
        """Gains that differ by 55 % of the least, as [4] found, and curves that differ too."""
        return cls(
            0.95 / (1 + 0.55 * rng.uniform(size=taxels)),
            half_load * rng.uniform(0.8, 1.25, taxels),
            0.85 * rng.uniform(0.96, 1.04, taxels),
            rng.permutation(taxels)[:broken],
        )

    def read(self, load: Array, rng: np.random.Generator) -> Array:
        """Readings (s, t, 1) under loads (s, t) (N)."""
        size = (np.maximum(load, 0.0) / self.half_load) ** self.power
        output = REST_OUTPUT + self.gain * size / (1 + size)
        output[:, self.broken] = 0.0
        output = output + self.noise * rng.normal(size=output.shape)
        return np.asarray(np.round(np.clip(output, 0, 1) * self.steps)[..., None] / self.steps)


class TaxelScene:
    """Points of an array on which parts press.

    Parameters
    ----------
    config : TaxelArrayConfig
        With `taxel_outlines`, or with squares of `areas`.
    """

    def __init__(self, config: TaxelArrayConfig) -> None:
        line = (np.arange(SIDE) + 0.5) / SIDE - 0.5
        cross = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        groups = []
        for i, centre in enumerate(config.positions[:, :2]):
            if config.taxel_outlines is None:
                groups.append(centre + np.sqrt(config.areas[i]) * cross)
                continue
            loops = config.taxel_outlines[i].loops
            low, high = loops[0].min(axis=0), loops[0].max(axis=0)
            box = (low + high) / 2 + (high - low) * cross
            groups.append(box[inside(loops, box)])
        self.points = np.concatenate(groups)
        self.owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
        self.part = (config.areas / np.bincount(self.owner))[self.owner]
        self.taxels = len(groups)

    def loads(self, part: Outline, pose: Array, force: float) -> Array:
        """Load (t,) of every taxel under a part at a pose (x, y, yaw) with a whole force (N)."""
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        own = (self.points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])
        pressure = part_pressure(part, own)
        load = np.bincount(self.owner, pressure * self.part, self.taxels)
        return np.asarray(force * load / max(float(load.sum()), 1e-30))


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
