"""What a uniform field does to channels, and the differences that it leaves alone [3].

Removing the mean over equal pixels is a projection; with turned chips, unequal gains or crossed
axes it is another one, on what is orthogonal to the response of all channels to a uniform field.
That response is known from the chips' axes, and better from a rest in known fields.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_ros.estimators.polynomial_rows import times
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
