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
from tactile_ros.estimators.pose_evidence import common_scale, log_evidence
from tactile_ros.estimators.pose_fit import Fit, fit_of
from tactile_ros.estimators.readings import CUT, Readings, misfit
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
ALIKE = 0.03  # least error of a force under an object that may be none of these
ODD = 0.25  # of the taxels that may fit to no known object
SEEN = 10.0  # of the noise: weaker patterns are noise
PRESENT = 0.06  # of the largest force: less is no contact


@dataclass(frozen=True)
class Found:
    """What was recognised: label -1 none of these, pose (x, y, yaw) and its covariance (3, 3).

    `unsure` is the error of a covered area, in parts of the largest.
    """

    label: int
    probability: float
    pose: Array
    cov: Array
    order: int
    cover: Array
    pressure: float
    unsure: float


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

    def locate(self, force: Array, noise: Array, usable: Bools, spread: float | Array) -> Found:
        """Recognise and place the object under one frame.

        Parameters
        ----------
        force : ndarray, shape (t,)
            Of each taxel (any unit).
        noise : ndarray, shape (t,)
            Its standard deviation.
        usable : ndarray, shape (t,)
            False: dead or unknown.
        spread : float or ndarray, shape (t,)
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
        stated = variance + (spread * y) ** 2
        readings = Readings(y, stated, usable, top, len(firm))
        points, coarse, chosen = self.points, self.coarse, None
        if len(y) > FEW_TAXELS and points.size:
            chosen = self._around(starts)
            points = coarse = points.among(chosen)
            readings = Readings(y[chosen], stated[chosen], usable[chosen], top, len(firm))
        fits = self._finals(points, self._chosen_starts(coarse, starts, readings), readings)
        fits.sort(key=_cost)
        fits += self._mistaken(points, fits, readings)
        if len(fits) > 1:
            fits = self._ranked(fits, readings)
        if chosen is not None:
            for fit in fits:
                cover = np.zeros(len(y))
                cover[chosen] = fit.cover
                fit.cover = cover
            self._polish(fits[0], Readings(y, stated, usable, top, len(firm)))
        alike = max(float(np.min(spread)), ALIKE) * float(firm[int(0.7 * (len(firm) - 1))])
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
            return [fit_of(fits, 0, readings, points)]
        found = []
        for variant in {id(variant): variant for variant, _ in starts}.values():
            params = np.array([params for other, params in starts if other is variant])
            if not variant.tube:
                fits = self.descent.run(points, variant, params, readings, *LATE)
                found += [fit_of(fits, i, readings, points) for i in range(len(params))]
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
                found.append(fit_of(fits, 0, readings, points))
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
                found.append(fit_of(ends, i, readings, points))
                seen.append(params)
        return found

    def _ranked(self, fits: list[Fit], readings: Readings) -> list[Fit]:
        """Different ones, those of the likeliest object first, each with its chance."""
        kept: list[Fit] = []
        for fit in fits:
            if not any(self._alike(fit, other) for other in kept):
                kept.append(fit)
        best = min(kept, key=_cost)
        scale = common_scale(best.cost, readings, len(best.params) + 1)
        told = [
            log_evidence(fit.fits, fit.index, readings, fit.error, self.reach, scale)
            for fit in kept
        ]
        parts = np.exp(np.array(told) - max(told))
        of_label = dict.fromkeys((fit.variant.label for fit in kept), 0.0)
        for fit, part in zip(kept, parts / parts.sum(), strict=True):
            fit.chance = float(part)
            of_label[fit.variant.label] += fit.chance
        kept.sort(key=lambda fit: (-of_label[fit.variant.label], -fit.chance))
        return kept

    def _alike(self, fit: Fit, other: Fit) -> bool:
        """Whether two descents have come to the same."""
        same = fit.variant is other.variant and fit.fits.profile == other.fits.profile
        return same and not self._differ(fit.params, other.params)

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
        better = fit_of(fits, 0, seen, self.fine)
        if np.abs(better.params - fit.params)[:2].max() < APART * self.step:
            fit.params, fit.cov = better.params, better.cov

    def _verdict(self, fits: list[Fit], y: Array, weight: Array, present: float) -> Found:
        """The best of the fits, if it is better than none of these."""
        best = fits[0]
        count, far, total = misfit(y, best.cover, best.pressure, weight, present)
        most = (CUT**2 * ODD + 1.0) * count + 2 * CUT**2
        if far > max(3, ODD * count) or total > most:
            return _nothing(y)
        if len(fits) == 1:
            return self._found(best, fits, 1.0)
        chance = sum(fit.chance for fit in fits if fit.variant is best.variant)
        if chance < 0.5:
            return _nothing(y)
        return self._found(best, fits, chance)

    @staticmethod
    def _found(best: Fit, fits: list[Fit], chance: float) -> Found:
        """What the best fit says, and how far others that are about as likely lie from it."""
        variant, free = best.variant, min(len(best.params), 3)
        cov, pose = np.zeros((3, 3)), np.zeros(3)
        pose[:free] = best.params[:free]
        cov[:free, :free] = best.cov[:free, :free]
        sector = 2 * np.pi / max(variant.order, 1)
        for fit in (fit for fit in fits[1:] if fit.variant is variant):
            away = fit.params[:free] - best.params[:free]
            if free == 3:
                away[2] -= sector * np.round(away[2] / sector)
            cov[:free, :free] += fit.chance / chance * np.outer(away, away)
        if free == 2:
            cov[2, 2] = np.pi**2 / 3
        else:
            pose[2] -= sector * np.round(pose[2] / sector)
        unsure = float(np.sqrt(best.error.floor))
        return Found(
            variant.label, chance, pose, cov, variant.order, best.cover, best.pressure, unsure
        )


def _nothing(force: Array) -> Found:
    """None of these."""
    return Found(-1, np.nan, np.full(3, np.nan), np.full((3, 3), np.nan), -1, force, 0.0, np.nan)


def _cost(fit: Fit) -> float:
    """Of a fit."""
    return fit.cost
