"""A simple signal of the magnet pad: magnets that give way to a press nearby.

It is no model of [2] to estimate with: magnets move against the force by a share that falls with
their distance from the contact as a Gaussian; the body's mechanics and the magnets' rotation are
left out. Fields are as exact as the noise needs. Forces are those of [2], 1.5..10 N, along the
surface's normal or inside the cone of 45 degrees about it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.dipoles import in_chip_axes
from tactile_ros.physics.magnet_blocks import EXACT
from tactile_ros.presses import REST_S, Programme, Touches, growing_loads, playing, recorded
from tactile_ros.sensors.magnet_pad.config import layout
from tactile_ros.sensors.magnet_pad.fidelity import block_model, blocks_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.physics.magnet_blocks import Blocks
    from tactile_ros.presses import Truth
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array, Recording

NOISE = 4e-6  # T
WIDTH = 0.6  # of the dent, in radii
STIFFNESS = 2.4  # of the body, in shear moduli times radius: about a flat punch of 6 mm
PLAY = 0.3  # of a place about its cell's centre, in distances of cells
PRESSES = 60
MEASURED = 100


def movement(config: MagnetPadConfig, touches: Touches) -> Array:
    """Displacement (s, m, 3) (m) of the magnets."""
    away = config.magnet_positions - np.nan_to_num(touches.position)[:, None]
    share = np.exp(-0.5 * np.square(away / (WIDTH * config.radius)).sum(axis=2))
    stiffness = STIFFNESS * config.shear_modulus * config.radius
    return np.asarray(-share[..., None] * touches.force[:, None] / stiffness)


def blocks_for(config: MagnetPadConfig, programme: Programme, noise: float = NOISE) -> Blocks:
    """Magnets in the cheapest model that presses at their full load need."""
    begin = REST_S + programme.period_s * np.arange(len(programme.positions))
    held = begin + programme.rise_s + programme.hold_s / 2
    moved = movement(config, programme.at(held[:MEASURED]))
    return blocks_of(config, block_model(config, noise, moved, np.zeros_like(moved)).size[0])


def reading(config: MagnetPadConfig, touches: Touches, blocks: Blocks | None = None) -> Array:
    """Readings (s, t, 3) (T) of the magnets, exact or in a model, where a press has moved them."""
    moved = movement(config, touches)
    blocks = blocks_of(config, EXACT) if blocks is None else blocks
    field = blocks.field(config.positions, moved, np.zeros_like(moved))
    return in_chip_axes(field, config.rotations)


def truth(config: MagnetPadConfig, touches: Touches) -> Truth:
    """Place, nearest cell, force."""
    place = np.nan_to_num(touches.position)
    far = np.linalg.norm(place[:, None] - config.cells, axis=2)
    cell = np.where(touches.press >= 0, far.argmin(axis=1), -1)
    return {'position': touches.position, 'cell': cell, 'force': touches.force}


def programme(config: MagnetPadConfig, seed: int, count: int, cone: float = 0.0) -> Programme:
    """Presses in all cells in random order, along the normal or inside a cone (rad) about it."""
    rng = np.random.default_rng(seed)
    rounds = -(-count // len(config.cells))
    cell = np.concatenate([rng.permutation(len(config.cells)) for _ in range(rounds)])[:count]
    around = np.arctan2(config.cells[:, 2], config.cells[:, 1])
    step = config.length / max(len(np.unique(np.round(config.cells[:, 0], 6))), 1)
    x = config.cells[cell, 0] + PLAY * step * rng.uniform(-0.5, 0.5, count)
    angle = around[cell] + PLAY * 0.7 * rng.uniform(-0.5, 0.5, count)
    normal = np.column_stack([np.zeros(count), np.cos(angle), np.sin(angle)])
    across = rng.normal(size=(count, 3))
    across -= (across * normal).sum(axis=1, keepdims=True) * normal
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    lean = cone * rng.uniform(0, 1, (count, 1))
    force = growing_loads(count, 1.5, 10.0, rng)[rng.permutation(count), None]
    direction = np.cos(lean) * normal + np.sin(lean) * across
    return Programme(np.column_stack([x, config.radius * normal[:, 1:]]), force * direction)


def presses(
    config: MagnetPadConfig,
    seed: int = 0,
    count: int = PRESSES,
    noise: float | None = None,
    cone: float = 0.0,
) -> Recording:
    """Readings of `count` presses with their truth: position, cell and force.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the sensor.
    seed : int
        Of places, loads and noise.
    count : int
        Presses (n).
    noise : float or None
        Of a channel (T); None: that of the chips.
    cone : float
        Largest angle of the force to the surface's normal (rad); [2] has pi / 4.

    Returns
    -------
    Recording
        One stream that begins with a tare.
    """
    played = programme(config, seed, count, cone)
    blocks = blocks_for(config, played)
    return recorded(
        layout(config),
        played,
        lambda touches: reading(config, touches, blocks),
        lambda touches: truth(config, touches),
        NOISE if noise is None else noise,
        seed,
    )


def signal(config: MagnetPadConfig, seed: int = 0) -> Callable[[float], Array]:
    """The readings of `presses` without noise, over time (s), again and again."""
    return playing(presses(config, seed, noise=0.0))
