"""Templates of coverage: what every object would press at many places, and the likeliest of them.

Few taxels have templates for all places; of thousands, the centre of the force tells the place and
only turns are tried.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.coverage_model import (
    FEW_FINENESS,
    FINENESS,
    FINER,
    PlaceTable,
    TaxelPoints,
    Variant,
    model_error,
    tried_poses,
    variant_of,
)
from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.coverage import mistakable_turns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array, Integers, Outline, Singles


@compiled
def misfits(
    unit: Singles, close: Integers, shape: Singles,
    score: Singles, least: np.float32, misfit: Array,
) -> None:  # fmt: skip
    """Sums (n,) of misfits of templates that score so much at least, inf of others; filled."""
    for i in range(len(close)):
        misfit[i] = np.inf
        if score[i] < least:
            continue
        row, total = unit[close[i]], 0.0
        for k in range(len(shape)):
            total += abs(score[i] * row[k] - shape[k])
        misfit[i] = total


@compiled
def first_apart(
    misfit: Array, close: Integers, what: Array, most: float, turn: float, taken: Integers
) -> int:
    """How many templates (m,) differ in variant or in turn, the best first; `taken` is filled."""
    free, count = misfit.copy(), 0
    while count < len(taken):
        best = int(np.argmin(free))
        if not free[best] <= most:
            break
        free[best] = np.inf
        variant, yaw, apart = what[close[best], 0], what[close[best], 3], True
        for k in range(count):
            if what[taken[k], 0] == variant:
                apart = apart and abs(np.sin((what[taken[k], 3] - yaw) / 2)) > turn
        if apart:
            taken[count] = close[best]
            count += 1
    return count


@compiled
def likeliest(
    unit: Singles, close: Integers, score: Singles,
    what: Array, shape: Singles, closer: int, near: float, exact: float,
    turn: float, taken: Integers,
) -> int:  # fmt: skip
    """How many of the chosen templates are worth a closer look; `taken` is filled."""
    misfit, least = np.empty(len(close)), score.min()
    if len(close) > closer:
        least = np.sort(score)[len(close) - closer]
    misfits(unit, close, shape, score, least, misfit)
    best = misfit.min()
    return first_apart(misfit, close, what, best + near * (best + exact), turn, taken)


LEAST_POINTS = 4
POINTS = 2048  # of all taxels together, about
MOST_POINTS = 128  # of one taxel
TABLE_POINTS, FEW_TABLE_POINTS = 32, 256  # of one of many, of few taxels, to tabulate places
FINE_POINTS = 16  # of one of thousands of taxels under an edge, in the end
COARSE = 8  # times fewer points where a search begins
FEW_TAXELS = 200  # up to which templates are kept for every place
TEMPLATES = 24_000  # as many again for every object that is a tube
WIDTHS = (0.25, 0.5, 0.9)  # of a tube's contact, in radii
NEAR, NEAR_TUBES = 0.35, 5.0  # beyond the best score: starts that are worth a closer look
EXACT = 0.05  # misfit that a template may have by chance
MOST_STARTS = 4
MOST_OF_TUBES = 12
TURN, TURN_TUBES = 0.35, 0.12  # half angle between starts, by its sine
ENOUGH = 0.85  # product of unit vectors: where the nearest templates are less alike, all are asked
CLOSER, CLOSER_TUBES = 60, 2000  # templates whose misfit is looked at taxel by taxel
VAGUE = 32  # taxels up to which templates leave open which object it is
MOST_ACTIVE = 150  # taxels that tell the turn, where there are thousands


class CoverageTemplates:
    """What objects would press on one array, and where to begin to look.

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
        self, positions: Array, areas: Array, taxel_outlines: Sequence[Outline] | None,
        objects: Sequence[Outline],
    ) -> None:  # fmt: skip
        count = int(np.clip(POINTS // len(positions), LEAST_POINTS, MOST_POINTS))
        self.points = TaxelPoints(positions, areas, taxel_outlines, count)
        self.coarse = self.points
        self.areas = areas
        self.middle = positions[:, :2].mean(axis=0)
        self.centres = np.ascontiguousarray(positions[:, :2])
        self.step = float(np.sqrt(np.median(areas)))
        away = np.hypot(self.points.x - self.middle[0], self.points.y - self.middle[1])
        self.reach = float(away.max()) + 2 * self.points.radius
        self.tubes = any(outline.bend is not None for outline in objects)
        self.vague = len(positions) <= VAGUE and not self.tubes
        if self.tubes and count > COARSE:
            self.coarse = TaxelPoints(positions, areas, taxel_outlines, count // COARSE)
        self.variants = [
            variant_of(label, outline, self.points.radius, self.reach, self.step)
            for label, outline in enumerate(objects)
        ]
        for variant in self.variants:
            variant.turns = mistakable_turns(variant.outline, variant.centre, variant.order)
        self.fine: TaxelPoints | None = None
        self.sharp: list[Variant] = []
        if len(positions) > FEW_TAXELS and self.points.size:
            self.fine = TaxelPoints(positions, areas, taxel_outlines, FINE_POINTS)
            self.sharp = [
                variant_of(label, outline, self.fine.radius, self.reach, self.step)
                for label, outline in enumerate(objects)
            ]
        self.bank: tuple[Singles, Array] | None = None
        self._near: dict[tuple[int, int], Integers] = {}
        if len(positions) <= FEW_TAXELS and objects:
            few = len(positions) <= VAGUE
            some = FEW_TABLE_POINTS if few else TABLE_POINTS
            fine = TaxelPoints(positions, areas, taxel_outlines, some)
            fineness = FEW_FINENESS if few else FINENESS
            for variant in self.variants:
                if variant.order == 0:
                    sharp = variant_of(
                        variant.label, variant.outline, fine.radius, self.reach, self.step
                    )
                    variant.places = PlaceTable(
                        fine, sharp, self.middle, self.reach, self.step, fineness
                    )
            self.bank = self._bank()
        self._measure(positions, taxel_outlines)

    def _measure(self, positions: Array, taxel_outlines: Sequence[Outline] | None) -> None:
        """How far points and tables are from finer points, of every object."""
        kinds = [(self.points, self.variants)]
        kinds += [] if self.coarse is self.points else [(self.coarse, self.variants)]
        kinds += [] if self.fine is None else [(self.fine, self.sharp)]
        for points, variants in kinds:
            count = FINER * len(points.x) // len(points.first)
            finer = TaxelPoints(positions, self.areas, taxel_outlines, count)
            for variant in variants:
                sharp = variant_of(
                    variant.label, variant.outline, finer.radius, self.reach, self.step
                )
                poses = tried_poses(variant, self.middle, self.reach, len(finer.x))
                seen = partial(points.seen, variant)
                points.errors[variant.label] = model_error(seen, finer, sharp, poses)
                places = variant.places
                if places is not None:
                    places.error = model_error(places.all_seen, finer, sharp, poses)

    def _bank(self) -> tuple[Singles, Array]:
        """Templates of unit length (n, t), and their variants and poses (n, 5)."""
        rows, what = [], []
        for i, variant in enumerate(self.variants):
            places = self._places(variant)
            for k in range(0, len(places), 500):
                some = places[k : k + 500]
                rows.append(self.coarse.cover(variant, some[:, : variant.free]))
            what.append(np.column_stack([np.full(len(places), i), places]))
        cover, poses = np.concatenate(rows), np.concatenate(what)
        length = np.linalg.norm(cover, axis=1)
        keep = length > 0.2 * self.areas.mean()
        cover, poses = cover[keep], poses[keep]
        unit = (cover / length[keep, None]).astype(np.float32)
        self._bucket = 0.1 * self.reach
        centroid = cover @ self.centres / cover.sum(axis=1, keepdims=True) - self.middle
        if not self.tubes:
            self._sort(centroid)
        return unit, poses

    def _sort(self, centroid: Array) -> None:
        """Which templates lie near each bucket of the force's centroid."""
        edge = self._bucket
        wide = 0.5 * edge + 0.05 * self.reach + 0.5 * self.step
        for i in range(-11, 12):
            inside = np.flatnonzero(np.abs(centroid[:, 0] - i * edge) < wide)
            over = centroid[inside, 1]
            for j in range(-11, 12):
                self._near[i, j] = inside[np.abs(over - j * edge) < wide]

    def _places(self, variant: Variant) -> Array:
        """Poses (n, 4) of templates: x, y, yaw, width."""
        turns = self._turns(variant)
        widths = variant.radius * np.array(WIDTHS) if variant.tube else np.zeros(1)
        most = TEMPLATES // (len(turns) * len(widths)) // (1 if self.tubes else len(self.variants))
        span = (0.4 if self.tubes else 0.85) * self.reach
        side = min(int(np.sqrt(most)), int(np.ceil(2 * self.reach / (0.3 * self.step))))
        line = np.linspace(-span, span, max(side, 5))
        x, y = self.middle[0] + line, self.middle[1] + line
        grid = np.stack(np.meshgrid(x, y, turns, widths, indexing='ij'), axis=-1)
        return np.asarray(grid.reshape(-1, 4))

    def _turns(self, variant: Variant) -> Array:
        """Turns that templates need: the rim moves by less than a taxel from one to the next."""
        if variant.order == 0:
            return np.zeros(1)
        sector = 2 * np.pi / variant.order
        count = int(np.clip(sector * variant.gyration / (0.5 * self.step), 6, 36))
        return sector * np.arange(count) / count

    def starts(self, y: Array) -> Array:
        """Variants and poses (n, 5) from where least squares may begin, the likeliest first."""
        if self.bank is None:
            return self._aligned(y)
        unit, what = self.bank
        close = None if self.tubes else self._bucket_of(y)
        shape = (y / np.sqrt(y @ y)).astype(np.float32)
        if close is not None and len(close):
            near = unit[close]
            scores = near @ shape
        if close is None or not len(close) or scores.max() < ENOUGH:
            close, near = np.arange(len(what)), unit
            scores = unit @ shape
        elif not self.vague:
            taken = np.empty(MOST_STARTS, np.int64)
            count = likeliest(unit, close, scores, what, shape, CLOSER, NEAR, EXACT, TURN, taken)
            return what[taken[:count]]
        closer = CLOSER_TUBES if self.tubes else CLOSER
        if len(close) > closer and not self.vague:
            first = np.argpartition(-scores, closer)[:closer]
            close, scores, near = close[first], scores[first], near[first]
        # bad taxels count once in sums of misfits, and squared in products
        misfit = np.abs(scores[:, None] * near - shape).sum(axis=1)
        return self._chosen(what[close], np.asarray(-misfit / (misfit.min() + EXACT), np.float64))

    def _bucket_of(self, y: Array) -> Integers | None:
        """Templates near the centre of the force; None: far outside."""
        middle = (y @ self.centres / y.sum() - self.middle) / self._bucket
        return self._near.get((round(float(middle[0])), round(float(middle[1]))))

    def _chosen(self, what: Array, scores: Array) -> Array:
        """The best few that differ in variant, or in turn; of few taxels, of every variant."""
        order = np.argsort(-scores)
        if self.vague:
            return what[self._every(what, order)]
        order = order[scores[order] > scores[order[0]] - (NEAR_TUBES if self.tubes else NEAR)]
        most = MOST_OF_TUBES if self.tubes else MOST_STARTS
        return what[self._apart(what, order, most)]

    def _every(self, what: Array, order: Integers) -> Integers:
        """Which templates (n, 5) are the best few of every variant, from those in an order."""
        taken: list[int] = []
        for i in range(len(self.variants)):
            own = order[what[order, 0] == i]
            first = np.sort(np.unique(what[own, 3], return_index=True)[1])  # of each turn
            taken += self._apart(what, own[first], MOST_STARTS)
        return np.asarray(taken, np.int64)

    def _apart(self, what: Array, order: Integers, most: int) -> list[int]:
        """The first of an order that differ in variant, or in turn."""
        turn = TURN_TUBES if self.tubes else TURN
        taken: list[int] = []
        kept: list[tuple[float, float]] = []
        for i, variant, yaw in zip(order, what[order, 0], what[order, 3], strict=True):
            same = (seen for which, seen in kept if which == variant)
            if all(abs(np.sin((seen - yaw) / 2)) > turn for seen in same):
                taken.append(int(i))
                kept.append((variant, yaw))
            if len(taken) == most:
                break
        return taken

    def _aligned(self, y: Array) -> Array:
        """Starts with the centroid of the force on that of the object, for many taxels."""
        active = np.flatnonzero(y > 0.25 * y.max())
        active = active[:: max(len(active) // MOST_ACTIVE, 1)]
        load = y[active]
        middle = y @ self.centres / y.sum()
        away = self.centres[active] - middle
        found, scores = [], []
        for i, variant in enumerate(self.variants):
            turns = self._turns(variant)
            cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
            cx, cy = variant.centre
            u = cos * away[:, 0] + sin * away[:, 1] + cx
            v = cos * away[:, 1] - sin * away[:, 0] + cy
            width = np.array([[0.5 * variant.radius]])
            scores.append(variant.at(u, v, width)[0] @ load / np.sqrt(variant.squared))
            poses = np.empty((len(turns), 5))
            poses[:, 0], poses[:, 3], poses[:, 4] = i, turns, width
            poses[:, 1] = middle[0] - cos[:, 0] * cx + sin[:, 0] * cy
            poses[:, 2] = middle[1] - sin[:, 0] * cx - cos[:, 0] * cy
            found.append(poses)
        score = np.concatenate(scores)
        return self._chosen(np.concatenate(found), 6 * score / score.max())
