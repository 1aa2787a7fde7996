"""A simple signal of the multipole skin: a sheet of dipoles dented by flat heads.

It is no model of [1] to estimate with: the dent is the head's outline blurred by a Gaussian of
half the body's thickness, the lateral squeeze of the bonded layer is the dent's slope, scaled to
0.75 mm per mm at an edge, and the field changes linearly with both; the elastic layer is not
solved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.dipoles import (
    dipole_field,
    dipole_gradients,
    in_chip_axes,
    magnet_moment,
)
from tactile_ros.physics.outlines import grid_inside
from tactile_ros.presses import Programme, Touches, growing_loads, playing, recorded
from tactile_ros.sensors.multipole_skin.config import HEADS, layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.presses import Truth
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Integers, Outline, Recording

NOISE = 4e-6  # T
CELLS = 30  # of the sheet along an edge
HEAD_PITCH = 1e-3
SQUEEZE = 0.75  # lateral movement at an edge over depth
STIFFENING = 3.0  # of the bonded layer over Young's modulus
PLAY = 0.25  # of a place about the middle, in sheet sizes
PRESSES = 40


def sheet_dipoles(config: MultipoleSkinConfig) -> tuple[Array, Array]:
    """Places (m) and moments (A m2) of the sheet's cells, shape (g, 3) each."""
    edges = [size * ((np.arange(CELLS) + 0.5) / CELLS - 0.5) for size in config.sheet_size]
    plane = np.stack(np.meshgrid(*edges), axis=-1).reshape(-1, 2)
    low = float(config.positions[:, 2].mean()) + config.gap
    height = np.full(len(plane), low + config.sheet_thickness / 2)
    volume = float(np.prod(config.sheet_size)) / CELLS**2 * config.sheet_thickness
    y = plane[:, 1]
    band = np.floor((y + config.sheet_size[1] / 2) / config.pole_pitch + 1e-9)
    along_y = {'M1': 0 * y, 'M2': 1 + 0 * y, 'M3': np.sign(y), 'M4': 1 - 2 * (band % 2)}
    direction = np.zeros((len(plane), 3))
    direction[:, 1] = along_y[config.magnetisation]
    direction[:, 2] = config.magnetisation == 'M1'
    moments = magnet_moment(config.remanence, volume) * direction
    return np.column_stack([plane, height]), moments


def dent(config: MultipoleSkinConfig, places: Array, points: Array) -> Array:
    """Movement (g, 3) of the sheet's places per depth of a head that covers points (n, 2)."""
    blur = (config.layer_thickness + config.sheet_thickness) / 2
    away = points[None] - places[:, None, :2]
    near = np.exp(-0.5 * np.square(away / blur).sum(axis=2))
    near *= HEAD_PITCH**2 / (2 * np.pi * blur**2)
    slope = (near[..., None] * away).sum(axis=1) / blur**2
    across = -SQUEEZE * np.sqrt(2 * np.pi) * blur * slope
    return np.column_stack([across, -near.sum(axis=1)])


def _turned(points: Array, yaw: float, place: Array) -> Array:
    """Points (n, 2) of a head that is turned and moved."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + place[:2], np.float64)


class Scene:
    """Heads that press the skin, one after the other.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Of the sensor; its `objects` press, or the heads of [1] where it has none.
    seed : int
        Of heads, places, turns and loads.
    count : int
        Presses (n).

    Attributes
    ----------
    labels, yaws : ndarray, shape (n,)
        Head and turn (rad) of each press.
    programme : Programme
        Places and loads.
    """

    labels: Integers
    yaws: Array

    def __init__(self, config: MultipoleSkinConfig, seed: int, count: int) -> None:
        rng = np.random.default_rng(seed)
        self.config = config
        self.heads: tuple[Outline, ...] = config.objects or HEADS
        self.labels = rng.integers(len(self.heads), size=count)
        self.yaws = rng.uniform(-np.pi, np.pi, count)
        self._covered = [grid_inside(head.loops, HEAD_PITCH) for head in self.heads]
        place = PLAY * config.sheet_size * rng.uniform(-1, 1, (count, 2))
        top = config.layer_thickness + config.sheet_thickness
        load = growing_loads(count, 2.0, 6.0, rng)[rng.permutation(count)]
        self.programme = Programme(
            np.column_stack([place, np.full(count, top)]),
            load[:, None] * np.array([0.0, 0.0, 1.0]),
        )
        self._rest, self._changes = self._pictures()

    def depth(self, press: int) -> float:
        """Depth (m) of a press at its full load."""
        body = self.config.layer_thickness + self.config.sheet_thickness
        area = len(self._covered[self.labels[press]]) * HEAD_PITCH**2
        load = self.programme.forces[press, 2]
        return float(load * body / (STIFFENING * self.config.youngs_modulus * area))

    def _pictures(self) -> tuple[Array, Array]:
        """Field at rest, shape (t, 3), and its changes, shape (n + 1, t, 3) (T)."""
        places, moments = sheet_dipoles(self.config)
        chips = self.config.positions
        slopes = dipole_gradients(chips, places, moments)
        changes = np.zeros((len(self.labels) + 1, len(chips), 3))  # the last is no press
        for press, label in enumerate(self.labels):
            place = self.programme.positions[press]
            points = _turned(self._covered[label], self.yaws[press], place)
            moved = self.depth(press) * dent(self.config, places, points)
            changes[press] = np.tensordot(slopes, moved, axes=2)
        return dipole_field(chips, places, moments), changes

    def reading(self, touches: Touches) -> Array:
        """Readings (s, t, 3) (T)."""
        change = self._changes[touches.press] * touches.share[:, None, None]
        return in_chip_axes(self._rest + change, self.config.rotations)

    def truth(self, touches: Touches) -> Truth:
        """Place, head, turn, force."""
        touched = touches.press >= 0
        return {
            'position': touches.position,
            'force': touches.force,
            'label': np.where(touched, self.labels[touches.press], -1),
            'yaw': np.where(touched, self.yaws[touches.press], np.nan),
        }


def presses(
    config: MultipoleSkinConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: label, yaw, position and force.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Of the sensor; its `objects` press.
    seed : int
        Of heads, places, turns, loads and noise.
    count : int
        Presses (n).
    noise : float or None
        Of a channel (T); None: that of the chips.

    Returns
    -------
    Recording
        One stream that begins with a tare.
    """
    scene = Scene(config, seed, count)
    noise = NOISE if noise is None else noise
    return recorded(layout(config), scene.programme, scene.reading, scene.truth, noise, seed)


def signal(config: MultipoleSkinConfig, seed: int = 0) -> Callable[[float], Array]:
    """The readings of `presses` without noise, over time (s), again and again."""
    return playing(presses(config, seed, noise=0.0))
