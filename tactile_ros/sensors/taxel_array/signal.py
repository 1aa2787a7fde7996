"""A simple signal of a taxel array: a Gaussian footprint, and a gain of its own for every taxel.

It is no model of [4] to estimate with: drift, hysteresis and the area law are left out. The taxels
share the load by the footprint; output rises and levels off with force, and gains differ by up to
55 % of the least, as [4] found. Where the config has objects they are placed and turned instead,
and share their load by counted points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.enrolment import Programme, Touches, growing_loads, playing, recorded
from tactile_ros.sensors.taxel_array.config import layout
from tactile_ros.sensors.taxel_array.placed_parts import Placing

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.enrolment import Truth
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Recording

NOISE = 5e-4  # half a step of 10 bits
FOOTPRINT = 0.6  # in edges of a mean taxel
GAIN_SPREAD = 0.55
OF_THIS_ARRAY = 4  # gains belong to the array, not to the presses
PRESSES = 40


def gains(taxels: int) -> Array:
    """Sensitivities (t,) of the taxels of the one array that is simulated."""
    spread = np.random.default_rng(OF_THIS_ARRAY).uniform(0, GAIN_SPREAD, taxels)
    return (1 + spread) / (1 + GAIN_SPREAD)


def taxel_forces(config: TaxelArrayConfig, touches: Touches) -> Array:
    """Load of every taxel under a Gaussian footprint, shape (s, t) (N)."""
    away = config.positions[:, :2] - np.nan_to_num(touches.position[:, None, :2])
    width = FOOTPRINT * np.sqrt(config.areas.mean())
    near = config.areas * np.exp(-0.5 * np.square(away / width).sum(axis=2))
    share = near / np.maximum(near.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    forces: Array = np.maximum(share * touches.force[:, 2:], 0.0)
    return forces


def reading(config: TaxelArrayConfig, touches: Touches) -> Array:
    """Readings (s, t, 1), fractions of the converter's range, under footprints."""
    return outputs(config, taxel_forces(config, touches))


def outputs(config: TaxelArrayConfig, force: Array) -> Array:
    """Readings (s, t, 1), fractions of the converter's range, of loads (s, t) (N)."""
    half = config.force_range.mean()
    output: Array = gains(len(config.positions)) * force / (force + half)
    return output[..., None]


def truth(touches: Touches, load: Array, placing: Placing | None) -> Truth:
    """Place, total force (only its z is seen), force of every taxel, and which object lies how."""
    force = touches.force.copy()
    force[:, :2] = np.nan
    known: Truth = {'position': touches.position, 'force': force, 'taxel_force': load}
    return known if placing is None else {**known, **placing.truth(touches)}


def programme(config: TaxelArrayConfig, seed: int, count: int) -> Programme:
    """Presses near random taxels, up to half of a taxel's range."""
    rng = np.random.default_rng(seed)
    taxel = rng.integers(len(config.positions), size=count)
    play = np.sqrt(config.areas[taxel])[:, None] * rng.uniform(-0.4, 0.4, (count, 2))
    places = config.positions[taxel] + np.column_stack([play, np.zeros(count)])
    low, high = config.force_range
    load = growing_loads(count, low + 0.05 * (high - low), low + 0.5 * (high - low), rng)
    return Programme(places, load[:, None] * np.array([0.0, 0.0, 1.0]))


def presses(
    config: TaxelArrayConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: position, force and taxel_force.

    Parameters
    ----------
    config : TaxelArrayConfig
        Of the sensor.
    seed : int
        Of places, loads and noise.
    count : int
        Presses (n); of objects where the config has some.
    noise : float or None
        Of a channel (fraction); None: half a step of the converter.

    Returns
    -------
    Recording
        One stream that begins with a tare.
    """
    placing = Placing.drawn(config, seed, count) if config.objects else None
    plan = programme(config, seed, count) if placing is None else placing.programme

    def loads(touches: Touches) -> Array:
        return taxel_forces(config, touches) if placing is None else placing.loads(touches)

    return recorded(
        layout(config),
        plan,
        lambda touches: outputs(config, loads(touches)),
        lambda touches: truth(touches, loads(touches), placing),
        NOISE if noise is None else noise,
        seed,
        (0.0, 1.0),
    )


def signal(config: TaxelArrayConfig, seed: int = 0) -> Callable[[float], Array]:
    """The readings of `presses` without noise, over time (s), again and again."""
    return playing(presses(config, seed, noise=0.0))
