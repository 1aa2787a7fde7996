"""Field of a disc magnet at pixels, of which the config tells only where to start.

The tabulated field of the disc [3], with what a calibration finds beside the config: gap,
remanence and its change with temperature, where the disc rests, the tilt that comes with a shift,
gains and crossed axes of the channels.
"""

from __future__ import annotations

from functools import cached_property
from typing import TypeVar

import numpy as np

from tactile_ros.estimators.polynomial_ridge import times
from tactile_ros.physics.field_table import COLUMNS, ROWS, disc_table, reach_under, table_disc
from tactile_ros.types import Array, Integers

ENTRY = 0.01  # what the config is uncertain by, of gains and crossed axes
STRAY = 2e-3  # T: a field that [3] is to bear
LEAST_SHARE = 0.1


class UniformField:
    """Response of all channels to a uniform field.

    Parameters
    ----------
    axes : ndarray, shape (n, 3)
        Direction that each channel measures; 0 for channels that are not used.
    noise : float
        Of a channel (T).

    Attributes
    ----------
    response_ : ndarray, shape (n, 3)
        Reading of each channel for a field of 1 along x, y, z.
    uncertainty : float
        Of an entry of it.

    Examples
    --------
    >>> axes = np.tile([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (4, 1))
    >>> bool(np.allclose(axes.T @ UniformField(axes, 1e-6).differences, 0))
    True
    """

    response_: Array

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

        Returns
        -------
        UniformField
            Itself.
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
    projection_ : ndarray, shape (n, m)
        To the differences that a uniform field does not change.
    sigma_ : float
        Of a difference (T).
    absolute_ : bool
        Whether readings are fields, not changes since rest.
    rest_ : ndarray, shape (1, n), or None
        Readings at rest (T); None before a fit.
    """

    found_: Array
    projection_: Array
    sigma_: float
    absolute_: bool

    def __init__(
        self,
        pixels: Array,
        axes: Array,
        disc: Array,
        tilt: float = 0.0,
        shape: tuple[int, int] = (ROWS, COLUMNS),
    ) -> None:
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
        axes = self._model[1]
        field, slope = self._fields(place, heat)
        channels = len(axes) // len(self.pixels)
        field, slope = np.repeat(field, channels, axis=1), np.repeat(slope, channels, axis=1)
        readings = np.einsum('ni,sni->sn', axes, field)
        return readings, np.einsum('ni,snij->snj', axes, slope[..., : place.shape[1]])

    def _fields(self, place: Array, heat: Array) -> tuple[Array, Array]:
        """Field of a disc of 1 T at pixels (s, t, 3), and its slopes (s, t, 3, 5)."""
        gap, x, y, z, coupling, *lean, weaker, deeper = self._model[0]
        centre = gap * place[:, :3] + np.array([x, y, z])
        turn = coupling * (1 - deeper * place[:, 2])
        tilts = np.stack([-turn * place[:, 1], turn * place[:, 0]], axis=1) + np.array(lean)
        if place.shape[1] == 5:
            tilts = tilts + place[:, 3:]
        field, slope = table_disc(self.pixels, centre, tilts, self.table, self.grid)
        px, py, turn = (one[:, None, None] for one in (place[:, 0], place[:, 1], turn))
        slope[..., :3] *= gap
        slope[..., 0] += turn * slope[..., 4]
        slope[..., 1] -= turn * slope[..., 3]
        slope[..., 2] -= coupling * deeper * (px * slope[..., 4] - py * slope[..., 3])
        strength = (1 + weaker * heat)[:, None, None]
        return field * strength, slope * strength[..., None]

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
