"""Which known object lies on an array, and where: coverage templates, then least squares.

[4] recognises parts by their contour without training. Here templates of coverage find where to
begin, and robust least squares on soft coverage finish; taxels that fit to no pose (dead or stuck
ones that nobody marked) lose their weight. Nothing is learned: outlines and layout suffice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.estimators.coverage_templates import CoverageTemplates
from tactile_ros.types import Array, Bools, Integers

ROUNDS = 6
CUT = 3.0  # sigma at which a taxel's misfit stops to count
LOOSE = 3.0  # times wider at first
ROUGH = 0.008  # error of edges, which all have in common, in radii of a point's part
CENTRED = 0.4  # of the reach: how far from the middle the origin of a gripped tube lies
CLOSE = 0.01  # of a step's limit: what is left to go needs no other round
ODD = 0.25  # of the taxels that may fit to no known object
SEEN = 10.0  # of the noise: weaker patterns are noise
PRESENT = 0.06  # of the largest force: less is no contact


@dataclass
class Fit:
    """Pose (x, y, yaw), pressure, covariance and cost of one variant."""

    variant: int
    pose: Array
    pressure: float
    cov: Array
    cost: float
    cover: Array


@dataclass(frozen=True)
class Found:
    """What was recognised: label -1 none of these, pose (x, y, yaw) and its covariance (3, 3)."""

    label: int
    probability: float
    pose: Array
    cov: Array
    order: int
    cover: Array
    pressure: float


class ObjectPose(CoverageTemplates):
    """Objects on one array; parameters as of `CoverageTemplates`."""

    def locate(self, force: Array, noise: Array, usable: Bools, spread: float) -> Found:
        """Recognise and place the object under one frame.

        Parameters
        ----------
        force : ndarray, shape (t,)
            Of each taxel (any unit).
        noise : ndarray, shape (t,)
            Its standard deviation.
        usable : ndarray, shape (t,)
            False: dead or unknown.
        spread : float
            Error of laws and model, in parts of the force of a taxel that is covered.

        Returns
        -------
        Found
            Label -1 if there is none, or none of these.
        """
        y = np.where(usable & (force > 0), force, 0.0)
        top = float(np.sort(y)[-3:].mean()) if len(y) > 2 else float(y.max(initial=0.0))
        nothing = Found(-1, np.nan, np.full(3, np.nan), np.full((3, 3), np.nan), -1, y, 0.0)
        if top <= SEEN * float(np.median(noise)) or not self.variants:
            return nothing
        starts = self.starts(y)
        if not len(starts):
            return nothing
        sigma = np.sqrt(noise**2 + (spread * np.quantile(y[y > PRESENT * top], 0.7)) ** 2)
        weight = np.where(usable, 1.0 / sigma, 0.0)
        early = 5 if self.tubes else 2
        fits = [self._polish(y, weight, start, early, LOOSE) for start in starts]
        fits.sort(key=_cost)
        finalists = [fit for fit in fits[:3] if fit.cost < 3 * fits[0].cost + 60]
        fits = [
            self._polish(y, weight, np.append(fit.variant, fit.pose), ROUNDS, 1.0)
            for fit in finalists
        ]
        return self._verdict(fits, y, weight, PRESENT * top, nothing)

    def _polish(self, y: Array, weight: Array, start: Array, rounds: int, loose: float) -> Fit:
        """Robust least squares from a start, in steps of a taxel, a radian, and parts of 1."""
        index, pose, width = int(start[0]), start[1:4].copy(), float(start[4])
        variant = self.variants[index]
        free = 2 if variant.order == 0 else 3
        unit = np.array([self.step, self.step, self.step / variant.table.gyration])[:free]
        count = free + 1 + (len(variant.tables) > 1)
        centred, hold = np.zeros(count), np.full(count, 1e-4)
        if self.tubes:
            hold[:2] = (self.step / (CENTRED * self.reach)) ** 2
        pressure = 0.0
        for i in range(rounds):
            cover, slopes, wider = self.seen(variant, pose, width)
            c = cover * self.areas
            if i == 0:
                pressure = self._first_pressure(y, c, weight)
            miss = y - pressure * c
            w = _tukey(miss * weight, CUT * loose * (2.0 if i == 0 else 1.0)) * weight**2
            j = np.empty((len(c), count))
            j[:, :free] = (pressure * self.areas)[:, None] * slopes[:, :free] * unit
            j[:, free] = pressure * c
            if len(wider):
                j[:, -1] = pressure * self.areas * wider
            centred[:2] = (self.middle - pose[:2]) / self.step if self.tubes else 0.0
            gram = (j * w[:, None]).T @ j + np.diag(hold)
            step = np.linalg.solve(gram, j.T @ (w * miss) + hold * centred)
            move = np.clip(step[:free], -1.0, 1.0)
            pose[:free] += move * unit
            pressure *= float(np.clip(1 + step[free], 0.3, 3.0))
            if len(wider):
                change = float(np.clip(step[-1], -1.0, 1.0))
                width = float(np.clip(width + change, 0.0, len(variant.tables) - 1.0))
            if np.all(np.abs(move) < CLOSE):
                break
        cov = _covariance(gram, j, w, miss, weight)[:free, :free] * np.outer(unit, unit)
        cov[np.diag_indices(free)] += np.square(ROUGH * self.blur / self.step * unit)
        c = c + self.areas * (slopes[:, :free] @ (move * unit))
        if len(wider):
            c = c + self.areas * wider * change
        excess = (y - pressure * c) * weight
        cost = float(np.minimum(excess**2, CUT**2 * loose**2).sum())
        if self.tubes:
            cost += float(np.square(pose[:2] - self.middle).sum() / (CENTRED * self.reach) ** 2)
        return Fit(index, np.append(pose, width), pressure, cov, cost, c)

    @staticmethod
    def _first_pressure(y: Array, c: Array, weight: Array) -> float:
        """Median pressure of taxels that are well covered; of few, by least squares."""
        well = (weight > 0) & (c > 0.5 * c.max(initial=0.0))
        if np.count_nonzero(well) > 4:
            pressure = float(np.median(y[well] / c[well]))
            if pressure > 0:
                return pressure
        w = weight**2
        return max(float((w * c) @ y), 1e-12) / max(float((w * c) @ c), 1e-300)

    def _verdict(
        self, fits: list[Fit], y: Array, weight: Array, present: float, nothing: Found
    ) -> Found:
        """The best of the fits, if it is better than none of these."""
        fits.sort(key=_cost)
        best = fits[0]
        told = (weight > 0) & ((y > present) | (best.pressure * best.cover > present))
        count = int(np.sum(told))
        wrong = np.abs(y - best.pressure * best.cover)[told] * weight[told]
        scale = float(np.clip(1.4826 * np.median(wrong), 1.0, 3.0)) ** 2 if count else 1.0
        if count > 6 and scale > 1:
            excess = np.square(wrong)[wrong < CUT * float(np.sqrt(scale))]
            scale = max(scale, float(excess.mean()) if len(excess) else 1.0)
        labels = np.array([self.variants[fit.variant].label for fit in fits])
        costs = np.array([fit.cost / scale for fit in fits])
        none = (CUT**2 * ODD + 1.0) * count + 2 * CUT**2
        worst = np.count_nonzero(wrong > 2 * CUT) > max(3, ODD * count)
        likely = np.exp(-0.5 * np.append(costs - costs[0], max(none - costs[0], -60.0)))
        chance = float(likely[:-1][labels == labels[0]].max() / _classes(labels, likely))
        if worst or chance < 0.5 or likely[-1] > 1:
            return nothing
        variant = self.variants[best.variant]
        cov = np.zeros((3, 3))
        free = len(best.cov)
        cov[:free, :free] = best.cov
        pose = best.pose[:3].copy()
        if free == 2:
            pose[2], cov[2, 2] = 0.0, np.pi**2 / 3
        else:
            sector = 2 * np.pi / variant.order
            pose[2] -= sector * np.round(pose[2] / sector)
        return Found(variant.label, chance, pose, cov, variant.order, best.cover, best.pressure)


def _cost(fit: Fit) -> float:
    """Of a fit."""
    return fit.cost


def _covariance(gram: Array, j: Array, w: Array, miss: Array, weight: Array) -> Array:
    """Of parameters, half from misfits where they are, half from their common size."""
    inverse = np.linalg.inv(gram)
    excess = w * np.square(miss)
    size = np.abs(j).max(axis=1)
    told = int(np.sum((size > 1e-3 * size.max()) & (w > 0)))
    spare = max(told - len(gram), 0)
    common = float(np.clip((excess.sum() + 0.5) / (spare + 0.5), 0.003, 9.0))
    if spare < 12:
        return np.asarray(inverse * common)
    part = (j * (w * w * np.square(miss))[:, None]).T @ j * (told / spare)
    return np.asarray(0.5 * inverse * common + 0.5 * inverse @ part @ inverse)


def _classes(labels: Integers, likely: Array) -> float:
    """Sum over labels of the likelihood of the best fit of each, with that of none."""
    each = [likely[:-1][labels == label].max() for label in np.unique(labels)]
    return float(sum(each) + likely[-1])


def _tukey(excess: Array, cut: float) -> Array:
    """Weights (t,) of misfits in sigma: 1 in the middle, 0 from 2 cuts on."""
    part = np.minimum(np.square(excess / (2 * cut)), 1.0)
    return np.asarray(np.square(1.0 - part))
