"""Force of an elastomer that expands and softens when it warms, from a place and temperatures.

[3] gives both causes of its thermal drift: the elastomer's height, which shifts the place, and its
stiffness, which scales the force. Both are found from recordings, by elimination of what is
linear (Golub and Pereyra, Inverse Problems 19, 2003); the rest is a polynomial that may still
change a little with temperature.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.estimators.polynomial_ridge import PolynomialRidge, monomials
from tactile_ros.estimators.training import fitted, training_rows
from tactile_ros.types import Array, Integers

DEGREES, FEW = (3, 4, 5), 6  # of what is eliminated; rows for one of its terms
ROUNDS, STEP = 8, 1e-4
MOST_ROWS = 1500
MOST = 1.6  # of the logarithm of a stiffness
PRIOR = 1e-3  # of the squares: what temperatures must explain before they are believed


class WarmPolynomial:
    """Polynomial of a place less its rise with temperature, times a stiffness of temperature.

    Parameters
    ----------
    degrees : tuple of int
        Of the polynomial, to choose from.
    slow : int
        Temperatures, the last features; the third feature is the height.

    Attributes
    ----------
    rise_, stiff_ : ndarray, shape (slow,)
        Of the height (its unit), and of the stiffness's logarithm (1), for a unit of each
        temperature.
    curve_ : ndarray, shape (slow,)
        Of that logarithm, for the square of a unit (1).
    rest_ : PolynomialRidge
        Of the corrected features.

    Examples
    --------
    >>> x = np.random.default_rng(0).uniform(-1, 1, (300, 4))
    >>> y = (1 - 0.1 * x[:, 3:]) * ((x[:, 2:3] - 0.05 * x[:, 3:]) ** 2 + x[:, :1])
    >>> found = WarmPolynomial((1, 2, 3), 1).fit(x, y)
    >>> found.rise_.round(3).tolist(), found.stiff_.round(3).tolist()
    ([0.05], [-0.1])
    """

    rise_: Array
    stiff_: Array
    curve_: Array
    rest_: PolynomialRidge

    def __init__(self, degrees: tuple[int, ...] = (1, 2, 3), slow: int = 1) -> None:
        self.degrees = degrees
        self.slow = slow

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> WarmPolynomial:
        """Learn from features x (s, d), targets y (s, k) and groups (s,) or None."""
        rows = training_rows(x, y, groups)
        self._find(rows.x, rows.y)
        known, stiff = self._corrected(rows.x, self.rise_, self.stiff_, self.curve_)
        self.rest_ = PolynomialRidge(self.degrees, self.slow).fit(
            known, rows.y / stiff, rows.groups
        )
        return self

    def leaves(self, x: Array, y: Array) -> float:
        """Squares (1) that the best rise and stiffness leave of targets over their spreads."""
        rows = training_rows(x, y)
        return self._find(rows.x, rows.y)

    def _find(self, x: Array, y: Array) -> float:
        """Find rise and stiffness; squares that they leave."""
        few = slice(None, None, -(-len(x) // MOST_ROWS))
        found, scale = np.zeros(3 * self.slow), np.ptp(x[:, 2]) + 1e-12
        spread = np.maximum(y.std(axis=0), 1e-300)
        part, target = x[few], y[few] / spread
        heat = np.abs(part[:, -self.slow :]).max(axis=0) + 1e-12
        unit = np.concatenate([0.05 * scale / heat, 0.05 / heat, 0.01 / heat**2])
        best, least = found, np.inf
        for _ in range(ROUNDS):
            left = self._left(part, target, found * unit)
            cost = float((left**2).sum() + PRIOR * found @ found)
            if cost > 0.9999 * least:
                break
            best, least = found, cost
            slopes = [self._left(part, target, (found + e) * unit) - left for e in _steps(found)]
            matrix = np.stack(slopes, axis=1) / STEP
            normal = matrix.T @ matrix + PRIOR * np.eye(len(found))
            found = found - np.linalg.solve(normal, matrix.T @ left + PRIOR * found)
            found = np.clip(found, -5, 5)
        self.rise_, self.stiff_, self.curve_ = np.split(best * unit, 3)
        return least

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of features (s, d); NotCalibratedError before a fit."""
        fitted(self, 'rest_')
        known, stiff = self._corrected(x, self.rise_, self.stiff_, self.curve_)
        return np.asarray(self.rest_.predict(known) * stiff)

    def _left(self, x: Array, y: Array, found: Array) -> Array:
        """What the best polynomial leaves of targets, shape (s k,)."""
        known, stiff = self._corrected(x, *np.split(found, 3))
        place = known[:, : -self.slow]
        z = (place - place.mean(axis=0)) / np.maximum(place.std(axis=0), 1e-300)
        terms = stiff * np.column_stack([np.ones(len(z)), monomials(z, _degree(z))])
        basis, _ = np.linalg.qr(terms)
        return np.asarray(y - basis @ (basis.T @ y)).ravel()

    def _corrected(self, x: Array, rise: Array, stiff: Array, curve: Array) -> tuple[Array, Array]:
        """Features with the height less its rise, and the stiffness (s, 1)."""
        heat = x[:, -self.slow :]
        known = np.array(x, float)
        known[:, 2] -= (heat * rise).sum(axis=1)
        harder = (heat * stiff + heat**2 * curve).sum(axis=1)
        return known, np.exp(np.clip(harder, -MOST, MOST))[:, None]


def _degree(x: Array) -> int:
    """Highest degree of which x (s, d) has rows enough."""
    terms = {degree: math.comb(x.shape[1] + degree, degree) for degree in DEGREES}
    return max((n for n, count in terms.items() if FEW * count <= len(x)), default=DEGREES[0])


def _steps(found: Array) -> Array:
    """One small step along each parameter."""
    return np.asarray(STEP * np.eye(len(found)))
