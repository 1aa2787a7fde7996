# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Models of the multipole skin's field, at rest and pressed, and the one that its noise needs."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.worlds.flat_punch import FlatPunch
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
from tactile_ros.physics.magnetics import dipole_field, in_chip_axes

if TYPE_CHECKING:
    from collections.abc import Callable

    from scipy.interpolate import CubicSpline

    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Bools

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
HARMONICS = (1, 2, 4)
ROUNDING = 1e-12  # m


def sheet_of(config: MultipoleSkinConfig) -> Sheet:
    """The magnetised sheet at rest."""
    low = float(config.positions[:, 2].mean()) + config.gap
    even = np.full(2, config.remanence)
    return Sheet(
        np.asarray(config.sheet_size), low, config.sheet_thickness, config.pole_pitch,
        config.magnetisation, even,
    )  # fmt: skip


def displacement(layer: Layer, pressure: Array, pitch: float, z: float) -> Array:
    """Displacement (ny, nx, 3) (m) at a height under a pressure (ny, nx) (Pa), periodic."""
    ky, kx = wave_numbers(pressure.shape, pitch)
    spectrum = layer.waves(np.array([z]), ky, kx)[:3, 0] * np.fft.rfft2(pressure)
    moved = np.fft.irfft2(spectrum, pressure.shape, axes=(1, 2))
    return np.stack([moved[1], moved[0], moved[2]], axis=-1)


def all_rated(models: list[Model], exact: Model, states: Array, noise: float) -> Choice:
    """Choice of the cheapest model, with the errors of all of them, by cost."""
    truth, sigma = exact.readings(states), np.array(noise)
    every = [*sorted(models, key=lambda m: (m.operations, m.numbers)), exact]
    rated = tuple(rate(model, truth, states, sigma) for model in every)
    return replace(choose(models, exact, states, noise), rated=rated)


def rest_model(config: MultipoleSkinConfig, noise: float) -> tuple[Choice, list[Model]]:
    """Choice for the sheet at rest, which may sit off its place, and all models."""
    chips, sheet = config.positions, sheet_of(config)
    count = len(chips)

    def shifted(field: Callable[[Array], Array]) -> Callable[[Array], Array]:
        return lambda states: field(chips - states[:, None])

    def dipoles(pitch: float, levels: int) -> Model:
        places, moments = carpet(sheet, pitch, levels)
        return Model(
            f'{len(places)} dipoles',
            shifted(lambda at: dipole_field(at, places, moments)),
            DIPOLE_COST * len(places) * count,
            size=(len(places),),
        )

    blocks = len(sheet.bands)
    exact = Model('exact bands', shifted(sheet.field), BLOCK_COST * blocks * count)
    models = [dipoles(5e-3, 1), dipoles(2.5e-3, 1), dipoles(2.5e-3, 2), dipoles(1.25e-3, 2)]
    if config.magnetisation == 'M4':
        models += [
            Model(
                f'{n} harmonics',
                shifted(lambda at, n=n: harmonics(sheet, at, n)),  # type: ignore[misc]
                40.0 * n * count,
                size=(n,),
            )
            for n in HARMONICS
        ]
    states = region(-PLAY * np.ones(3), PLAY * np.ones(3), 4)
    return all_rated(models, exact, states, noise), [*models, exact]


class PressedSheet:
    """Change of the readings by a round head, on squares of one pitch.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Of the skin.
    pitch : float
        Of the carpet and of the map of the layer (m).
    law : str
        'bonded', 'half-space', 'springs', or 'even' for a bonded layer under even pressure.
    points, levels : int
        Gauss points along each side of a square, and over the thickness.
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
        line = pitch * (np.arange(count) - count // 2)
        self.line, self.levels = line, np.unique(self.places[:, 2])
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
        if self.law == 'bonded':
            return self._exact(x, y, depth)
        # the map is centred on the head, so that its squares cover it alike everywhere
        covered = np.hypot(*np.meshgrid(self.line, self.line)) <= RADIUS
        pressure = self._pressure(covered, depth)
        moved = np.zeros_like(self.places)
        for level in self.levels:
            here = np.isclose(self.places[:, 2], level)
            shift = self._map(pressure, self.layer.thickness - self._below(float(level)))
            moved[here] = self._between(shift, self.places[here, :2] - np.array([x, y]))
        return moved

    def _below(self, level: float) -> float:
        """Depth of a level of dipoles below the surface (m)."""
        top = float(self.levels.mean()) + self.config.sheet_thickness / 2
        return round(top - level, 12)

    def _exact(self, x: float, y: float, depth: float) -> Array:
        """The same under a rigid head on the bonded layer."""
        apart = self.places[:, :2] - np.array([x, y])
        distance = np.hypot(*apart.T)
        farthest = float(np.hypot(*self.config.sheet_size) / 2 + np.sqrt(2) * FARTHEST)
        moved = np.empty_like(self.places)
        for level in self.levels:
            here = np.isclose(self.places[:, 2], level)
            away, up = _punched(self.layer, farthest, self._below(float(level)))(distance[here]).T
            side = apart[here] / np.maximum(distance[here], ROUNDING)[:, None]
            moved[here] = depth * np.column_stack([side * away[:, None], up])
        return moved

    def _pressure(self, covered: Bools, depth: float) -> Array:
        """Pressure of a head on squares (ny, nx) (Pa); for springs how deep they sink (m)."""
        if self.law == 'half-space':
            return self.layer.punch(covered, self.pitch, depth)
        even = np.asarray(depth * covered, np.float64)
        if self.law == 'springs':
            return even
        sunk = displacement(self.layer, even, self.pitch, self.layer.thickness)
        return np.asarray(-depth / sunk[covered][:, 2].mean() * even)

    def _map(self, pressure: Array, z: float) -> Array:
        """Displacement (ny, nx, 3) at a height (m) over the base."""
        if self.law == 'springs':
            return np.asarray(-pressure[..., None] * np.array([0.0, 0.0, z / self.body]))
        return displacement(self.layer, pressure, self.pitch, z)

    def _between(self, shift: Array, at: Array) -> Array:
        """A map (ny, nx, 3) at places (g, 2) from its middle, linear between squares."""
        last = len(self.line) - 1
        position = np.clip(at / self.pitch + len(self.line) // 2, 0, last - 1e-9)
        first = np.floor(position).astype(np.int64)
        u = position - first
        found = np.zeros((len(at), 3))
        for a in (0, 1):
            for b in (0, 1):
                weight = (u[:, 0] if a else 1 - u[:, 0]) * (u[:, 1] if b else 1 - u[:, 1])
                found += weight[:, None] * shift[first[:, 1] + b, first[:, 0] + a]
        return found


def harmonics(sheet: Sheet, points: Array, count: int) -> Array:
    """Field (..., 3) (T) of an M4 without edges, all bands of which are as strong as the first.

    `points` (..., 3) lie outside of the sheet (m); `count` is that of odd harmonics: 1, 3 ...
    """
    half = sheet.thickness / 2
    phase = points[..., 1] + sheet.size[1] / 2
    above = points[..., 2] - sheet.low - half
    field = np.zeros(np.shape(points))
    for n in 2 * np.arange(count) + 1:
        k = n * np.pi / sheet.pole_pitch
        strength = 4 * sheet.strengths[0] / (n * np.pi) * np.sinh(k * half)
        strength = strength * np.exp(-k * np.abs(above))
        field[..., 1] -= strength * np.sin(k * phase)
        field[..., 2] -= np.sign(above) * strength * np.cos(k * phase)
    return field


@lru_cache
def _punched(layer: Layer, farthest: float, below: float) -> CubicSpline:
    """Movement at a depth (m) under the head, over the distance from its axis."""
    return FlatPunch(layer, RADIUS, farthest).movement(below)


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
