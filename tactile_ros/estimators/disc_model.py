"""Field of a disc magnet at pixels, of which the config tells only where to start.

The tabulated field of the disc [3], with what a calibration finds beside the config: gap,
remanence and its change with temperature, where the disc rests, the tilt that comes with a shift,
gains and crossed axes of the channels.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TypeVar

import numpy as np

from tactile_ros.estimators.polynomial_ridge import times
from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.field_table import COLUMNS, ROWS, disc_table, reach_under
from tactile_ros.types import Array, Integers

ENTRY = 0.01  # what the config is uncertain by, of gains and crossed axes
STRAY = 2e-3  # T: a field that [3] is to bear
LEAST_SHARE = 0.1


class UniformField:
    """Response of all channels to a uniform field.

    Removing the mean over equal pixels is a projection; with turned chips, unequal gains or
    crossed axes it is another one, on what is orthogonal to the response of all channels to a
    uniform field. That response is known from the chips' axes, and better from a rest in known
    fields.

    Parameters
    ----------
    axes : ndarray, shape (n, 3)
        Direction that each channel measures; 0 for channels that are not used.
    noise : float
        Of a channel (T).

    Attributes
    ----------
    uncertainty : float
        Of an entry of it.

    Examples
    --------
    >>> axes = np.tile([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (4, 1))
    >>> bool(np.allclose(axes.T @ UniformField(axes, 1e-6).differences, 0))
    True
    """

    response_: Array  # (n, 3) reading of each channel for a field of 1 along x, y, z

    def __init__(self, axes: Array, noise: float) -> None:
        self.noise = noise
        self.response_ = np.array(axes, float)
        self.uncertainty = ENTRY

    def fit(self, change: Array, stray: Array) -> UniformField:
        """Learn gains and crossed axes.

        Parameters
        ----------
        change : ndarray, shape (s, n)
            Readings at rest, less those of the tare (T).
        stray : ndarray, shape (s, 3)
            Known field since the tare (T).
        """
        used = (self.response_ != 0).any(axis=1)
        left = stray.T @ stray + np.eye(3) * (max(self.noise, 1e-9) / ENTRY) ** 2
        error = change - stray @ self.response_.T
        least = np.maximum(np.linalg.eigvalsh(left)[0], 1e-300)
        self.uncertainty = float(max(self.noise, 1e-9) / np.sqrt(least))
        for name in ('differences', 'seen', '_inverse'):
            vars(self).pop(name, None)
        self.response_ += np.where(used, np.linalg.solve(left, stray.T @ error), 0.0).T
        return self

    @property
    def directions(self) -> Array:
        """Responses (n, r) that a field of `STRAY` would make visible, orthonormal."""
        left, size, _ = np.linalg.svd(self.response_, full_matrices=False)
        return left[:, size * STRAY > np.sqrt(max(self.noise, 1e-9) ** 2 + (1e-3 * STRAY) ** 2)]

    @cached_property
    def differences(self) -> Array:
        """Projection (n, m), orthonormal, that no uniform field passes; channels unused are 0."""
        used = (self.response_ != 0).any(axis=1)
        seen = self.directions
        left, size, _ = np.linalg.svd(np.diag(used * 1.0) - seen @ seen.T)
        return np.ascontiguousarray(left[:, size > 0.5])

    @property
    def measured(self) -> Array:
        """Which of x, y, z channels measure, shape (3,) of bool."""
        size = np.sqrt((self.response_**2).sum(axis=0))
        return np.asarray(size > LEAST_SHARE * size.max())

    def solve(self, change: Array) -> Array:
        """Uniform field (s, 3) (T) of readings (s, n) (T); NaN for axes that none measures."""
        return times(change, self._inverse)

    @cached_property
    def seen(self) -> Integers:
        """Indices of the axes that channels measure."""
        return np.flatnonzero(self.measured)

    @cached_property
    def _inverse(self) -> Array:
        """Readings to the field, shape (n, 3); NaN for axes that none measures."""
        seen = self.measured
        inverse = np.full(self.response_.shape, np.nan)
        inverse[:, seen] = np.linalg.pinv(self.response_[:, seen]).T
        return inverse


@compiled
def lagrange(u: float) -> tuple[float, ...]:
    """Weights of four nodes at -1, 0, 1, 2, and their slopes."""
    a, b, c = u + 1, u - 1, u - 2
    return (
        -u * b * c / 6,
        a * b * c / 2,
        -a * u * c / 2,
        a * u * b / 6,
        -(b * c + u * c + u * b) / 6,
        (b * c + a * c + a * b) / 2,
        -(u * c + a * c + a * u) / 2,
        (u * b + a * b + a * u) / 6,
    )


@compiled
def table_point(
    x: float, y: float, z: float, table: Array, grid: Array
) -> tuple[float, float, float, float, float, float]:
    """Radial field over distance and axial field; their slopes over the distance, and depth."""
    p, q = (x * x + y * y) / grid[0] + 1, (-z - grid[1]) / grid[2]
    i = min(max(math.floor(p) - 1, 0), table.shape[0] - 4)
    j = min(max(math.floor(q) - 1, 0), table.shape[1] - 4)
    wi, wj = lagrange(p - i - 1), lagrange(q - j - 1)
    f = g = fs = gs = fz = gz = 0.0
    for a in range(4):
        rf = rg = tf = tg = 0.0
        for b in range(4):
            near, far = table[i + a, j + b, 0], table[i + a, j + b, 1]
            rf += near * wj[b]
            rg += far * wj[b]
            tf += near * wj[b + 4]
            tg += far * wj[b + 4]
        f += rf * wi[a]
        g += rg * wi[a]
        fs += rf * wi[a + 4]
        gs += rg * wi[a + 4]
        fz += tf * wi[a]
        gz += tg * wi[a]
    fs, gs = fs * (2 / grid[0]), gs * (2 / grid[0])
    return f, g, fs, gs, fz / -grid[2], gz / -grid[2]


@compiled
def turned(a: float, b: float, turn: Array) -> None:
    """Rotation (3, 3) by turns about x and y (rad)."""
    angle = math.hypot(a, b)
    half = 0.5 * angle
    sine = math.sin(angle) / angle if angle > 0 else 1.0
    share = math.sin(half) / half if angle > 0 else 1.0
    versine = 0.5 * share * share
    turn[0, 0], turn[1, 1] = 1 - versine * b * b, 1 - versine * a * a
    turn[2, 2] = math.cos(angle)
    turn[0, 1] = turn[1, 0] = versine * a * b
    turn[0, 2], turn[2, 0] = sine * b, -sine * b
    turn[1, 2], turn[2, 1] = -sine * a, sine * a


@compiled
def pixel_field(
    apart: Array, turn: Array, table: Array, grid: Array, work: Array, slope: Array
) -> tuple[float, float, float]:
    """Field of a turned disc at a point apart (3,) of it, and its slopes (3, 5)."""
    x = turn[0, 0] * apart[0] + turn[1, 0] * apart[1] + turn[2, 0] * apart[2]
    y = turn[0, 1] * apart[0] + turn[1, 1] * apart[1] + turn[2, 1] * apart[2]
    z = turn[0, 2] * apart[0] + turn[1, 2] * apart[1] + turn[2, 2] * apart[2]
    f, g, fs, gs, fz, gz = table_point(x, y, z, table, grid)
    own, half = work[:3], work[3:6]
    own[0, 0], own[1, 1], own[0, 1], own[1, 0] = (
        f + x * x * fs,
        f + y * y * fs,
        x * y * fs,
        x * y * fs,
    )
    own[0, 2], own[1, 2], own[2, 0], own[2, 1], own[2, 2] = x * fz, y * fz, x * gs, y * gs, gz
    bx = turn[0, 0] * f * x + turn[0, 1] * f * y + turn[0, 2] * g
    by = turn[1, 0] * f * x + turn[1, 1] * f * y + turn[1, 2] * g
    bz = turn[2, 0] * f * x + turn[2, 1] * f * y + turn[2, 2] * g
    for i in range(3):
        for k in range(3):
            half[i, k] = turn[i, 0] * own[0, k] + turn[i, 1] * own[1, k] + turn[i, 2] * own[2, k]
    for i in range(3):
        for k in range(3):
            slope[i, k] = -(
                half[i, 0] * turn[k, 0] + half[i, 1] * turn[k, 1] + half[i, 2] * turn[k, 2]
            )
    slope[0, 3], slope[1, 3], slope[2, 3] = 0.0, -bz, by
    slope[0, 4], slope[1, 4], slope[2, 4] = bz, 0.0, -bx
    for i in range(3):
        slope[i, 3] += slope[i, 2] * apart[1] - slope[i, 1] * apart[2]
        slope[i, 4] += slope[i, 0] * apart[2] - slope[i, 2] * apart[0]
    return bx, by, bz


@compiled
def disc_row(
    place: Array, warm: float, disc: Array, pixels: Array, axes: Array, table: Array, grid: Array,
    work: Array, slope: Array, seen: Array, steep: Array,
) -> None:  # fmt: skip
    """Readings (n,) of a disc at a place (u,), and their slopes (n, u)."""
    unknowns = len(place)
    gap, coupling = disc[0], disc[4]
    x, y = gap * place[0] + disc[1], gap * place[1] + disc[2]
    z = gap * place[2] + disc[3]
    lean = coupling * (1 - disc[8] * place[2])
    a, b = -lean * place[1] + disc[5], lean * place[0] + disc[6]
    if unknowns == 5:
        a, b = a + place[3], b + place[4]
    turn, apart = work[6:9], work[9]
    turned(a, b, turn)
    strength = 1 + disc[7] * warm
    channels = len(axes) // len(pixels)
    for p in range(len(pixels)):
        apart[0], apart[1], apart[2] = pixels[p, 0] - x, pixels[p, 1] - y, pixels[p, 2] - z
        bx, by, bz = pixel_field(apart, turn, table, grid, work, slope)
        for i in range(3):
            for k in range(3):
                slope[i, k] *= gap
            slope[i, 0] += lean * slope[i, 4]
            slope[i, 1] -= lean * slope[i, 3]
            sideways = place[0] * slope[i, 4] - place[1] * slope[i, 3]
            slope[i, 2] -= coupling * disc[8] * sideways
        for n in range(p * channels, (p + 1) * channels):
            ax, ay, az = axes[n, 0] * strength, axes[n, 1] * strength, axes[n, 2] * strength
            seen[n] = ax * bx + ay * by + az * bz
            for k in range(unknowns):
                steep[n, k] = ax * slope[0, k] + ay * slope[1, k] + az * slope[2, k]


@compiled
def disc_rows(
    places: Array, warm: Array, disc: Array, pixels: Array, axes: Array, table: Array, grid: Array,
    seen: Array, steep: Array,
) -> None:  # fmt: skip
    """Readings (s, n) of discs at places (s, u), and their slopes (s, n, u)."""
    work, slope = np.empty((10, 3)), np.empty((3, 5))
    for s in range(len(places)):
        disc_row(
            places[s], warm[s], disc, pixels, axes, table, grid, work, slope, seen[s], steep[s]
        )


GAP, REMANENCE, REST, LEANING, COUPLING, DEEPER = 0.1, 0.1, 0.08, 0.03, 0.3, 0.5
CROSSED = 0.01  # of gains and crossed axes
OFFSETS = np.array([2e-4, 5e-6])  # T: drift over a unit of temperature, and over its square
WEAKER = 0.04  # loss of remanence over a unit of temperature
GEOMETRY, WEAKENING = 9, 7
DEEPEST, SIDEWAYS, STEEP = 0.85, 1.2, 0.6  # of the gap, of the gap, rad
UPWARD = np.array([1.0, 1.0, 0.8, 1.0, 1.0])
RIGHT = 1e-3  # of the field: what a disc's model may be wrong by

Model = TypeVar('Model', bound='DiscModel')


class DiscModel:
    """Readings of pixels under a disc.

    Parameters
    ----------
    pixels : ndarray, shape (t, 3)
        (m).
    axes : ndarray, shape (n, 3)
        Direction that each of the n = c t channels measures, pixel by pixel.
    disc : ndarray, shape (4,)
        Gap to its near face, diameter, height (m), remanence (T).
    tilt : float
        Standard deviation of tilts beside those that come with a shift (rad); 0: none.
    shape : tuple of int
        Of the disc's table, as `physics.fidelity` chooses it.

    Attributes
    ----------
    found_ : ndarray, shape (9 + 5 n,)
        What was found of gap, remanence, rest, leaning, coupling, change of remanence with
        temperature, change of coupling with depth, gains and crossed axes, and two drifts of
        each channel, in units of what the config is uncertain by.
    rest_ : ndarray, shape (1, n), or None
        Readings at rest (T); None before a fit.
    """

    found_: Array
    projection_: Array  # (n, m) to the differences that a uniform field does not change
    sigma_: float  # of a difference (T)
    absolute_: bool  # whether readings are fields, not changes since rest

    def __init__(
        self, pixels: Array, axes: Array, disc: Array, tilt: float = 0.0,
        shape: tuple[int, int] = (ROWS, COLUMNS),
    ) -> None:  # fmt: skip
        self.pixels, self.axes, self.disc, self.tilt = pixels, axes, disc, tilt
        gap, diameter, height, _ = disc
        reach = reach_under(pixels, float(gap), float(height))
        self.table, self.grid = disc_table(float(diameter), float(height), reach, shape)
        self.found_ = np.zeros(GEOMETRY + axes.size + 2 * len(axes))
        self.rest_: Array | None = None

    def given(self: Model, projection: Array, sigma: float, *, absolute: bool) -> Model:
        """Say what is measured: differences (n, m), noise of a channel (T), and from what."""
        self.projection_, self.absolute_ = projection, absolute
        self.sigma_ = float(np.hypot(sigma, 1e-9))
        return self

    @property
    def unknowns(self) -> int:
        """3 for a place, 5 with a tilt of its own."""
        return 5 if self.tilt > 0 else 3

    @property
    def report(self) -> dict[str, float]:
        """What was found beside the config: lengths (m), remanence (T), gains (1)."""
        found, gap = self.found_, float(self.disc[0])
        return {
            'gap': gap * float(1 + GAP * found[0]),
            'remanence': float(self.disc[3] * (1 + REMANENCE * found[1])),
            'rest_x': gap * REST * float(found[2]),
            'rest_y': gap * REST * float(found[3]),
            'tilt_per_shift': COUPLING * float(found[6]),
            'remanence_per_unit': WEAKER * float(found[7]),
            'gain_spread': CROSSED * float(found[GEOMETRY : self._offsets].std()),
            'drift_per_unit': float(self.offset[0].std()),
        }

    @property
    def _offsets(self) -> int:
        """Where the offsets begin in what was found."""
        return GEOMETRY + self.axes.size

    @property
    def offset(self) -> Array:
        """Offsets that were found, shape (2, n) (T)."""
        return np.asarray(OFFSETS[:, None] * self.found_[self._offsets :].reshape(2, -1))

    def _set(self, found: Array) -> None:
        """Take what is found; what follows from it is forgotten."""
        self.found_ = found
        vars(self).pop('_model', None)
        vars(self).pop('_offset', None)

    @cached_property
    def _model(self) -> tuple[Array, Array]:
        """Geometry (9,) and directions of the channels (n, 3) with gains, times remanence (T)."""
        found, (gap, _, height, remanence) = self.found_, self.disc
        geometry = np.array([
            gap, gap * REST * found[2], gap * REST * found[3],
            gap * (1 + GAP * found[0]) + height / 2, COUPLING * found[6],
            LEANING * found[4], LEANING * found[5], WEAKER * found[7],
            DEEPER * found[8],
        ])  # fmt: skip
        used = (self.axes != 0).any(axis=1, keepdims=True)
        axes = self.axes + CROSSED * used * found[GEOMETRY : self._offsets].reshape(-1, 3)
        return geometry, axes * (remanence * (1 + REMANENCE * found[1]))

    def _sigma(self, change: Array) -> Array:
        """Of a difference of every row, with what a model may be wrong by: (s, 1) (T)."""
        size = np.sqrt((change**2).mean(axis=1))
        return np.asarray(np.hypot(self.sigma_, RIGHT * size)[:, None])

    def _prior(self) -> Array:
        """Inverse variances of a place (in gaps) and a tilt."""
        return np.array([1.0, 1.0, 1.0, *[1 / max(self.tilt, 1e-9) ** 2] * 2])[: self.unknowns]

    def field(self, place: Array, warm: Array | None = None) -> tuple[Array, Array]:
        """Readings of a disc moved from rest.

        Parameters
        ----------
        place : ndarray, shape (s, 3 or 5)
            Shift in gaps, and tilt (rad).
        warm : ndarray, shape (s,), or None
            As in the fit.

        Returns
        -------
        readings : ndarray, shape (s, n)
            (T).
        slopes : ndarray, shape (s, n, 3 or 5)
            (T).
        """
        readings, slopes = self._absolute(place, heats(place, warm))
        return readings - self._offset, slopes

    @cached_property
    def _offset(self) -> Array:
        """Readings at rest (n,) (T), 0 where none are taken off."""
        if self.absolute_:
            return np.zeros(len(self.axes))
        rest = self.rest_
        rest = self._absolute(np.zeros((1, 3)), np.zeros(1))[0] if rest is None else rest
        return np.asarray(rest[0])

    def _absolute(self, place: Array, heat: Array) -> tuple[Array, Array]:
        return self._along(self._model[1], place, heat)

    def _along(self, axes: Array, place: Array, heat: Array) -> tuple[Array, Array]:
        """Readings (s, n) along axes (n, 3) with their strengths, and slopes (s, n, 3 or 5)."""
        seen = np.empty((len(place), len(axes)))
        steep = np.empty((*seen.shape, place.shape[1]))
        disc_rows(
            np.ascontiguousarray(place), heat, self._model[0], self.pixels, axes, self.table,
            self.grid, seen, steep,
        )  # fmt: skip
        return seen, steep

    def _fields(self, place: Array, heat: Array) -> Array:
        """Field of a disc of 1 T at pixels (s, t, 3)."""
        every = np.tile(np.eye(3), (len(self.pixels), 1))
        return self._along(every, place, heat)[0].reshape(len(place), -1, 3)

    def _inside(self, place: Array) -> Array:
        """Places (s, 3 or 5) that the table knows."""
        _, least, most = self._bounds
        return np.asarray(np.minimum(np.maximum(place, least), most))

    @cached_property
    def _bounds(self) -> tuple[Array, Array, Array]:
        """Prior, and the least and the most that a place and a tilt may be."""
        least = np.array([-SIDEWAYS, -SIDEWAYS, -DEEPEST, -STEEP, -STEEP])[: self.unknowns]
        return self._prior(), least, -least * UPWARD[: self.unknowns]


def heats(rows: Array, warm: Array | None) -> Array:
    """Temperatures of rows, 0 where none are given or known, shape (s,)."""
    return np.zeros(len(rows)) if warm is None else np.nan_to_num(warm)
