"""Linear regression with a Gaussian prior on the weights, chosen by the evidence.

MacKay, Bayesian interpolation, Neural Computation 4, 1992: prior spreads stand in units of the
noise, whose own size has a closed form; what makes the data likeliest is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from tactile_ros.types import Array

ROUNDING = 1e-15
LEAST = 1e-24  # sum of squares left, of targets of order one


@dataclass(frozen=True)
class Moments:
    """What a regression needs of its rows, however many there are.

    Attributes
    ----------
    gram : ndarray, shape (p, p)
        Sum of weighted products of terms.
    cross : ndarray, shape (p, k)
        Sum of weighted products of terms and targets.
    square : float
        Sum of weighted squares of targets.
    rows : int
        Numbers that were told, s k.
    """

    gram: Array
    cross: Array
    square: float
    rows: int

    @classmethod
    def of(cls, terms: Array, y: Array, weight: Array | None = None) -> Moments:
        """Of terms (s, p), targets (s, k) and weights (s,)."""
        scaled = terms if weight is None else terms * weight[:, None]
        square = float((y * y).sum() if weight is None else (y * y * weight[:, None]).sum())
        return cls(scaled.T @ terms, scaled.T @ y, square, y.size)

    def evidence(self, spread: Array, least: float = 0.0) -> float:
        """Logarithm of the evidence, up to a constant, for prior spreads (p,) over the noise.

        The noise is what is likeliest, but not below `least`.
        """
        factor, misfit = self._factor(spread)
        outputs = self.cross.shape[1]
        volume = 2 * outputs * np.log(np.diagonal(factor)).sum()
        noise = max(misfit / self.rows, least * least)
        excess = misfit / noise - self.rows
        return float(-0.5 * (self.rows * np.log(noise) + excess + volume))

    def slope(self, spread: Array) -> tuple[float, Array]:
        """Evidence, and its slope (p,) along the logarithms of the prior spreads."""
        factor, misfit = self._factor(spread)
        outputs = self.cross.shape[1]
        volume = 2 * outputs * np.log(np.diagonal(factor)).sum()
        level = float(-0.5 * (self.rows * np.log(misfit / self.rows) + volume))
        weights = cho_solve((factor, True), self.cross * spread[:, None])
        root = solve_triangular(factor, np.eye(len(factor)), lower=True)
        doubt = outputs * (1.0 - np.einsum('ij,ij->j', root, root))
        gain = self.rows / misfit * (weights * weights).sum(axis=1)
        return level, np.asarray(gain - doubt)

    def solve(self, spread: Array) -> tuple[Array, Array, float]:
        """Weights (p, k), square root (p, p) of their covariance over the noise's, and noise."""
        factor, misfit = self._factor(spread)
        scaled = self.cross * spread[:, None]
        weights = spread[:, None] * cho_solve((factor, True), scaled)
        root = solve_triangular(factor, np.diag(spread), lower=True)
        return weights, np.asarray(root), float(np.sqrt(misfit / self.rows))

    def left(self, weights: Array, root: Array) -> float:
        """Spread of what weights (p, k) leave, less the freedom that they used.

        `root` (p, p) is the square root of their covariance over the noise's.
        """
        square = self.square - 2 * float((weights * self.cross).sum())
        square += float((weights * (self.gram @ weights)).sum())
        used = self.cross.shape[1] * float(np.einsum('ij,ij->', root @ self.gram, root))
        return float(np.sqrt(max(square, 0.0) / max(self.rows - used, 1.0)))

    def _factor(self, spread: Array) -> tuple[Array, float]:
        """Cholesky factor of the scaled posterior precision, and the sum of squares left."""
        matrix = self.gram * spread * spread[:, None]
        # rounding of what many rows add up to must not make the factor fail
        matrix[np.diag_indices_from(matrix)] += 1.0 + ROUNDING * float(matrix.max())
        factor = cholesky(matrix, lower=True, check_finite=False)
        half = solve_triangular(factor, self.cross * spread[:, None], lower=True)
        left = self.square - float((half * half).sum())
        least = 1e-12 * self.square + LEAST
        return np.asarray(factor), max(left, least)


def peak(places: tuple[float, ...], levels: Array) -> float:
    """Where a parabola through the largest of levels (n,) at even places and its neighbours peaks.

    Never beyond a neighbour; n is 3 or more.

    Examples
    --------
    >>> peak((0.0, 1.0, 2.0, 3.0), -((np.arange(4.0) - 1.2) ** 2))
    1.2
    """
    at = min(max(int(levels.argmax()), 1), len(levels) - 2)
    below, middle, above = levels[at - 1 : at + 2]
    bend = below - 2 * middle + above
    step = 0.5 * (below - above) / bend if bend < 0 else 0.0
    return float(places[at] + (places[1] - places[0]) * min(max(step, -1.0), 1.0))
