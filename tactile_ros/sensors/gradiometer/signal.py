"""A simple signal of the gradiometer: the disc on three springs, as exact as its noise needs.

It is no model of [3] to estimate with: the disc's tilt, the elastomer's coupling and temperature
are left out. Force moves the disc by force over stiffness, so that full scale is the
depth (1.5 mm) and a fifth of it the radius (1.1 mm) to which [3] calibrated; the contact is on the
elastomer's top, which gives the two torques.

The scenes of [3] play in it: presses shear; a magnet passes by every 12 s, each time
turned another way; from the twelfth second on the chip warms by 8 degrees and cools again, and the
disc follows with a delay and loses remanence. Truth tells the stray field where it is uniform.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.enrolment import Programme, Touches, growing_loads, playing, recorded
from tactile_ros.physics.dipoles import dipole_field, in_chip_axes
from tactile_ros.physics.disc_models import exact_disc
from tactile_ros.physics.fidelity import Model, region
from tactile_ros.physics.temperature import (
    CALIBRATED_AT,
    following,
    hall_sensitivity,
    remanence_at,
)
from tactile_ros.sensors.gradiometer.config import layout
from tactile_ros.sensors.gradiometer.fidelity import disc_of, twin_model

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.enrolment import Truth
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.types import Array, Recording

NOISE = 9e-6  # T, of one reading of a pixel [3]
DEPTH, RADIUS = 1.5e-3, 1.1e-3
SHEAR_SHARE = 0.2
ELASTOMER_ABOVE = 0.5e-3
AXES = [0, 2]  # Bx, Bz
PRESSES = 30
STATES = 50
PASSES_S = 12.0  # from one magnet to the next
FIRST_PASS_S = 10.6
PASS_S = 4.8
SPEED = 0.25  # m/s, along x
ASIDE = (0.1, 0.08)  # m, in y and z
MOMENT = 10.0  # A m2, of a magnet of 2 cm
TURNS = np.array([[1.0, 0.3, 1.0], [0.3, 1.0, -1.0], [1.0, -1.0, 0.3]])
WARMS_S = (12.0, 36.0)
WARMER = 8.0  # degrees
LAG_S = 4.0  # where the config leaves it open


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
    """Presses to 0.6 of full scale, every other one with shear in a random direction."""
    rng = np.random.default_rng(seed)
    load = growing_loads(count, 0.05 * config.full_scale, 0.6 * config.full_scale, rng)
    angle, share = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, 0.2, count)
    shear = load * share
    forces = np.column_stack([shear * np.cos(angle), shear * np.sin(angle), load])
    top = config.gap + config.disc_height + ELASTOMER_ABOVE
    return Programme(np.tile([0.0, 0.0, top], (count, 1)), forces)


def passing_magnet(config: GradiometerConfig, times: Array) -> tuple[Array, Array]:
    """Field of the magnets that pass by, at times (s,) (s).

    Returns
    -------
    field : ndarray, shape (s, t, 3)
        At the pixels (T); 0 while none passes.
    uniform : ndarray, shape (s, 3)
        Its mean (T); NaN where pixels differ from it by more than their noise.
    """
    number = np.maximum(np.rint((times - FIRST_PASS_S) / PASSES_S), 0).astype(np.int64)
    since = times - FIRST_PASS_S - PASSES_S * number
    turns = MOMENT * TURNS / np.linalg.norm(TURNS, axis=1)[:, None]
    moments = np.where(np.abs(since) < PASS_S / 2, 1.0, 0.0)[:, None] * turns[number % len(turns)]
    places = np.column_stack([SPEED * since, *(np.full(len(times), x) for x in ASIDE)])
    points = np.broadcast_to(config.positions, (len(times), *config.positions.shape))
    field = dipole_field(points, places[:, None], moments[:, None])
    mean = field.mean(axis=1)
    even = np.abs(field - mean[:, None]).max(axis=(1, 2)) < NOISE
    return field, np.where(even[:, None], mean, np.nan)


def warm_up(config: GradiometerConfig, times: Array) -> tuple[Array, Array]:
    """Temperatures (s,) of chip and disc (degrees Celsius) at rising times (s,) (s)."""
    phase = np.clip((times - WARMS_S[0]) / (WARMS_S[1] - WARMS_S[0]), 0.0, 1.0)
    chip = CALIBRATED_AT + WARMER / 2 * (1 - np.cos(2 * np.pi * phase))
    return chip, following(chip, np.diff(times, prepend=0.0), config.thermal_lag or LAG_S)


def presses(
    config: GradiometerConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: force, torque and stray field.

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
    plain = recorded(
        layout(config),
        programme(config, seed, count),
        lambda touches: reading(config, touches, model),
        lambda touches: truth(config, touches),
        0.0,
        seed,
    )
    times = np.arange(len(plain)) / plain.layout.rate_hz
    chip, disc = warm_up(config, times)
    field, uniform = passing_magnet(config, times)
    weaker = remanence_at(disc, 1.0) / remanence_at(np.array(CALIBRATED_AT), 1.0)
    seen = plain.values * weaker[:, None, None] + in_chip_axes(field, config.rotations)[..., AXES]
    raised = hall_sensitivity(chip, config.sensitivity)[:, None, None] * seen
    sigma = NOISE if noise is None else noise
    return replace(
        plain,
        values=raised + sigma * np.random.default_rng(seed).normal(size=seen.shape),
        temperature_c=np.repeat(chip[:, None], len(config.positions), axis=1),
        truth={**plain.truth, 'stray_field': uniform},
    )


def signal(config: GradiometerConfig, seed: int = 0) -> Callable[[float], Array]:
    """The readings of `presses` without noise, over time (s), again and again."""
    return playing(presses(config, seed, noise=0.0))


def temperature(config: GradiometerConfig) -> Callable[[float], Array]:
    """Temperatures (t,) of the chips in `presses` (degrees Celsius), over time (s)."""
    rate_hz, pixels = config.rate_hz, len(config.positions)
    count = round(programme(config, 0, PRESSES).duration_s * rate_hz)
    chip, _ = warm_up(config, np.arange(count) / rate_hz)
    return lambda t: np.full(pixels, chip[round(t * rate_hz) % count])
