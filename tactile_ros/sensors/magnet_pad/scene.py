"""What a stray field and the magnets' temperature cost and buy in the place of a touch.

The scene is that of [2]: touches along the normal by a tip of a third of the radius, anywhere on
the pad, of 0.06 to 0.4 times its shear modulus and the square of its radius (1.5 to 10 N).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.fidelity import region
from tactile_ros.physics.scene_terms import Term, Worth, worth
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.sensors.magnet_pad.fidelity import blocks_of
from tactile_ros.sensors.magnet_pad.nominal import LEAST_NOISE, Presses, change_of_field

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array

LOADS, TIP, BOND = (0.06, 0.4), 0.3, 0.5
ALONG, AROUND = 0.45, 0.5  # of the length; rad from the base
STRAY = 0.3e-3  # T, of one component of stray fields in a scene that has them
WARM = 5.0  # degrees from the temperature of the tare
COUNT = 60


def touches_of(config: MagnetPadConfig, count: int = COUNT) -> Array:
    """Touches of the scene: along (m), around (rad), force (N), shape (s, 3)."""
    reach, stiff = ALONG * config.length, config.shear_modulus * config.radius**2
    low = np.array([-reach, AROUND, LOADS[0] * stiff])
    return region(low, np.array([reach, np.pi - AROUND, LOADS[1] * stiff]), count)


def by_tip(config: MagnetPadConfig, place: Array, force: Array) -> Presses:
    """Touches at places (s, 3) (m) on the surface, with forces (s, 3) (N), by the scene's tip."""
    around, same = np.arctan2(place[:, 2], place[:, 1]), np.ones(len(place))
    return Presses(place[:, 0], around, force, TIP * config.radius * same, BOND * same)


def upright(config: MagnetPadConfig, touches: Array) -> Presses:
    """Touches (s, 3) of the scene."""
    along, around, force = touches.T
    normal = np.column_stack([0 * along, np.cos(around), np.sin(around)])
    place = config.radius * normal + along[:, None] * np.eye(3)[0]
    return by_tip(config, place, force[:, None] * normal)


def readings_of(config: MagnetPadConfig, touches: Array) -> Array:
    """Changes (s, n) (T) of touches (s, 3)."""
    return change_of_field(config, upright(config, touches)).reshape(len(touches), -1)


def terms(config: MagnetPadConfig, noise: float, count: int = COUNT) -> tuple[Worth, ...]:
    """What each term costs and buys, in place (m), at a noise (T)."""
    touches = touches_of(config, count)[2**3 :]
    radius, load = config.radius, float(touches[:, 2].mean())
    steps = np.array([1e-4 * radius, 1e-4, 1e-3 * load])
    # around counts as an arc, so that both coordinates of the place are lengths
    units = np.array([1e-4 * radius, 1e-4 * radius, 1e-3])
    slopes = [
        (readings_of(config, touches + step) - readings_of(config, touches - step)) / (2 * unit)
        for step, unit in zip(np.diag(steps), units, strict=True)
    ]
    taxels = len(config.positions)
    turns = np.tile(np.eye(3), (taxels, 1, 1)) if config.rotations is None else config.rotations
    even = np.concatenate([turn.T for turn in turns])
    still = np.zeros((1, len(config.magnet_positions), 3))
    level = blocks_of(config, 2).field(config.positions, still, still)
    level = np.einsum('tji,stj->sti', turns, level).reshape(1, -1)
    warm = REMANENCE_SLOPE * (level + readings_of(config, touches))
    return worth(
        np.stack(slopes, axis=-1),
        max(noise, LEAST_NOISE),
        (
            Term('uniform stray field', np.broadcast_to(even, (len(touches), *even.shape)), STRAY),
            Term('temperature of the magnets', warm[..., None], WARM),
        ),
        wanted=2,
    )
