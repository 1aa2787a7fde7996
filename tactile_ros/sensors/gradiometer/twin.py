# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The gradiometer behind a microcontroller on a serial port, real or simulated.

Force moves the disc by force over stiffness, so that full scale is the depth (1.5 mm) and a fifth
of it the radius (1.1 mm) to which [3] calibrated; the contact is on the elastomer's top, which
gives the two torques. Presses shear; a magnet passes by every 12 s, each time turned another way;
from the twelfth second on the chip warms by 8 degrees and cools again, and the disc follows with a
delay and loses remanence. Truth tells the stray field where it is uniform.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactile_ros.devices.connections import FramedConnection
from tactile_ros.devices.framed_protocol import Payload, gradiometer
from tactile_ros.enrolment import Programme, Touches, Truth, growing_loads, recorded
from tactile_ros.physics.fidelity import Choice, Term, TermGain, choose, region, term_gains
from tactile_ros.physics.field_table import SHAPES, reach_under, table_disc_model
from tactile_ros.physics.magnetics import dipole_field, exact_disc, in_chip_axes
from tactile_ros.physics.temperature import (
    CALIBRATED_AT,
    EXPANSION,
    REMANENCE_SLOPE,
    following,
    hall_sensitivity,
    remanence_at,
)
from tactile_ros.sensors.gradiometer.config import GradiometerConfig, layout
from tactile_ros.types import Array, Layout, Recording
from tactile_ros.types.config_fields import number

FIDELITY_ASIDE, SINKS, RISES = 0.45, 0.6, 0.05  # of the gap [3]
LEANS = 0.1  # rad
COUNT = 400
STRAY = 1e-3  # T, of one component of stray fields in a scene that has them
WARM = 15.0  # degrees, by which the magnet differs from the chip or from calibration
STEP = 1e-6
LEAST_NOISE = 1e-8  # T, below which nothing is gained


def disc_of(config: GradiometerConfig) -> tuple[float, float, float]:
    """Diameter, height (m) and remanence (T)."""
    return config.disc_diameter, config.disc_height, config.remanence


def states_of(config: GradiometerConfig, count: int = COUNT, seed: int = 0) -> Array:
    """Places (m) and tilts (rad) of the disc in the scene, shape (s, 5)."""
    gap = config.gap
    rest = np.array([0.0, 0.0, gap + config.disc_height / 2, 0.0, 0.0])
    low = np.array([-FIDELITY_ASIDE * gap, -FIDELITY_ASIDE * gap, -SINKS * gap, -LEANS, -LEANS])
    return region(rest + low, rest + low * np.array([-1, -1, -RISES / SINKS, -1, -1]), count, seed)


def field_model(config: GradiometerConfig, noise: float) -> Choice:
    """The smallest cubic table that an inversion needs at a noise (T); the finest, if none is."""
    pixels, disc = config.positions, disc_of(config)
    reach = reach_under(pixels, config.gap, config.disc_height)
    tables = [table_disc_model(pixels, disc, reach, shape) for shape in SHAPES]
    exact = exact_disc(pixels, disc)
    choice = choose(tables, exact, states_of(config), max(noise, LEAST_NOISE))
    if choice.size:
        return choice
    finest = max(choice.rated, key=lambda rated: rated.numbers)
    return replace(choice, name=finest.name, size=finest.size)


def terms(config: GradiometerConfig, noise: float, count: int = 100) -> tuple[TermGain, ...]:
    """Cost and worth of each term of a scene, in place of the disc (m), at a noise (T)."""
    states = states_of(config, count)[2**5 :]
    field = exact_disc(config.positions, disc_of(config)).readings

    def readings(at: Array) -> Array:
        return field(at)[..., [0, 2]].reshape(len(at), -1)

    def slope(axis: int, step: float) -> Array:
        move = step * np.eye(5)[axis]
        return (readings(states + move) - readings(states - move)) / (2 * step)

    level = readings(states)
    place = np.stack([slope(axis, STEP) for axis in range(3)], axis=-1)
    tilt = np.stack([slope(axis, 1e-4) for axis in (3, 4)], axis=-1)
    even = np.tile(np.array([[1.0, 0.0], [0.0, 1.0]]), (len(config.positions), 1))
    uniform = np.broadcast_to(even, (len(states), *even.shape))
    thick = config.gap * EXPANSION * place[..., 2]
    warm = (REMANENCE_SLOPE * level + thick)[..., None]
    found = (
        Term('uniform stray field', uniform, STRAY),
        Term('temperature of the magnet', warm, WARM),
        Term('tilt of its own', tilt, 0.03),
    )
    return term_gains(place, noise, found)


NOISE = 9e-6  # T, of one reading of a pixel [3]
DEPTH, RADIUS = 1.5e-3, 1.1e-3
SHEAR_SHARE = 0.2
ELASTOMER_ABOVE = 0.5e-3
AXES = [0, 2]  # Bx, Bz
PRESSES = 30
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


def reading(config: GradiometerConfig, touches: Touches) -> Array:
    """Readings (s, t, 2) (T) of the disc where the force has moved it."""
    rest = np.array([0.0, 0.0, config.gap + config.disc_height / 2])
    shear = SHEAR_SHARE * config.full_scale / RADIUS
    stiffness = np.array([shear, shear, config.full_scale / DEPTH])
    places = rest - touches.force / stiffness
    states = np.concatenate([places, np.zeros((len(places), 2))], axis=1)
    field = exact_disc(config.positions, disc_of(config)).readings(states)
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
    """Field (s, t, 3) (T) of the magnets that pass by, at times (s,) (s), and its mean (s, 3).

    The mean is NaN where pixels differ from it by more than their noise.
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


def temperature_profile(config: GradiometerConfig, times: Array) -> tuple[Array, Array]:
    """Temperatures (s,) of chip and disc (degrees Celsius) at rising times (s,) (s)."""
    phase = np.clip((times - WARMS_S[0]) / (WARMS_S[1] - WARMS_S[0]), 0.0, 1.0)
    chip = CALIBRATED_AT + WARMER / 2 * (1 - np.cos(2 * np.pi * phase))
    return chip, following(chip, np.diff(times, prepend=0.0), config.thermal_lag or LAG_S)


def presses(
    config: GradiometerConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: force, torque and stray field.

    One stream that begins with a tare. `noise` is of a channel (T); None: that of [3].
    """
    plain = recorded(
        layout(config),
        programme(config, seed, count),
        lambda touches: reading(config, touches),
        lambda touches: truth(config, touches),
        0.0,
        seed,
    )
    times = np.arange(len(plain)) / plain.layout.rate_hz
    chip, disc = temperature_profile(config, times)
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


def temperature(config: GradiometerConfig) -> Callable[[float], Array]:
    """Temperatures (t,) of the chips in `presses` (degrees Celsius), over time (s)."""
    rate_hz, pixels = config.rate_hz, len(config.positions)
    count = round(programme(config, 0, PRESSES).duration_s * rate_hz)
    chip, _ = temperature_profile(config, np.arange(count) / rate_hz)
    return lambda t: np.full(pixels, chip[round(t * rate_hz) % count])


@dataclass(frozen=True)
class GradiometerConnection(FramedConnection):
    """A microcontroller that sends eight counts and the chip's temperature in frames."""

    tesla_per_count: float = number(2.5e-6, 'step of a reading', 'T', 1e-9, 1e-3)

    def payload(self, layout: Layout) -> Payload:
        """Eight counts and the temperature."""
        return gradiometer()

    def scale(self) -> float:
        """Step of a reading (T)."""
        return self.tesla_per_count
