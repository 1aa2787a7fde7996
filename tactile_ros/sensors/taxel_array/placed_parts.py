"""Parts placed and turned on an array, for its twin: which taxels bear how much of the load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.enrolment import Programme, growing_loads
from tactile_ros.physics.coverage import symmetry, taxel_points
from tactile_ros.physics.parts import part_pressure
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from tactile_ros.enrolment import Touches, Truth
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig

POINTS = 49  # of a taxel
PLAY = 0.25  # of the array's reach: how far from its middle a part is placed
LIGHTEST, HEAVIEST = 0.05, 0.6  # of a taxel's largest force, on the most loaded one


@dataclass(frozen=True)
class Placing:
    """Objects of a programme, one for each press.

    Attributes
    ----------
    programme : Programme
        Origins of the objects (m) and their whole loads (N).
    label, order : ndarray of int, shape (n,)
        Which object, and its symmetry.
    yaw : ndarray, shape (n,)
        Its turn (rad).
    share : ndarray, shape (n, t)
        Part of the load that each taxel bears.
    """

    programme: Programme
    label: Integers
    order: Integers
    yaw: Array
    share: Array

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
