"""Which known object lies on an array, and where: coverage templates, then least squares.

[4] recognises parts by their contour without training. Here templates of coverage find where to
begin, and robust least squares on soft coverage finish; taxels that fit to no pose (dead or stuck
ones that nobody marked) lose their weight. Nothing is learned: outlines and layout suffice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.coverage_descent import Descent
from tactile_ros.estimators.coverage_model import TaxelPoints, Variant
from tactile_ros.estimators.coverage_templates import FEW_TAXELS, CoverageTemplates
from tactile_ros.estimators.place_rows import covariance_of
from tactile_ros.estimators.readings import CUT, PRIOR, Fits, Readings, misfit
from tactile_ros.physics import compiled
from tactile_ros.physics.tubes import SPRINGS
from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Outline

EARLY = {True: (6, (0.3, 0.2, 0.1, 0.06, 0.04, 0.03)), False: (2, (0.15, 0.04))}
LATE, LATE_TUBES = (8, (0.1,)), (25, ())
POLISH = (4, ())
RIM, INSIDE = (
    0.003,
    60,
)  # of a taxel: the others are wholly covered; some of which tell the pressure
FINALISTS = 4
PROFILES = (1, SPRINGS, 0)
APART = 0.05  # turns (rad) and places (steps) at which two descents have not met
EDGE = 0.001  # error of the model everywhere, in parts of the largest force
ALIKE = 0.03  # least error of a force under an object that may be none of these
ODD = 0.25  # of the taxels that may fit to no known object
SEEN = 10.0  # of the noise: weaker patterns are noise
PRESENT = 0.06  # of the largest force: less is no contact


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


@dataclass
class Fit:
    """One end of a descent: parameters, covariance (m, m), cost."""

    variant: Variant
    params: Array
    pressure: float
    cov: Array
    cost: float
    cover: Array


class ObjectPose(CoverageTemplates):
    """Objects on one array; parameters as of `CoverageTemplates`."""

    def __init__(
        self,
        positions: Array,
        areas: Array,
        taxel_outlines: Sequence[Outline] | None,
        objects: Sequence[Outline],
    ) -> None:
        super().__init__(positions, areas, taxel_outlines, objects)
        self.descent = Descent(self.middle, self.reach)
        for variant in self.variants[:1]:  # what is compiled is built now, not under a frame
            params = np.append(self.middle, (0.0, variant.radius / 2))[None, : variant.free]
            cover = self.points.cover(variant, params)[0]
            self.locate(cover, 1e-3 * areas, np.ones(len(areas), bool), 0.01)

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
            Error of laws, in parts of the force of a taxel.

        Returns
        -------
        Found
            Label -1 if there is none, or none of these.
        """
        y = np.maximum(force, 0.0) * usable
        ranked = np.sort(y)
        top = float(np.add.reduce(ranked[-3:])) / len(ranked[-3:])
        loud = np.count_nonzero(noise * SEEN < top)  # as if by the median, but quicker
        if 2 * loud <= len(noise) or not self.variants:
            return _nothing(y)
        starts = self.starts(y)
        if not len(starts):
            return _nothing(y)
        firm = ranked[int(ranked.searchsorted(PRESENT * top, 'right')) :]
        variance = noise * noise
        stated = variance + ((spread * y) ** 2 + (EDGE * top) ** 2)
        readings = Readings(y, stated, usable, top, len(firm))
        points, coarse, chosen = self.points, self.coarse, None
        if len(y) > FEW_TAXELS and points.size:
            chosen = self._around(starts)
            points = coarse = points.among(chosen)
            readings = Readings(y[chosen], stated[chosen], usable[chosen], top, len(firm))
        fits = self._finals(points, self._chosen_starts(coarse, starts, readings), readings)
        fits.sort(key=_cost)
        fits += self._mistaken(points, fits, readings)
        fits.sort(key=_cost)
        if chosen is not None:
            for fit in fits:
                cover = np.zeros(len(y))
                cover[chosen] = fit.cover
                fit.cover = cover
            self._polish(fits[0], Readings(y, stated, usable, top, len(firm)))
        alike = max(spread, ALIKE) * float(firm[int(0.7 * (len(firm) - 1))])
        rough = usable / (variance + alike**2)
        return self._verdict(fits, y, rough, PRESENT * top)

    def _around(self, starts: Array) -> Integers:
        """Taxels that any of the starts may touch."""
        near = np.zeros(len(self.areas), bool)
        for index, x, y in starts[:, :3]:
            span = self.variants[int(index)].span + 4 * self.step
            near |= np.square(self.centres[:, 0] - x) + np.square(self.centres[:, 1] - y) < span**2
        return np.flatnonzero(near)

    def _chosen_starts(
        self, points: TaxelPoints, starts: Array, readings: Readings
    ) -> list[tuple[Variant, Array]]:
        """The likeliest few after a short descent, each (variant, params)."""
        if len(starts) == 1 and not self.tubes:
            return [(self.variants[int(starts[0, 0])], starts[0, 1:])]
        rounds, loose = EARLY[self.tubes]
        ends = []
        for index in np.unique(starts[:, 0]):
            variant = self.variants[int(index)]
            some = starts[starts[:, 0] == index, 1:]
            fits = self.descent.run(points, variant, some, readings, rounds, loose, final=False)
            ends += [
                (float(cost), variant, params)
                for cost, params in zip(fits.cost, fits.params, strict=True)
            ]
        ends.sort(key=lambda end: end[0])
        taken: list[tuple[Variant, Array]] = []
        for cost, variant, params in ends:
            if cost > 3 * ends[0][0] + 60 or len(taken) == FINALISTS:
                break
            if all(variant is not other or self._differ(params, seen) for other, seen in taken):
                taken.append((variant, params))
        return taken

    def _differ(self, params: Array, other: Array) -> bool:
        """Whether two descents have not met."""
        away = np.abs(params[:2] - other[:2]).max() / self.step
        turn = abs(np.sin((params[2] - other[2]) / 2)) if len(params) > 2 else 0.0
        return bool(away > APART or turn > APART / 2)

    def _finals(
        self, points: TaxelPoints, starts: list[tuple[Variant, Array]], readings: Readings
    ) -> list[Fit]:
        """Descents to the end, for tubes with every profile of contact."""
        if len(starts) == 1 and not starts[0][0].tube:
            fits = self.descent.run(points, starts[0][0], starts[0][1][None], readings, *LATE)
            return [self._fit(fits, 0, readings, points)]
        found = []
        for variant in {id(variant): variant for variant, _ in starts}.values():
            params = np.array([params for other, params in starts if other is variant])
            if not variant.tube:
                fits = self.descent.run(points, variant, params, readings, *LATE)
                found += [self._fit(fits, i, readings, points) for i in range(len(params))]
                continue
            ends: list[tuple[float, int, Array]] = []
            for profile in PROFILES:
                rough = self.descent.run(
                    self.coarse, variant, params, readings, *LATE_TUBES, profile
                )
                costs = zip(rough.cost.tolist(), rough.params, strict=True)
                ends += [(cost, profile, end) for cost, end in costs]
            # the best of each profile, since few points tell them apart badly, and others
            ends.sort(key=lambda end: end[0])
            first = {profile: i for i, (_, profile, _) in reversed(list(enumerate(ends)))}
            order = sorted(range(len(ends)), key=lambda i: (i not in first.values(), i))
            for _, profile, end in (ends[i] for i in order[: FINALISTS + 1]):
                fits = self.descent.run(points, variant, end[None], readings, *LATE_TUBES, profile)
                found.append(self._fit(fits, 0, readings, points))
        return found

    def _mistaken(self, points: TaxelPoints, fits: list[Fit], readings: Readings) -> list[Fit]:
        """Descents from where the best fit may be mistaken: no start may have led there."""
        best, variant = fits[0], fits[0].variant
        if not len(variant.turns):
            return []
        x, y, yaw = best.params
        turned = yaw + variant.turns
        cx, cy = variant.centre
        x += (np.cos(yaw) - np.cos(turned)) * cx - (np.sin(yaw) - np.sin(turned)) * cy
        y += (np.sin(yaw) - np.sin(turned)) * cx + (np.cos(yaw) - np.cos(turned)) * cy
        starts = np.column_stack([x, y, turned])
        ends = self.descent.run(points, variant, starts, readings, *LATE)
        seen = [fit.params for fit in fits if fit.variant is variant]
        found = []
        for i, params in enumerate(ends.params):
            if all(self._differ(params, other) for other in seen):
                found.append(self._fit(ends, i, readings, points))
                seen.append(params)
        return found

    def _polish(self, fit: Fit, readings: Readings) -> None:
        """Place once more by taxels under edges, with more points of each; `fit` is changed."""
        if self.fine is None or not self.fine.size or fit.variant.tube:
            return
        sharp = self.sharp[fit.variant.label]
        part = fit.cover / self.areas
        inside = np.flatnonzero(part > 1 - RIM)
        edges = np.flatnonzero((part > RIM) & (part < 1 - RIM))
        some = np.concatenate([edges, inside[:: max(len(inside) // INSIDE, 1)]])
        seen = Readings(
            readings.force[some], readings.variance[some], readings.usable[some], readings.top,
            len(some),
        )  # fmt: skip
        fits = self.descent.run(self.fine.among(some), sharp, fit.params[None], seen, *POLISH)
        better = self._fit(fits, 0, seen, self.fine)
        if np.abs(better.params - fit.params)[:2].max() < APART * self.step:
            fit.params, fit.cov = better.params, better.cov

    def _fit(self, fits: Fits, i: int, readings: Readings, points: TaxelPoints) -> Fit:
        """One of the descents, with the covariance of its parameters."""
        free, places = fits.params.shape[1], fits.variant.places
        unit = fits.variant.unit[:free]
        error = points.errors[fits.variant.label] if places is None else places.error
        cov = _covariance(fits, i, readings)[:free, :free] * (unit[:, None] * unit)
        cov.reshape(-1)[:: free + 1] += np.square(error.shared * unit)
        return Fit(
            fits.variant,
            fits.params[i],
            float(fits.pressure[i]),
            cov,
            float(fits.cost[i]),
            fits.cover[i],
        )

    def _verdict(self, fits: list[Fit], y: Array, weight: Array, present: float) -> Found:
        """The best of the fits, if it is better than none of these."""
        best = fits[0]
        count, far, total = misfit(y, best.cover, best.pressure, weight, present)
        most = (CUT**2 * ODD + 1.0) * count + 2 * CUT**2
        if far > max(3, ODD * count) or total > most:
            return _nothing(y)
        if len(fits) == 1:
            return self._found(best, fits, [1.0], 1.0)
        scale = max(best.cost / max(count - len(best.params), 1), 1.0)
        likely = [float(np.exp(0.5 * (best.cost - fit.cost) / scale)) for fit in fits]
        each: dict[int, float] = {}
        for fit, part in zip(fits, likely, strict=True):
            each[fit.variant.label] = max(part, each.get(fit.variant.label, 0.0))
        chance = 1.0 / sum(each.values())
        if chance < 0.5:
            return _nothing(y)
        return self._found(best, fits, likely, chance)

    @staticmethod
    def _found(best: Fit, fits: list[Fit], likely: list[float], chance: float) -> Found:
        """What the best fit says, and how far others that are about as likely lie from it."""
        variant, free = best.variant, min(len(best.params), 3)
        cov, pose = np.zeros((3, 3)), np.zeros(3)
        pose[:free] = best.params[:free]
        cov[:free, :free] = best.cov[:free, :free]
        sector = 2 * np.pi / max(variant.order, 1)
        same = [
            (fit, part) for fit, part in zip(fits, likely, strict=True) if fit.variant is variant
        ]
        total = sum(part for _, part in same)
        for fit, part in same[1:]:
            away = fit.params[:free] - best.params[:free]
            if free == 3:
                away[2] -= sector * np.round(away[2] / sector)
            cov[:free, :free] += part / total * np.outer(away, away)
        if free == 2:
            cov[2, 2] = np.pi**2 / 3
        else:
            pose[2] -= sector * np.round(pose[2] / sector)
        return Found(variant.label, chance, pose, cov, variant.order, best.cover, best.pressure)


def _nothing(force: Array) -> Found:
    """None of these."""
    return Found(-1, np.nan, np.full(3, np.nan), np.full((3, 3), np.nan), -1, force, 0.0)


def _cost(fit: Fit) -> float:
    """Of a fit."""
    return fit.cost


def _covariance(fits: Fits, i: int, readings: Readings) -> Array:
    """Of parameters, half from misfits where they are, half from their common size."""
    if compiled.available() and fits.variant.places is not None:
        return covariance_of(
            fits.normal[i], fits.slopes[:, i], fits.share[i], readings.force, fits.cover[i],
            float(fits.pressure[i]),
        )  # fmt: skip
    inverse = np.linalg.inv(fits.normal[i])
    share, j = fits.share[i], fits.slopes[:, i]
    miss = readings.force - fits.pressure[i] * fits.cover[i]
    excess = share * np.square(miss)
    size = np.abs(j).max(axis=0)
    told = int(np.count_nonzero((size > 1e-3 * size.max()) & (share > 0)))
    spare = max(told - len(inverse), 0)
    common = min(max((float(excess.sum()) + PRIOR) / (spare + PRIOR), 0.1), 9.0)
    if spare < 12:
        return np.asarray(inverse * common)
    part = (j * (share * excess)) @ j.T * (told / spare)
    return np.asarray(0.5 * inverse * common + 0.5 * inverse @ part @ inverse)
