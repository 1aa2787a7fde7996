# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Which head pressed, where, how turned and how deep: templates first, then least squares.

A press is compared with templates of unit length, after what a uniform field could have added is
taken out of both. The likeliest places are found by what all heads have in common there; then
the best nodes of each head are refined, and misfits decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from tactile_ros.estimators.few_shot import Rows, without_field
from tactile_ros.estimators.model_inversion import _factor, _substitute
from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.coverage import symmetry
from tactile_ros.physics.magnet_sheet import moved_dipole_series, powers

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from tactile_ros.estimators.sheet_calibration import SkinModel
    from tactile_ros.types import Array, Integers, Outline

    Singles = npt.NDArray[np.float32]

COARSE = (3, 1)  # cells from place to place along x and y, across which bands change
REACH = 0.45  # of the sheet: places from its middle
RIM = 2e-3  # m, that the rim of a head moves from turn to turn
TURNS = (6, 40)
BOTH = 2  # powers of depth in which turns of dipoles count
AT_ONCE = 12  # channels
ROUNDS = 8  # of a descent
FAINTEST = 0.02  # of the usual depth, where a descent begins
CLOSE = 0.5  # of a misfit, which one step may leave to its straight line
BEHIND = 0.1  # of how far a head is behind
SHRUNK = 0.3  # of a step that led nowhere
DAMPING, TINY = 1e-4, 1e-30
LONGEST = np.array([2e-3, 2e-3, 0.35])  # m, m, rad: steps
RATIO = (0.4, 2.5)  # of depths from step to step
USUAL = 0.12  # of the body: depth of the templates that are searched
RANK = 6  # patterns that heads have in common at a place
PLACES = 20  # looked at closely
STARTS = 2  # of each head
DEEPEST, SHALLOWEST = 0.5, 0.005  # of the body


@dataclass
class Head:
    """One outline: its order of symmetry, loads, turns, and first row of the bank."""

    order: int
    points: Array
    loads: Array
    turns: int
    first: int

    @property
    def sector(self) -> float:
        """Turn after which it looks the same (rad)."""
        return 2 * np.pi / max(self.order, 1)


@dataclass(frozen=True)
class Matches(Rows):
    """The best press of every head, for each of n presses."""

    cost: Array  # (n, heads) squared misfit over its variance
    pose: Array  # (n, heads, 4) place (m), turn (rad) and depth (m)
    cov: Array  # (n, heads, 4, 4) of the pose, as noise and error of the model have it
    slopes: Array  # (n, heads, 4, d) change of the pattern with the pose
    fitted: Array  # (n, heads, d) pattern of the best press


class PressBank:
    """Templates of heads on one skin; a label is an index into `outlines`.

    Attributes
    ----------
    table : ndarray, shape (turns, x, y, 3, t 3)
        Spline coefficients for the powers 1 to 3 of the depth (T / m, T / m2, T / m3).
    """

    def __init__(self, model: SkinModel, outlines: Sequence[Outline]) -> None:
        self.sheet, self.dents, self.turning = model.sheet, model.dents, model.turning
        self.common, self.body = model.common, model.body
        self.heads: list[Head] = []
        rows = 0
        for outline in outlines:
            points, loads = self.dents.loads(outline)
            order = symmetry(outline)
            radius = float(np.linalg.norm(np.concatenate(outline.loops), axis=1).max())
            wanted = 2 * np.pi / max(order, 1) * radius / RIM
            turns = 1 if order == 0 else int(np.clip(np.ceil(wanted), *TURNS))
            self.heads.append(Head(order, points, loads, turns, rows))
            rows += turns
        self.sectors = np.array([head.sector for head in self.heads])
        self.orders = np.array([head.order for head in self.heads])
        self.step = self.dents.pitch * np.array(COARSE)
        self.half = np.array(
            [int(REACH * len(line)) // c for line, c in zip(self.sheet.lines, COARSE, strict=True)]
        )
        self.table = self._table(model.chips, model.responses)
        self._index()

    def _index(self) -> None:
        """Make unit templates of a usual depth, and what all have in common at each place."""
        self.basis = np.linalg.qr(self.common)[0]
        self.limit = np.array([*LONGEST, *RATIO, SHALLOWEST * self.body, DEEPEST * self.body])
        nodes, usual = self.at_nodes(), USUAL * self.body
        found = nodes[..., 0, :] + usual * nodes[..., 1, :] + usual**2 * nodes[..., 2, :]
        found = without_field(found, self.basis.astype(np.float32))
        found /= np.linalg.norm(found, axis=-1, keepdims=True) + np.float32(TINY)
        turns, nx, ny, d = found.shape
        self.units = np.ascontiguousarray(np.moveaxis(found, 0, 2).reshape(nx * ny, turns, d))
        gram = np.matmul(np.swapaxes(self.units, 1, 2), self.units)
        spans = np.linalg.eigh(gram)[1][..., -min(RANK, turns) :]
        self.spans = np.ascontiguousarray(np.moveaxis(spans, 2, 0)).reshape(-1, d)
        self.places = np.stack(np.meshgrid(*self.nodes, indexing='ij'), axis=-1).reshape(-1, 2)

    def find(self, patterns: Array, variance: Array) -> Matches:
        """The best press of every head, from patterns and their variance, both (n, d)."""
        (n, d), heads = patterns.shape, len(self.heads)
        weight = 1 / np.sqrt(variance)
        span = np.swapaxes(np.linalg.qr(weight[..., None] * self.common)[0], 1, 2)
        span = np.ascontiguousarray(span)
        wanted = patterns * weight
        wanted -= np.einsum('ni,nki,nkd->nd', wanted, span, span)
        pose, cost = np.empty((n, heads, 4)), np.empty((n, heads))
        normal, plain = np.empty((n, heads, 4, 4)), np.empty((n, heads, 5, d))
        starts, each = np.repeat(np.arange(heads), STARTS), STARTS * np.arange(heads)
        all_cost, all_normal = np.empty(len(starts)), np.empty((len(starts), 4, 4))
        all_plain = np.empty((len(starts), 5, d))
        # one by one, so that a press has the same starts alone and among others
        for i, pattern in enumerate(patterns):
            start = self._starts(pattern - self.basis @ (pattern @ self.basis))
            descend_rows(
                self.flat, self.grid, self.about, starts, self.limit, weight[i], span[i],
                wanted[i], start, all_cost, all_normal, all_plain,
            )  # fmt: skip
            best = all_cost.reshape(-1, STARTS).argmin(axis=1) + each
            pose[i], cost[i] = start[best], all_cost[best]
            normal[i], plain[i] = all_normal[best], all_plain[best]
        unit = np.sqrt(np.diagonal(normal, axis1=2, axis2=3)) + TINY
        size = unit[..., None] * unit[..., None, :]
        cov = np.linalg.inv(normal / size + DAMPING * np.eye(4)) / size
        return Matches(cost, pose, cov, plain[:, :, 1:], plain[:, :, 0])

    def _starts(self, own: Array) -> Array:
        """Poses (s, 4) at which descents of one press (d,) start, head by head."""
        own = (own / (np.sqrt(own @ own) + TINY)).astype(np.float32)
        seen = np.square(self.spans @ own).reshape(-1, len(self.places)).sum(axis=0)
        near = np.argsort(-seen)[:PLACES]
        score = -(self.units[near] @ own)
        pose = np.full((len(self.heads), STARTS, 4), USUAL * self.body)
        for i, head in enumerate(self.heads):
            part = score[:, head.first : head.first + head.turns]
            # of unlike turns: two that are neighbours often lead to one minimum
            turn = np.resize(np.argsort(part.min(axis=0))[:STARTS], STARTS)
            pose[i, :, :2] = self.places[near[part.argmin(axis=0)[turn]]]
            pose[i, :, 2] = turn * head.sector / head.turns
        return pose.reshape(-1, 4)

    @property
    def nodes(self) -> tuple[Array, Array]:
        """Places along x and y (m)."""
        x, y = (
            step * np.arange(-half, half + 1)
            for step, half in zip(self.step, self.half, strict=True)
        )
        return x, y

    def _table(self, chips: Array, responses: Array) -> Array:
        """Spline coefficients of all heads and turns."""
        spectra = [self._spectra(head, i) for head in self.heads for i in range(head.turns)]
        channels = 3 * len(chips)
        sides = 2 * self.half + 1
        table = np.empty((len(spectra), *sides, 3, channels), np.float32)
        for power in (1, 2, 3):
            dent = np.stack([one[power - 1] for one in spectra], axis=-1)  # kx, ky, product, row
            per = AT_ONCE // 3
            for first in range(0, len(chips), per):
                part = slice(first, first + per)
                kernel = self._kernel(chips[part], responses[part], power)
                found = np.matmul(kernel, dent)
                table[..., power - 1, 3 * first : 3 * first + kernel.shape[2]] = self._cut(found)
        for head in self.heads:
            rows = slice(head.first, head.first + head.turns)
            table[rows] = _spline_in_turn(table[rows])
        return table

    def _terms(self, power: int) -> list[tuple[tuple[int, ...], int, int, float]]:
        """Products of images, with the axis of the moment, power of movement and size."""
        axis = self.sheet.axis
        found = [(_factors(k), axis, power, 1.0) for k in powers(power)]
        if self.turning == 0:
            return found
        once = [(3, 2, 1.0)] if axis == 1 else [(4, 0, 1.0), (3, 1, -1.0)]
        for turn, toward, sign in once:
            size = sign * self.turning
            found += [((*_factors(k), turn), toward, power - 1, size) for k in powers(power - 1)]
        if power >= BOTH:
            twice = [((3, 4), 0, 0.5), ((3, 3), 1, -0.5)]
            twice = twice if axis == 1 else [((3, 3), 2, -0.5), ((4, 4), 2, -0.5)]
            found += [
                ((*_factors(k), *both), to, power - BOTH, size * self.turning**2)
                for both, to, size in twice
                for k in powers(power - BOTH)
            ]
        return found

    def _spectra(self, head: Head, turn: int) -> list[Array]:
        """Spectra (kx, ky, product) of products of a dent's images, for each power of depth."""
        pose = np.array([0.0, 0.0, turn * head.sector / head.turns])
        images = self.dents.images(head.points, head.loads, pose).astype(np.float32)
        found = []
        for power in (1, 2, 3):
            made = [np.prod(images[list(what)], axis=0) for what, _, _, _ in self._terms(power)]
            flat = np.concatenate(made)  # product and level
            spectrum = np.conj(fft.rfft2(flat)).astype(np.complex64)
            found.append(np.moveaxis(spectrum, 0, -1))
        return found

    def _kernel(self, chips: Array, responses: Array, power: int) -> Array:
        """Spectra (kx, ky, channel, product) of what products do to chips, at all cells."""
        x, y = self.sheet.lines
        cells = np.stack(np.meshgrid(x, y, self.sheet.levels, indexing='ij'), axis=-1)
        r = chips[:, None, None, None] - cells
        moment = self.sheet.moments[..., None]
        series = {
            (axis, order): moved_dipole_series(r, moment, axis, order)
            for axis, order in {(axis, order) for _, axis, order, _ in self._terms(power)}
        }
        at = [self.dents.index(line, i) for i, line in enumerate((x, y))]
        n, terms = self.dents.count, self._terms(power)
        full = np.zeros((len(terms), 2, len(chips), 3, n, n), np.float32)
        for i, (what, axis, order, size) in enumerate(terms):
            i0, i1, i2 = (sum(f == j for f in what) for j in range(3))
            found = size * series[axis, order][powers(order).index((i0, i1, i2))]
            read = np.einsum('tij,jtxyl->ltixy', responses, found)
            full[i][..., at[0][:, None], at[1][None]] = read
        flat = full.reshape(2 * len(terms), 3 * len(chips), n, n)
        spectrum = fft.rfft2(flat).astype(np.complex64)
        return np.ascontiguousarray(np.moveaxis(spectrum, (0, 1), (3, 2)))

    def _cut(self, spectrum: Array) -> Array:
        """Spline coefficients (row, x, y, channel) at the places, from spectra over all cells."""
        n, count = self.dents.count, self.dents.count // COARSE[0]
        folded = spectrum.reshape(COARSE[0], count, *spectrum.shape[1:]).sum(axis=0)
        folded *= _gain(fft.fftfreq(count), folded, 0) / COARSE[0]
        rows = np.arange(-self.half[0], self.half[0] + 1)
        found = fft.ifft(folded, axis=0)[rows]
        found *= _gain(fft.rfftfreq(n), found, 1)
        columns = np.arange(-self.half[1], self.half[1] + 1)
        smooth = fft.irfft(found, n, axis=1)[:, columns]
        return np.moveaxis(smooth, -1, 0)

    def at(self, head: Integers, poses: Array) -> Array:
        """Templates of heads (n,) at poses (n, 3) (m, rad), shape (n, 4, 3, t 3).

        Value, and its change with x, y (per m) and turn (per rad), for each power of depth; beyond
        the places it stays as at their edge.
        """
        wide = 3 * self.table.shape[-1]
        found, work = np.empty((len(head), 4, wide), np.float32), np.empty((3, wide), np.float32)
        for i, pose in enumerate(poses):
            template_rows(self.flat, self.grid, self.about[head[i]], pose, work, found[i])
        return found.reshape(len(head), 4, 3, -1)

    @cached_property
    def flat(self) -> npt.NDArray[np.float32]:
        """Table with a row for each node."""
        return np.asarray(self.table.reshape(-1, 3 * self.table.shape[-1]), np.float32)

    @cached_property
    def about(self) -> Array:
        """First row, rows per radian, and rows of each head, shape (heads, 3)."""
        return np.array(
            [
                [head.first, head.turns / head.sector if head.order else 0.0, head.turns]
                for head in self.heads
            ]
        )

    @cached_property
    def grid(self) -> Array:
        """Steps (m) along x and y, and places from the middle to the edge."""
        return np.array([*self.step, *self.half], float)

    def at_nodes(self) -> Array:
        """Templates at all nodes, shape (turns, x, y, 3, t 3)."""
        found = self.table
        for axis in (1, 2):
            edge = [(1, 1) if i == axis else (0, 0) for i in range(found.ndim)]
            wide = np.moveaxis(np.pad(found, edge, mode='edge'), axis, 0)
            found = np.moveaxis((wide[:-2] + 4 * wide[1:-1] + wide[2:]) / 6, 0, axis)
        for head in self.heads:
            rows = slice(head.first, head.first + head.turns)
            part = found[rows]
            found[rows] = (np.roll(part, 1, axis=0) + 4 * part + np.roll(part, -1, axis=0)) / 6
        return found


def _factors(exponents: tuple[int, int, int]) -> tuple[int, ...]:
    """Numbers of the components of a product."""
    return tuple(i for i, count in enumerate(exponents) for _ in range(count))


def _spline_in_turn(rows: Array) -> Array:
    """Spline coefficients of values (n, ...) that return to themselves."""
    if len(rows) == 1:
        return rows
    spectrum = fft.rfft(rows, axis=0)
    spectrum *= _gain(fft.rfftfreq(len(rows)), spectrum, 0)
    return np.asarray(fft.irfft(spectrum, len(rows), axis=0), np.float32)


def _gain(wave: Array, like: Array, axis: int) -> Array:
    """Gain from the spectrum of values to that of spline coefficients, along one axis."""
    shape = [1] * like.ndim
    shape[axis] = -1
    gain: Array = np.asarray(3 / (2 + np.cos(2 * np.pi * wave)), np.float32).reshape(shape)  # type: ignore[assignment]
    return gain


@compiled
def spline_rows(t: float, value: Singles, slope: Singles, steps: float) -> None:
    """Weights (4,) of a cubic spline's coefficients, and their slopes by `steps`; both filled."""
    u = 1.0 - t
    value[0], value[3] = u * u * u / 6.0, t * t * t / 6.0
    value[1] = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0
    value[2] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    slope[0], slope[3] = -3.0 * u * u / 6.0 * steps, 3.0 * t * t / 6.0 * steps
    slope[1] = (9.0 * t * t - 12.0 * t) / 6.0 * steps
    slope[2] = (12.0 * u - 9.0 * u * u) / 6.0 * steps


@compiled
def plane_rows(
    flat: Singles, first: int, stride: int, weight: Singles, slope: Singles, work: Singles
) -> None:
    """Sixteen neighbouring rows of a table as one, and its slopes; `work` (3, r) is filled."""
    v0, v1, v2, v3 = weight[1, 0], weight[1, 1], weight[1, 2], weight[1, 3]
    u0, u1, u2, u3 = slope[1, 0], slope[1, 1], slope[1, 2], slope[1, 3]
    work[:] = 0
    for j in range(4):
        w, s = weight[0, j], slope[0, j]
        row = first + j * stride
        a, b, c, d = flat[row], flat[row + 1], flat[row + 2], flat[row + 3]
        for k in range(work.shape[1]):
            value = v0 * a[k] + v1 * b[k] + v2 * c[k] + v3 * d[k]
            work[0, k] += w * value
            work[1, k] += s * value
            work[2, k] += w * (u0 * a[k] + u1 * b[k] + u2 * c[k] + u3 * d[k])


@compiled
def template_rows(
    flat: Singles, grid: Array, about: Array, pose: Array, work: Singles, parts: Singles
) -> None:
    """One template and its slopes, as of `PressBank.at`; `parts` (4, 3 d) is filled."""
    weight, slope = np.empty((3, 4), np.float32), np.empty((3, 4), np.float32)
    turn = pose[2] * about[1]
    x = min(max(pose[0] / grid[0] + grid[2], 1.0), 2.0 * grid[2] - 1.0 - 1e-9)
    y = min(max(pose[1] / grid[1] + grid[3], 1.0), 2.0 * grid[3] - 1.0 - 1e-9)
    low_turn, low_x, low_y = np.floor(turn), np.floor(x), np.floor(y)
    spline_rows(turn - low_turn, weight[0], slope[0], about[1])
    spline_rows(x - low_x, weight[1], slope[1], 1.0 / grid[0])
    spline_rows(y - low_y, weight[2], slope[2], 1.0 / grid[1])
    nx, ny, turns = 2 * int(grid[2]) + 1, 2 * int(grid[3]) + 1, int(about[2])
    parts[:] = 0
    last = -1
    for i in range(4):
        w, s = weight[0, i], slope[0, i]
        row = int(about[0]) + (int(low_turn) + i - 1) % turns
        if row != last:  # round heads have one
            first = (row * nx + int(low_x) - 1) * ny + int(low_y) - 1
            plane_rows(flat, first, ny, weight[1:], slope[1:], work)
        last = row
        for k in range(work.shape[1]):
            parts[0, k] += w * work[0, k]
            parts[1, k] += w * work[1, k]
            parts[2, k] += w * work[2, k]
            parts[3, k] += s * work[0, k]


@compiled
def normal_equations(
    parts: Singles, depth: float, weight: Array, span: Array, wanted: Array, plain: Array,
    normal: Array, right: Array,
) -> float:  # fmt: skip
    """Squared misfit of a template at a depth.

    Its pattern with slopes of place, turn and depth (5, d), and the normal matrix (4, 4) and right
    side (4,) of a Gauss-Newton step are filled; a uniform field, `span` (3, d), is left out.
    """
    d, a, b = len(wanted), depth * depth, depth * depth * depth
    for k in range(d):
        for j in range(4):
            plain[j, k] = depth * parts[j, k] + a * parts[j, d + k] + b * parts[j, 2 * d + k]
        plain[4, k] = parts[0, k] + 2.0 * depth * parts[0, d + k] + 3.0 * a * parts[0, 2 * d + k]
    rows = plain * weight
    rows -= (rows @ span.T) @ span
    miss = wanted - rows[0]
    normal[:] = rows[1:] @ rows[1:].T
    right[:] = rows[1:] @ miss
    return float(miss @ miss)


@compiled
def clipped_step(
    normal: Array, right: Array, pose: Array, limit: Array, size: float, tried: Array
) -> float:
    """Reduction of the cost that a whole step promises; `tried` (4,) is the pose after a part."""
    system, move = normal.copy(), right.copy()
    for i in range(4):
        system[i, i] = (1.0 + DAMPING) * normal[i, i] + TINY
    _factor(system)
    _substitute(system, move.reshape(4, 1))
    for i in range(3):
        tried[i] = pose[i] + min(max(size * move[i], -limit[i]), limit[i])
    ratio = min(max(1.0 + size * move[3] / pose[3], limit[3]), limit[4])
    tried[3] = min(max(pose[3] * ratio, limit[5]), limit[6])
    return float(right @ move)


@compiled
def descend_rows(
    flat: Singles, grid: Array, about: Array, head: Integers, limit: Array, weight: Array,
    span: Array, wanted: Array, pose: Array, cost: Array, normal: Array, plain: Array,
) -> None:  # fmt: skip
    """Descents (s) of one press by Gauss-Newton; all from `pose` on is filled.

    One that can no more change what is said, as the best ones stand, ends early.
    """
    d = len(wanted)
    work, parts = np.empty((3, 3 * d), np.float32), np.empty((4, 3 * d), np.float32)
    right, slope, steep = np.empty(4), np.empty(4), np.empty((4, 4))
    flatter, tried, own = np.empty((5, d)), np.empty(4), np.full(len(about), np.inf)
    for s in range(len(head)):
        row = about[head[s]]
        template_rows(flat, grid, row, pose[s], work, parts)
        normal_equations(parts, pose[s, 3], weight, span, wanted, plain[s], normal[s], right)
        made = plain[s, 0] * weight
        made -= (made @ span.T) @ span
        ratio = max((made @ wanted) / (made @ made), FAINTEST)
        pose[s, 3] = min(max(pose[s, 3] * ratio, limit[5]), limit[6])
        cost[s] = normal_equations(
            parts, pose[s, 3], weight, span, wanted, plain[s], normal[s], right
        )
        size = 1.0
        for _ in range(ROUNDS):
            promised = size * clipped_step(normal[s], right, pose[s], limit, size, tried)
            hopeless = cost[s] - 2.0 * promised > own[head[s]]
            if hopeless or promised <= max(CLOSE, BEHIND * (cost[s] - own.min())):
                break
            template_rows(flat, grid, row, tried, work, parts)
            new = normal_equations(parts, tried[3], weight, span, wanted, flatter, steep, slope)
            if new < cost[s]:
                pose[s], cost[s], normal[s], plain[s], right[:] = tried, new, steep, flatter, slope
                size = 1.0
            else:
                size *= SHRUNK
        if clipped_step(normal[s], right, pose[s], limit, 1.0, tried) <= CLOSE:
            change = tried - pose[s]  # so short that a straight line tells what it does
            cost[s] -= change @ (2.0 * right - normal[s] @ change)
            plain[s, 0] += change @ plain[s, 1:]
            pose[s] = tried
        own[head[s]] = min(own[head[s]], cost[s])
