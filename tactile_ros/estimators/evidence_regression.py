# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bayesian linear regression whose prior is chosen by evidence (type-II maximum likelihood).

Weights have independent Gaussian priors; their standard deviations, in units of the noise, follow
from a few hyperparameters, which are chosen so that the targets are most probable. Errors of a
regression without one group of rows follow in closed form from the regression with it.

Sources: D. MacKay, Bayesian interpolation, Neural Computation 4 (1992); C. Bishop, Pattern
Recognition and Machine Learning (2006), sec. 3.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Callable

    Prior = Callable[[Array], tuple[Array, Array]]

ROUNDING = 1e-15
LEAST = 1e-24  # residual sum of squares, of targets of order one
STEPS = 60


@dataclass(frozen=True)
class Moments:
    """Sufficient statistics of weighted rows."""

    gram: Array  # (p, p) sum of weighted products of terms
    cross: Array  # (p, k) sum of weighted products of terms and targets
    square: float  # sum of weighted squares of targets
    rows: int  # number of targets, s k

    @classmethod
    def of(cls, terms: Array, y: Array, weight: Array | None = None) -> Moments:
        """Sums over rows of terms (s, p), targets (s, k) and weights (s,)."""
        scaled = terms if weight is None else terms * weight[:, None]
        square = float((y * y).sum() if weight is None else (y * y * weight[:, None]).sum())
        return cls(scaled.T @ terms, scaled.T @ y, square, y.size)

    def evidence(self, spread: Array, least: float = 0.0) -> tuple[float, Array]:
        """Log evidence for prior sigmas (p,) over the noise, and its slope (p,) by their logs.

        It is up to a constant, for the most probable noise, which is at least `least`.
        """
        factor, misfit = self._factor(spread)
        outputs = self.cross.shape[1]
        volume = 2 * outputs * np.log(np.diagonal(factor)).sum()
        noise = max(misfit / self.rows, least * least)
        excess = misfit / noise - self.rows
        weights = cho_solve((factor, True), self.cross * spread[:, None])
        root = solve_triangular(factor, np.eye(len(factor)), lower=True)
        used = outputs * (1.0 - np.einsum('ij,ij->j', root, root))
        slope = (weights * weights).sum(axis=1) / noise - used
        return float(-0.5 * (self.rows * np.log(noise) + excess + volume)), np.asarray(slope)

    def solve(self, spread: Array) -> tuple[Array, Array, float]:
        """Weights (p, k), square root (p, p) of their covariance over the noise's, and noise."""
        factor, misfit = self._factor(spread)
        weights = spread[:, None] * cho_solve((factor, True), self.cross * spread[:, None])
        root = solve_triangular(factor, np.diag(spread), lower=True)
        return weights, np.asarray(root), float(np.sqrt(misfit / self.rows))

    def left(self, weights: Array, root: Array) -> float:
        """Residual standard deviation of weights (p, k), less the degrees of freedom they used.

        `root` (p, p) is the square root of their covariance over the noise's.
        """
        square = self.square - 2 * float((weights * self.cross).sum())
        square += float((weights * (self.gram @ weights)).sum())
        used = self.cross.shape[1] * float(np.einsum('ij,ij->', root @ self.gram, root))
        return float(np.sqrt(max(square, 0.0) / max(self.rows - used, 1.0)))

    def _factor(self, spread: Array) -> tuple[Array, float]:
        """Cholesky factor of the scaled posterior precision, and the residual sum of squares."""
        matrix = self.gram * spread * spread[:, None]
        # the rounding of sums over many rows must not make the factor fail
        matrix[np.diag_indices_from(matrix)] += 1.0 + ROUNDING * float(matrix.max())
        factor = cholesky(matrix, lower=True, check_finite=False)
        half = solve_triangular(factor, self.cross * spread[:, None], lower=True)
        left = self.square - float((half * half).sum())
        return np.asarray(factor), max(left, 1e-12 * self.square + LEAST)


@dataclass(frozen=True)
class HyperPrior:
    """Gaussian priors of hyperparameters, which are searched within three sigma."""

    mean: Array  # (h,)
    sigma: Array  # (h,)

    def maximise(self, moments: Moments, prior: Prior, least: float = 0.0) -> Array:
        """Most probable hyperparameters (h,) of a regression with at least some noise.

        `prior` gives logarithms (p,) of the prior sigmas over the noise, and their derivatives
        (h, p), of hyperparameters.
        """

        def cost(theta: Array) -> tuple[float, Array]:
            spread, along = prior(theta)
            level, slope = moments.evidence(np.exp(spread), least)
            off = (theta - self.mean) / self.sigma
            return 0.5 * float(off @ off) - level, off / self.sigma - along @ slope

        low, high = self.mean - 3 * self.sigma, self.mean + 3 * self.sigma
        found = minimize(
            cost, self.mean, jac=True, method='L-BFGS-B',
            bounds=np.stack([low, high], axis=1), options={'maxiter': STEPS, 'ftol': 1e-7},
        )  # fmt: skip
        return np.asarray(found.x)


def leave_groups_out(half: Array, error: Array, groups: Integers) -> tuple[Array, Array]:
    """Errors (s,) and variances (s,), over the noise, of rows by a regression without their group.

    They are (I - H)^-1 e with H = half half^T: `half` (s, p) are terms times the transposed root
    of the weights' covariance, `error` (s,) those of the regression with all rows.
    """
    alone, variance = np.empty(len(error)), np.empty(len(error))
    for group in np.unique(groups):
        rows = np.flatnonzero(groups == group)
        own = half[rows]
        # the smaller of the two systems
        if len(rows) <= half.shape[1]:
            hat = own @ own.T
            system = np.eye(len(rows)) * (1 + 1e-9) - hat
            both = np.linalg.solve(system, np.column_stack([error[rows], hat]))
            alone[rows], variance[rows] = both[:, 0], np.diagonal(both[:, 1:])
        else:
            system = np.eye(half.shape[1]) * (1 + 1e-9) - own.T @ own
            left = np.linalg.solve(system, own.T)
            alone[rows] = error[rows] + own @ (left @ error[rows])
            variance[rows] = np.einsum('sp,ps->s', own, left)
    return alone, np.maximum(variance, 0.0)
