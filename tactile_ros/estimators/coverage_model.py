"""Soft coverage of taxels by an object at a pose, with its slopes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import available, compiled
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
    edge : float
        Variance of where an edge seems to lie under a taxel, in squares of a step.
    floor : float
        Variance of the cover of a taxel under edges that move it against one another, in squares
        of the largest cover.
    shared : ndarray, shape (m,)
        Standard deviation of x, y, yaw and width beyond what taxels that err each by itself
        make of them, in units of the variant.
    """

    edge: float
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
SLOPE = np.pad(CUBIC[:, 1:] * np.array([1.0, 2.0, 3.0]), ((0, 0), (0, 1)))
POWERS = np.stack([CUBIC, SLOPE])  # weights of four nodes, and their slopes, by powers


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
        self,
        points: TaxelPoints,
        variant: Variant,
        middle: Array,
        reach: float,
        step: float,
        fineness: float = FINENESS,
    ) -> None:
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
        self._offsets = (side * np.arange(-1, 3)[:, None] + np.arange(-1, 3)).reshape(-1)
        self.scale = variant.unit[0] / self.pitch

    def seen(self, x: float, y: float) -> Array:
        """Slopes and covered area (3, t) at a place (m), as of `TaxelPoints.seen`."""
        last = self.side - 3
        fx, fy = (x - self.low[0]) / self.pitch, (y - self.low[1]) / self.pitch
        i, j = min(max(int(fx), 1), last), min(max(int(fy), 1), last)
        tables = POWERS @ np.array([_powers(fx - i), _powers(fy - j)]).T
        (along, over), (up, rise) = tables[:, :, 0], tables[:, :, 1]
        weights = np.empty((3, 4, 4))
        np.multiply(up[:, None], over * self.scale, out=weights[0])
        np.multiply(rise[:, None] * self.scale, along, out=weights[1])
        np.multiply(up[:, None], along, out=weights[2])
        near = self.rows[self._offsets + (j * self.side + i)]
        return np.asarray(weights.reshape(3, 16) @ near)

    def all_seen(self, places: Array) -> Array:
        """The same of places (k, 2), shape (3, k, t)."""
        return np.stack([self.seen(float(x), float(y)) for x, y in places], axis=1)


def _powers(t: float) -> tuple[float, float, float, float]:
    """Of a place between the middle two of four nodes."""
    t = min(max(t, -1.0), 2.0)
    return 1.0, t, t * t, t * t * t


CUT = 3.0  # sigma at which a taxel's misfit stops to count
CLOSE = 0.01  # of a step's limit: what is left to go needs no other round
SLACK = 1.0  # of a quarter of the taxels' least misfit: what the model may still err by
WEAK = 1e-4  # of a sigma per step: what nothing tells stays where it is
WELL = 0.5  # of the largest cover: taxels that tell the pressure
PRIOR = 2.0  # taxels' worth of trust in the stated errors


@dataclass
class Readings:
    """Forces of one frame and their errors.

    Attributes
    ----------
    force, variance : ndarray, shape (t,)
        Of each taxel (any unit); 0 force where not usable.
    usable : ndarray, shape (t,)
        False: dead or unknown.
    top : float
        The largest forces.
    count : int
        Taxels that are pressed.
    """

    force: Array
    variance: Array
    usable: Bools
    top: float
    count: int

    @cached_property
    def least(self) -> float:
        """Least standard deviation."""
        return float(np.sqrt(self.variance.min()))

    def excess(self, squared: Array) -> float:
        """By how much the misfit that a quarter of (t,) exceeds is above what is stated."""
        size = np.sort(squared * self.usable)[-(self.count // 4) - 1]
        return float(SLACK * max(size**0.5 - self.least, 0.0))


@dataclass
class Fits:
    """What k descents of one variant came to.

    Attributes
    ----------
    variant, profile : Variant, int
        Whose coverage was fitted.
    params : ndarray, shape (k, m)
        x, y (m), yaw (rad), width (m).
    pressure, cost : ndarray, shape (k,)
        Force of a covered area (N/m2); sum of squared misfits, none above the square of the cut.
    cover : ndarray, shape (k, t)
        Covered areas (m2).
    normal : ndarray, shape (k, m + 1, m + 1)
        Matrix of the last step, in units of the variant and parts of the pressure.
    slopes : ndarray, shape (m + 1, k, t)
        Of the forces.
    share : ndarray, shape (k, t)
        Weight of each taxel.
    """

    variant: Variant
    profile: int
    params: Array
    pressure: Array
    cost: Array
    cover: Array
    normal: Array
    slopes: Array
    share: Array


def first_pressure(readings: Readings, cover: Array) -> float:
    """Pressure by the median of taxels that are well covered; of few, by least squares."""
    well = np.flatnonzero(readings.usable & (cover > WELL * cover.max()))
    if len(well) > 4:
        some = np.sort(readings.force[well] / cover[well])
        if some[len(some) // 2] > 0:
            return float(some[len(some) // 2])
    w = cover * readings.usable / readings.variance
    return max(float(w @ readings.force), 1e-12) / max(float(w @ cover), 1e-300)


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
    if available():
        return misfit_row(y, cover, pressure, weight, present)
    expected = pressure * cover
    told = (weight > 0) & (np.maximum(y, expected) > present)
    wrong = (np.square(y - expected) * weight)[told]
    far = int(np.count_nonzero(wrong > (2 * CUT) ** 2))
    return len(wrong), far, float(np.minimum(wrong, CUT**2).sum())


@compiled
def misfit_row(
    y: Array, cover: Array, pressure: float, weight: Array, present: float
) -> tuple[int, int, float]:
    """As `misfit`, taxel by taxel."""
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
    label, order : int
        Index into the objects; symmetry about the origin, 0 any turn.
    outline : Outline
        Of the object.
    blur : float
        Radius of the disc that a point stands for (m).
    unit : ndarray, shape (4,)
        Natural steps of x, y (m), yaw (rad) and width (m).
    gyration, radius, squared : float
        Of the contact (m), of a tube (m), and the coverage squared over the plane (m2).
    centre : ndarray, shape (2,)
        Of the contact, from the origin (m).
    span : float
        Farthest contact from the origin (m); inf: a tube.
    table : CoverageTable, RadialTable or None
        None: a tube.
    places : PlaceTable or None
        Coverage of every taxel over places, of what looks alike from all sides.
    turns : ndarray, shape (n,)
        About its centre, after which it may be mistaken for itself (rad).
    """

    label: int
    order: int
    outline: Outline
    blur: float
    unit: Array
    gyration: float
    radius: float
    squared: float
    centre: Array
    span: float
    table: CoverageTable | RadialTable | None
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
