"""What pixels read at rest when chip and disc are warm, and offsets that follow the chip.

A Hall element reads s(T) (B + o) + d T + e T^2: what the sensitivity does not scale, of an offset
too, drifts with the chip in each channel's own way (the beta of [3], one for each pixel). A
baseline was read at temperatures that nobody noted: both, the chip's and the disc's, are told by
the baseline itself.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.uniform_field import UniformField
from tactile_ros.sensors.gradiometer.thermal import UNIT, sensitivity
from tactile_ros.types import Array

AMISS = 3e-4  # of the field at rest: what its model may be wrong by
RANGE, LAGS_BY = 2.0, 0.2  # units of temperature: of chips, and by which a disc lags
ROUNDS = 3


class WarmRest:
    """Readings at rest over temperatures.

    Parameters
    ----------
    axes : ndarray, shape (n, 3)
        Direction of each channel; 0 for dead ones.
    coefficients : ndarray, shape (3,)
        p0, p1, p2 of the sensitivity.
    usual : float
        Temperature from which all others count (degrees Celsius).

    Attributes
    ----------
    level_ : ndarray, shape (n,)
        Field at rest at the usual temperature (T).
    warmer_ : ndarray, shape (n,)
        Its change over a unit of the disc's temperature (T).
    offset_ : ndarray, shape (2, n)
        Drift of readings over a unit of the chip's temperature, and over its square (T).
    unsure_ : ndarray, shape (2 m, 2 m)
        Covariance of that drift, of differences (T2); learned by `WarmFit`.
    gain_ : ndarray, shape (n, 2)
        Of both temperatures from readings (units / T).
    """

    level_: Array
    warmer_: Array
    gain_: Array
    unsure_: Array
    _last: tuple[Array, Array] | None = None  # a stream has one baseline for many frames

    def __init__(self, axes: Array, coefficients: Array, usual: float) -> None:
        self.axes, self.coefficients, self.usual = axes, coefficients, usual
        self.offset_ = np.zeros((2, len(axes)))

    def fit(self, base: Array, chip: Array, disc: Array, warmer: Array) -> WarmRest:
        """Learn the field at rest.

        Parameters
        ----------
        base : ndarray, shape (s, n)
            Baselines of resting rows (T).
        chip, disc : ndarray, shape (s,)
            Temperatures of those rows (units from the usual one); rows of one baseline were
            read with it.
        warmer : ndarray, shape (n,)
            What a unit of the disc's temperature changes (T).

        Returns
        -------
        WarmRest
            Itself.
        """
        _, which, count = np.unique(base, axis=0, return_inverse=True, return_counts=True)
        which = np.asarray(which).reshape(-1)
        chip, disc = (np.bincount(which, one)[which] / count[which] for one in (chip, disc))
        field = self.field(base, chip)
        self.level_ = (field - disc[:, None] * warmer).mean(axis=0)
        self.warmer_, self._last = warmer, None
        self._learn_gain()
        return self

    def _learn_gain(self) -> None:
        """Both temperatures from what a uniform field does not change, by least squares."""
        passed = UniformField(self.axes, 1e-6).differences
        step = 0.04
        slope = np.stack([
            (self._read(np.array([[step, 0.0]])) - self._read(np.array([[-step, 0.0]])))[0],
            (self._read(np.array([[0.0, step]])) - self._read(np.array([[0.0, -step]])))[0],
        ], axis=1) / (2 * step)  # fmt: skip
        sigma = AMISS * float(np.sqrt((self.level_**2).mean())) + 1e-9
        seen = passed.T @ slope / sigma
        tied = np.array([[1.0, -1.0], [-1.0, 1.0]]) / LAGS_BY**2
        prior = tied + np.diag([1 / RANGE**2, 0.0])
        self.gain_ = (np.linalg.solve(seen.T @ seen + prior, seen.T) @ passed.T / sigma).T

    def _strength(self, chip: Array) -> Array:
        """Sensitivity at chip temperatures (s,), shape (s, 1)."""
        return sensitivity(self.usual + UNIT * chip, self.coefficients)[:, None]

    def _read(self, warm: Array) -> Array:
        """Readings at rest (s, n) at temperatures (s, 2) of chip and disc."""
        chip, disc = warm[:, :1], warm[:, 1:]
        field = self.level_ + disc * self.warmer_
        return np.asarray(self._strength(warm[:, 0]) * field + self.drift(chip[:, 0]))

    def drift(self, chip: Array) -> Array:
        """Drift of readings (s, n) (T) at chip temperatures (s,)."""
        # a channel at a time: the same bits alone and among others
        linear, square = self.offset_
        return np.asarray(chip[:, None] * linear + (chip * chip)[:, None] * square)

    def field(self, read: Array, chip: Array) -> Array:
        """Field (s, n) of readings (s, n) at chip temperatures (s,)."""
        return np.asarray((read - self.drift(chip)) / self._strength(chip))

    def temperatures(self, base: Array) -> Array:
        """Temperatures (s, 2) of chip and disc when baselines (s, n) were read."""
        if self._last is not None and (base == self._last[0]).all():
            return np.repeat(self._last[1], len(base), axis=0)
        new = np.ones(len(base), bool)
        new[1:] = (base[1:] != base[:-1]).any(axis=1)
        read = base[new]
        warm = np.zeros((len(read), 2))
        for _ in range(ROUNDS):
            error = np.nan_to_num(read - self._read(warm))
            # a row at a time: the same bits alone and among others
            move = np.matmul(error[:, None], self.gain_)[:, 0]
            warm = np.clip(warm + move, -RANGE, RANGE)
        told = np.asarray(warm[np.cumsum(new) - 1])
        if len(base):
            self._last = base[-1:].copy(), told[-1:].copy()
        return told

    def usual_rest(self, base: Array, warm: Array) -> Array:
        """Field (s, n) that the rest of baselines (s, n) would have at the usual temperature."""
        return self.field(base, warm[:, 0]) - warm[:, 1:] * self.warmer_

    def drifts(self, chip: Array, warm: Array) -> Array:
        """How changes follow both drifts at chip temperatures (s,), tared at `warm`: (s, 2)."""
        now, then = (_powers(one) / self._strength(one) for one in (chip, warm[:, 0]))
        return np.asarray(now - then)


def _powers(chip: Array) -> Array:
    """Temperatures and their squares, shape (s, 2)."""
    return np.stack([chip, chip * chip], axis=1)
