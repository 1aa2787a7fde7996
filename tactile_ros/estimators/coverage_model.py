"""Soft coverage of taxels by an object at a pose, its slopes and errors: tables and points."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.coverage import (
    HALF_SPACE,
    CoverageTable,
    RadialTable,
    contact_profile,
    nearest_axis,
    symmetry,
    taxel_points,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Array, Bools, Integers, Outline

MOST_POSES, FEWEST_POSES = 96, 16
LOOKS = 4_000_000  # at points, of all poses together, about
PLAY = 0.2  # of the reach: how far from the middle objects are tried
SEED = 6
FINER = 8  # times as many points
WIDE = (0.3, 0.9)  # least and largest width of a tube's contact, in radii
TOLERANCE = 1e-3  # of its area: what a taxel's outline is known by
LEAST = 1e-3  # of the largest cover: what a taxel errs by at least, whatever touches it
SLIGHT = 1e-4  # of the largest squared slope: no edge touches
FLAT = 0.25  # of the taxels under edges: those whose cover changes least
MIDDLE = 0.455  # median of the square of what is normal
NEVER = 1e-9  # what no taxel tells stays where it is


@dataclass(frozen=True)
class ModelError:
    """Of one object on one set of points.

    Attributes
    ----------
    floor : float
        Variance of the cover of a taxel under edges that move it against one another, in squares
        of the largest cover.
    shared : ndarray, shape (m,)
        Standard deviation of x, y, yaw and width beyond what taxels that err each by itself
        make of them, in units of the variant.
    """

    edge: float  # variance of where an edge seems to lie under a taxel, in squares of a step
    floor: float
    shared: Array


def tried_poses(variant: Variant, middle: Array, reach: float, points: int) -> Array:
    """Parameters (n, m) of a variant about the middle of an array, fewer for more points."""
    count = int(np.clip(LOOKS // points, FEWEST_POSES, MOST_POSES))
    rng = np.random.default_rng(SEED)
    place = middle + PLAY * reach * rng.uniform(-1, 1, (count, 2))
    turn = rng.uniform(-np.pi, np.pi, count)
    width = variant.radius * rng.uniform(*WIDE, count)
    return np.column_stack([place, turn, width])[:, : variant.free]


def model_error(
    seen: Callable[[Array], Array], finer: TaxelPoints, sharp: Variant, poses: Array
) -> ModelError:
    """Measure a model beside finer points.

    Parameters
    ----------
    seen : callable
        Slopes and cover (m + 1, k, t) of poses (k, m), as of `TaxelPoints.seen`.
    finer, sharp : TaxelPoints, Variant
        Points several times as many, and the object for discs of their size.
    poses : ndarray, shape (k, m)
        Where to look.
    """
    stacks, misses = [], []
    for pose in poses:
        stack = seen(pose[None])[:, 0]
        stacks.append(stack)
        misses.append(finer.cover(sharp, pose[None])[0] - stack[-1])
    rises = np.square(np.array(stacks)[:, :2]).sum(axis=1)
    top = max(float(stack[-1].max()) for stack in stacks)
    edge, floor = _parts(np.square(misses), rises)
    floor += float(np.square(TOLERANCE * finer.areas).mean())
    moved, own = [], []
    for stack, miss, rise in zip(stacks, misses, rises, strict=True):
        weight = 1.0 / (edge * rise + floor + (LEAST * top) ** 2)
        inverse = np.linalg.inv((stack * weight) @ stack.T + NEVER * np.eye(len(stack)))
        moved.append(inverse @ ((stack * weight) @ miss))
        own.append(np.diag(inverse))
    # by medians: few poses hang over the border of the array
    beyond = np.median(np.square(moved), axis=0) / MIDDLE - np.median(own, axis=0)
    beyond[:2] = beyond[:2].mean()
    return ModelError(edge, floor / top**2, np.sqrt(np.maximum(beyond, 0.0))[:-1])


def _parts(squared: Array, rises: Array) -> tuple[float, float]:
    """What squared errors (n, t) are per squared slope (n, t), and where edges cancel."""
    touched = rises > SLIGHT * rises.max()
    squared, rises = squared[touched], rises[touched]
    flat = rises <= np.quantile(rises, FLAT)
    floor = float(squared[flat].mean())
    edge = float((squared.sum() - floor * len(squared)) / rises.sum())
    # where the flat ones err most, all err alike
    return (edge, floor) if edge > 0 else (0.0, float(squared.mean()))


FINENESS = 5.0  # nodes for the width of one of many taxels
FEW_FINENESS = 16.0  # of one of few, of which each must tell more
MOST_NODES = 120  # of a side
CUBIC = np.array([[0, -1, 2, -1], [2, 0, -5, 3], [0, 1, 4, -3], [0, 0, -1, 1]]) / 2.0


@compiled
def weights_of(t: float, value: Array, slope: Array) -> None:
    """Weights of four nodes at a place between the middle two, and their slopes."""
    t = min(max(t, -1.0), 2.0)
    for k in range(4):
        a, b, c, d = CUBIC[k, 0], CUBIC[k, 1], CUBIC[k, 2], CUBIC[k, 3]
        value[k] = a + b * t + c * t * t + d * t * t * t
        slope[k] = b + 2.0 * c * t + 3.0 * d * t * t


@compiled
def seen_at(
    rows: Array, side: int, low: Array, pitch: float, scale: float, x: float, y: float,
    stack: Array,
) -> None:  # fmt: skip
    """Slopes and covered area (3, t) at a place (m): `PlaceTable.seen`; `stack` is filled."""
    along, over, up, rise = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    fx, fy = (x - low[0]) / pitch, (y - low[1]) / pitch
    i = min(max(int(fx), 1), side - 3)
    j = min(max(int(fy), 1), side - 3)
    weights_of(fx - i, along, over)
    weights_of(fy - j, up, rise)
    stack[:] = 0.0
    for m in range(4):
        for n in range(4):
            node = rows[(j + m - 1) * side + i + n - 1]
            by_x, by_y, own = up[m] * over[n] * scale, rise[m] * scale * along[n], up[m] * along[n]
            for k in range(len(node)):
                stack[0, k] += by_x * node[k]
                stack[1, k] += by_y * node[k]
                stack[2, k] += own * node[k]


class PlaceTable:
    """Cubic interpolation between nodes of places.

    Parameters
    ----------
    points : TaxelPoints
        Of the taxels.
    variant : Variant
        The object.
    middle : ndarray, shape (2,)
        Of the array (m).
    reach, step : float
        Of the array, and width of a taxel (m).
    fineness : float
        Nodes for the width of a taxel.

    Attributes
    ----------
    error : ModelError
        How far it is from finer points; see `coverage_error`.
    """

    def __init__(
        self, points: TaxelPoints, variant: Variant, middle: Array, reach: float, step: float,
        fineness: float = FINENESS,
    ) -> None:  # fmt: skip
        side = min(int(np.ceil(2 * reach * fineness / step)) + 1, MOST_NODES)
        self.error = ModelError(0.0, 0.0, np.zeros(2))
        self.side = side
        self.low = middle - reach
        self.pitch = 2 * reach / (side - 1)
        line = self.pitch * np.arange(side)
        rows = [
            points.cover(variant, np.column_stack([self.low[0] + line, np.full(side, y)]))
            for y in self.low[1] + line
        ]
        self.rows: Array = np.concatenate(rows)
        self.scale = variant.unit[0] / self.pitch

    def seen(self, x: float, y: float) -> Array:
        """Slopes and covered area (3, t) at a place (m), as of `TaxelPoints.seen`."""
        stack = np.empty((3, self.rows.shape[1]))
        seen_at(self.rows, self.side, self.low, self.pitch, self.scale, x, y, stack)
        return stack

    def all_seen(self, places: Array) -> Array:
        """The same of places (k, 2), shape (3, k, t)."""
        return np.stack([self.seen(float(x), float(y)) for x, y in places], axis=1)


CUT = 3.0  # sigma at which a taxel's misfit stops to count
CLOSE = 0.01  # of a step's limit: what is left to go needs no other round
SLACK = 1.0  # of a quarter of the taxels' least misfit: what the model may still err by
WEAK = 1e-4  # of a sigma per step: what nothing tells stays where it is
WELL = 0.5  # of the largest cover: taxels that tell the pressure
PRIOR = 2.0  # taxels' worth of trust in the stated errors


@compiled
def pressure_of(force: Array, variance: Array, usable: Bools, cover: Array) -> float:
    """Pressure at which a descent begins: `first_pressure`."""
    most, count = cover.max(), 0
    ratio = np.empty(len(cover))
    for k in range(len(cover)):
        if usable[k] and cover[k] > WELL * most:
            ratio[count] = force[k] / cover[k]
            count += 1
    if count > 4:
        middle = np.sort(ratio[:count])[count // 2]
        if middle > 0:
            return float(middle)
    told, area = 0.0, 0.0
    for k in range(len(cover)):
        weight = cover[k] * usable[k] / variance[k]
        told += weight * force[k]
        area += weight * cover[k]
    return max(told, 1e-12) / max(area, 1e-300)


@compiled
def excess_of(squared: Array, usable: Bools, count: int, least: float) -> float:
    """By how much a quarter of the misfits is above what is stated: `Readings.excess`."""
    size = float(np.sort(squared * usable)[len(squared) - count // 4 - 1])
    return float(SLACK * max(size**0.5 - least, 0.0))


@dataclass
class Readings:
    """Forces of one frame and their errors."""

    # (t,) of each taxel (any unit); 0 force where not usable
    force: Array
    variance: Array
    usable: Bools  # (t,) false: dead or unknown
    top: float  # the largest forces
    count: int  # taxels that are pressed

    @cached_property
    def least(self) -> float:
        """Least standard deviation."""
        return float(np.sqrt(self.variance.min()))

    def excess(self, squared: Array) -> float:
        """By how much the misfit that a quarter of (t,) exceeds is above what is stated."""
        return excess_of(squared, self.usable, self.count, self.least)


@dataclass
class Fits:
    """What k descents of one variant came to.

    Attributes
    ----------
    normal : ndarray, shape (k, m + 1, m + 1)
        Matrix of the last step, in units of the variant and parts of the pressure.
    """

    # whose coverage was fitted
    variant: Variant
    profile: int
    params: Array  # (k, m) x, y (m), yaw (rad), width (m)
    # (k,) force of a covered area (N/m2); sum of squared misfits, none above the square of the cut
    pressure: Array
    cost: Array
    cover: Array  # (k, t) covered areas (m2)
    normal: Array
    slopes: Array  # (m + 1, k, t) of the forces
    share: Array  # (k, t) weight of each taxel


def first_pressure(readings: Readings, cover: Array) -> float:
    """Pressure by the median of taxels that are well covered; of few, by least squares."""
    return pressure_of(readings.force, readings.variance, readings.usable, cover)


@compiled
def misfit(
    y: Array, cover: Array, pressure: float, weight: Array, present: float
) -> tuple[int, int, float]:
    """Taxels that tell of a fit, those far off, and the sum of squared misfits, cut off.

    Parameters
    ----------
    y, cover : ndarray, shape (t,)
        Forces (any unit), and covered areas (m2) of a fit.
    pressure : float
        Of the fit (unit of force per m2).
    weight : ndarray, shape (t,)
        One over the variance of a force; 0: not usable.
    present : float
        Least force, read or expected, that tells.
    """
    count, far, total = 0, 0, 0.0
    for k in range(len(y)):
        expected = pressure * cover[k]
        if weight[k] > 0 and max(y[k], expected) > present:
            wrong = (y[k] - expected) ** 2 * weight[k]
            count += 1
            far += wrong > (2 * CUT) ** 2
            total += min(wrong, CUT**2)
    return count, far, total


ACROSS = 0.866  # of a disc's radius: half a strip that is as wide, by its variance
LEAST_WIDTH, MOST_WIDTH = 0.08, 0.99  # of a tube's contact, in radii
UNKNOWN_RADIUS = 0.2  # of the reach


@dataclass
class Variant:
    """One object.

    Attributes
    ----------
    places : PlaceTable or None
        Coverage of every taxel over places, of what looks alike from all sides.
    turns : ndarray, shape (n,)
        About its centre, after which it may be mistaken for itself (rad).
    """

    # index into the objects; symmetry about the origin, 0 any turn
    label: int
    order: int
    outline: Outline  # of the object
    blur: float  # radius of the disc that a point stands for (m)
    unit: Array  # (4,) natural steps of x, y (m), yaw (rad) and width (m)
    # of the contact (m), of a tube (m), and the coverage squared over the plane (m2)
    gyration: float
    radius: float
    squared: float
    centre: Array  # (2,) of the contact, from the origin (m)
    span: float  # farthest contact from the origin (m); inf: a tube
    table: CoverageTable | RadialTable | None  # none: a tube
    places: PlaceTable | None = None
    turns: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def tube(self) -> bool:
        """Whether it is an angle tube, whose contact's width is unknown."""
        return self.table is None

    @property
    def free(self) -> int:
        """How many of x, y, yaw, width are to be found."""
        return 4 if self.table is None else 2 if self.order == 0 else 3

    def at(
        self, u: Array, v: Array, width: Array, profile: int = HALF_SPACE
    ) -> tuple[Array, Array, Array, Array | None]:
        """Coverage at points of the object's frame, its slopes, and that with the width."""
        if self.table is not None:
            return (*self.table.at(u, v), None)
        distance, across_u, across_v = nearest_axis(u, v, self.outline.bend or 0.0)
        blur = ACROSS * self.blur
        value, slope, wider = contact_profile(distance, width, blur, profile, self.radius)
        return value, slope * across_u, slope * across_v, wider


def variant_of(label: int, outline: Outline, blur: float, reach: float, step: float) -> Variant:
    """One object on an array that reaches so far, whose taxels are `step` wide (m)."""
    order = symmetry(outline)
    if outline.bend is not None:
        radius = outline.thickness or UNKNOWN_RADIUS * reach
        unit = np.array([step, step, step / (0.5 * reach), 0.3 * radius])
        middle = 0.5 * reach * (np.array([1 + np.cos(outline.bend), np.sin(outline.bend)]) / 2)
        squared = 2 * reach * radius
        return Variant(
            label, order, outline, blur, unit, 0.5 * reach, radius, squared, middle, np.inf, None
        )
    table = CoverageTable(outline, blur)
    unit = np.array([step, step, step / table.gyration, 1.0])
    corners = np.concatenate(list(outline.loops))
    span = float(np.linalg.norm(corners, axis=1).max())
    looked_up = RadialTable(table, span) if order == 0 else table
    return Variant(
        label, order, outline, blur, unit, table.gyration, 0.0, table.squared, table.centre,
        span, looked_up,
    )  # fmt: skip


class TaxelPoints:
    """Points that stand for taxels.

    Parameters
    ----------
    positions, areas : ndarray, shape (t, 3) and (t,)
        Centres (m) and areas (m2) of the taxels.
    outlines : sequence of Outline, or None
        Their shapes; None: squares.
    count : int
        Points of a taxel, about.

    Attributes
    ----------
    x, y : ndarray, shape (n,)
        Points, one taxel after the other (m).
    first : ndarray, shape (t,)
        Index of the first point of each taxel.
    areas, part : ndarray, shape (t,)
        Of each taxel, and what one of its points stands for (m2).
    radius : float
        Of a disc as large (m).
    size : int
        Points of each taxel; 0: they differ.
    errors : dict of int to ModelError
        How far they are from finer points, by the label of the object; see `measure`.
    """

    def __init__(
        self, positions: Array, areas: Array, outlines: Sequence[Outline] | None, count: int
    ) -> None:
        points, self.first, self.radius = taxel_points(positions, areas, outlines, count)
        self.x, self.y = points.T.copy()
        sizes = np.diff(np.append(self.first, len(points)))
        self.areas, self.part = areas, areas / sizes
        self.size = int(sizes[0]) if np.all(sizes == sizes[0]) else 0
        self.errors: dict[int, ModelError] = {}

    def among(self, chosen: Integers) -> TaxelPoints:
        """The same, of chosen taxels only, where all have as many points."""
        some = TaxelPoints.__new__(TaxelPoints)
        rows = (chosen[:, None] * self.size + np.arange(self.size)).reshape(-1)
        some.x, some.y, some.part = self.x[rows], self.y[rows], self.part[chosen]
        some.areas = self.areas[chosen]
        some.first, some.radius, some.size = self.first[: len(chosen)], self.radius, self.size
        some.errors = self.errors
        return some

    def seen(self, variant: Variant, params: Array, profile: int = HALF_SPACE) -> Array:
        """Covered area of each taxel, last, and before it its slopes.

        Parameters
        ----------
        variant : Variant
            What lies there.
        params : ndarray, shape (k, m)
            x, y (m), yaw (rad), width (m), as many of them as the variant has.
        profile : int
            Of a tube's contact.

        Returns
        -------
        ndarray, shape (m + 1, k, t)
            Slopes by the parameters, in steps of `variant.unit`, and area times pressure, which
            is 1 at most (m2).
        """
        dx, dy = self.x - params[:, :1], self.y - params[:, 1:2]
        if variant.free == 2:
            value, by_u, by_v, _ = variant.at(dx, dy, params)
            columns = [-by_u, -by_v]
        else:
            cos, sin = np.cos(params[:, 2:3]), np.sin(params[:, 2:3])
            u, v = cos * dx + sin * dy, cos * dy - sin * dx
            value, by_u, by_v, wider = variant.at(u, v, params[:, 3:4], profile)
            columns = [sin * by_v - cos * by_u, -sin * by_u - cos * by_v, by_u * v - by_v * u]
            columns += [] if wider is None else [wider]
        stack = np.array([*columns, value])
        if self.size != 1:
            stack = np.add.reduceat(stack, self.first, axis=2)
        stack *= self.part
        stack[:-1] *= variant.unit[: len(stack) - 1, None, None]
        return stack

    def cover(self, variant: Variant, params: Array) -> Array:
        """Covered area (k, t) alone; see `seen`."""
        if not isinstance(variant.table, RadialTable):
            return np.asarray(self.seen(variant, params)[-1])
        value = variant.table.cover(self.x - params[:, :1], self.y - params[:, 1:2])
        if self.size != 1:
            value = np.add.reduceat(value, self.first, axis=1)
        return np.asarray(value * self.part)
