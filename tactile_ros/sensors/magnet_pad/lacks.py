"""What recorded touches differ by from the fitted model: smooth over the surface, by the evidence.

Gaussian bumps over the unrolled surface, times the load and its square (and its tangential parts,
where touches lean), with a prior whose width and size the evidence chooses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.evidence import Moments
from tactile_ros.estimators.kernel_ridge import gaussian
from tactile_ros.types import Array, Bools

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.response import PadResponse, PadTouches

CENTRES = (14, 10)
REACHES = (0.35, 0.6, 1.0)  # radii
LEAST_SHARE = 1e-9
SQUARE = 0.4  # of the part that is square in the load
AMPLITUDES = tuple(10.0**power for power in np.arange(-0.5, 4.0, 0.5))


class Lacks:
    """What recorded touches differ by from the model: bumps over the surface, times the load.

    Parameters
    ----------
    response : PadResponse
        Of the model.
    touches : PadTouches
        Recorded (s).
    x : ndarray, shape (s, d)
        Their readings (T).
    noise : float
        Of a channel (T).

    Attributes
    ----------
    into : tuple of int
        Monomials of the load that bumps are added to.
    """

    def __init__(self, response: PadResponse, touches: PadTouches, x: Array, noise: float) -> None:
        self.radius = response.config.radius
        ends = [np.linspace(side[0], side[-1], n) for side, n in
                zip((response.along, response.around), CENTRES, strict=True)]  # fmt: skip
        self.centres = np.stack(np.meshgrid(*ends, indexing='ij'), axis=-1).reshape(-1, 2)
        self.into = (0, 1, 4, 5) if response.leaning else (0, 1)
        load = touches.load / response.full_
        loads = [load, SQUARE * load**2]
        if response.leaning:
            loads += [load * lean for lean in touches.lean.T]
        self.error = x - response(touches)
        # what differs from touch to touch grows with them
        spread = np.sqrt((self.error**2).mean() / max(float((x**2).mean()), 1e-300))
        self.weight = noise**2 / (noise**2 + (0.1 * spread) ** 2 * (x * x).mean(axis=1))
        place = np.column_stack([touches.along, touches.around])
        best = -np.inf
        for reach in REACHES:
            mixing = self._mixing(reach)
            bumps = self._kernel(place, reach) @ mixing
            own = np.concatenate([bumps * one[:, None] for one in loads], axis=1)
            moments = Moments.of(own, self.error, self.weight)
            for amplitude in AMPLITUDES:
                found = moments.evidence(np.full(own.shape[1], amplitude))
                if found > best:
                    best, self.reach, self.mixing = found, reach, mixing
                    self.amplitude, self.terms = amplitude, own

    def _kernel(self, place: Array, reach: float) -> Array:
        """Bumps (s, n) around the centres at places (s, 2) (m, rad)."""
        unit = np.array([1 / self.radius, 1.0]) / reach
        return gaussian(place * unit, self.centres * unit)

    def _mixing(self, reach: float) -> Array:
        value, vector = np.linalg.eigh(self._kernel(self.centres, reach))
        kept = value > LEAST_SHARE * value[-1]
        return np.asarray(vector[:, kept] / np.sqrt(value[kept]))

    def bumps(self, place: Array) -> Array:
        """Smooth functions (s, p) of places (s, 2) (m, rad)."""
        return np.asarray(self._kernel(place, self.reach) @ self.mixing)

    def doubt(self, place: Array) -> Array:
        """Variance (3, g) (T2) of what was last solved at places (g, 2) (m, rad).

        Of the parts linear and square in the load, and twice their covariance.
        """
        bumps = self.bumps(place)
        count = bumps.shape[1]
        one = bumps @ self.root[:, :count].T
        two = SQUARE * bumps @ self.root[:, count : 2 * count].T
        return np.stack(
            [(one * one).sum(axis=1), (two * two).sum(axis=1), 2 * (one * two).sum(axis=1)]
        )

    def solve(self, rows: Bools) -> Array:
        """Weights (l, d, p) of the bumps for each monomial, learned from some rows (s,)."""
        moments = Moments.of(self.terms[rows], self.error[rows], self.weight[rows])
        weights, root, noise = moments.solve(np.full(self.terms.shape[1], self.amplitude))
        self.root = noise * root
        split = weights.reshape(len(self.into), -1, weights.shape[1]).transpose(0, 2, 1)
        split = split.copy()
        split[1] *= SQUARE
        return split
