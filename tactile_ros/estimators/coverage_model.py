"""Soft coverage of taxels by an object at a pose, with its slopes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.coverage import CoverageTable, RadialTable, symmetry, taxel_points
from tactile_ros.physics.tubes import HALF_SPACE, contact_profile, nearest_axis

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.coverage_error import ModelError
    from tactile_ros.estimators.place_table import PlaceTable
    from tactile_ros.types import Array, Integers, Outline

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
