"""Robust least squares on soft coverage, from several starts at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.coverage_model import LEAST_WIDTH, MOST_WIDTH
from tactile_ros.physics.tubes import HALF_SPACE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.coverage_model import TaxelPoints, Variant
    from tactile_ros.types import Array, Bools

CUT = 3.0  # sigma at which a taxel's misfit stops to count
CLOSE = 0.01  # of a step's limit: what is left to go needs no other round
CENTRED = 0.4  # of the reach: how far from the middle the origin of a gripped tube lies
SLACK = 1.0  # of a quarter of the taxels' least misfit: what the model may still err by
WEAK = 1e-4  # of a sigma per step: what nothing tells stays where it is


@dataclass
class Readings:
    """Forces of one frame and their errors.

    Attributes
    ----------
    force, sigma : ndarray, shape (t,)
        Of each taxel (any unit).
    usable : ndarray, shape (t,)
        False: dead or unknown.
    top : float
        The largest forces.
    count : int
        Taxels that are pressed.
    """

    force: Array
    sigma: Array
    usable: Bools
    top: float
    count: int

    def squared_weights(self, variance: Array | float) -> Array:
        """One over variances, where the model has an error of its own."""
        return np.asarray(self.usable / (np.square(self.sigma) + variance))

    def excess(self, miss: Array) -> Array:
        """By how much the misfit (k, 1) that a quarter of (k, t) exceeds is above the stated."""
        size = np.sort(np.abs(miss) * self.usable, axis=1)[:, -(self.count // 4) - 1, None]
        return np.asarray(SLACK * np.maximum(size - self.sigma.min(), 0.0))


@dataclass
class Fits:
    """What k descents of one variant came to.

    Attributes
    ----------
    variant, profile : Variant, int
        Whose coverage was fitted.
    params : ndarray, shape (k, m)
        x, y (m), yaw (rad), width (m).
    pressure, cost : ndarray, shape (k,)
        Force of a covered area (N/m2); sum of squared misfits, none above the square of the cut.
    cover : ndarray, shape (k, t)
        Covered areas (m2).
    normal : ndarray, shape (k, m + 1, m + 1)
        Matrix of the last step, in units of the variant and parts of the pressure.
    slopes : ndarray, shape (m + 1, k, t)
        Of the forces.
    share : ndarray, shape (k, t)
        Weight of each taxel.
    """

    variant: Variant
    profile: int
    params: Array
    pressure: Array
    cost: Array
    cover: Array
    normal: Array
    slopes: Array
    share: Array


class Descent:
    """Steps of Gauss and Newton on one array.

    Parameters
    ----------
    middle : ndarray, shape (2,)
        Of the array (m).
    reach : float
        Of the array (m).
    """

    def __init__(self, middle: Array, reach: float) -> None:
        self.middle, self.reach = middle, reach

    def run(
        self,
        points: TaxelPoints,
        variant: Variant,
        starts: Array,
        readings: Readings,
        rounds: int,
        loose: Sequence[float],
        profile: int = HALF_SPACE,
        final: bool = True,
    ) -> Fits:
        """Descend with one variant from parameters (k, m), in so many rounds at most.

        In the first rounds the model may err by `loose` parts of the largest force; if not
        `final`, costs stay as loose as the last one was.
        """
        params = starts[:, : variant.free].copy()
        pressure = np.zeros(len(params))
        for i in range(rounds):
            stack = _seen(points, variant, params, profile)
            if i == 0:
                pressure = _first_pressure(readings, stack[-1])
            stack *= pressure[:, None]
            miss = readings.force - stack[-1]
            edges = points.edge_error(variant.unit[0]) * np.square(stack[:2]).sum(axis=0)
            rough = readings.excess(miss)
            if i < len(loose):
                rough = np.maximum(rough, loose[i] * readings.top)
            weight = readings.squared_weights(edges + np.square(rough))
            share = weight * _tukey(np.square(miss) * weight)
            normal, step = self._solve(variant, params, stack, share, miss)
            move = np.minimum(np.maximum(step, -1.0), 1.0)
            _go(variant, params, pressure, move)
            if i >= len(loose) and np.abs(move[:, :-1]).max() < CLOSE:
                break
        miss = miss - (move.T[:, :, None] * stack).sum(axis=0)
        if final:
            weight = readings.squared_weights(edges)
        cost = np.minimum(np.square(miss) * weight, CUT**2).sum(axis=1) + self._strange(
            variant, params
        )
        cover = (readings.force - miss) / pressure[:, None]
        return Fits(variant, profile, params, pressure, cost, cover, normal, stack, share)

    def _strange(self, variant: Variant, params: Array) -> Array | float:
        """Cost (k,) of a tube that is gripped far from its bend."""
        if not variant.tube:
            return 0.0
        away = np.square(params[:, :2] - self.middle).sum(axis=1)
        return np.asarray(away / (CENTRED * self.reach) ** 2)

    def _solve(
        self, variant: Variant, params: Array, stack: Array, share: Array, miss: Array
    ) -> tuple[Array, Array]:
        """Matrix (k, m + 1, m + 1) and step (k, m + 1) of least squares."""
        tall = stack.transpose(1, 0, 2)
        normal = (tall * share[:, None]) @ tall.transpose(0, 2, 1)
        pull = tall @ (share * miss)[..., None]
        count = len(stack)
        normal.reshape(len(normal), -1)[:, :: count + 1] += WEAK
        if variant.tube:
            unit = variant.unit[:2]
            hold = np.square(unit / (CENTRED * self.reach))
            normal[:, [0, 1], [0, 1]] += hold
            pull[:, :2, 0] += hold * (self.middle - params[:, :2]) / unit
        return normal, np.asarray(np.linalg.solve(normal, pull)[..., 0])


def _go(variant: Variant, params: Array, pressure: Array, move: Array) -> None:
    """Take a step; `params` and `pressure` are changed."""
    params += move[:, :-1] * variant.unit[: variant.free]
    pressure *= np.maximum(1.0 + move[:, -1], 0.3)
    if variant.tube:
        width = params[:, 3]
        np.clip(width, LEAST_WIDTH * variant.radius, MOST_WIDTH * variant.radius, width)


def _seen(points: TaxelPoints, variant: Variant, params: Array, profile: int) -> Array:
    """Slopes and coverage (m + 1, k, t), by the quickest way."""
    if variant.places is None:
        return points.seen(variant, params, profile)
    found = [variant.places.seen(float(x), float(y)) for x, y in params]
    return found[0] if len(found) == 1 else np.concatenate(found, axis=1)


def _first_pressure(readings: Readings, cover: Array) -> Array:
    """Pressures (k,) by the median of taxels that are well covered; of few, by least squares."""
    found = np.empty(len(cover))
    for i, c in enumerate(cover):
        well = readings.usable & (c > 0.5 * c.max())
        some = readings.force[well] / c[well]
        found[i] = float(np.sort(some)[len(some) // 2]) if len(some) > 4 else 0.0
        if not found[i] > 0:
            w = c * readings.squared_weights(0.0)
            found[i] = max(float(w @ readings.force), 1e-12) / max(float(w @ c), 1e-300)
    return found


def _tukey(squared: Array) -> Array:
    """Weights of squared misfits in sigma: 1 in the middle, 0 from 2 cuts on."""
    rest = np.maximum(1.0 - squared / (2 * CUT) ** 2, 0.0)
    return np.asarray(rest * rest)
