"""Which model of the disc's field this gradiometer needs, and what terms of a scene are worth.

The scene is that of [3]: a disc that sinks by 0.6 of its gap, is pushed aside by 0.45 of it and
leans. Uniform stray fields and the magnet's own temperature are terms that a scene may do without.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.disc_models import (
    RINGS,
    SHAPES,
    dipole_disc,
    exact_disc,
    table_disc_model,
    table_reach,
)
from tactile_ros.physics.disc_table import reach_under
from tactile_ros.physics.fidelity import Choice, Model, choose, region
from tactile_ros.physics.scene_terms import Term, Worth, worth
from tactile_ros.physics.temperature import EXPANSION, REMANENCE_SLOPE

if TYPE_CHECKING:
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.types import Array

ASIDE, SINKS, RISES = 0.45, 0.6, 0.05  # of the gap [3]
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
    low = np.array([-ASIDE * gap, -ASIDE * gap, -SINKS * gap, -LEANS, -LEANS])
    return region(rest + low, rest + low * np.array([-1, -1, -RISES / SINKS, -1, -1]), count, seed)


def tables(config: GradiometerConfig, degree: int = 3) -> list[Model]:
    """Tables of growing shapes with linear or cubic interpolation."""
    reach = reach_under(config.positions, config.gap, config.disc_height)
    return [
        table_disc_model(config.positions, disc_of(config), reach, shape, degree)
        for shape in SHAPES
    ]


def field_model(config: GradiometerConfig, noise: float) -> Choice:
    """The smallest cubic table that an inversion needs at a noise (T); the finest, if none is."""
    exact = exact_disc(config.positions, disc_of(config))
    choice = choose(tables(config), exact, states_of(config), max(noise, LEAST_NOISE))
    if choice.size:
        return choice
    finest = max(choice.rated, key=lambda rated: rated.numbers)
    return replace(choice, name=finest.name, size=finest.size)


def twin_model(config: GradiometerConfig, states: Array, noise: float) -> Model:
    """The cheapest model of the disc at places and tilts (s, 5), for a twin of a noise (T)."""
    disc, pixels = disc_of(config), config.positions
    exact = exact_disc(pixels, disc)
    reach = table_reach(pixels, states)
    models = [dipole_disc(pixels, disc, rings) for rings in RINGS]
    models += [table_disc_model(pixels, disc, reach, shape) for shape in SHAPES]
    name = choose(models, exact, states, noise).name
    return next((model for model in models if model.name == name), exact)


def every_model(config: GradiometerConfig, noise: float) -> tuple[Choice, list[Model]]:
    """Choice among all models of the disc at a noise (T), all of them measured; and the models."""
    disc, pixels = disc_of(config), config.positions
    models = [dipole_disc(pixels, disc, rings) for rings in RINGS]
    models += tables(config, 1) + tables(config)
    exact = exact_disc(pixels, disc)
    return choose(models, exact, states_of(config), noise, every=True), [*models, exact]


def terms(config: GradiometerConfig, noise: float, count: int = 100) -> tuple[Worth, ...]:
    """What each term of a scene costs and buys, in place of the disc (m), at a noise (T)."""
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
    return worth(
        place,
        noise,
        (
            Term('uniform stray field', uniform, STRAY),
            Term('temperature of the magnet', warm, WARM),
            Term('tilt of its own', tilt, 0.03),
        ),
    )
