# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Models of fields that benches and tests compare: dipoles for a disc, carpets for a sheet.

A pressed sheet is carried by a bonded layer under a flat punch, which is solved exactly, or by
simpler mechanics.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline, RegularGridInterpolator
from scipy.special import j0, j1

from tactile_ros.physics.elastomer import Layer, wave_numbers
from tactile_ros.physics.fidelity import (
    BLOCK_COST,
    DIPOLE_COST,
    Choice,
    Model,
    choose,
    rate,
    region,
)
from tactile_ros.physics.magnet_sheet import Sheet, carpet
from tactile_ros.physics.magnetics import (
    Disc,
    dipole_field,
    in_chip_axes,
    magnet_moment,
    on_pixels,
)
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
from tactile_ros.types import Array, Bools

RINGS = ((1, 1, 1), (2, 1, 4), (2, 2, 5), (3, 2, 6), (3, 4, 8), (4, 5, 12))
RADIUS, DEEPEST, FARTHEST = 6e-3, 0.6e-3, 10e-3
PLAY = 0.5e-3  # m, of the sheet at rest, to any side
LEVELS = 2
# pitch (m) and Gauss points along each side of a part
CARPETS = (
    (5e-3, 1), (2.5e-3, 1), (1.25e-3, 1), (0.625e-3, 1), (5e-3, 2), (2.5e-3, 2), (1.875e-3, 2),
    (1.25e-3, 2),
)  # fmt: skip
FINEST = (1.25e-3, 3)  # on twice as many levels
MARGIN = 1.5  # of the sheet, that a map of the layer is wide
DEEP = 10.0  # thicknesses of a layer that stands for a half-space
ROUNDING = 1e-12  # m
NODES = 400  # of the punch's density, which waves that are felt do not outrun
UNFELT = 36.0  # wave number times depth, beyond which nothing is felt
POINTS = 5  # Gauss points in half a wave
SPACING = 1e-4  # m, of the table over the distance from the axis


def disc_dipoles(
    diameter: float, height: float, rings: tuple[int, int, int]
) -> tuple[Array, Array]:
    """Dipoles on rings that stand for a disc: places (m, 3) (m) and shares (m,) of its moment.

    Rings stand at Gauss points of the height and of the square of the radius. `rings`: levels of
    the height, rings on each, dipoles on a ring; (1, 1, 1): one at the centre.
    """
    levels, count, around = rings
    z, wz = np.polynomial.legendre.leggauss(levels)
    square, wr = np.polynomial.legendre.leggauss(count)
    radius = np.sqrt((square + 1) / 2) * (diameter / 2 if around > 1 else 0.0)
    # rings are turned against each other, lest they share their corners
    turn = 2 * np.pi * (np.arange(around) + 0.5 * np.arange(levels * count)[:, None]) / around
    tall, wide = np.repeat(z * height / 2, count)[:, None], np.tile(radius, levels)[:, None]
    places = np.stack([wide * np.cos(turn), wide * np.sin(turn), tall + 0 * turn], axis=-1)
    weight = np.repeat(wz, count) * np.tile(wr, levels) / 4
    return places.reshape(-1, 3), np.repeat(weight / around, around)


def dipole_disc(pixels: Array, disc: Disc, rings: tuple[int, int, int]) -> Model:
    """Disc as some dipoles at pixels (t, 3)."""
    diameter, height, remanence = disc
    places, shares = disc_dipoles(diameter, height, rings)
    moment = magnet_moment(remanence, float(np.pi / 4 * diameter**2 * height))
    moments = moment * shares[:, None] * np.array([0.0, 0.0, 1.0])
    readings = on_pixels(pixels, lambda own: dipole_field(own, places, moments))
    name = f'{len(places)} dipoles' if len(places) > 1 else 'dipole'
    return Model(name, readings, DIPOLE_COST * len(places) * len(pixels), size=rings)


def all_rated(models: list[Model], exact: Model, states: Array, noise: float) -> Choice:
    """Choice of the cheapest model, with the errors of all of them, by cost."""
    truth, sigma = exact.readings(states), np.array(noise)
    every = [*sorted(models, key=lambda m: (m.operations, m.numbers)), exact]
    rated = tuple(rate(model, truth, states, sigma) for model in every)
    return replace(choose(models, exact, states, noise), rated=rated)


def sheet_of(config: MultipoleSkinConfig) -> Sheet:
    """The magnetised sheet at rest."""
    low = float(config.positions[:, 2].mean()) + config.gap
    return Sheet(
        np.asarray(config.sheet_size), low, config.sheet_thickness, config.pole_pitch,
        config.magnetisation, np.full(2, config.remanence),
    )  # fmt: skip


def rest_model(config: MultipoleSkinConfig, noise: float) -> tuple[Choice, list[Model]]:
    """Choice for the sheet at rest, which may sit off its place, and all models."""
    chips, sheet = config.positions, sheet_of(config)

    def model(name: str, field: Callable[[Array], Array], cost: float, size: int = 0) -> Model:
        return Model(
            name, lambda states: field(chips - states[:, None]), cost * len(chips),
            size=(size,) if size else (),
        )  # fmt: skip

    def dipoles(pitch: float, levels: int) -> Model:
        places, moments = carpet(sheet, pitch, levels)
        count = len(places)
        return model(f'{count} dipoles', lambda at: dipole_field(at, places, moments),
                     DIPOLE_COST * count, count)  # fmt: skip

    exact = model('exact bands', sheet.field, BLOCK_COST * len(sheet.bands))
    models = [dipoles(5e-3, 1), dipoles(2.5e-3, 1), dipoles(2.5e-3, 2), dipoles(1.25e-3, 2)]
    states = region(-PLAY * np.ones(3), PLAY * np.ones(3), 4)
    return all_rated(models, exact, states, noise), [*models, exact]


class FlatPunch:
    """Movement of a bonded layer under a round smooth flat head, for each metre that it sinks.

    Its pressure has a root at the edge that no map of squares follows. As cosines of an even
    density over the radius it is finite everywhere, and the layer adds a smooth integral equation
    to the half-space's (Sneddon, Fourier Transforms, 1951; Lebedev and Ufliand, PMM 22, 1958).
    Movements are asked for up to `farthest` from its axis (m).
    """

    def __init__(self, layer: Layer, radius: float, farthest: float) -> None:
        self.layer, self.radius, self.farthest = layer, radius, farthest
        wave, weight = _panels(UNFELT / layer.thickness, np.pi / radius)
        sinks = -layer.pressed(wave, np.array([layer.thickness]))[1][:, 0]
        soft = (1 - layer.poisson_ratio) / layer.shear_modulus
        node, share = np.polynomial.legendre.leggauss(NODES)
        self._at, share = radius * (1 + node) / 2, radius * share / 2
        cosine = np.cos(np.outer(self._at, wave))
        kernel = (cosine * ((sinks * wave / soft - 1) * weight)) @ cosine.T
        matrix = np.eye(NODES) + 2 / np.pi * kernel * share
        density = np.linalg.solve(matrix, np.full(NODES, 2 / np.pi))
        self._density = density * share / soft

    def pressure(self, wave: Array) -> Array:
        """Hankel transform (n,) of the pressure at wave numbers (n,) (Pa m2 / m)."""
        return np.asarray(np.cos(np.outer(wave, self._at)) @ self._density)

    def movement(self, depth: float) -> CubicSpline:
        """Movement (..., 2) away and up over distances (...) from the axis, at a depth (m)."""
        distance = np.arange(0.0, self.farthest + 2 * SPACING, SPACING)
        wave, weight = _panels(UNFELT / depth, np.pi / (self.farthest + self.radius))
        across, up = self.layer.pressed(wave, np.array([self.layer.thickness - depth]))
        load = self.pressure(wave) * wave * weight
        phase = np.outer(distance, wave)
        moved = np.stack([-j1(phase) @ (load * across[:, 0]), j0(phase) @ (load * up[:, 0])], 1)
        return CubicSpline(distance, moved)


def _panels(end: float, width: float) -> tuple[Array, Array]:
    """Gauss points and weights of panels about as wide as `width`, from 0 to an end."""
    count = int(np.ceil(end / width))
    node, weight = np.polynomial.legendre.leggauss(POINTS)
    start = np.arange(count)[:, None] + (1 + node) / 2
    return (start * end / count).ravel(), np.tile(weight * end / count / 2, count)


@lru_cache
def _punched(layer: Layer, farthest: float, below: float) -> CubicSpline:
    """Movement at a depth (m) under the head, over the distance from its axis."""
    return FlatPunch(layer, RADIUS, farthest).movement(below)


class PressedSheet:
    """Change of the readings by a round head, on squares of one pitch (m).

    `law`: 'bonded', 'half-space', 'springs', or 'even' for a bonded layer under even pressure;
    `points`, `levels`: Gauss points along each side of a square, and over the thickness.
    """

    def __init__(
        self, config: MultipoleSkinConfig, pitch: float, law: str = 'bonded', points: int = 1,
        levels: int = LEVELS,
    ) -> None:  # fmt: skip
        self.config, self.law, self.pitch = config, law, pitch
        self.body = config.layer_thickness + config.sheet_thickness
        deep = DEEP if law == 'half-space' else 1.0
        shear = config.youngs_modulus / (2 * (1 + config.poisson_ratio))
        self.layer = Layer(deep * self.body, shear, config.poisson_ratio)
        sheet = sheet_of(config)
        self.places, self.moments = carpet(sheet, pitch, levels, points)
        count = 2 * int(np.ceil(MARGIN * sheet.size.max() / pitch / 2)) + 1
        self.line = pitch * (np.arange(count) - count // 2)
        self.levels = np.unique(self.places[:, 2])
        self.rest = dipole_field(config.positions, self.places, self.moments)

    def readings(self, states: Array) -> Array:
        """Changes (s, n) (T) of heads at x, y, sunk by a depth: states (s, 3) (m)."""
        return np.stack([self.change(*state) for state in states])

    def change(self, x: float, y: float, depth: float) -> Array:
        """Change (n,) (T) of one head."""
        moved = self.movement(x, y, depth)
        field = dipole_field(self.config.positions, self.places + moved, self.moments)
        return in_chip_axes(field - self.rest, self.config.rotations).reshape(-1)

    def movement(self, x: float, y: float, depth: float) -> Array:
        """Displacement (g, 3) (m) of the dipoles."""
        apart = self.places[:, :2] - np.array([x, y])
        top = float(self.levels.mean()) + self.config.sheet_thickness / 2
        # the map is centred on the head, so that its squares cover it alike everywhere
        covered = np.hypot(*np.meshgrid(self.line, self.line)) <= RADIUS
        pressure = None if self.law == 'bonded' else self._pressure(covered, depth)
        moved = np.empty_like(self.places)
        for level in self.levels:
            here = np.isclose(self.places[:, 2], level)
            below = round(top - float(level), 12)
            if pressure is None:
                moved[here] = depth * self._under_punch(apart[here], below)
            else:
                shift = self._map(pressure, self.layer.thickness - below)
                near = np.clip(apart[here], self.line[0], self.line[-1])
                moved[here] = RegularGridInterpolator((self.line, self.line), shift)(near[:, ::-1])
        return moved

    def _under_punch(self, apart: Array, below: float) -> Array:
        """Movement (g, 3) of places (g, 2) about a rigid head, for each metre that it sinks."""
        distance = np.hypot(*apart.T)
        farthest = float(np.hypot(*self.config.sheet_size) / 2 + np.sqrt(2) * FARTHEST)
        away, up = _punched(self.layer, farthest, below)(distance).T
        side = apart / np.maximum(distance, ROUNDING)[:, None]
        return np.column_stack([side * away[:, None], up])

    def _pressure(self, covered: Bools, depth: float) -> Array:
        """Pressure of a head on squares (ny, nx) (Pa); for springs how deep they sink (m)."""
        if self.law == 'half-space':
            return self.layer.punch(covered, self.pitch, depth)
        even = np.asarray(depth * covered, np.float64)
        if self.law == 'springs':
            return even
        sunk = self._map(even, self.layer.thickness)
        return np.asarray(-depth / sunk[covered][:, 2].mean() * even)

    def _map(self, pressure: Array, z: float) -> Array:
        """Displacement (ny, nx, 3) at a height (m) over the base, periodic."""
        if self.law == 'springs':
            return np.asarray(-pressure[..., None] * np.array([0.0, 0.0, z / self.body]))
        ky, kx = wave_numbers(pressure.shape, self.pitch)
        spectrum = self.layer.waves(np.array([z]), ky, kx)[:3, 0] * np.fft.rfft2(pressure)
        moved = np.fft.irfft2(spectrum, pressure.shape, axes=(1, 2))
        return np.stack([moved[1], moved[0], moved[2]], axis=-1)


def pressed_model(
    config: MultipoleSkinConfig, pitch: float, law: str = 'bonded', points: int = 1,
    levels: int = LEVELS,
) -> Model:  # fmt: skip
    """Model of the pressed sheet, its cost counted without the layer's."""
    pressed = PressedSheet(config, pitch, law, points, levels)
    count = len(pressed.places)
    named = {'bonded': 'bonded layer', 'even': 'even pressure'}.get(law, law)
    several = f' with {points} x {points} points' if points > 1 else ''
    cost = DIPOLE_COST * count * len(config.positions)
    name = f'{1e3 * pitch:g} mm{several}, {named}'
    return Model(name, pressed.readings, cost, size=(count,))


def pressed_choice(
    config: MultipoleSkinConfig, noise: float, states: Array
) -> tuple[Choice, list[Model], Model]:
    """Choice among carpets that a bonded layer carries, all of them, and the finest."""
    models = [pressed_model(config, pitch, points=points) for pitch, points in CARPETS]
    pitch, points = FINEST
    finest = pressed_model(config, pitch, points=points, levels=2 * LEVELS)
    return all_rated(models, finest, states, noise), models, finest


def pressed_states(count: int, corners: int = 0, seed: int = 0) -> Array:
    """Heads of the scene, of which deep ones at corners come first: x, y, depth, (n, 3) (m)."""
    low = np.array([-FARTHEST, -FARTHEST, 0.2 * DEEPEST])
    states = region(low, np.array([FARTHEST, FARTHEST, DEEPEST]), count, seed)
    return np.concatenate([states[1:8:2][:corners], states[8:]])
