"""An array that grips parts: pressure counted at many points of every taxel, and its own skin.

Nothing is shared with the coverage tables and laws that estimate: parts press on points, a part's
pressure is even or that of a round body that sinks in, and the skin answers by a power of the load
that levels off, with a gain and a curve of each taxel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.outlines import inside

if TYPE_CHECKING:
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Integers, Outline

SIDE = 30  # points along each side of the box around a taxel
SUNK = 0.5  # of a tube's radius: half the width of its contact
REST_OUTPUT = 0.002  # fraction that taxels read at rest, at most


def pressed(part: Outline, x: Array, y: Array) -> Array:
    """Pressure of a part at points of its own frame, 1 at most.

    Parameters
    ----------
    part : Outline
        Flat, or an angle tube of a radius `thickness`.
    x, y : ndarray, shape (n,)
        Points (m).

    Returns
    -------
    ndarray, shape (n,)
        Even under a flat part; under a tube what a circle sinks in below its chord.
    """
    if part.bend is None:
        return inside(part.loops, np.column_stack([x, y])).astype(np.float64)
    radius = float(part.thickness or 0.0)
    half = SUNK * radius
    most = radius - np.sqrt(radius**2 - half**2)
    found = np.zeros(len(x))
    for turn in (0.0, part.bend):
        along = np.cos(turn) * x + np.sin(turn) * y
        across = np.cos(turn) * y - np.sin(turn) * x
        chord = np.sqrt(np.maximum(radius**2 - across**2, 0.0)) - np.sqrt(radius**2 - half**2)
        found = np.maximum(found, np.where(along > 0, np.maximum(chord, 0.0) / most, 0.0))
    return found


@dataclass(frozen=True)
class TaxelSkin:
    """How t taxels answer to loads.

    Attributes
    ----------
    gain, half_load, power : ndarray, shape (t,)
        Largest output (fraction), load of half of it (N), and exponent.
    broken : ndarray of int, shape (n,)
        Taxels that read nothing, whatever bears on them.
    noise : float
        Of an output (fraction).
    steps : int
        Of the converter.
    """

    gain: Array
    half_load: Array
    power: Array
    broken: Integers
    noise: float = 5e-4
    steps: int = 1023

    @classmethod
    def drawn(
        cls, taxels: int, half_load: float, rng: np.random.Generator, broken: int = 0
    ) -> TaxelSkin:
        """Gains that differ by 55 % of the least, as [4] found, and curves that differ too."""
        return cls(
            0.95 / (1 + 0.55 * rng.uniform(size=taxels)),
            half_load * rng.uniform(0.8, 1.25, taxels),
            0.85 * rng.uniform(0.96, 1.04, taxels),
            rng.permutation(taxels)[:broken],
        )

    def read(self, load: Array, rng: np.random.Generator) -> Array:
        """Readings (s, t, 1) under loads (s, t) (N)."""
        size = (np.maximum(load, 0.0) / self.half_load) ** self.power
        output = REST_OUTPUT + self.gain * size / (1 + size)
        output[:, self.broken] = 0.0
        output = output + self.noise * rng.normal(size=output.shape)
        return np.asarray(np.round(np.clip(output, 0, 1) * self.steps)[..., None] / self.steps)


class TaxelScene:
    """Points of an array on which parts press.

    Parameters
    ----------
    config : TaxelArrayConfig
        With `taxel_outlines`, or with squares of `areas`.
    """

    def __init__(self, config: TaxelArrayConfig) -> None:
        line = (np.arange(SIDE) + 0.5) / SIDE - 0.5
        cross = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        groups = []
        for i, centre in enumerate(config.positions[:, :2]):
            if config.taxel_outlines is None:
                groups.append(centre + np.sqrt(config.areas[i]) * cross)
                continue
            loops = config.taxel_outlines[i].loops
            low, high = loops[0].min(axis=0), loops[0].max(axis=0)
            box = (low + high) / 2 + (high - low) * cross
            groups.append(box[inside(loops, box)])
        self.points = np.concatenate(groups)
        self.owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
        self.part = (config.areas / np.bincount(self.owner))[self.owner]
        self.taxels = len(groups)

    def loads(self, part: Outline, pose: Array, force: float) -> Array:
        """Load (t,) of every taxel under a part at a pose (x, y, yaw) with a whole force (N)."""
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        x, y = (self.points - pose[:2]).T
        pressure = pressed(part, cos * x + sin * y, cos * y - sin * x)
        load = np.bincount(self.owner, pressure * self.part, self.taxels)
        return np.asarray(force * load / max(float(load.sum()), 1e-30))
