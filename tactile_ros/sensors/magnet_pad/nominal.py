"""The pad as its config tells it: magnets carried by an incompressible body under touches.

Touches of all places and loads, normal to the surface or leaning, by tips of several sizes, on a
body that its base holds or not: what is not known of a touch is spread over the table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.dipoles import in_chip_axes
from tactile_ros.physics.elastomer import disc_press
from tactile_ros.sensors.magnet_pad.fidelity import block_model, blocks_of
from tactile_ros.types import Array

if TYPE_CHECKING:
    from tactile_ros.physics.fidelity import Choice
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig

SEED = 20191112
LOADS = (0.01, 0.6)  # of shear modulus times the square of the radius
TIPS = (0.05, 0.7)  # radius of a tip over that of the cylinder
LEAN = 0.5  # rad, largest of a leaning touch
UPRIGHT = 0.75  # share of touches that do not lean
BLOCK = 2048
MEASURED = 200  # touches by which a model of the blocks is chosen
NOISE, LEAST_NOISE = 4e-6, 1e-7  # T, where nothing tells it; below it nothing is gained


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

    def rows(self, part: slice) -> Presses:
        """Some of them."""
        return Presses(
            self.along[part], self.around[part], self.force[part], self.tip[part], self.bond[part]
        )

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


def spread_presses(config: MagnetPadConfig, count: int, seed: int = SEED) -> Presses:
    """Touches of all kinds over the whole pad, the same for the same config and seed."""
    rng = np.random.default_rng(seed)
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
        moved, turned = movement(config, presses.rows(slice(i, i + BLOCK)))
        parts.append(blocks.field(config.positions, moved, turned) - level)
    return in_chip_axes(np.concatenate(parts), config.rotations)


def field_choice(config: MagnetPadConfig, presses: Presses, noise: float) -> Choice:
    """Model of the blocks that touches need at a noise (T), by some of them."""
    some = slice(0, None, max(len(presses.along) // MEASURED, 1))
    moved, turned = movement(config, presses.rows(some))
    return block_model(config, max(noise, LEAST_NOISE), moved, turned)


def nominal_choice(config: MagnetPadConfig) -> Choice:
    """Model of the blocks that the nominal touches need at the config's noise."""
    noise = NOISE if config.noise is None else float(np.min(config.noise))
    return field_choice(config, spread_presses(config, MEASURED), noise)


def movement(config: MagnetPadConfig, presses: Presses) -> tuple[Array, Array]:
    """Shifts (m) and turns (rad) of the magnets under touches, shape (s, m, 3) both."""
    places, normals = presses.places(config.radius), presses.normals

    def displacement(points: Array) -> Array:
        wide = np.broadcast_to(points, (len(places), *points.shape))
        return disc_press(
            wide, places, normals, -presses.force, presses.tip, config.shear_modulus, presses.bond
        )

    return blocks_of(config, 1).carried(displacement)
