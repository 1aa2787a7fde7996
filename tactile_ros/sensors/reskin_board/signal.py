"""A simple signal of a board with a magnetic skin: one dipole above every chip that gives way.

It is no model of a skin to estimate with: each dipole moves against the force by a share that
falls with its distance from the contact as a Gaussian. Real recordings are shipped (`recordings`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.enrolment import Programme, Touches, growing_loads, playing, recorded
from tactile_ros.physics.dipoles import dipole_field, in_chip_axes
from tactile_ros.sensors.reskin_board.config import PITCH, layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.enrolment import Truth
    from tactile_ros.sensors.reskin_board.config import ReskinBoardConfig
    from tactile_ros.types import Array, Recording

NOISE = 1e-6  # T
ABOVE, MOMENT = 4e-3, 1e-3  # m, A m2
STIFFNESS = 10e3  # N / m
PRESSES = 40


def reading(config: ReskinBoardConfig, touches: Touches) -> Array:
    """Readings (s, t, 3) (T) of the dipoles where the press has moved them."""
    up = np.array([0.0, 0.0, 1.0])
    rest = config.positions + ABOVE * up
    away = (rest - np.nan_to_num(touches.position)[:, None])[..., :2]
    share = np.exp(-0.5 * np.square(away / PITCH).sum(axis=2))
    moved = rest - share[..., None] * touches.force[:, None] / STIFFNESS
    moments = np.broadcast_to(MOMENT * up, rest.shape)
    return in_chip_axes(dipole_field(config.positions, moved, moments), config.rotations)


def truth(touches: Touches) -> Truth:
    """Place and force."""
    return {'position': touches.position, 'force': touches.force}


def programme(config: ReskinBoardConfig, seed: int, count: int) -> Programme:
    """Presses of 1..8 N with some shear near random chips."""
    rng = np.random.default_rng(seed)
    chip = rng.integers(len(config.positions), size=count)
    play = np.column_stack([PITCH * rng.uniform(-0.6, 0.6, (count, 2)), np.full(count, ABOVE)])
    load = growing_loads(count, 1.0, 8.0, rng)
    shear = load[:, None] * rng.uniform(-0.2, 0.2, (count, 2))
    return Programme(config.positions[chip] + play, np.column_stack([shear, load]))


def presses(
    config: ReskinBoardConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: position and force.

    Parameters
    ----------
    config : ReskinBoardConfig
        Of the sensor.
    seed : int
        Of places, loads and noise.
    count : int
        Presses (n).
    noise : float or None
        Of a channel (T); None: that of the chips.

    Returns
    -------
    Recording
        One stream that begins with a tare.
    """
    return recorded(
        layout(config),
        programme(config, seed, count),
        lambda touches: reading(config, touches),
        truth,
        NOISE if noise is None else noise,
        seed,
    )


def signal(config: ReskinBoardConfig, seed: int = 0) -> Callable[[float], Array]:
    """The readings of `presses` without noise, over time (s), again and again."""
    return playing(presses(config, seed, noise=0.0))
