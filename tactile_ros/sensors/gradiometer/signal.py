"""A simple signal of the gradiometer: the disc on three springs, as exact as its noise needs.

It is no model of [3] to estimate with: the disc's tilt, the elastomer's coupling and temperature
are left out. Force moves the disc by force over stiffness, so that full scale is the
depth (1.5 mm) and a fifth of it the radius (1.1 mm) to which [3] calibrated; the contact is on the
elastomer's top, which gives the two torques.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.dipoles import in_chip_axes
from tactile_ros.physics.disc_models import exact_disc
from tactile_ros.physics.fidelity import Model, region
from tactile_ros.presses import Programme, Touches, growing_loads, playing, recorded
from tactile_ros.sensors.gradiometer.config import layout
from tactile_ros.sensors.gradiometer.fidelity import disc_of, twin_model

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.presses import Truth
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.types import Array, Recording

NOISE = 9e-6  # T, of one reading of a pixel [3]
DEPTH, RADIUS = 1.5e-3, 1.1e-3
SHEAR_SHARE = 0.2
ELASTOMER_ABOVE = 0.5e-3
AXES = [0, 2]  # Bx, Bz
PRESSES = 30
STATES = 50


def disc_model(config: GradiometerConfig, noise: float = NOISE) -> Model:
    """The cheapest model of the disc wherever full scale may move it."""
    reach = np.array([RADIUS, RADIUS, DEPTH, 0.0, 0.0])
    rest = np.array([0.0, 0.0, config.gap + config.disc_height / 2, 0.0, 0.0])
    # upward the disc comes from its rest, and no farther
    top = rest + reach * np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    return twin_model(config, region(rest - reach, top, STATES), noise)


def reading(config: GradiometerConfig, touches: Touches, model: Model | None = None) -> Array:
    """Readings (s, t, 2) (T) of the disc, exact or in a model, where the force has moved it."""
    model = exact_disc(config.positions, disc_of(config)) if model is None else model
    rest = np.array([0.0, 0.0, config.gap + config.disc_height / 2])
    shear = SHEAR_SHARE * config.full_scale / RADIUS
    stiffness = np.array([shear, shear, config.full_scale / DEPTH])
    places = rest - touches.force / stiffness
    field = model.readings(np.concatenate([places, np.zeros((len(places), 2))], axis=1))
    return in_chip_axes(field, config.rotations)[..., AXES]


def truth(config: GradiometerConfig, touches: Touches) -> Truth:
    """Force and two torques; the third cannot be seen."""
    fx, fy, _ = touches.force.T
    height = config.gap + config.disc_height + ELASTOMER_ABOVE
    torque = np.column_stack([-height * fy, height * fx, np.full(len(fx), np.nan)])
    return {'force': touches.force, 'torque': torque}


def programme(config: GradiometerConfig, seed: int, count: int) -> Programme:
    """Presses to 0.6 of full scale with shear in random directions."""
    rng = np.random.default_rng(seed)
    load = growing_loads(count, 0.05 * config.full_scale, 0.6 * config.full_scale, rng)
    angle, share = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, 0.2, count)
    shear = load * share
    forces = np.column_stack([shear * np.cos(angle), shear * np.sin(angle), load])
    top = config.gap + config.disc_height + ELASTOMER_ABOVE
    return Programme(np.tile([0.0, 0.0, top], (count, 1)), forces)


def presses(
    config: GradiometerConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: force and torque.

    Parameters
    ----------
    config : GradiometerConfig
        Of the sensor.
    seed : int
        Of places, loads and noise.
    count : int
        Presses (n).
    noise : float or None
        Of a channel (T); None: that of the pixels of [3].

    Returns
    -------
    Recording
        One stream that begins with a tare.
    """
    model = disc_model(config)
    return recorded(
        layout(config),
        programme(config, seed, count),
        lambda touches: reading(config, touches, model),
        lambda touches: truth(config, touches),
        NOISE if noise is None else noise,
        seed,
    )


def signal(config: GradiometerConfig, seed: int = 0) -> Callable[[float], Array]:
    """The readings of `presses` without noise, over time (s), again and again."""
    return playing(presses(config, seed, noise=0.0))
