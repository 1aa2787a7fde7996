"""The two conditions of [2] on a pad, by its nominal mechanics.

Condition 1: at rest every chip reads more than it can measure at least and less than it
saturates at, and under the largest force none saturates ([2] asks it of one chip; a saturated
chip says nothing, so that it has to hold for all). Condition 2: the least force changes the field
at one chip at least, in norm, by more than it resolves, in every cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.physics.dipoles import in_chip_axes
from tactile_ros.physics.magnet_blocks import Blocks
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.magnet_pad.nominal import Presses, change_of_field
from tactile_ros.types import Array

LOADS = np.geomspace(0.02, 30.0, 28)  # N
HALF = 0.5  # share of the base's hold


@dataclass(frozen=True)
class Wanted:
    """What is asked of a pad.

    Attributes
    ----------
    force, largest : float
        Least and largest force along the normal (N).
    tip : float
        Radius of what touches (m).
    least_field, resolution : float
        Least field that a chip measures, and least change that it resolves (T).
    """

    force: float = 1.5
    largest: float = 10.0
    tip: float = 3e-3
    least_field: float = 10e-6
    resolution: float = 20e-6


def rest_field(config: MagnetPadConfig) -> Array:
    """Field (t, 3) (T) of the magnets at rest, in chip axes."""
    blocks = Blocks.along(
        config.magnet_positions, config.magnet_axes, config.magnet_size, config.remanence
    )
    still = np.zeros((1, len(config.magnet_positions), 3))
    return np.asarray(
        in_chip_axes(blocks.field(config.positions, still, still), config.rotations)[0]
    )


def presses_on(config: MagnetPadConfig, places: Array, loads: Array, tip: float) -> Presses:
    """Every load (l,) (N) along the normal at every place (n, 3) (m), place by place."""
    around = np.arctan2(places[:, 2], places[:, 1])
    turned = np.repeat(around, len(loads))
    normal = np.column_stack([0 * turned, np.cos(turned), np.sin(turned)])
    force = np.tile(loads, len(places))[:, None] * normal
    one = np.ones(len(turned))
    return Presses(np.repeat(places[:, 0], len(loads)), turned, force, tip * one, HALF * one)


def changes(config: MagnetPadConfig, wanted: Wanted, loads: Array) -> Array:
    """Change of the readings (n, l, t, 3) (T) in every cell under loads (l,) (N)."""
    seen = change_of_field(config, presses_on(config, config.cells, loads, wanted.tip))
    return seen.reshape(len(config.cells), len(loads), *seen.shape[1:])


def least_forces(config: MagnetPadConfig, wanted: Wanted) -> Array:
    """Least force (n,) (N) in each cell that some chip resolves; inf: none up to 30 N."""
    size = np.linalg.norm(changes(config, wanted, LOADS), axis=3).max(axis=2)
    size = np.maximum.accumulate(size, axis=1)
    found = np.full(len(size), np.inf)
    for i, row in enumerate(size):
        if row[-1] > wanted.resolution:
            rising = np.log(np.maximum(row, 1e-15)) + 1e-12 * np.arange(len(row))
            found[i] = np.exp(np.interp(np.log(wanted.resolution), rising, np.log(LOADS)))
    return found


def loudest(config: MagnetPadConfig, wanted: Wanted) -> Array:
    """Largest reading (t, 3) (T) of each channel, at rest or under the largest force."""
    rest = rest_field(config)
    loads = wanted.largest * np.array([0.0, 0.5, 1.0])
    return np.asarray(np.abs(rest + changes(config, wanted, loads)).max(axis=(0, 1)))


def saturation(config: MagnetPadConfig) -> Array:
    """Range (3,) of the channels (T)."""
    limit = np.inf if config.saturation is None else np.asarray(config.saturation, float)
    return np.broadcast_to(limit, (3,))


def quiet_enough(config: MagnetPadConfig, wanted: Wanted) -> Array:
    """Whether condition 1 holds for each chip (t,)."""
    rest = np.linalg.norm(rest_field(config), axis=1)
    clear = (loudest(config, wanted) < saturation(config)).all(axis=1)
    return np.asarray((rest > wanted.least_field) & clear)


def place_bound(config: MagnetPadConfig, wanted: Wanted, noise: float) -> float:
    """Mean standard deviation (m) of a place at the geometric mean of the loads.

    Notes
    -----
    Cramer and Rao with place and load unknown; infinite where readings do not tell them.
    """
    load = np.array([np.sqrt(wanted.force * wanted.largest)])
    step = 1e-5
    level = presses_on(config, config.cells, load, wanted.tip)
    around = np.arctan2(config.cells[:, 2], config.cells[:, 1]) + step / config.radius
    beside = config.cells.copy()
    beside[:, 1:] = config.radius * np.column_stack([np.cos(around), np.sin(around)])
    shifted = (
        presses_on(config, config.cells + np.array([step, 0, 0]), load, wanted.tip),
        presses_on(config, beside, load, wanted.tip),
        presses_on(config, config.cells, load * (1 + 1e-3), wanted.tip),
    )
    start = change_of_field(config, level)
    slopes = np.stack([change_of_field(config, one) - start for one in shifted], axis=-1)
    slopes = slopes.reshape(len(start), -1, 3) / (noise * np.array([step, step, 1e-3]))
    inner = np.matmul(slopes.transpose(0, 2, 1), slopes)
    known = np.linalg.cond(inner) < 1e16
    if not known.all():
        return np.inf
    cov = np.linalg.inv(inner)
    return float(np.sqrt(cov[:, 0, 0] + cov[:, 1, 1]).mean())
