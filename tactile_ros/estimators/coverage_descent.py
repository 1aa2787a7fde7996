"""Robust least squares on soft coverage, from several starts at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.coverage_model import LEAST_WIDTH, MOST_WIDTH
from tactile_ros.estimators.place_descent import descend_places
from tactile_ros.estimators.readings import CLOSE, CUT, WEAK, Fits, first_pressure
from tactile_ros.physics.tubes import HALF_SPACE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.coverage_model import TaxelPoints, Variant
    from tactile_ros.estimators.readings import Readings
    from tactile_ros.types import Array

CENTRED = 0.3  # of the reach: how far from the middle the origin of a gripped tube lies


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
        if variant.places is not None:
            return descend_places(variant, starts[0], readings, rounds, loose, final)
        params = starts[:, : variant.free].copy()
        pressure = np.zeros(len(params))
        error = points.errors[variant.label]
        floor = error.floor * readings.top**2
        for i in range(rounds):
            stack = points.seen(variant, params, profile)
            if i == 0:
                pressure = np.array([first_pressure(readings, one) for one in stack[-1]])
            stack *= pressure[:, None]
            miss = readings.force - stack[-1]
            edges = error.edge * np.square(stack[:2]).sum(axis=0) + floor
            squared = np.square(miss)
            rough = np.array([[readings.excess(one)] for one in squared])
            if i < len(loose):
                rough = np.maximum(rough, loose[i] * readings.top)
            weight = readings.usable / (readings.variance + edges + np.square(rough))
            share = weight * _tukey(squared * weight)
            normal, step = self._solve(variant, params, stack, share, miss)
            move = np.minimum(np.maximum(step, -1.0), 1.0)
            _go(variant, params, pressure, move)
            if i >= len(loose) and np.abs(move[:, :-1]).max() < CLOSE:
                break
        miss = miss - (move.T[:, :, None] * stack).sum(axis=0)
        if final:
            weight = readings.usable / (readings.variance + edges)
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


def _tukey(squared: Array) -> Array:
    """Weights of squared misfits in sigma: 1 in the middle, 0 from 2 cuts on."""
    rest = np.maximum(1.0 - squared / (2 * CUT) ** 2, 0.0)
    return np.asarray(rest * rest)
