"""What every head would do to a magnetised sheet, at all places, turns and depths.

For each head and turn the answer of the chips at all places is one product of spectra for each
power of the depth, so that twenty thousand presses cost a second or two. They are kept as
coefficients of cubic splines in place and turn: between the nodes a template costs 64 rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactile_ros.physics.coverage import symmetry
from tactile_ros.physics.magnetic_sheet import moved_dipole_series, powers
from tactile_ros.physics.punch_dents import PunchDents

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.physics.magnetic_sheet import Sheet
    from tactile_ros.types import Array, Integers, Outline

COARSE = (3, 1)  # cells from place to place along x and y, across which bands change
REACH = 0.45  # of the sheet: places from its middle
RIM = 2e-3  # m, that the rim of a head moves from turn to turn
TURNS = (6, 40)
BOTH = 2  # powers of depth in which turns of dipoles count
AT_ONCE = 12  # channels


@dataclass
class Head:
    """One outline: its label, order of symmetry, radius (m), loads, and first row of the bank."""

    label: int
    order: int
    radius: float
    points: Array
    loads: Array
    turns: int
    first: int

    @property
    def sector(self) -> float:
        """Turn after which it looks the same (rad)."""
        return 2 * np.pi / max(self.order, 1)


class PressBank:
    """Templates of heads on one sheet.

    Parameters
    ----------
    sheet : Sheet
        At rest.
    dents : PunchDents
        Of the body that it is in.
    chips : ndarray, shape (t, 3)
        Hall elements (m).
    responses : ndarray, shape (t, 3, 3)
        Field in sensor axes -> readings of a chip.
    turning : float
        Share of the body's turns that dipoles follow.
    outlines : sequence of Outline
        Heads; a label is an index into them.

    Attributes
    ----------
    heads : list of Head
        In the order of the outlines.
    places : tuple of ndarray
        Nodes along x and y (m).
    table : ndarray, shape (turns, x, y, 3, t 3)
        Spline coefficients for the powers 1 to 3 of the depth (T / m, T / m2, T / m3).
    """

    def __init__(
        self,
        sheet: Sheet,
        dents: PunchDents,
        chips: Array,
        responses: Array,
        turning: float,
        outlines: Sequence[Outline],
    ) -> None:
        self.sheet, self.dents, self.turning = sheet, dents, turning
        self.heads: list[Head] = []
        rows = 0
        for label, outline in enumerate(outlines):
            points, loads = dents.loads(outline)
            order = symmetry(outline)
            radius = float(np.linalg.norm(np.concatenate(outline.loops), axis=1).max())
            wanted = 2 * np.pi / max(order, 1) * radius / RIM
            turns = 1 if order == 0 else int(np.clip(np.ceil(wanted), *TURNS))
            self.heads.append(Head(label, order, radius, points, loads, turns, rows))
            rows += turns
        self.step = dents.pitch * np.array(COARSE)
        self.half = np.array(
            [int(REACH * len(line)) // c for line, c in zip(sheet.lines, COARSE, strict=True)]
        )
        self.table = self._table(chips, responses)

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
        if self.turning == 0 or power > BOTH:
            return found
        once = [(3, 2, 1.0)] if axis == 1 else [(4, 0, 1.0), (3, 1, -1.0)]
        for turn, toward, sign in once:
            size = sign * self.turning
            found += [((*_factors(k), turn), toward, power - 1, size) for k in powers(power - 1)]
        if power == BOTH:
            twice = [((3, 4), 0, 0.5), ((3, 3), 1, -0.5)]
            twice = twice if axis == 1 else [((3, 3), 2, -0.5), ((4, 4), 2, -0.5)]
            found += [(both, to, 0, size * self.turning**2) for both, to, size in twice]
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
        moment = self.sheet.moments[None, :, None]
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
        """Templates by power of depth, and how they change with the pose.

        Parameters
        ----------
        head : ndarray, shape (n,)
            Numbers of heads.
        poses : ndarray, shape (n, 3)
            Places (m) and turns (rad).

        Returns
        -------
        ndarray, shape (n, 4, 3, t 3)
            Value, and its change with x, y (per m) and turn (per rad), for each power of depth;
            beyond the places it stays as at their edge.
        """
        sides = 2 * self.half + 1
        first, per_turn, turns = (self.about[head, i] for i in range(3))
        at = np.empty((len(head), 3))
        at[:, 0] = poses[:, 2] * per_turn
        at[:, 1:] = np.clip(poses[:, :2] / self.step + self.half, 1.0, sides - 2.0 - 1e-9)
        low = np.floor(at)
        weight, slope = _spline(at - low)
        slope[:, 0] *= per_turn[:, None].astype(np.float32)
        slope[:, 1:] *= (1 / self.step)[:, None].astype(np.float32)
        rows = low.astype(np.int64)[:, :, None] + np.arange(-1, 3)
        turn = first.astype(np.int64)[:, None] + rows[:, 0] % turns.astype(np.int64)[:, None]
        index = (turn[:, :, None, None] * sides[0] + rows[:, 1, None, :, None]) * sides[1]
        return self._mixed(weight, slope, index + rows[:, 2, None, None, :])

    def _mixed(self, weight: Array, slope: Array, index: Integers) -> Array:
        """Rows at an index (n, 4, 4, 4) with weights and slopes (n, 3, 4); see `at`.

        Sums are written out, so that compiled loops have the same bits.
        """
        (wt, wx, wy), (st, sx, sy) = (np.moveaxis(w, 1, 0)[..., None] for w in (weight, slope))
        found = np.zeros((len(index), 4, 3 * self.table.shape[-1]), np.float32)
        for i in range(4):
            plane = np.zeros((3, *found[:, 0].shape), np.float32)
            for j in range(4):
                row = self.flat[index[:, i, j]]
                value = sum(wy[:, k] * row[:, k] for k in range(4))
                plane[0] += wx[:, j] * value
                plane[1] += sx[:, j] * value
                plane[2] += wx[:, j] * sum(sy[:, k] * row[:, k] for k in range(4))
            for k in range(3):
                found[:, k] += wt[:, i] * plane[k]
            found[:, 3] += st[:, i] * plane[0]
        return found.reshape(len(index), 4, 3, -1)

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
    """What turns the spectrum of values into that of spline coefficients, along one axis."""
    shape = [1] * like.ndim
    shape[axis] = -1
    gain: Array = np.asarray(3 / (2 + np.cos(2 * np.pi * wave)), np.float32).reshape(shape)  # type: ignore[assignment]
    return gain


def _spline(part: Array) -> tuple[Array, Array]:
    """Weights (..., 4) of a cubic spline's coefficients, and their slopes, for parts of a step."""
    t, u = part, 1.0 - part
    weight = [
        u * u * u, 3.0 * t * t * t - 6.0 * t * t + 4.0, 3.0 * u * u * u - 6.0 * u * u + 4.0,
        t * t * t,
    ]  # fmt: skip
    slope = [-3.0 * u * u, 9.0 * t * t - 12.0 * t, 12.0 * u - 9.0 * u * u, 3.0 * t * t]
    found = (np.stack(one, axis=-1) / 6.0 for one in (weight, slope))
    first, second = (np.asarray(one, np.float32) for one in found)
    return first, second  # type: ignore[return-value]
