# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Coverage of taxels by objects: outlines, pressure under parts, and output of a covered taxel.

A table holds the part of a small disc at a point that an object covers, and its slope. A cylinder
that sinks into a bed of springs presses as deep as it lies under the surface, into an elastic
half-space like the root of 1 - q^2 (Hertz, q = distance / half width). [4] Fig. 1 and Eq. (2): the
same force on a larger part of a taxel gives another current.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Bools, Integers, Outline, Singles

SUNK = 0.5  # of a tube's radius: half the width of its contact
TILT = 0.3  # of the mean pressure, at the radius of gyration
UNKNOWN_RADIUS = 0.2  # of the reach, of a tube
TUBE_NODES, TUBE_WIDTHS = 240, np.linspace(0.1, 0.99, 60)  # half widths in radii
WIDTH_SIGMA = 0.3  # of a half width, in radii
ACROSS = 0.866  # of a disc's radius: half a strip that is as wide, by its variance
LEAST = 0.05  # of a taxel's whole output: no correction is larger than its inverse
NODES = 400  # of the longer side of a table
FINENESS = 4.0  # nodes for the radius of a disc
TURNS = (0.71, 1.37, 2.29)  # no symmetry of a polygon of few corners
ALIKE = 0.015  # of the area: what a turn may change and still be called a symmetry
MOST_FOLD = 12
FINER = 16  # lines across a node's cell
FINE = 512  # points of a box for each part that a taxel is cut into


def inside(loops: Sequence[Array], points: Array) -> Bools:
    """Points (n, 2) that an odd number of edges of the loops lies to the right of.

    Examples
    --------
    >>> square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    >>> inside([square], np.array([[0.5, 0.5], [1.5, 0.5]])).tolist()
    [True, False]
    """
    order = np.argsort(points[:, 1])  # an edge passes a run of these: others cost it nothing
    x, y = points[order].T
    odd = np.zeros(len(points), bool)
    for loop in loops:
        for (x0, y0), (x1, y1) in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            run = slice(*np.searchsorted(y, [min(y0, y1), max(y0, y1)]))
            odd[run] ^= x[run] < x0 + (y[run] - y0) * (x1 - x0) / (y1 - y0)
    return odd[np.argsort(order)]


def part_pressure(part: Outline, points: Array) -> Array:
    """Pressure (n,) of a part at points (n, 2) (m) of its own frame, 1 at most.

    It is even under a flat part, and that of a sinking circle under a tube of radius `thickness`.

    Examples
    --------
    >>> square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    >>> part_pressure(Outline('square', (square,)), np.array([[0.0, 0.0], [2.0, 0.0]])).tolist()
    [1.0, 0.0]
    """
    if part.bend is None:
        return inside(part.loops, points).astype(np.float64)
    x, y = points.T
    radius = float(part.thickness or 0.0)
    chord = np.sqrt(1 - SUNK**2) * radius
    pressure = np.zeros(len(x))
    for turn in (0.0, part.bend):
        along = np.cos(turn) * x + np.sin(turn) * y
        across = np.cos(turn) * y - np.sin(turn) * x
        depth = np.sqrt(np.maximum(radius**2 - across**2, 0.0)) - chord
        there = (along > 0) & (depth > 0)
        pressure = np.maximum(pressure, np.where(there, depth / (radius - chord), 0.0))
    return pressure


def washer(name: str, outer: float, inner: float, corners: int = 96) -> Outline:
    """Outline of a washer of two radii (m)."""
    turn = 2 * np.pi * np.arange(corners) / corners
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    return Outline(name, (outer * rim, (inner * rim)[::-1]))


def read_parts(text: str) -> tuple[Outline, ...]:
    """Parts of a text, named by their text; ValueError if one cannot be read.

    Parts stand apart by semicolons: `washer OUTER INNER` (radii in mm), `tube BEND RADIUS`
    (degrees and mm), `polygon X Y X Y ...` (corners in mm, counter-clockwise). Empty: none.

    Examples
    --------
    >>> [part.name for part in read_parts('washer 16 8; tube 90 9')]
    ['washer_16_8', 'tube_90_9']
    """
    return tuple(_part(words.split()) for words in text.split(';') if words.strip())


def _part(words: list[str]) -> Outline:
    """One part of its words."""
    name = '_'.join(words)
    try:
        sizes = [float(word) for word in words[1:]]
        if words[0] == 'washer' and len(sizes) == 2 and sizes[0] > sizes[1] > 0:
            return washer(name, 1e-3 * sizes[0], 1e-3 * sizes[1])
        if words[0] == 'tube' and len(sizes) == 2 and sizes[1] > 0:
            return Outline(name, (), 1e-3 * sizes[1], float(np.deg2rad(sizes[0])))
        if words[0] == 'polygon' and len(sizes) >= 6 and len(sizes) % 2 == 0:
            return Outline(words[0], (1e-3 * np.reshape(sizes, (-1, 2)),))
    except ValueError as err:
        msg = f'parts must be numbers after their kind; received {" ".join(words)!r}'
        raise ValueError(msg) from err
    msg = (
        'parts must be "washer OUTER INNER", "tube BEND RADIUS" or "polygon X Y X Y X Y ..." in '
        f'mm and degrees, apart by semicolons; received {" ".join(words)!r}'
    )
    raise ValueError(msg)


def area_share(area: Array, whole: Array, law: Array) -> Array:
    """Output (..., t) of partly pressed taxels over that of the whole at the same load, >= 0.05.

    `area` (..., t) is pressed of the `whole` (t,) (m2). The law p1, p2 (1 / m2), p3, p4 (m2) (4,)
    is of the current, p1 + p2 A + p3 exp(-A / p4), [4] Eq. (2): the step response of a PID element
    with a lag, with the area in place of time.

    Examples
    --------
    >>> area_share(np.array([1e-5]), np.array([2e-5]), np.array([0.0, 1.0, 0.0, 1.0])).tolist()
    [0.5]
    """
    p1, p2, p3, p4 = law
    part, all_of_it = (
        p1 + p2 * pressed + p3 * np.exp(-pressed / p4)
        for pressed in (np.clip(area, 0.0, whole), whole)
    )
    return np.asarray(np.maximum(part / all_of_it, LEAST))


def _soft_raster(loops: Sequence[Array], x: Array, y: Array, pitch: float) -> Array:
    """Part of each node's cell (y, x) that lies inside: exact along x, in lines across y."""
    start = np.concatenate(list(loops))
    end = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    levels = (y[:, None] + pitch * ((np.arange(FINER) + 0.5) / FINER - 0.5)).reshape(-1)
    line, side = np.nonzero((start[:, 1] > levels[:, None]) != (end[:, 1] > levels[:, None]))
    a, b = start[side], end[side]
    crossing = a[:, 0] + (levels[line] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    order = np.lexsort([crossing, line])
    # Each line is entered and left in turn: an entry fills the rest of its cell and all after it.
    sign = np.where(np.arange(len(order)) % 2, -1.0, 1.0)
    cells = (crossing[order] - x[0]) / pitch + 0.5
    cell = np.floor(cells).astype(np.int64)
    row, inside = line[order] // FINER, np.zeros((len(y), len(x) + 1))
    for offset, part in ((0, cell + 1 - cells), (1, cells - cell)):
        np.add.at(inside, (row, cell + offset), sign * part)
    return np.asarray(np.cumsum(inside, axis=1)[:, :-1] / FINER)


def _blur(picture: Array, radius: float) -> Array:
    """Mean of a picture over a disc of a radius in nodes."""
    from scipy.signal import fftconvolve

    reach = int(np.ceil(radius))
    steps = np.arange(-reach, reach + 1)
    away = np.hypot(steps, steps[:, None])
    disc = np.clip(radius + 0.5 - away, 0.0, 1.0)
    return np.asarray(fftconvolve(picture, disc / disc.sum(), mode='same'))


@dataclass(frozen=True, eq=False)
class ObjectFields:
    """Pressure fields that are fixed in an object's frame, on a table of nodes.

    Rows of a tube's table are distances from the nearer axis, its columns half widths of the
    contact, of which `low` holds the first and the step, and `sigma` the prior.
    """

    # (n, 3 k + 1) means of k fields over a small disc at a node, and their slopes (1/m);
    # in the end the way to the next node near which a field is not linear (m)
    table: Singles
    columns: int  # nodes of a row
    low: Array  # (2,) first node (m)
    pitch: float  # way between nodes (m)
    sigma: Array  # (k,) prior of a field's amount in parts of that of the first, which is free
    order: int  # symmetry about the origin: 0 any turn
    gyration: float  # radius of the first field (m)
    span: float  # its farthest point; inf: endless (m)
    centre: Array  # (2,) of the first field (m)
    bend: float = np.nan  # of an angle tube (rad); NaN: a flat part
    sharp: bool = True  # fields end at an outline

    @property
    def tube(self) -> bool:
        """True for a table over distance from an axis and half width of the contact."""
        return self.bend == self.bend

    @property
    def count(self) -> int:
        """Fields (k)."""
        return len(self.sigma)


def outline_fields(outline: Outline, radius: float, count: int = 3) -> ObjectFields:
    """Fields of a flat part, mean over discs of a radius (m): even pressure, and its tilts."""
    order = symmetry(outline)
    corners = np.concatenate(list(outline.loops))
    low, high = corners.min(axis=0), corners.max(axis=0)
    pitch = max(float((high - low).max()) / NODES, radius / FINENESS)
    margin = 2 * radius + 3 * pitch
    x, y = (np.arange(low[i] - margin, high[i] + margin + pitch, pitch) for i in (0, 1))
    picture = _soft_raster(outline.loops, x, y, pitch)
    total = max(float(picture.sum()), 1e-12)
    centre = np.array([(picture * x).sum(), (picture * y[:, None]).sum()]) / total
    u, v = x - centre[0], (y - centre[1])[:, None]
    size = max(float(np.ptp(x)), float(np.ptp(y)))
    gyration = float(np.sqrt((picture * (u**2 + v**2)).sum() / total)) or size
    pictures = [picture, picture * u / gyration, picture * v / gyration]
    about = float(np.sqrt((picture * (x**2 + y[:, None] ** 2)).sum() / total)) or size
    span = float(np.linalg.norm(corners, axis=1).max())
    sigma = np.array([1.0, TILT, TILT])[:count]
    table = _table(pictures[:count], pitch, radius)
    return ObjectFields(
        table, len(x), np.array([x[0], y[0]]), pitch, sigma, order, about, span, centre
    )


@dataclass(frozen=True, eq=False)
class LearnedFields:
    """Pressure fields on a square grid in an object's frame, estimated from frames."""

    pictures: Array  # (k, n, n), rows along y
    half: float  # half the side of the grid (m)
    sigma: Array  # (k,) prior of a field's amount in parts of that of the first

    def fields(self, radius: float) -> ObjectFields:
        """Table of means over discs of a radius (m)."""
        from scipy.ndimage import zoom

        side = self.pictures.shape[1]
        finer = max(int(np.ceil(2 * self.half / (side - 1) / (radius / 2.0))), 1)
        some = [zoom(picture, (finer * (side - 1) + 1) / side, order=1, grid_mode=False)
                for picture in self.pictures]  # fmt: skip
        nodes = some[0].shape[0]
        pitch = 2 * self.half / (nodes - 1)
        return ObjectFields(
            _table(some, pitch, radius), nodes, np.full(2, -self.half), pitch,
            self.sigma, 1, 0.5 * self.half, np.sqrt(2) * self.half, np.zeros(2),
            sharp=False,
        )  # fmt: skip


def tube_fields(outline: Outline, radius: float, reach: float) -> tuple[ObjectFields, ...]:
    """Field of an angle tube by each profile: springs, half-space (Hertz; Johnson 4.2), strip."""
    size = outline.thickness or UNKNOWN_RADIUS * reach
    blur = ACROSS * radius
    away = np.arange(0.0, size + 2 * blur, (size + 2 * blur) / TUBE_NODES)
    fine = np.linspace(-size - 3 * blur, size + 3 * blur, 6001)
    half = size * TUBE_WIDTHS
    found = []
    for profile in range(3):
        rows = []
        for one in half:
            q = np.minimum(np.abs(fine) / one, 1.0)
            chord = np.sqrt(size**2 - one**2)
            springs = (np.sqrt(size**2 - (q * one) ** 2) - chord) / (size - chord)
            pressure = (springs, np.sqrt(1.0 - q * q), (np.abs(fine) < one) * 1.0)[profile]
            whole = np.concatenate([[0.0], np.cumsum(pressure[1:] + pressure[:-1])])
            whole *= 0.5 * (fine[1] - fine[0])
            upper, lower = (np.interp(away + way, fine, whole) for way in (blur, -blur))
            rows.append((upper - lower) / (2 * blur))
        picture = np.array(rows).T
        by_away, by_width = np.gradient(picture, away, half)
        table = np.stack([picture, by_away, by_width], axis=-1).reshape(-1, 3)
        found.append(
            ObjectFields(
                table.astype(np.float32), len(half), np.array([half[0], half[1] - half[0]]),
                float(away[1]), np.array([1.0, WIDTH_SIGMA * size]), symmetry(outline),
                0.5 * reach, np.inf, np.zeros(2), float(outline.bend or 0.0), sharp=False,
            )
        )  # fmt: skip
    return tuple(found)


def _table(pictures: Sequence[Array], pitch: float, radius: float) -> Singles:
    """Means over discs of pictures, and their slopes, side by side."""
    from scipy.ndimage import distance_transform_edt

    columns: list[Array] = []
    for picture in pictures:
        soft = _blur(picture, radius / pitch)
        rise_y, rise_x = np.gradient(soft, pitch)
        columns += [soft, np.asarray(rise_x), np.asarray(rise_y)]
    slope: Array = np.hypot(columns[1], columns[2])
    columns.append(pitch * distance_transform_edt(slope < 1e-6 * slope.max()))
    return np.stack(columns, axis=-1).reshape(-1, len(columns)).astype(np.float32)


def symmetry(outline: Outline) -> int:
    """Order of rotation about the outline's origin: 0 any turn, n by 2 pi / n, 1 none."""
    if outline.bend is not None:
        straight = abs(np.cos(outline.bend) + 1) < 1e-9
        return 2 if straight else 1
    span = float(np.linalg.norm(np.concatenate(list(outline.loops)), axis=1).max())
    grid, pitch = np.linspace(-span, span, 241, retstep=True)
    smooth = _blur(_soft_raster(outline.loops, grid, grid, float(pitch)), 2.0)
    if all(_change(smooth, turn) < ALIKE for turn in TURNS):
        return 0
    found = [n for n in range(2, MOST_FOLD + 1) if _change(smooth, 2 * np.pi / n) < ALIKE]
    return max(found, default=1)


def _change(picture: Array, turn: float) -> float:
    """Part of a square picture's area that a turn about its middle changes."""
    from scipy.ndimage import map_coordinates

    middle = (len(picture) - 1) / 2
    row, column = np.indices(picture.shape) - middle
    cos, sin = np.cos(turn), np.sin(turn)
    there = [middle + cos * row - sin * column, middle + sin * row + cos * column]
    turned = map_coordinates(picture, there, order=1)
    return float(np.abs(turned - picture).sum() / max(picture.sum(), 1e-12))


def taxel_points(
    positions: Array, areas: Array, outlines: Sequence[Outline] | None, count: int
) -> tuple[Array, Integers, float]:
    """Points that stand for taxels, about equal parts of each.

    Parameters
    ----------
    positions, areas : ndarray, shape (t, 3) and (t,)
        Centres (m) and areas (m2).
    outlines : sequence of Outline, or None
        Shapes of the taxels; None: squares along the axes.
    count : int
        Points of a taxel, about.

    Returns
    -------
    points, first : ndarray, shape (n, 2) and (t,)
        Points, one taxel after the other (m), and the number of the first of each taxel.
    radius : float
        Of a disc as large as a point's part (m).
    """
    groups = []
    for i, (centre, area) in enumerate(zip(positions[:, :2], areas, strict=True)):
        if outlines is None:
            side = max(round(np.sqrt(count)), 1)
            steps = (np.arange(side) + 0.5) / side - 0.5
            cross = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
            groups.append(centre + np.sqrt(area) * cross)
        else:
            groups.append(_parts(outlines[i].loops, centre, count))
    sizes = np.array([len(group) for group in groups])
    radius = float(np.sqrt(np.mean(areas / sizes) / np.pi))
    return np.concatenate(groups), np.cumsum(sizes) - sizes, radius


def _parts(loops: Sequence[Array], centre: Array, count: int) -> Array:
    """Centroids of about `count` parts of equal area inside loops, from halves of halves."""
    corners = np.concatenate(list(loops))
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    pitch = float(np.sqrt(np.prod(size) / (FINE * count)))
    x, y = (low[i] + pitch * (np.arange(np.ceil(size[i] / pitch)) + 0.5) for i in (0, 1))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    fine = grid[inside(loops, grid)]
    if len(fine) < count:
        return fine.mean(axis=0)[None] if len(fine) else centre[None]
    parts = [fine]
    while 2 * len(parts) <= count:
        parts = [half for part in parts for half in _halves(part)]
    return np.array([part.mean(axis=0) for part in parts])


def _halves(part: Array) -> tuple[Array, Array]:
    """Points on either side of the middle across the longer way."""
    longer = int(np.argmax(part.var(axis=0)))
    order = np.argsort(part[:, longer], kind='stable')
    middle = len(part) // 2
    return part[order[:middle]], part[order[middle:]]
