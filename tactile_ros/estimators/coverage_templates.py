"""Templates of coverage: what every object would press at many places, and the likeliest of them.

Few taxels have templates for all places; of thousands, the centre of the force tells the place and
only turns are tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.coverage import CoverageTable, symmetry, taxel_points
from tactile_ros.types import Array, Outline

if TYPE_CHECKING:
    from collections.abc import Sequence

POINTS = 1300  # of all taxels together, about
FEW_TAXELS = 200  # up to which templates are kept for every place
TEMPLATES = 24_000  # as many again for every object that is a tube
WIDTHS = (0.2, 0.3, 0.4, 0.5, 0.62, 0.78, 0.95)  # of a tube's contact, in radii
NEAR = 0.35  # beyond the best score: starts that are worth a closer look
MOST_STARTS = 4
MOST_OF_TUBES = 12
CLOSER = 150  # templates whose misfit is looked at taxel by taxel


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

    def seen(self, variant: Variant, pose: Array, width: float) -> tuple[Array, Array, Array]:
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

    def starts(self, y: Array) -> Array:
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


def _variant(label: int, outline: Outline, radius: float, reach: float) -> Variant:
    """Tables of one object."""
    order = symmetry(outline)
    if outline.bend is None:
        return Variant(label, order, (CoverageTable(outline, radius, reach),))
    size = outline.thickness or 0.1 * reach
    tables = (CoverageTable(outline, radius, reach, part * size) for part in WIDTHS)
    return Variant(label, order, tuple(tables))
