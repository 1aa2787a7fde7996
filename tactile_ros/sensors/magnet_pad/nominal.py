"""The pad as its config tells it: magnets carried by an incompressible body under touches.

Touches of all places and loads, normal to the surface or leaning, by tips of several sizes, on a
body that its base holds or not: what is not known of a touch is spread over the table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.touch_mixture import Linearised
from tactile_ros.physics.dipoles import in_chip_axes
from tactile_ros.physics.elastomer import disc_press
from tactile_ros.sensors.magnet_pad.fidelity import block_model, blocks_of
from tactile_ros.sensors.magnet_pad.telling import READING, SIGMAS, Telling
from tactile_ros.types import Array, Bools

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.physics.fidelity import Choice
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.signals import Columns

SEED = 20191112
LOADS = (0.01, 0.6)  # of shear modulus times the square of the radius
TIPS = (0.05, 0.7)  # radius of a tip over that of the cylinder
LEAN = 0.5  # rad, largest of a leaning touch
UPRIGHT = 0.75  # share of touches that do not lean
BLOCK = 2048
MEASURED = 200  # touches by which a model of the blocks is chosen
NOISE, LEAST_NOISE = 4e-6, 1e-7  # T, where nothing tells it; below it nothing is gained
COUNT = 8000
STEP = 1e-2  # radii and rad, by which slopes are measured
LOAD = 2.0  # radii that a factor e of load counts as
NEAR = 6  # neighbour whose distance is the reach of a touch
RIGHT = 0.06  # of a reading: what the model may be wrong by
UNLIKE = 4.0  # misfit of a channel, from which a stray field is thought of
UNSURE = 0.8  # the table's spread has touches that lean and bodies of all bonds
STIFF = 0.2  # share by which a modulus from a hardness, and thus a force, may be wrong
LEAST = 1e-4  # m; N times shear modulus and radius follow


@dataclass(frozen=True)
class Presses:
    """Touches of the half cylinder.

    Attributes
    ----------
    along, around : ndarray, shape (s,)
        Place along the axis (m), and angle from y (rad).
    force : ndarray, shape (s, 3)
        What the skin exerts on the object (N).
    tip, bond : ndarray, shape (s,)
        Radius of the contact (m); share of the base's image.
    """

    along: Array
    around: Array
    force: Array
    tip: Array
    bond: Array

    @property
    def normals(self) -> Array:
        """Outward normals, shape (s, 3)."""
        zero = np.zeros_like(self.around)
        return np.column_stack([zero, np.cos(self.around), np.sin(self.around)])

    @property
    def size(self) -> Array:
        """Of the force, shape (s,) (N)."""
        return np.asarray(np.linalg.norm(self.force, axis=1))

    def turned(self, angle: float) -> Presses:
        """The same a little further around (rad), forces with their places."""
        cosine, sine = np.cos(angle), np.sin(angle)
        force = self.force.copy()
        force[:, 1] = cosine * self.force[:, 1] - sine * self.force[:, 2]
        force[:, 2] = sine * self.force[:, 1] + cosine * self.force[:, 2]
        return replace(self, around=self.around + angle, force=force)

    def places(self, radius: float) -> Array:
        """Contacts on a cylinder of `radius`, shape (s, 3) (m)."""
        places = radius * self.normals
        places[:, 0] = self.along
        return places


def uniform_response(config: MagnetPadConfig) -> Array:
    """What a uniform field adds to the readings (3 t, 3), in sensor axes."""
    turns = config.rotations
    turned = np.tile(np.eye(3), (len(config.positions), 1, 1)) if turns is None else turns
    return np.concatenate([turn.T for turn in turned])


def spread_presses(config: MagnetPadConfig, count: int) -> Presses:
    """Touches of all kinds over the whole pad, the same for the same config."""
    rng = np.random.default_rng(SEED)
    along = config.length * (rng.uniform(size=count) - 0.5)
    across = rng.uniform(-1, 1, count)
    around = np.arccos(0.98 * across)
    low, high = np.log(LOADS)
    size = np.exp(rng.uniform(low, high, count)) * config.shear_modulus * config.radius**2
    lean = LEAN * rng.uniform(size=count) * (rng.uniform(size=count) > UPRIGHT)
    turn = rng.uniform(0, 2 * np.pi, count)
    zero = np.zeros(count)
    normal = np.column_stack([zero, np.cos(around), np.sin(around)])
    tangent = np.column_stack([zero, -np.sin(around), np.cos(around)])
    sideways = np.cos(turn)[:, None] * np.eye(3)[0] + np.sin(turn)[:, None] * tangent
    direction = np.cos(lean)[:, None] * normal + np.sin(lean)[:, None] * sideways
    tip = config.radius * rng.uniform(*TIPS, count)
    bond = np.clip(rng.uniform(-0.8, 1.6, count), 0.0, 1.0)
    return Presses(along, around, size[:, None] * direction, tip, bond)


def change_of_field(config: MagnetPadConfig, presses: Presses, edge_nodes: int = 2) -> Array:
    """Change of the readings (s, t, 3) (T) in chip axes, from rest to touched."""
    blocks = blocks_of(config, edge_nodes)
    rest = np.zeros((1, len(config.magnet_positions), 3))
    level = blocks.field(config.positions, rest, rest)
    parts = []
    for i in range(0, len(presses.along), BLOCK):
        moved, turned = blocks.carried(_displacement(config, presses, slice(i, i + BLOCK)))
        parts.append(blocks.field(config.positions, moved, turned) - level)
    return in_chip_axes(np.concatenate(parts), config.rotations)


def field_choice(config: MagnetPadConfig, presses: Presses, noise: float) -> Choice:
    """Model of the blocks that touches need at a noise (T), by some of them."""
    some = slice(0, None, max(len(presses.along) // MEASURED, 1))
    moved, turned = blocks_of(config, 1).carried(_displacement(config, presses, some))
    return block_model(config, max(noise, LEAST_NOISE), moved, turned)


def nominal_choice(config: MagnetPadConfig) -> Choice:
    """Model of the blocks that the nominal touches need at the config's noise."""
    noise = NOISE if config.noise is None else float(np.min(config.noise))
    return field_choice(config, spread_presses(config, MEASURED), noise)


def _displacement(
    config: MagnetPadConfig, presses: Presses, rows: slice
) -> Callable[[Array], Array]:
    """Of points (n, 3) under some of the presses, shape (s, n, 3)."""
    places, normals = presses.places(config.radius)[rows], presses.normals[rows]
    force, tip, bond = -presses.force[rows], presses.tip[rows], presses.bond[rows]

    def displacement(points: Array) -> Array:
        wide = np.broadcast_to(points, (len(places), *points.shape))
        return disc_press(wide, places, normals, force, tip, config.shear_modulus, bond)

    return displacement


class NominalPad:
    """Touches of the nominal model as a table that answers readings.

    Parameters
    ----------
    config : MagnetPadConfig
        Geometry and materials.

    Attributes
    ----------
    telling : Telling
        Of the touches.
    """

    def __init__(self, config: MagnetPadConfig) -> None:
        self.cells = config.cells
        noise = NOISE if config.noise is None else max(float(np.max(config.noise)), LEAST_NOISE)
        presses = spread_presses(config, COUNT)
        several = len(config.positions) > 1 and config.stray_term
        common = uniform_response(config) if several else None
        rows = self._rows(config, presses, noise)
        limit = UNLIKE * rows.readings.shape[1]
        self.telling = Telling(rows, common, noise, SIGMAS * noise, limit, neighbours=32)
        force = LEAST * config.shear_modulus * config.radius
        self.floor = np.diag(np.repeat([LEAST, force], 3) ** 2)

    @staticmethod
    def _rows(config: MagnetPadConfig, presses: Presses, noise: float) -> Linearised:
        """Touches with their readings, and both a little further along, around and harder."""
        nodes, radius = nominal_choice(config).size[0], config.radius
        spots = np.column_stack(
            [presses.along / radius, presses.around, LOAD * np.log(presses.size)]
        )
        reach = cKDTree(spots).query(spots, k=[NEAR + 1])[0][:, 0]
        reach = np.clip(reach, 0.005, 0.3)[:, None]
        steps = (
            replace(presses, along=presses.along + STEP * radius),
            presses.turned(STEP),
            replace(presses, force=presses.force * (1 + STEP / LOAD)),
        )
        level = change_of_field(config, presses, nodes).reshape(len(reach), -1)
        one = np.ones(len(level))
        start = np.column_stack([presses.places(radius), presses.force, one, level])
        rises = []
        for step in steps:
            change = change_of_field(config, step, nodes).reshape(len(reach), -1)
            moved = np.column_stack([step.places(radius), step.force, one, change])
            rises.append(moved - start)
        leads = np.stack(rises, axis=-1) / STEP * reach[:, None]
        sigma = np.sqrt(noise**2 + RIGHT**2 * (level**2).mean(axis=1))
        share = np.full(len(level), 1 / len(level))
        return Linearised(level, leads[:, READING:], start, leads, sigma, share)

    def estimate(self, x: Array, rest: Bools) -> Columns:
        """Place, force and cell of changes of field x (s, d) (T); NaN and -1 where x is not."""
        there = np.asarray(np.isfinite(x).all(axis=1))
        mean, cov = np.full((len(x), 6), np.nan), np.full((len(x), 6, 6), np.nan)
        cell, share = np.full(len(x), -1), np.full(len(x), np.nan)
        stray = np.full((len(x), 3), np.nan)
        if there.any():
            told = self.telling(x[there], self.cells)
            spread = UNSURE**2 * told.cov + self.floor
            stiffer = STIFF * told.mean[:, 3:]
            spread[:, 3:, 3:] += stiffer[:, :, None] * stiffer[:, None, :]
            mean[there], cov[there] = told.mean, spread
            cell[there], share[there] = told.shares.argmax(axis=1), told.shares.max(axis=1)
            stray[there] = told.stray
            if self.telling.part is not None and (rest & there).any():
                stray[rest & there] = self.telling.resting_field(x[rest & there])
        known = {
            'position': mean[:, :3], 'position_cov': cov[:, :3, :3],
            'force': mean[:, 3:], 'force_cov': cov[:, 3:, 3:],
            'cell': cell, 'cell_probability': share,
        }  # fmt: skip
        return known if self.telling.part is None else {**known, 'stray_field': stray}
