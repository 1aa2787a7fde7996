# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A magnet pad of its own: exact blocks of magpylib in a body that is compressible and stiffens.

The load is spread as under a Hertz contact on a tangent half-space of any Poisson ratio
(Boussinesq and Cerruti), fades towards the base, and grows less than in proportion. Magnets lie
and are magnetised otherwise than the config says, chips have gains and crossed axes. Nothing of it
is shared with the model of the package.
"""

from __future__ import annotations

import magpylib
import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.types import Layout, Recording

LEVEL = 1e-3
FLAT = 0.97  # largest |y| of a touch, in radii


class PadWorld:
    """Readings of touches on a pad that is nearly the one of `config`.

    `mount` moves the magnets (m, standard deviation), as mounting the pad anew does; `amiss`
    scales by how much their places and strengths are others than those of the config.
    """

    def __init__(
        self, config: object, seed: int = 0, *, poisson: float = 0.47, stiffening: float = 60.0,
        height: float = 0.03, base: float = 0.25, gains: float = 0.01, mount: float = 0.0,
        remounted: int = 0, noise: float = 4e-6, amiss: float = 1.0,
    ) -> None:  # fmt: skip
        rng = np.random.default_rng(seed)
        self.config, self.noise = config, noise
        self.poisson, self.stiffening, self.base = poisson, stiffening, base
        self.magnets = config.magnet_positions.copy()
        self.magnets[:, 2] *= 1 + height * rng.uniform(-1, 1)
        self.magnets += 1e-4 * amiss * rng.normal(size=self.magnets.shape)
        self.magnets += mount * np.random.default_rng(remounted).normal(size=self.magnets.shape)
        self.strength = config.remanence * (1 + 0.03 * amiss * rng.normal(size=len(self.magnets)))
        self.shear = config.shear_modulus * np.exp(0.15 * rng.normal())
        chips = len(config.positions)
        self.gains = np.eye(3) + gains * rng.normal(size=(chips, 3, 3))

    def _moved(self, points: np.ndarray, touches: Touches, tip: np.ndarray) -> np.ndarray:
        """Displacement (s, n, 3) of points (n, 3)."""
        normal = touches.normal
        side = np.tile([1.0, 0.0, 0.0], (len(normal), 1))
        other = np.cross(normal, side)
        frame = np.stack([side, other, -normal], axis=2)
        size = np.linalg.norm(touches.force, axis=1, keepdims=True)
        load = -touches.force / (1 + size / self.stiffening)
        load = np.einsum('sji,sj->si', frame, load)
        away = np.einsum('sji,snj->sni', frame, points - touches.place[:, None])
        total = np.zeros_like(away)
        rings = np.sqrt(1 - (1 - (np.arange(4) + 0.5) / 4) ** (2 / 3))
        for ring in rings:
            for angle in 2 * np.pi * (np.arange(7) + ring) / 7:
                at = tip[:, None] * ring * np.array([np.cos(angle), np.sin(angle)])
                part = away.copy()
                part[..., :2] -= at[:, None]
                total += self._half_space(part, load[:, None] / (7 * len(rings)))
        moved = np.einsum('sij,snj->sni', frame, total)
        rise = points[:, 2] / (self.base * self.config.radius)
        return moved * (1 - np.exp(-(rise**2)))[:, None]

    def _half_space(self, r: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Boussinesq and Cerruti: depth is the third axis, `load` on the surface at 0."""
        x, y, z = np.moveaxis(r, -1, 0)
        z = np.maximum(z, 1e-4)
        d = np.sqrt(x * x + y * y + z * z)
        p, q, n = np.moveaxis(load, -1, 0)
        k = 1 - 2 * self.poisson
        fall = d * (d + z)
        ux = n * x * (z / d**3 - k / fall)
        uy = n * y * (z / d**3 - k / fall)
        uz = n * (z * z / d**3 + 2 * (1 - self.poisson) / d)
        for a, b, t, lead in ((x, y, p, 0), (y, x, q, 1)):
            same = 1 / d + a * a / d**3 + k * (1 / (d + z) - a * a / (d * (d + z) ** 2))
            cross = a * b / d**3 - k * a * b / (d * (d + z) ** 2)
            ux = ux + t * (same if lead == 0 else cross)
            uy = uy + t * (same if lead == 1 else cross)
            uz = uz + t * (a * z / d**3 + k * a / fall)
        return np.stack([ux, uy, uz], axis=-1) / (4 * np.pi * self.shear)

    def change(self, touches: Touches, tip: float | np.ndarray) -> np.ndarray:
        """Change of the readings (s, t, 3) (T) in chip axes."""
        tip = np.broadcast_to(np.asarray(tip, float), (len(touches.place),))
        step = 2e-4
        probes = np.concatenate([np.zeros((1, 3)), step * np.eye(3), -step * np.eye(3)])
        total = np.zeros((len(tip), *self.config.positions.shape))
        axes = self.config.magnet_axes / np.linalg.norm(
            self.config.magnet_axes, axis=1, keepdims=True
        )
        for magnet, axis, strength in zip(self.magnets, axes, self.strength, strict=True):
            u = self._moved(magnet + probes, touches, tip)
            slope = (u[:, 1:4] - u[:, 4:]) / (2 * step)  # [s, j, i]: d u_i / d x_j
            curl = np.stack(
                [slope[:, j, k] - slope[:, k, j] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1
            )
            turn = Rotation.from_rotvec(0.5 * curl)
            total += self._block(magnet + u[:, 0], turn, axis, strength)
            total -= self._block(magnet[None], Rotation.identity(1), axis, strength)
        total = np.einsum('tij,stj->sti', self.gains, total)
        turns = self.config.rotations
        return total if turns is None else np.einsum('tji,stj->sti', turns, total)

    def resting(self) -> np.ndarray:
        """Field of the magnets at rest (t, 3) (T) in chip axes."""
        axes = self.config.magnet_axes / np.linalg.norm(
            self.config.magnet_axes, axis=1, keepdims=True
        )
        still = Rotation.identity(1)
        each = zip(self.magnets, axes, self.strength, strict=True)
        field = sum(self._block(magnet[None], still, axis, size)[0] for magnet, axis, size in each)
        field = np.einsum('tij,tj->ti', self.gains, field)
        turns = self.config.rotations
        return field if turns is None else np.einsum('tji,tj->ti', turns, field)

    def warmed(
        self, recording: Recording, rise: np.ndarray, seed: int = 0, *, slope: float = -1.2e-3,
        usual: float = 25.0, thermometer: float = 0.02, layout: Layout,
    ) -> Recording:  # fmt: skip
        """The same where magnets and chips are warmer in each row by `rise` (s,) (degrees).

        Magnets lose `slope` of their field with each degree, chips tell the temperature.
        """
        field = recording.values - LEVEL + self.resting()
        values = field * (1 + slope * rise[:, None, None])
        noise = np.random.default_rng(seed).normal(size=recording.values.shape[:2])
        return Recording.from_arrays(
            layout, values, temperature_c=usual + rise[:, None] + thermometer * noise,
            tare=recording.tare, truth=dict(recording.truth),
        )  # fmt: skip

    def _block(
        self, centre: np.ndarray, turn: Rotation, axis: np.ndarray, strength: float
    ) -> np.ndarray:
        """Field (s, t, 3) of a block at centres (s, 3)."""
        upright, _ = Rotation.align_vectors(axis[None], [[0.0, 0.0, 1.0]])
        whole = turn * upright
        fields = []
        for chip in self.config.positions:
            own = whole.inv().apply(chip - centre)
            block = np.broadcast_to(self.config.magnet_size, own.shape)
            pole = np.broadcast_to([0.0, 0.0, strength], own.shape)
            fields.append(whole.apply(magpylib.core.magnet_cuboid_Bfield(own, block, pole)))
        return np.stack(fields, axis=1)

    def record(
        self, touches: Touches, seed: int, *, tip: float | np.ndarray = 3e-3, stray: float = 0.0,
        layout: Layout, rest: int = 60, session: int = 0,
    ) -> Recording:  # fmt: skip
        """A rest that is tared, then every touch once, in a stray field of `stray` (T)."""
        rng = np.random.default_rng(seed)
        count = len(touches.place)
        outside = rng.normal(size=(count, 3))
        outside *= stray / np.linalg.norm(outside, axis=1, keepdims=True)
        turns = self.config.rotations
        seen = np.broadcast_to(outside[:, None], (count, len(self.config.positions), 3))
        if turns is not None:
            seen = np.einsum('tji,stj->sti', turns, seen)
        change = self.change(touches, tip) + np.einsum('tij,stj->sti', self.gains, seen)
        values = LEVEL + np.concatenate([np.zeros((rest, *change.shape[1:])), change])
        values += self.noise * rng.normal(size=values.shape)
        blank = np.full((rest, 3), np.nan)
        truth = {
            'position': np.concatenate([blank, touches.place]),
            'force': np.concatenate([blank, touches.force]),
            'cell': np.concatenate([np.full(rest, -1), touches.cell]),
            'in_contact': (np.arange(rest + count) >= rest).astype(np.int8),
            'repetition': np.concatenate([np.zeros(rest, int), np.arange(count)]),
            'session': np.full(rest + count, session),
            'stray_field': np.concatenate([np.zeros((rest, 3)), outside]),
        }
        tare = np.arange(rest + count) < rest
        return Recording.from_arrays(layout, values, tare=tare, truth=truth)


class Touches:
    """Places (s, 3) on a half cylinder, outward normals, forces (s, 3), cells (s,)."""

    def __init__(
        self, config: object, plan: np.ndarray, load: np.ndarray, cell: np.ndarray,
        lean: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.config, self.plan, self.load, self.cell, self.lean = config, plan, load, cell, lean
        y = np.clip(plan[:, 1] / config.radius, -FLAT, FLAT)
        self.normal = np.column_stack([np.zeros(len(y)), y, np.sqrt(1 - y * y)])
        self.place = config.radius * self.normal
        self.place[:, 0] = plan[:, 0]
        around = np.cross([1.0, 0.0, 0.0], self.normal)
        self.around = around
        lean = np.zeros((len(y), 2)) if lean is None else lean
        self.force = load[:, None] * (
            self.normal + lean[:, :1] * np.array([1.0, 0, 0]) + lean[:, 1:] * around
        )

    @classmethod
    def in_cells(
        cls, config: object, grid: tuple[int, int], count: int, spread: float, seed: int,
        loads: tuple[float, float] = (1.5, 10.0), cone: float = 0.0,
    ) -> Touches:  # fmt: skip
        """Within `spread` of a cell's width of its centre, leaning up to `cone` (rad)."""
        rng = np.random.default_rng(seed)
        cell = rng.permutation(np.arange(count) % len(config.cells))
        width = np.array([config.length / grid[0], 2 * config.radius / grid[1]])
        plan = config.cells[cell, :2] + spread * width * rng.uniform(-0.5, 0.5, (count, 2))
        tilt, turn = cone * rng.uniform(size=count), rng.uniform(0, 2 * np.pi, count)
        lean = np.tan(tilt)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        load = rng.uniform(*loads, count) * np.cos(tilt)
        return cls(config, plan, load, cell, lean)

    def shifted(self, along: float, around: float, load: float) -> Touches:
        """The same touches a little further along (m), around (m of arc) and harder (share)."""
        angle = np.arccos(np.clip(self.place[:, 1] / self.config.radius, -1, 1))
        angle = angle - around / self.config.radius
        moved = Touches.__new__(Touches)
        vars(moved).update(vars(self))
        moved.normal = np.column_stack([np.zeros(len(angle)), np.cos(angle), np.sin(angle)])
        moved.place = self.config.radius * moved.normal
        moved.place[:, 0] = self.plan[:, 0] + along
        moved.around = np.cross([1.0, 0.0, 0.0], moved.normal)
        lean = np.zeros((len(angle), 2)) if self.lean is None else self.lean
        moved.force = (self.load * (1 + load))[:, None] * (
            moved.normal + lean[:, :1] * np.array([1.0, 0, 0]) + lean[:, 1:] * moved.around
        )
        return moved
