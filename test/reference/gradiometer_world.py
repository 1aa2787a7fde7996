# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A gradiometer that the package knows nothing of: fields of magpylib, an elastomer that warms.

Press for press: disc with tilt, crossed axes, offsets, stiffness that grows with depth and falls
with temperature, an elastomer that expands, a disc that warms later than the chip, fields that are
uniform or of a magnet nearby.
"""

import dataclasses
from dataclasses import dataclass

import magpylib
import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

SENSOR = load_sensor('gradiometer')


@dataclass(frozen=True)
class Scene:
    """What surrounds the sensor: uniform field (T), magnet's distance (m), degrees around 35."""

    stray: tuple[float, float, float] = (0.0, 0.0, 0.0)
    magnet: float = np.inf
    span: float = 0.0
    ramp_s: float = 0.0
    turned: bool = False


class World:
    """One specimen: the config says what it was built as, the specimen differs from it."""

    def __init__(
        self, seed: int, noise: float = 2e-6, amiss: float = 1.0, turned: float = 0.0
    ) -> None:
        rng = np.random.default_rng([seed, 77])
        self.noise, self.rest = noise, 60
        wide, deep = rng.uniform(1.7e-3, 2.3e-3, 2)
        corner = 0.5 * np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * [wide, deep]
        pixels = np.column_stack([corner, np.zeros(4)])
        self.config = dataclasses.replace(
            SENSOR.config(), positions=pixels, noise=noise, gap=rng.uniform(2.2e-3, 3e-3),
            disc_diameter=rng.uniform(1.8e-3, 2.6e-3), disc_height=rng.uniform(0.8e-3, 1.3e-3),
            remanence=rng.uniform(1.0, 1.4), saturation=rng.uniform(70e-3, 130e-3),
        )  # fmt: skip
        # the angle of the second die (rad)
        angles = turned * np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1], [0, 0, 1]])
        self.turn = Rotation.from_rotvec(angles).as_matrix()
        if turned:
            self.config = dataclasses.replace(self.config, rotations=self.turn)
        self.gap = self.config.gap * (1 + 0.03 * amiss * rng.normal())
        self.remanence = self.config.remanence * (1 + 0.03 * amiss * rng.normal())
        self.place = 1e-4 * amiss * rng.normal(size=2)
        self.mix = np.eye(3) + 0.005 * amiss * rng.normal(size=(4, 3, 3))
        self.offset = 2e-4 * amiss * rng.normal(size=(4, 2))
        self.depth = 0.55 * self.gap
        self.stiffness = rng.uniform(1200, 2500) * np.array([0.35, 0.35, 1.0])
        self.lean = rng.uniform(20, 70)
        self.softer, self.wider = rng.uniform(1e-3, 4e-3), rng.uniform(1e-4, 3e-4)
        self.weaker, self.lag_s = rng.uniform(8e-4, 1.2e-3), rng.uniform(5.0, 25.0)

    def field(self, shift: np.ndarray, tilt: np.ndarray, heat: np.ndarray) -> np.ndarray:
        """Field (s, 4, 3) of the disc, moved, tilted and as warm as `heat` (s,) says."""
        size = (self.config.disc_diameter, self.config.disc_height)
        magnet = magpylib.magnet.Cylinder(dimension=size, polarization=(0, 0, self.remanence))
        rise = self.gap * (1 + self.wider * heat) + 0.5 * size[1]
        centre = shift + np.column_stack([np.tile(self.place, (len(shift), 1)), rise])
        turn = Rotation.from_rotvec(np.column_stack([tilt, np.zeros(len(tilt))]))
        own = [turn.inv().apply(pixel - centre) for pixel in self.config.positions]
        seen = np.stack([turn.apply(magnet.getB(points)) for points in own], axis=1)
        return np.asarray(seen * (1 - self.weaker * heat)[:, None, None])

    def force(self, shift: np.ndarray, heat: np.ndarray) -> np.ndarray:
        """Force (s, 3) (N) that holds the disc where it is."""
        depth = -shift[:, 2] / self.gap
        stiff = (1 - self.softer * heat)[:, None] * self.stiffness
        force = stiff * shift * (1 + 0.8 * depth[:, None]) * [1.0, 1.0, -1.0]
        force[:, 2] *= 1 - 0.3 * (shift[:, :2] ** 2).sum(axis=1) / self.gap**2
        return np.asarray(force)

    def surroundings(self, scene: Scene, count: int, rng: np.random.Generator) -> np.ndarray:
        """Field (s, 4, 3) of what surrounds the sensor since the rest."""
        outside = np.tile(np.array(scene.stray)[None, None], (count, 4, 1))
        if scene.turned:
            outside = 2e-3 * rng.normal(size=(count, 1, 3)) + 0 * outside
        if np.isfinite(scene.magnet):
            way = rng.normal(size=3) * [1, 1, 0.5]
            at = scene.magnet * way / np.linalg.norm(way)
            near = magpylib.misc.Dipole(moment=0.06 * rng.normal(size=3), position=at)
            outside = outside + near.getB(self.config.positions)[None]
        return np.asarray(outside)

    def warmth(self, scene: Scene, count: int, rng: np.random.Generator) -> np.ndarray:
        """Degrees over 35 of the chip and of the disc, shape (2, s)."""
        if scene.ramp_s <= 0:
            heat = scene.span * rng.uniform(-0.5, 0.5, count)
            return np.stack([heat, heat])
        time = np.linspace(0, scene.ramp_s, count)
        chip = 0.5 * scene.span * np.sin(2 * np.pi * time / (0.6 * scene.ramp_s))
        disc, step = np.zeros(count), scene.ramp_s / count
        for i in range(1, count):
            mean = 0.5 * (chip[i] + chip[i - 1])
            disc[i] = disc[i - 1] + (mean - disc[i - 1]) * -np.expm1(-step / self.lag_s)
        return np.stack([chip, disc])

    def record(self, count: int, seed: int, scene: Scene = Scene()) -> Recording:
        """Presses after a rest; the surroundings come after the rest."""
        rng = np.random.default_rng([seed, 5])
        shift = np.concatenate([np.zeros((self.rest, 3)), self.shifts(count, rng)])
        return self.recorded(shift, seed, scene)

    def shifts(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Places of the disc since rest, shape (s, 3) (m)."""
        radius, angle = np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
        depth = rng.uniform(0.01, 1, count) * self.depth
        side = 0.4 * self.gap * radius
        return np.column_stack([side * np.cos(angle), side * np.sin(angle), -depth])

    def tilts(self, shift: np.ndarray) -> np.ndarray:
        """Turns (s, 2) (rad) that come with shifts."""
        tilt = self.lean * np.column_stack([-shift[:, 1], shift[:, 0]])
        return np.asarray(tilt * (1 - 0.3 * shift[:, 2:] / self.gap))

    def recorded(self, shift: np.ndarray, seed: int, scene: Scene) -> Recording:
        """Frames of a disc at places (s, 3), of which the first `rest` are the tare."""
        rng = np.random.default_rng([seed, 6])
        touched = np.arange(len(shift)) >= self.rest
        chip, disc = self.warmth(scene, len(shift), rng)
        if scene.turned:
            shift = 0 * shift
        tilt = self.tilts(shift)
        force = self.force(shift, disc)
        outside = self.surroundings(scene, len(shift), rng) * touched[:, None, None]
        read = np.einsum('tij,stj->sti', self.mix, self.field(shift, tilt, disc) + outside)
        read = np.einsum('tij,sti->stj', self.turn, read)
        read = (read[..., [0, 2]] + self.offset) * (1 - 0.005 * chip)[:, None, None]
        read = read + self.noise * rng.normal(size=read.shape)
        limit = float(np.max(self.config.saturation))  # type: ignore[arg-type]
        told = 35 + chip
        unseen = np.full(len(force), np.nan)
        torque = np.column_stack([-4e-3 * force[:, 1], 4e-3 * force[:, 0], unseen])
        truth = {'force': force, 'torque': torque}
        if scene.turned:
            truth = {'stray_field': outside[:, 0], 'in_contact': np.zeros(len(force), np.int8)}
        stamps = np.round(1e9 * np.linspace(0, scene.ramp_s, len(shift))).astype(np.int64)
        return Recording.from_arrays(
            SENSOR.layout(self.config), np.clip(read, -limit, limit), tare=~touched,
            stamp_ns=stamps if scene.ramp_s > 0 else None,
            temperature_c=np.repeat(told[:, None], 4, axis=1) if scene.span else None, truth=truth,
        )  # fmt: skip
