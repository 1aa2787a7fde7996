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
from tactile_ros.physics.parts import part_pressure

if TYPE_CHECKING:
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Integers, Outline

SIDE = 30  # points along each side of the box around a taxel
REST_OUTPUT = 0.002  # fraction that taxels read at rest, at most


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
        own = (self.points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])
        pressure = part_pressure(part, own)
        load = np.bincount(self.owner, pressure * self.part, self.taxels)
        return np.asarray(force * load / max(float(load.sum()), 1e-30))
