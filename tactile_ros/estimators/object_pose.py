"""Which known object lies on an array, and where: coverage templates, then least squares.

[4] recognises parts by their contour without training. Here templates of coverage find where to
begin, and robust least squares on soft coverage finish; taxels that fit to no pose (dead or stuck
ones that nobody marked) lose their weight. Nothing is learned: outlines and layout suffice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.coverage import CoverageTable, symmetry, taxel_points
from tactile_ros.types import Array, Bools, Integers, Outline

if TYPE_CHECKING:
    from collections.abc import Sequence

POINTS = 1300  # of all taxels together, about
FEW_TAXELS = 200  # up to which templates are kept for every place
TEMPLATES = 24_000  # as many again for every object that is a tube
WIDTHS = (0.2, 0.3, 0.4, 0.5, 0.62, 0.78, 0.95)  # of a tube's contact, in radii
ROUNDS = 6
CUT = 3.0  # sigma at which a taxel's misfit stops to count
LOOSE = 3.0  # times wider at first
NEAR = 0.35  # beyond the best score: starts that are worth a closer look
MOST_STARTS = 4
ROUGH = 0.011  # error of edges, which all have in common, in radii of a point's part
MOST_OF_TUBES = 12
CENTRED = 0.4  # of the reach: how far from the middle the origin of a gripped tube lies
CLOSER = 150  # templates whose misfit is looked at taxel by taxel
CLOSE = 0.01  # of a step's limit: what is left to go needs no other round
ODD = 0.25  # of the taxels that may fit to no known object
PRESENT = 0.06  # of the largest force: less is no contact


@dataclass
class Variant:
    """One object; a tube has a table for each of some widths of its contact."""

    label: int
    order: int
    tables: tuple[CoverageTable, ...]

    @property
    def table(self) -> CoverageTable:
        """Of the middle width."""
        return self.tables[len(self.tables) // 2]


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


class ObjectPose:
    """Objects on one array.

    Parameters
    ----------
    positions, areas : ndarray, shape (t, 3) and (t,)
        Centres (m) and areas (m2) of the taxels.
    taxel_outlines : sequence of Outline, or None
        Their shapes; None: squares.
    objects : sequence of Outline
        What may lie there; a label is an index into them.
    """

    def __init__(
        self,
        positions: Array,
        areas: Array,
        taxel_outlines: Sequence[Outline] | None,
        objects: Sequence[Outline],
    ) -> None:
        count = int(np.clip(POINTS // len(positions), 1, 64))
        points, self.first, self.blur = taxel_points(positions, areas, taxel_outlines, count)
        self.x, self.y = points.T.copy()
        self.sizes = np.diff(np.append(self.first, len(points)))
        self.areas = areas
        self.middle = positions[:, :2].mean(axis=0)
        self.centres = positions[:, :2]
        self.reach = float(np.linalg.norm(points - self.middle, axis=1).max()) + 2 * self.blur
        self.step = float(np.sqrt(np.median(areas)))
        self.variants = [
            _variant(label, outline, self.blur, 2 * self.reach)
            for label, outline in enumerate(objects)
        ]
        self.tubes = any(outline.bend is not None for outline in objects)
        self.bank = self._bank() if len(positions) <= FEW_TAXELS else None

    # ------------------------------------------------------------ forward

    def coverage(self, table: CoverageTable, pose: Array) -> tuple[Array, Array]:
        """Covered part of each taxel (t,), and its change with x, y, yaw (t, 3)."""
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        dx, dy = self.x - pose[0], self.y - pose[1]
        u, v = cos * dx + sin * dy, cos * dy - sin * dx
        value, gu, gv = table.at(u, v)
        stack = np.empty((4, len(value)))
        stack[0] = value
        stack[1] = sin * gv - cos * gu
        stack[2] = -sin * gu - cos * gv
        stack[3] = gu * v - gv * u
        means = np.add.reduceat(stack, self.first, axis=1) / self.sizes
        return means[0], means[1:].T

    def _bank(self) -> tuple[Array, Array, Array]:
        """Templates of unit length (n, t), their variants and poses (n, 4), centroids (n, 2)."""
        rows, what = [], []
        for i, variant in enumerate(self.variants):
            for width in range(1, len(variant.tables), 2) if len(variant.tables) > 1 else (0,):
                for pose in self._places(variant):
                    rows.append(self._quick(variant.tables[width], pose))
                    what.append([i, *pose, width])
        cover = np.array(rows) * self.areas
        length = np.linalg.norm(cover, axis=1)
        total = np.maximum(cover.sum(axis=1), 1e-30)
        keep = length > 0.2 * self.areas.mean()
        unit = (cover[keep] / length[keep, None]).astype(np.float32)
        centroid = (cover @ self.centres / total[:, None])[keep]
        return unit, np.array(what)[keep], centroid

    def _places(self, variant: Variant) -> Array:
        """Poses (n, 3) of templates."""
        turns = self._turns(variant)
        most = TEMPLATES // len(turns) // (3 if self.tubes else len(self.variants))
        span = (0.4 if self.tubes else 0.85) * self.reach
        side = min(int(np.sqrt(most)), int(np.ceil(2 * self.reach / (0.3 * self.step))))
        line = np.linspace(-span, span, max(side, 5))
        x, y, yaw = np.meshgrid(line, line, turns, indexing='ij')
        return np.stack([self.middle[0] + x, self.middle[1] + y, yaw], axis=-1).reshape(-1, 3)

    def _quick(self, table: CoverageTable, pose: Array) -> Array:
        """Covered part of each taxel (t,)."""
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        dx, dy = self.x - pose[0], self.y - pose[1]
        value, _, _ = table.at(cos * dx + sin * dy, cos * dy - sin * dx)
        return np.asarray(np.add.reduceat(value, self.first) / self.sizes)

    def _turns(self, variant: Variant) -> Array:
        """Turns that templates need: the rim moves by less than a taxel from one to the next."""
        if variant.order == 0:
            return np.zeros(1)
        sector = 2 * np.pi / variant.order
        count = int(np.clip(sector * variant.table.gyration / (0.5 * self.step), 6, 36))
        return sector * np.arange(count) / count

    # ------------------------------------------------------------ inverse

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
        if top <= 0 or not self.variants:
            return nothing
        starts = self._starts(y)
        if not len(starts):
            return nothing
        sigma = np.sqrt(noise**2 + (spread * np.quantile(y[y > PRESENT * top], 0.7)) ** 2)
        weight = np.where(usable, 1.0 / sigma, 0.0)
        early = 5 if self.tubes else 2
        fits = [self._polish(y, weight, start, early, LOOSE) for start in starts]
        fits.sort(key=lambda fit: fit.cost)
        finalists = [fit for fit in fits[:3] if fit.cost < 3 * fits[0].cost + 60]
        fits = [
            self._polish(y, weight, np.append(fit.variant, fit.pose), ROUNDS, 1.0)
            for fit in finalists
        ]
        return self._verdict(fits, y, weight, PRESENT * top, nothing)

    def _starts(self, y: Array) -> Array:
        """Variant and pose (n, 4) from where least squares may begin."""
        if self.bank is None:
            return self._aligned(y)
        unit, what, centroid = self.bank
        middle = y @ self.centres / y.sum()
        close = np.flatnonzero(
            np.square(centroid - middle).sum(axis=1) < (0.16 * self.reach + 0.5 * self.step) ** 2
        )
        shape = (y / np.linalg.norm(y)).astype(np.float32)
        scores = unit[close] @ shape
        if not len(close) or scores.max() < 0.85:
            close = np.arange(len(what))
            scores = unit @ shape
        if len(close) > CLOSER:
            first = np.argpartition(-scores, CLOSER)[:CLOSER]
            close, scores = close[first], scores[first]
        near = unit[close]
        # bad taxels count once in sums of misfits, and squared in products
        misfit = np.abs(scores[:, None] * near - shape).sum(axis=1)
        return self._chosen(what[close], np.asarray(-misfit / misfit.min(), np.float64))

    def _chosen(self, what: Array, scores: Array) -> Array:
        """The best few that differ in variant, or in turn."""
        if not len(scores):
            return what
        order = np.argsort(-scores)[:400]
        order = order[scores[order] > scores[order[0]] - (3 * NEAR if self.tubes else NEAR)]
        taken: list[int] = []
        for i in order:
            same = [j for j in taken if what[j, 0] == what[i, 0]]
            turn = 0.12 if self.tubes else 0.35
            if all(abs(np.sin((what[j, 3] - what[i, 3]) / 2)) > turn for j in same):
                taken.append(int(i))
            if len(taken) == (MOST_OF_TUBES if self.tubes else MOST_STARTS):
                break
        return what[taken]

    def _aligned(self, y: Array) -> Array:
        """Starts with the centroid of the force on that of the object, for many taxels."""
        active = np.flatnonzero(y > 0.25 * y.max())
        active = active[:: max(len(active) // 250, 1)]
        load, places = y[active], self.centres[active]
        middle = y @ self.centres / y.sum()
        found, scores = [], []
        for i, variant in enumerate(self.variants):
            turns = self._turns(variant)
            cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
            away = places - middle
            u = cos * away[:, 0] + sin * away[:, 1] + variant.table.centre[0]
            v = cos * away[:, 1] - sin * away[:, 0] + variant.table.centre[1]
            value = variant.table.at(u, v)[0]
            scores.append(value @ load / np.sqrt(variant.table.squared))
            cx, cy = variant.table.centre
            wide = np.full(len(turns), len(variant.tables) // 2)
            x = middle[0] - np.cos(turns) * cx + np.sin(turns) * cy
            z = middle[1] - np.sin(turns) * cx - np.cos(turns) * cy
            found.append(np.column_stack([np.full(len(turns), i), x, z, turns, wide]))
        score = np.concatenate(scores)
        return self._chosen(np.concatenate(found), 6 * score / score.max())

    def _seen(self, variant: Variant, pose: Array, width: float) -> tuple[Array, Array, Array]:
        """Coverage (t,), its change with the pose (t, 3) and with the width of a tube (t,)."""
        if len(variant.tables) == 1:
            cover, slopes = self.coverage(variant.tables[0], pose)
            return cover, slopes, np.zeros(0)
        k = min(int(width), len(variant.tables) - 2)
        part = width - k
        low, low_slopes = self.coverage(variant.tables[k], pose)
        high, high_slopes = self.coverage(variant.tables[k + 1], pose)
        cover = (1 - part) * low + part * high
        return cover, (1 - part) * low_slopes + part * high_slopes, high - low

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
            cover, slopes, wider = self._seen(variant, pose, width)
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
        fits.sort(key=lambda fit: fit.cost)
        best = fits[0]
        told = (weight > 0) & ((y > present) | (best.pressure * best.cover > present))
        count = int(np.count_nonzero(told))
        wrong = np.abs(y - best.pressure * best.cover)[told] * weight[told]
        scale = float(np.clip(1.4826 * np.median(wrong), 1.0, 3.0)) ** 2 if count else 1.0
        if count > 6 and scale > 1:
            excess = np.square(wrong)[wrong < CUT * np.sqrt(scale)]
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


def _covariance(gram: Array, j: Array, w: Array, miss: Array, weight: Array) -> Array:
    """Of parameters, half from misfits where they are, half from their common size."""
    inverse = np.linalg.inv(gram)
    excess = w * np.square(miss)
    told = np.count_nonzero((np.abs(j).max(axis=1) > 1e-3 * np.abs(j).max()) & (w > 0))
    spare = max(told - len(gram), 0)
    common = float(np.clip((excess.sum() + 2.0) / (spare + 2.0), 0.05, 9.0))
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


def _variant(label: int, outline: Outline, radius: float, reach: float) -> Variant:
    """Tables of one object."""
    order = symmetry(outline)
    if outline.bend is None:
        return Variant(label, order, (CoverageTable(outline, radius, reach),))
    size = outline.thickness or 0.1 * reach
    tables = (CoverageTable(outline, radius, reach, part * size) for part in WIDTHS)
    return Variant(label, order, tuple(tables))
