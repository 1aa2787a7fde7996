# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Which object lies on an array, and where: coverage of taxels by outlines, MAP by Gauss-Newton.

The forward model of taxel t is F_t = sum_k a_k * integral over the taxel of field_k, where the
fields are fixed in the object's frame: the outline itself and its tilts under an uneven load, the
profiles of contact of a tube, or fields learned from labelled frames. The state is x, y, yaw and
the amounts a_k, with priors; taxels that fit no state (dead or stuck ones that nobody marked) are
a second component of the noise and lose their weight. Starts come from a table of templates.
[4] recognises parts by their contour without training; outlines and layout suffice here too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.coverage import (
    LearnedFields,
    ObjectFields,
    outline_fields,
    taxel_points,
    tube_fields,
)
from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Outline, Singles

COARSE_POINTS, FINE_POINTS = 288, 2304  # of all taxels together, about
LEAST_COARSE, LEAST_FINE, MOST_OF_TAXEL = 1, 16, 128  # of one taxel
BLOCKS = 128  # of taxels that templates tell apart
TEMPLATES = 4000  # of an object, about
SPACING, TURNING = 0.15, 0.3  # between templates, in widths of a taxel
USUAL_WIDTH = 0.5  # of the widths of a tube's contact
CENTRED = 0.3  # of the reach: how far a tube's bend lies from the middle
TUBE_PLAY = 0.6  # of the reach: how far from the middle a tube's bend is looked for
STARTS, FINALISTS, MARGIN = 8, 4, 15.0
APART, TURNED = 1.0, 0.5  # widths of a taxel between starts, the turn at the object's rim
WORTH, SIMILAR = 3.0, 0.02  # times what the best template leaves, and more: worth a descent
LOOSE = np.array([0.5, 0.5, 0.3, 0.2, 0.1, 0.05, 0.03])  # of the top: error while far away
SOFT = np.array([0.3, 0.2, 0.15, 0.1, 0.08, 0.06, 0.05, 0.04, 0.03, 0.03])
TIGHT = np.array([0.1, 0.03, 0.0, 0.0, 0.0, 0.0])
STRAY = 0.05  # share of taxels that may read anything
PRESENT = 0.06  # of the largest force: less is no contact
EVEN = 0.01  # of the pressure: tilt of an even load
VAGUE = 32  # taxels up to which templates leave open which object it is
SEEN = 10.0  # of the noise: weaker patterns are noise
ODD = 0.3  # of the touched taxels that may contradict an object
MOST_MISFIT = 0.15  # of the top: a frame that misses by more is explained by no object
FLAT = 1e-6  # of the largest squared slope: no edge touches
RIDGE = 1e-9  # of a scaled matrix: what nothing tells stays where it is
MEDIAN = 0.455  # of the square of a normal variable
CLOSE = 2e-3  # widths of a taxel: a smaller step ends a descent
TRIED = 12  # poses at which coarse and fine points are compared


@compiled
def press_point(
    x: float, y: float, part: float, table: Singles, columns: int, low: Array, pitch: float,
    state: Array, cos: float, sin: float, radius: float, slopes: Array,
) -> bool:  # fmt: skip
    """Add a point's share of a taxel to slopes (3 + k,).

    False, and nothing is added, where a field is not linear within the radius.
    """
    fields, rows = len(state) - 3, len(table) // columns
    dx, dy = x - state[0], y - state[1]
    u, v = cos * dx + sin * dy, cos * dy - sin * dx
    column, row = (u - low[0]) / pitch + 0.5, (v - low[1]) / pitch + 0.5
    if column < 0 or row < 0 or column >= columns or row >= rows:
        return radius == 0.0
    c, r = int(column), int(row)
    node = r * columns + c
    if table[node, 3 * fields] < radius:
        return False
    away_u, away_v = (column - 0.5 - c) * pitch, (row - 0.5 - r) * pitch
    by_u, by_v = 0.0, 0.0
    for k in range(fields):
        rise_u, rise_v = table[node, 3 * k + 1], table[node, 3 * k + 2]
        slopes[3 + k] += part * (table[node, 3 * k] + rise_u * away_u + rise_v * away_v)
        by_u += state[3 + k] * rise_u
        by_v += state[3 + k] * rise_v
    slopes[0] -= part * (cos * by_u - sin * by_v)
    slopes[1] -= part * (sin * by_u + cos * by_v)
    slopes[2] += part * (by_u * v - by_v * u)
    return True


@compiled
def press_tube(
    x: float, y: float, part: float, table: Singles, columns: int, low: Array, pitch: float,
    bend_cos: float, bend_sin: float, state: Array, cos: float, sin: float, radius: float,
    slopes: Array,
) -> bool:  # fmt: skip
    """As `press_point`, under a tube whose state ends in its half width (m).

    With a radius nothing is added; False where the tube is as near.
    """
    dx, dy = x - state[0], y - state[1]
    u, v = cos * dx + sin * dy, cos * dy - sin * dx
    along = max(bend_cos * u + bend_sin * v, 0.0)
    to_u, to_v = min(u, 0.0), v
    other_u, other_v = u - bend_cos * along, v - bend_sin * along
    away, other = np.hypot(to_u, to_v), np.hypot(other_u, other_v)
    if other < away:
        away, to_u, to_v = other, other_u, other_v
    rows = len(table) // columns
    if radius > 0.0:
        return bool(away > rows * pitch + radius)
    r = int(away / pitch + 0.5)
    if r < rows:
        width = (state[4] - low[0]) / low[1]
        w = min(max(int(width + 0.5), 0), columns - 1)
        node = r * columns + w
        rise, wider = table[node, 1], table[node, 2]
        value = table[node, 0] + rise * (away - r * pitch) + wider * (width - w) * low[1]
        by = state[3] * rise / max(away, 1e-12)
        by_u, by_v = by * to_u, by * to_v
        slopes[3] += part * value
        slopes[4] += part * state[3] * wider
        slopes[0] -= part * (cos * by_u - sin * by_v)
        slopes[1] -= part * (sin * by_u + cos * by_v)
        slopes[2] += part * (by_u * v - by_v * u)
    return True


@compiled
def pressed_taxels(
    points: Array, first: Integers, centres: Array, radii: Array, areas: Array, chosen: Integers,
    table: Singles, columns: int, low: Array, pitch: float, bend: float, state: Array,
    force: Array, slopes: Array,
) -> None:  # fmt: skip
    """Write forces (n,) of chosen taxels at a state and their slopes (n, 3 + k)."""
    cos, sin, bend_cos, bend_sin = np.cos(state[2]), np.sin(state[2]), np.cos(bend), np.sin(bend)
    tube = not np.isnan(bend)
    for i in range(len(chosen)):
        t = chosen[i]
        row = slopes[i]
        row[:] = 0.0
        part, radius = areas[t], radii[t]
        x, y = centres[t]
        for n in range(first[t] - 1, first[t + 1]):  # its middle first, which may do for all
            if n >= first[t]:
                part, radius = areas[t] / (first[t + 1] - first[t]), 0.0
                x, y = points[n]
            if tube:
                done = press_tube(
                    x, y, part, table, columns, low, pitch, bend_cos, bend_sin, state, cos, sin,
                    radius, row,
                )  # fmt: skip
            else:
                done = press_point(
                    x, y, part, table, columns, low, pitch, state, cos, sin, radius, row
                )
            if done and radius > 0.0:
                break
        force[i] = 0.0
        for k in range(3, 4 if tube else len(state)):
            force[i] += state[k] * row[k]


@compiled
def robust_square(squared: Array, count: int) -> float:
    """Mean square of the first few of squared normal variables, by their median; 0 of none."""
    return np.median(squared[:count]) / MEDIAN if count else 0.0


@compiled
def fill_variances(
    force: Array, slopes: Array, y: Array, variance: Array, edge: float, rough: float,
    present: float, free: int, sharp: bool, total: Array,
) -> None:  # fmt: skip
    """Write the variance (n,) of each taxel's misfit; `variance` is inf where not usable.

    Far from the end it is that of a constant, `rough`. In the end, under a `sharp` outline, wholly
    covered taxels err by their own laws, those under an edge by more, in proportion to the length
    of the edge, since none is sharp and straight: both by the median of the frame's own misfits.
    """
    inner, outer = np.empty(len(y)), np.empty(len(y))
    inside, outside, steepest = 0, 0, 0.0
    for i in range(len(y)):
        slope = slopes[i, 0] ** 2 + slopes[i, 1] ** 2
        steepest = max(steepest, slope)
        total[i] = variance[i] + edge * slope + rough
    if rough > 0.0:
        return
    if not sharp:
        steepest = np.inf
    for i in range(len(y)):
        if max(y[i], force[i]) > present and not np.isinf(variance[i]):
            miss = (y[i] - force[i]) ** 2
            if slopes[i, 0] ** 2 + slopes[i, 1] ** 2 > FLAT * steepest:
                length = np.hypot(slopes[i, 0], slopes[i, 1])
                outer[outside] = (miss - total[i] * MEDIAN) / length
                outside += 1
            else:
                inner[inside] = miss / total[i]
                inside += 1
    left = max(outside - free, 0)
    extra = max(robust_square(outer, outside), 0.0) * outside / left if left > 1 else 0.0
    scale = max(robust_square(inner, inside), 1.0) if inside > free else 1.0
    for i in range(len(y)):
        if slopes[i, 0] ** 2 + slopes[i, 1] ** 2 > FLAT * steepest:
            total[i] += extra * np.hypot(slopes[i, 0], slopes[i, 1])
        else:
            total[i] *= scale


@compiled
def normal_equations(
    force: Array, slopes: Array, y: Array, total: Array, stray: float, free: int,
    normal: Array, pull: Array,
) -> None:  # fmt: skip
    """Write the weighted normal equations of covered taxels of which the misfit varies by `total`.

    `stray` is the density of a reading that fits no state, in parts of that of one that does.
    """
    normal[:] = 0.0
    pull[:] = 0.0
    size = len(pull)
    for i in range(len(y)):
        if slopes[i, 3] == 0.0 or np.isinf(total[i]):
            continue
        miss = y[i] - force[i]
        likelihood = np.exp(-min(0.5 * miss * miss / total[i], 500.0))
        weight = likelihood / (likelihood + stray * np.sqrt(2 * np.pi * total[i])) / total[i]
        for m in range(size):
            tall = slopes[i, m] * weight
            pull[m] += tall * miss
            for n in range(m + 1):
                normal[m, n] += tall * slopes[i, n]
    for m in range(size):
        for n in range(m):
            normal[n, m] = normal[m, n]
    for m in range(free, 3):
        normal[m] = 0.0
        normal[:, m] = 0.0
        pull[m] = 0.0


@compiled
def cost_of(force: Array, y: Array, total: Array, stray: float) -> float:
    """Minus logarithm of the likelihood of readings."""
    cost = 0.0
    for i in range(len(y)):
        if not np.isinf(total[i]):
            squared = min((y[i] - force[i]) ** 2 / total[i], 1000.0)
            cost -= np.log(np.exp(-0.5 * squared) / np.sqrt(2 * np.pi * total[i]) + stray)
    return cost


@compiled
def write_prior(
    state: Array, tube: bool, usual: float, sigma: Array, home: Array, held: Array,
    middle: Array, tight: Array,
) -> None:  # fmt: skip
    """Write means and inverse variances (3 + k,) of place and amounts."""
    unit = 1.0 if tube else state[3]
    middle[:3], tight[:3] = home, held
    middle[3], tight[3] = 0.0, 0.0
    for k in range(1, len(state) - 3):
        middle[3 + k], tight[3 + k] = usual, 1.0 / (sigma[k] * unit) ** 2


@compiled
def scaled_solution(normal: Array, pull: Array) -> Array:
    """Solution of normal equations whose unknowns differ in their units."""
    unit = np.empty(len(pull))
    for m in range(len(pull)):
        unit[m] = 1.0 / np.sqrt(max(normal[m, m], 1e-300))
    scaled = normal * unit.reshape((len(pull), 1)) * unit
    for m in range(len(pull)):
        scaled[m, m] = 1.0 + RIDGE
    return np.linalg.solve(scaled, pull * unit) * unit


@compiled
def stray_density(top: float) -> float:
    """Density of a reading that fits no state, in parts of that of one that does."""
    return STRAY / (1 - STRAY) / (1.5 * top)


@compiled
def descend(
    points: Array, first: Integers, centres: Array, radii: Array, areas: Array, chosen: Integers,
    table: Singles, columns: int, low: Array, pitch: float, bend: float, sharp: bool, y: Array,
    variance: Array, edge: float, sigma: Array, home: Array, held: Array, limit: Array,
    free: int, top: float, loose: Array,
    state: Array, normal: Array, force: Array, total: Array,
) -> float:  # fmt: skip
    """Descend from a state, which is changed; return the cost of the priors.

    `normal`, `force` and the variances `total` are filled; `sigma` (k,) are priors of the amounts
    in parts of the first.
    """
    size, count = len(state), len(chosen)
    slopes, pull = np.empty((count, size)), np.empty(size)
    middle, tight = np.empty(size), np.empty(size)
    tube = not np.isnan(bend)
    usual = low[0] + USUAL_WIDTH * low[1] * (columns - 1) if tube else 0.0
    stray = stray_density(top)
    for step in range(len(loose)):
        if tube:
            state[4] = min(max(state[4], low[0]), low[0] + low[1] * (columns - 1))
        pressed_taxels(
            points, first, centres, radii, areas, chosen, table, columns, low, pitch, bend, state,
            force, slopes,
        )  # fmt: skip
        fill_variances(
            force, slopes, y, variance, edge, (loose[step] * top) ** 2, PRESENT * top,
            free + size - 3, sharp, total,
        )  # fmt: skip
        normal_equations(force, slopes, y, total, stray, free, normal, pull)
        write_prior(state, tube, usual, sigma, home, held, middle, tight)
        for m in range(size):
            normal[m, m] += 1.0 if free <= m < 3 else tight[m]
            pull[m] -= tight[m] * (state[m] - middle[m])
        move = scaled_solution(normal, pull)
        far = 0.0
        for m in range(free):
            far = max(far, abs(move[m]) / limit[m])
        shrink = 1.0 if far <= 1.0 else 1.0 / far
        for m in range(size):
            if m < free or m >= 3:
                state[m] += shrink * move[m]
        state[3] = max(state[3], 0.3 * (state[3] - shrink * move[3]))
        if loose[step] == 0.0 and far < CLOSE:
            break
    write_prior(state, tube, usual, sigma, home, held, middle, tight)
    return 0.5 * float((tight * np.square(state - middle)).sum())


class TaxelPoints:
    """About `count` points for each taxel; without outlines they are squares."""

    def __init__(
        self, positions: Array, areas: Array, outlines: Sequence[Outline] | None, count: int
    ) -> None:
        self.points, first, self.radius = taxel_points(positions, areas, outlines, count)
        self.first = np.append(first, len(self.points))
        self.areas = areas
        parts = np.split(self.points, first[1:])
        self.centres = np.array([part.mean(axis=0) for part in parts])
        pairs = zip(parts, self.centres, strict=True)
        away = [np.linalg.norm(part - centre, axis=1).max() for part, centre in pairs]
        self.radii = np.array(away) + self.radius

    def pressed(
        self, fields: ObjectFields, state: Array, chosen: Integers | None = None
    ) -> tuple[Array, Array]:
        """Forces (t,) of all or of chosen taxels at a state, and their slopes (t, 3 + k)."""
        chosen = np.arange(len(self.areas)) if chosen is None else chosen
        force, slopes = np.empty(len(chosen)), np.empty((len(chosen), len(state)))
        shape = self.points, self.first, self.centres, self.radii, self.areas
        table = fields.table, fields.columns, fields.low, fields.pitch, fields.bend
        pressed_taxels(*shape, chosen, *table, state, force, slopes)
        return force, slopes


@dataclass
class Found:
    """A recognised object: label -1 where no object explains the frame."""

    label: int
    probability: float
    pose: Array  # (3,) x, y (m), yaw (rad)
    cov: Array  # (3, 3) of the pose
    order: int  # symmetry about the origin: 0 any turn
    expected: Array  # (t,) forces of the taxels under the object
    cover: Array  # (t,) covered areas (m2)
    pressure: float  # force of a covered area


@dataclass
class Descent:
    """The end of a descent."""

    index: int  # of the object
    state: Array
    normal: Array
    cost: float
    prior: float  # cost of the priors
    force: Array  # (t,) of the taxels
    total: Array  # (t,) variance of their misfits
    sigma: Array  # (k,) priors of the amounts


class ObjectPose:
    """Objects that may lie on one array; a label is an index into them.

    Taxels have positions (t, 3) (m), areas (t,) (m2) and outlines; None: they are squares.
    """

    def __init__(
        self, positions: Array, areas: Array, taxel_outlines: Sequence[Outline] | None,
        objects: Sequence[Outline | LearnedFields],
    ) -> None:  # fmt: skip
        taxels = len(positions)
        counts = [
            int(np.clip(total // taxels, least, MOST_OF_TAXEL))
            for total, least in ((COARSE_POINTS, LEAST_COARSE), (FINE_POINTS, LEAST_FINE))
        ]
        self.coarse, self.fine = (
            TaxelPoints(positions, areas, taxel_outlines, count) for count in counts
        )
        self.areas, self.centres = areas, np.ascontiguousarray(positions[:, :2])
        self.step = float(np.sqrt(np.median(areas)))
        self.every = np.arange(taxels)
        self.middle = 0.5 * (self.centres.min(axis=0) + self.centres.max(axis=0))
        self.half = 0.5 * np.ptp(self.centres, axis=0) + self.step
        reach = np.linalg.norm(self.fine.points - self.middle, axis=1).max()
        self.reach = float(reach) + 2 * self.fine.radius
        self.labels: list[int] = []
        self.objects: tuple[list[ObjectFields], list[ObjectFields]] = ([], [])
        for label, one in enumerate(objects):
            for points, made in zip((self.coarse, self.fine), self.objects, strict=True):
                if isinstance(one, LearnedFields):
                    made.append(one.fields(points.radius))
                elif one.bend is not None:
                    made.extend(tube_fields(one, points.radius, self.reach))
                else:
                    count = 3 if points is self.fine else 1
                    made.append(outline_fields(one, points.radius, count))
            self.labels += [label] * (len(self.objects[0]) - len(self.labels))
        self.edges = [self._edges(*pair) for pair in zip(*self.objects, strict=True)]
        self._templates()
        self.locate(areas, 1e-3 * areas, np.ones(taxels, bool), 0.01)  # compiled now

    def _edges(self, rough: ObjectFields, fields: ObjectFields) -> tuple[float, float]:
        """Squared place errors of edges by coarse and by fine points (m2)."""
        rng = np.random.default_rng(6)
        places = self.middle + 0.3 * self.half * rng.uniform(-1, 1, (TRIED, 2))
        wrong = 0.0
        for place, yaw in zip(places, rng.uniform(-np.pi, np.pi, TRIED), strict=True):
            fine, slopes = self.fine.pressed(fields, first_state(fields, place[0], place[1], yaw))
            coarse = self.coarse.pressed(rough, first_state(rough, place[0], place[1], yaw))[0]
            rise = np.square(slopes[:, :2]).sum()
            wrong += float(np.square(fine - coarse).sum() / max(rise, 1e-300)) / TRIED
        return wrong, wrong * (len(self.coarse.points) / len(self.fine.points)) ** 1.5

    def _templates(self) -> None:
        """Make unit templates (n, b) of the objects at many poses (n, 4): object, x, y, yaw."""
        size = 0.0
        block = np.arange(len(self.areas))
        while block.max() >= BLOCKS:
            size += self.step
            cell = np.floor((self.centres - self.middle) / size).astype(np.int64)
            block = np.unique(cell, axis=0, return_inverse=True)[1].reshape(-1)
        self.block, rows, poses = block, [], []
        self.width = max(size, self.step)
        for index, fields in enumerate(self.objects[0]):
            if index and self.labels[index] == self.labels[index - 1]:
                continue  # of the profiles of a tube the first
            for x, y, yaw in self._tried(fields, self.width):
                state = first_state(fields, x, y, yaw)
                cover = self.coarse.pressed(fields, state)[0]
                rows.append(np.bincount(block, cover))
                poses.append((index, x, y, yaw))
        table = np.array(rows).reshape(len(rows), block.max() + 1)
        length = np.linalg.norm(table, axis=1)
        kept = length > 0.2 * self.areas.mean()
        self.poses = np.array(poses).reshape(-1, 4)[kept]
        unit = table[kept] / length[kept, None]
        unit[unit < 1e-4] = 0.0
        self.templates = unit.astype(np.float32)
        self.squared, self.length = np.square(self.templates), length[kept]

    def _tried(self, fields: ObjectFields, width: float) -> Array:
        """Poses (n, 3) of templates of one object, about a width of a taxel or block apart."""
        turns = 1
        if fields.order != 0:
            sector = 2 * np.pi / fields.order
            turns = int(np.clip(sector * fields.gyration / (TURNING * width), 6, 48))
        play = self.half if not fields.tube else TUBE_PLAY * self.half
        spacing = max(SPACING * width, float(np.sqrt(4 * np.prod(play) * turns / TEMPLATES)))
        lines = [
            self.middle[i] + np.linspace(-play[i], play[i], int(2 * play[i] / spacing) + 1)
            for i in range(2)
        ]
        yaws = 2 * np.pi / max(fields.order, 1) * np.arange(turns) / turns
        grid = np.meshgrid(*lines, yaws, indexing='ij')
        poses = np.stack(grid, axis=-1).reshape(-1, 3)
        # yaw is about the origin, which may lie outside: places are those of the middle
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        u, v = fields.centre
        poses[:, 0] -= cos * u - sin * v
        poses[:, 1] -= sin * u + cos * v
        return poses

    def _starts(self, y: Array, usable: Bools, top: float) -> Array:
        """Likeliest poses by templates, apart from one another, with their pressures (n, 5)."""
        limited = np.minimum(y, 1.5 * top) * usable
        pattern = np.bincount(self.block, limited).astype(np.float32)
        able = np.bincount(self.block, usable) > 0
        length = self.squared @ able.astype(np.float32)
        score = (self.templates @ pattern) / np.sqrt(np.maximum(length, 0.05))
        score /= max(float(np.linalg.norm(pattern)), 1e-30)
        few = np.argpartition(score, -min(400, len(score)))[-min(400, len(score)) :]
        few = few[np.argsort(-score[few], kind='stable')]
        left = 1.0 - np.square(score[few])
        first = np.unique(self.poses[few, 0], return_index=True)[1]  # the best of each object
        worth = left < WORTH * left[0] + SIMILAR
        worth[first] |= len(self.areas) <= VAGUE
        few = np.concatenate([few[first][worth[first]], few[worth]])
        amount = (self.templates[few] @ pattern) / np.maximum(length[few], 0.05) / self.length[few]
        taken: list[Array] = []
        for pose in np.column_stack([self.poses[few], amount]):
            if len(taken) == STARTS:
                break
            if all(self._separation(pose, other) > 1.0 for other in taken):
                taken.append(pose)
        return np.array(taken)

    def _separation(self, pose: Array, other: Array) -> float:
        """Distance of two poses (object, x, y, yaw), in what is counted as another start."""
        if pose[0] != other[0]:
            return np.inf
        fields = self.objects[0][int(pose[0])]
        place = np.abs(pose[1:3] - other[1:3]).max() / (APART * self.step)
        if fields.order == 0:
            return float(place)
        sector = 2 * np.pi / fields.order
        turn = abs((pose[3] - other[3] + sector / 2) % sector - sector / 2) * fields.gyration
        return float(max(place, turn / (TURNED * self.step)))

    def _near(self, span: float, state: Array) -> Integers:
        """Taxels that a part may touch, all where there are few."""
        if len(self.areas) <= BLOCKS or np.isinf(span):
            return self.every
        near = span + 3 * self.step
        away = self.centres - state[:2]
        return np.flatnonzero(np.square(away).sum(axis=1) < near**2)

    def _descend(
        self, fine: bool, index: int, state: Array, y: Array, variance: Array, top: float,
        even: bool = False,
    ) -> Descent:  # fmt: skip
        """Descend with coarse or fine points; `even`: the load of a flat part has no tilt."""
        points = self.fine if fine else self.coarse
        fields = self.objects[int(fine)][index]
        state = np.append(state, np.zeros(3 + fields.count - len(state)))  # coarse ones are fewer
        chosen = self._near(fields.span, state)
        free = 2 if fields.order == 0 else 3
        size = self.step if fine else self.width
        limit = 0.6 * size * np.array([1.0, 1.0, 1.0 / max(fields.gyration, 2 * size)])
        loose = TIGHT if fine else LOOSE if fields.sharp else SOFT
        sigma = np.where(even & (np.arange(fields.count) > 0), EVEN, fields.sigma)
        home = np.append(self.middle, state[2])
        held = np.full(3, 1e-9)
        if fields.tube:
            held[:2] = 1.0 / (CENTRED * self.reach) ** 2
        normal = np.empty((len(state), len(state)))
        force, total = np.empty(len(chosen)), np.empty(len(chosen))
        prior = descend(
            points.points, points.first, points.centres, points.radii, points.areas, chosen,
            fields.table, fields.columns, fields.low, fields.pitch, fields.bend, fields.sharp,
            y[chosen], variance[chosen], self.edges[index][int(fine)], sigma, home, held,
            limit, free, top, loose, state, normal, force, total,
        )  # fmt: skip
        every, rest = np.zeros(len(y)), variance.copy()
        every[chosen], rest[chosen] = force, total
        cost = prior + cost_of(every, y, rest, stray_density(top))
        return Descent(index, state, normal, cost, prior, every, rest, sigma)

    def locate(self, force: Array, noise: Array, usable: Bools, spread: float | Array) -> Found:
        """Recognise and place the object under one frame; label -1: none, or none of these.

        Forces (t,) of any unit have a `noise` (t,) at rest and a relative error `spread`, one or
        (t,); taxels that are not `usable` (t,) are dead or unknown.
        """
        y = np.maximum(force, 0.0) * usable
        ranked = np.sort(y)
        top = float(ranked[-3:].mean())
        if 2 * np.count_nonzero(noise * SEEN < top) <= len(noise) or not len(self.poses):
            return nothing(len(y))
        top = min(top, 2 * float(np.median(ranked[ranked > 0.2 * top])))
        variance = np.where(usable, noise**2 + (spread * y) ** 2, np.inf)
        ends = []
        for pose in self._starts(y, usable, top):
            index = int(pose[0])
            fields = self.objects[0][index]
            state = first_state(fields, *pose[1:4])
            state[3] = max(pose[4], 0.1 * top / self.areas.max())
            ends.append(self._descend(False, index, state, y, variance, top))
        ends.sort(key=lambda end: end.cost)
        finals: list[Descent] = []
        for end in ends:
            pose = np.array([end.index, *end.state[:3]])
            others = (np.array([other.index, *other.state[:3]]) for other in finals)
            far = len(finals) >= FINALISTS or end.cost > ends[0].cost + MARGIN
            if far and len(self.areas) > VAGUE:
                break
            if all(self._separation(pose, o) > 0.3 for o in others):
                finals.append(end)
        finals = [
            self._descend(True, index, end.state, y, variance, top, even)
            for end in finals
            for index, label in enumerate(self.labels)  # one for each profile of contact
            if label == self.labels[end.index]
            for even in self._loadings(index)
        ]
        return self._verdict(finals, y, variance, top)

    def _loadings(self, index: int) -> tuple[bool, ...]:
        """Loads of a flat part, even or not, that are tried: few taxels determine no tilt."""
        few = len(self.areas) <= VAGUE and self.objects[1][index].sharp
        return (True, False) if few else (False,)

    def _evidence(self, end: Descent) -> float:
        """Logarithm of the evidence, by Laplace."""
        fields = self.objects[1][end.index]
        free = np.array([True, True, fields.order != 0, *np.ones(fields.count, bool)])
        normal = end.normal[np.ix_(free, free)]
        unit = 1.0 if fields.tube else end.state[3]
        sigma = np.array([*self.half, 2 * np.pi, end.state[3], *(end.sigma[1:] * unit)])
        scaled = normal * np.outer(sigma[free], sigma[free])
        return -end.cost - 0.5 * float(np.linalg.slogdet(scaled)[1])

    def _verdict(self, ends: list[Descent], y: Array, variance: Array, top: float) -> Found:
        """The likeliest object, unless none explains the frame."""
        # all are judged by the misfits of the best one
        best = min(ends, key=lambda end: end.cost)
        for end in ends:
            end.cost = end.prior + cost_of(end.force, y, best.total, stray_density(top))
        logp = np.array([self._evidence(end) for end in ends])
        logp = np.where(np.isfinite(logp), logp, -1e9)
        part = np.exp(logp - logp.max())
        of_label: dict[int, float] = {}
        for end, one in zip(ends, part / part.sum(), strict=True):
            key = self.labels[end.index]
            of_label[key] = of_label.get(key, 0.0) + float(one)
        label = max(of_label, key=lambda k: of_label[k])
        mine = [i for i in np.argsort(-logp) if self.labels[ends[i].index] == label]
        best = ends[mine[0]]
        miss = np.abs(y - best.force)
        touched = np.isfinite(variance) & (np.maximum(y, best.force) > PRESENT * top)
        usual = float(np.median(miss[touched])) / MEDIAN**0.5
        odd = np.count_nonzero(touched & (miss > max(4 * usual, MOST_MISFIT * top)))
        if usual > MOST_MISFIT * top or odd > max(3, ODD * np.count_nonzero(touched)):
            return nothing(len(y))
        return self._found(label, of_label[label], [ends[i] for i in mine], part[mine])

    def _found(self, label: int, chance: float, ends: list[Descent], part: Array) -> Found:
        """Pose of the best of descents to one object, with what the others leave open."""
        best = ends[0]
        fields = self.objects[1][best.index]
        free = 2 if fields.order == 0 else 3
        cov = np.zeros((3, 3))
        unit = 1.0 / np.sqrt(np.maximum(np.diag(best.normal), 1e-300))
        scaled = best.normal * np.outer(unit, unit) + RIDGE * np.eye(len(unit))
        cov[:free, :free] = (np.linalg.inv(scaled) * np.outer(unit, unit))[:free, :free]
        pose = best.state[:3].copy()
        sector = 2 * np.pi / max(fields.order, 1)
        for end, weight in zip(ends[1:], part[1:] / part.sum(), strict=True):
            away = end.state[:free] - best.state[:free]
            if free == 3:
                away[2] -= sector * np.round(away[2] / sector)
            cov[:free, :free] += weight * np.outer(away, away)
        pose[2] -= sector * np.round(pose[2] / sector)
        if free == 2:
            pose[2], cov[2, 2] = 0.0, np.pi**2 / 3
        alone = first_state(fields, *best.state[:3])
        if fields.tube:
            alone[4] = best.state[4]
        near = self._near(fields.span, best.state)
        cover = np.zeros(len(self.areas))
        cover[near] = self.fine.pressed(fields, alone, near)[0]
        return Found(
            label, chance, pose, cov, fields.order, best.force, cover, float(best.state[3])
        )


def first_state(fields: ObjectFields, x: float, y: float, yaw: float) -> Array:
    """State of an object at a pose: pressure 1, no tilts, a contact of usual width."""
    state = np.array([x, y, yaw, 1.0, *np.zeros(fields.count - 1)])
    if fields.tube:
        state[4] = fields.low[0] + USUAL_WIDTH * fields.low[1] * (fields.columns - 1)
    return state


def nothing(taxels: int) -> Found:
    """None of these."""
    blank = np.zeros(taxels)
    return Found(-1, np.nan, np.full(3, np.nan), np.full((3, 3), np.nan), -1, blank, blank, np.nan)
