# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A taxel array behind a microcontroller on a serial port, real or simulated.

It is no model of [4] to estimate with: drift, hysteresis and the area law are left out. The taxels
share the load by the footprint; output rises and levels off with force, and gains differ by up to
55 % of the least, as [4] found. Where the config has objects they are placed and turned instead,
and share their load by counted points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.devices.connections import FramedConnection
from tactile_ros.devices.framed_protocol import Payload, taxel_matrix
from tactile_ros.enrolment import Programme, Touches, Truth, growing_loads, recorded
from tactile_ros.physics.coverage import part_pressure, symmetry, taxel_points
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig, layout
from tactile_ros.types import Array, Integers, Layout, Recording
from tactile_ros.types.config_fields import whole

POINTS = 49  # of a taxel
PLAY = 0.25  # of the array's reach: how far from its middle a part is placed
LIGHTEST, HEAVIEST = 0.05, 0.6  # of a taxel's largest force, on the most loaded one


@dataclass(frozen=True)
class Placing:
    """Objects of a programme, one for each press."""

    programme: Programme  # origins of the objects (m) and their whole loads (N)
    # (n,) which object, and its symmetry
    label: Integers
    order: Integers
    yaw: Array  # (n,) its turn (rad)
    share: Array  # (n, t) part of the load that each taxel bears

    @classmethod
    def drawn(cls, config: TaxelArrayConfig, seed: int, count: int) -> Placing:
        """Objects of a config in turn, at random places and turns."""
        rng = np.random.default_rng(seed)
        label = np.arange(count) % len(config.objects)
        yaw = rng.uniform(-np.pi, np.pi, count)
        plane = config.positions[:, :2]
        reach = PLAY * np.linalg.norm(plane - plane.mean(axis=0), axis=1).max()
        place = plane.mean(axis=0) + rng.uniform(-reach, reach, (count, 2))
        share = _shares(config, label, place, yaw)
        low, high = config.force_range
        load = growing_loads(
            count, low + LIGHTEST * (high - low), low + HEAVIEST * (high - low), rng
        )
        load = load / np.maximum(share.max(axis=1), 1e-12)
        places = np.column_stack([place, np.zeros(count)])
        plan = Programme(places, load[:, None] * np.array([0.0, 0.0, 1.0]))
        order = np.array([symmetry(part) for part in config.objects])[label]
        return cls(plan, label, order, yaw, share)

    def loads(self, touches: Touches) -> Array:
        """Load of every taxel, shape (s, t) (N)."""
        return np.asarray(self.share[touches.press] * np.maximum(touches.force[:, 2:], 0.0))

    def truth(self, touches: Touches) -> Truth:
        """Label, turn and symmetry of the object of each instant; -1 and NaN without one."""
        there, press = touches.press >= 0, touches.press
        order = np.where(there, self.order[press], -1)
        return {
            'label': np.where(there, self.label[press], -1),
            'yaw': np.where(order > 0, self.yaw[press], np.nan),
            'symmetry': order,
        }


def _shares(config: TaxelArrayConfig, label: Integers, place: Array, yaw: Array) -> Array:
    """Part of the load (n, t) that each taxel bears under each placed object."""
    points, first, _ = taxel_points(config.positions, config.areas, config.taxel_outlines, POINTS)
    sizes = np.diff(np.append(first, len(points)))
    share = np.empty((len(label), len(sizes)))
    for i, (which, at, turn) in enumerate(zip(label, place, yaw, strict=True)):
        cos, sin = np.cos(turn), np.sin(turn)
        own = (points - at) @ np.array([[cos, -sin], [sin, cos]])
        pressure = part_pressure(config.objects[which], own)
        bears = np.add.reduceat(pressure, first) / sizes * config.areas
        share[i] = bears / max(float(bears.sum()), 1e-30)
    return share


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

    One stream that begins with a tare. `seed` is of all that is drawn, `noise` of a channel
    (fraction of the range); None: half a step of the converter. The `objects` of the
    config are placed, where it has some.
    """
    placing = Placing.drawn(config, seed, count) if config.objects else None
    plan = programme(config, seed, count) if placing is None else placing.programme

    def loads(touches: Touches) -> Array:
        return taxel_forces(config, touches) if placing is None else placing.loads(touches)

    return recorded(
        layout(config), plan, lambda touches: outputs(config, loads(touches)),
        lambda touches: truth(touches, loads(touches), placing),
        NOISE if noise is None else noise, seed, (0.0, 1.0),
    )  # fmt: skip


@dataclass(frozen=True)
class TaxelArrayConnection(FramedConnection):
    """A microcontroller that scans the matrix and sends packed counts of 10 bits in frames."""

    full_count: int = whole(1023, 'count of the converter at its full range', 1, 1023)

    def payload(self, layout: Layout) -> Payload:
        """Counts of all taxels."""
        return taxel_matrix(layout.shape[0], self.full_count)

    def scale(self) -> float:
        """Share of the range per count."""
        return 1 / self.full_count
