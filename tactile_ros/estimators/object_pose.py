"""Which known object lies on an array, and where: coverage templates, then least squares.

[4] recognises parts by their contour without training. Here templates of coverage find where to
begin, and robust least squares on soft coverage finish; taxels that fit to no pose (dead or stuck
ones that nobody marked) lose their weight. Nothing is learned: outlines and layout suffice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.coverage_model import (
    CLOSE,
    CUT,
    LEAST_WIDTH,
    MOST_WIDTH,
    PRIOR,
    WEAK,
    Fits,
    Readings,
    TaxelPoints,
    Variant,
    excess_of,
    first_pressure,
    misfit,
    pressure_of,
    seen_at,
)
from tactile_ros.estimators.coverage_templates import FEW_TAXELS, CoverageTemplates
from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.coverage import HALF_SPACE, SPRINGS
from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.coverage_model import (
        Fits,
        ModelError,
        Readings,
        TaxelPoints,
        Variant,
    )
    from tactile_ros.types import Array, Bools, Outline


@compiled
def added(stack: Array, share: Array, miss: Array, normal: Array, pull: Array) -> None:
    """Matrix (3, 3) and right side (3,) of least squares; both are filled."""
    normal[:] = 0.0
    pull[:] = 0.0
    for k in range(len(share)):
        for m in range(3):
            tall = stack[m, k] * share[k]
            pull[m] += tall * miss[k]
            for n in range(m + 1):
                normal[m, n] += tall * stack[n, k]
    for m in range(3):
        normal[m, m] += WEAK
        for n in range(m):
            normal[n, m] = normal[m, n]


@compiled
def inverse_of(a: Array, inverse: Array) -> None:
    """Inverse of a symmetric matrix (3, 3), by cofactors; it is filled."""
    p, q, r, s, t, u = a[0, 0], a[0, 1], a[0, 2], a[1, 1], a[1, 2], a[2, 2]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = s * u - t * t, p * u - r * r, p * s - q * q
    inverse[0, 1] = inverse[1, 0] = r * t - q * u
    inverse[0, 2] = inverse[2, 0] = q * t - r * s
    inverse[1, 2] = inverse[2, 1] = q * r - p * t
    inverse /= p * inverse[0, 0] + q * inverse[0, 1] + r * inverse[0, 2]


@compiled
def weighed(
    stack: Array, variance: Array, usable: Bools, squared: Array, edge: float, floor: float,
    rough: float, share: Array, weight: Array,
) -> None:  # fmt: skip
    """Weights (t,) of squared misfits, robust ones and such without what is rough; filled."""
    for k in range(len(share)):
        edges = edge * (stack[0, k] ** 2 + stack[1, k] ** 2) + floor
        near = usable[k] / (variance[k] + edges + rough**2)
        far = max(1.0 - squared[k] * near / (2 * CUT) ** 2, 0.0)
        share[k] = near * far * far
        weight[k] = usable[k] / (variance[k] + edges)


@compiled
def step_of(normal: Array, pull: Array, move: Array) -> None:
    """Step (3,) of least squares, none beyond 1; filled."""
    inverse = np.empty((3, 3))
    inverse_of(normal, inverse)
    for m in range(3):
        total = 0.0
        for n in range(3):
            total += inverse[m, n] * pull[n]
        move[m] = min(max(total, -1.0), 1.0)


@compiled
def descend_rows(
    rows: Array, side: int, low: Array, pitch: float, scale: float,
    force: Array, variance: Array, usable: Bools, top: float, count: int, least: float,
    found: Array, step: float, edge: float, floor: float, rounds: int, loose: Array, final: bool,
    stack: Array, share: Array, cover: Array, normal: Array,
) -> float:  # fmt: skip
    """Cost of a descent: `descend_places`; `found` (x, y, pressure) and what follows is filled."""
    miss, weight, pull, move = np.empty(len(force)), np.empty(len(force)), np.empty(3), np.empty(3)
    rough = 0.0
    for i in range(rounds):
        seen_at(rows, side, low, pitch, scale, found[0], found[1], stack)
        if i == 0:
            found[2] = pressure_of(force, variance, usable, stack[2])
        stack *= found[2]
        miss[:] = force - stack[2]
        squared = miss * miss
        rough = excess_of(squared, usable, count, least)
        if i < len(loose):
            rough = max(rough, loose[i] * top)
        weighed(stack, variance, usable, squared, edge, floor, rough, share, weight)
        added(stack, share, miss, normal, pull)
        step_of(normal, pull, move)
        found[0] += move[0] * step
        found[1] += move[1] * step
        found[2] *= max(1.0 + move[2], 0.3)
        if i >= len(loose) and max(abs(move[0]), abs(move[1])) < CLOSE:
            break
    cost = 0.0
    for k in range(len(force)):
        left = miss[k] - (move[0] * stack[0, k] + move[1] * stack[1, k] + move[2] * stack[2, k])
        near = weight[k] if final or not weight[k] else 1.0 / (1.0 / weight[k] + rough**2)
        cost += min(left * left * near, CUT**2)
        cover[k] = (force[k] - left) / found[2]
    return cost


def descend_places(
    variant: Variant, start: Array, readings: Readings, rounds: int, loose: Sequence[float],
    final: bool,
) -> Fits:  # fmt: skip
    """Descend with one variant from (x, y); see `Descent.run`."""
    places, step = variant.places, float(variant.unit[0])
    assert places is not None
    taxels = len(readings.force)
    stack, share, cover = np.empty((3, taxels)), np.empty(taxels), np.empty(taxels)
    found, normal = np.array([start[0], start[1], 0.0]), np.empty((3, 3))
    cost = descend_rows(
        places.rows, places.side, places.low, places.pitch, places.scale, readings.force,
        readings.variance, readings.usable, readings.top, readings.count, readings.least,
        found, step, places.error.edge, places.error.floor * readings.top**2, rounds,
        np.array(loose), final, stack, share, cover, normal,
    )  # fmt: skip
    return Fits(
        variant, 0, found[None, :2], found[2:], np.array([cost]), cover[None], normal[None],
        stack[:, None], share[None],
    )  # fmt: skip


BROKEN = 0.05  # of the taxels, which then read anything up to the largest force
UNIFORM = 12.0  # over the squared width of an even prior: what it knows


def log_evidence(
    fits: Fits, i: int, readings: Readings, error: ModelError, reach: float, scale: float
) -> float:
    """Logarithm of the probability density of the readings, of one mode of one object.

    Parameters
    ----------
    fits : Fits
        Descents.
    i : int
        Which of them.
    readings : Readings
        What was fitted.
    error : ModelError
        Of the model.
    reach : float
        Of the array: places are as likely everywhere on it (m).
    scale : float
        By which errors are larger than stated, squared.

    Returns
    -------
    float
        Up to a constant of the frame.
    """
    variant, slopes, pressure = fits.variant, fits.slopes[:, i], float(fits.pressure[i])
    unit, free = variant.unit, len(slopes) - 1
    wide = [2 * reach / unit[0], 2 * reach / unit[1]]
    if free > 2:
        wide.append(2 * math.pi / max(variant.order, 1) / unit[2])
    if free > 3:
        wide.append((MOST_WIDTH - LEAST_WIDTH) * variant.radius / unit[3])
    edges = error.edge * (slopes[0] ** 2 + slopes[1] ** 2) + error.floor * readings.top**2
    variance = scale * (readings.variance + edges)
    squared = np.square(readings.force - pressure * fits.cover[i]) / variance
    sound = (1 - BROKEN) * np.exp(-0.5 * squared) / np.sqrt(2 * math.pi * variance)
    told = sound + BROKEN / readings.top
    normal = (slopes * (readings.usable * sound / told / variance)) @ slopes.T
    normal += np.diag(np.append(UNIFORM / np.square(wide), 1.0))
    room = 0.5 * free * math.log(2 * math.pi) - 0.5 * float(np.linalg.slogdet(normal)[1])
    profiles = len(PROFILES) if variant.tube else 1
    told = float(np.log(told) @ readings.usable)
    return told + room - float(np.log(wide).sum()) - math.log(profiles)


def common_scale(cost: float, readings: Readings, free: int) -> float:
    """By how much errors are larger than stated, squared, as the best fit tells it; 1 at least."""
    spare = max(readings.count - free, 0)
    return max((cost + PRIOR) / (spare + PRIOR), 1.0)


@dataclass
class Fit:
    """One end of a descent: parameters, covariance (m, m), cost; the descents and which."""

    variant: Variant
    params: Array
    pressure: float
    cov: Array
    cost: float
    cover: Array
    fits: Fits
    index: int
    error: ModelError
    chance: float = 1.0


def fit_of(fits: Fits, i: int, readings: Readings, points: TaxelPoints) -> Fit:
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
        fits,
        i,
        error,
    )


def _covariance(fits: Fits, i: int, readings: Readings) -> Array:
    """Of parameters, half from misfits where they are, half from their common size."""
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
        self, points: TaxelPoints, variant: Variant, starts: Array, readings: Readings,
        rounds: int, loose: Sequence[float], profile: int = HALF_SPACE, final: bool = True,
    ) -> Fits:  # fmt: skip
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
        self, positions: Array, areas: Array, taxel_outlines: Sequence[Outline] | None,
        objects: Sequence[Outline],
    ) -> None:  # fmt: skip
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
