# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The magnet pad on an I2C bus or on a serial port, real or simulated.

A tip of a third of the radius presses a body that its base holds half (`nominal`), which carries
and turns the blocks. Forces are those of [2], 1.5..10 N, along the surface's normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.devices.connections import ChipConnection
from tactile_ros.enrolment import Programme, Touches, Truth, growing_loads, recorded
from tactile_ros.physics.magnetics import EXACT, in_chip_axes
from tactile_ros.sensors.magnet_pad.body_model import NOISE, blocks_of, movement, touches_at
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig, layout
from tactile_ros.types import Array, Recording

PLAY = 0.3  # of a place about its cell's centre, in distances of cells
PRESSES = 60


def carried(config: MagnetPadConfig, touches: Touches) -> tuple[Array, Array]:
    """Shifts (m) and turns (rad) of the magnets, shape (s, m, 3) both."""
    count = len(config.magnet_positions)
    moved, turned = np.zeros((2, len(touches.press), count, 3))
    rows = np.flatnonzero(touches.press >= 0)
    # the body is linear: a press is computed once, whatever its load
    _, first, which = np.unique(touches.press[rows], return_index=True, return_inverse=True)
    first, share = rows[first], touches.share[rows, None, None]
    full = touches.force[first] / touches.share[first, None]
    shift, turn = movement(config, touches_at(touches.position[first], full))
    moved[rows], turned[rows] = share * shift[which], share * turn[which]
    return moved, turned


def reading(config: MagnetPadConfig, touches: Touches) -> Array:
    """Readings (s, t, 3) (T) of the magnets where a press has moved them."""
    field = blocks_of(config, EXACT).field(config.positions, *carried(config, touches))
    return in_chip_axes(field, config.rotations)


def truth(config: MagnetPadConfig, touches: Touches) -> Truth:
    """Place, nearest cell, force."""
    place = np.nan_to_num(touches.position)
    far = np.linalg.norm(place[:, None] - config.cells, axis=2)
    cell = np.where(touches.press >= 0, far.argmin(axis=1), -1)
    return {'position': touches.position, 'cell': cell, 'force': touches.force}


def programme(config: MagnetPadConfig, seed: int, count: int) -> Programme:
    """Presses in all cells in random order, along the surface's normal."""
    rng = np.random.default_rng(seed)
    rounds = -(-count // len(config.cells))
    cell = np.concatenate([rng.permutation(len(config.cells)) for _ in range(rounds)])[:count]
    around = np.arctan2(config.cells[:, 2], config.cells[:, 1])
    step = config.length / max(len(np.unique(np.round(config.cells[:, 0], 6))), 1)
    x = config.cells[cell, 0] + PLAY * step * rng.uniform(-0.5, 0.5, count)
    angle = around[cell] + PLAY * 0.7 * rng.uniform(-0.5, 0.5, count)
    normal = np.column_stack([np.zeros(count), np.cos(angle), np.sin(angle)])
    force = growing_loads(count, 1.5, 10.0, rng)[rng.permutation(count), None]
    return Programme(np.column_stack([x, config.radius * normal[:, 1:]]), force * normal)


def presses(
    config: MagnetPadConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: position, cell and force.

    One stream that begins with a tare. `noise` is of a channel (T); None: that of the chips.
    """
    return recorded(
        layout(config), programme(config, seed, count), lambda touches: reading(config, touches),
        lambda touches: truth(config, touches), NOISE if noise is None else noise, seed,
    )  # fmt: skip


@dataclass(frozen=True)
class MagnetPadConnection(ChipConnection):
    """Two chips on one I2C bus, 0x0C and 0x0D, or a microcontroller that reads them."""
