"""Stray field of the gradiometer: what the pixels' mean holds beside the disc, and its warning.

A uniform field is told from the disc's by the disc's place. A magnet nearby is not uniform; that
part of its gradient which no place of the disc explains shows it, and says how far to trust.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.types import Array, Bools, Integers

DEGREES = (1, 2, 3, 4)
CERTAIN = 1.5  # beyond the oddest of a thousand
USUAL = 0.999


class StrayField:
    """Uniform field beside the disc's, and how odd the differences are.

    Parameters
    ----------
    noise : float
        Of a channel (T).

    Attributes
    ----------
    common_ : PolynomialRidge
        Uniform field that is left beside the disc's model where there is none, of its place.
    misfit_ : PolynomialRidge
        What the disc's model leaves over, of its place.
    whiten_ : ndarray, shape (m, m)
        Turns what is left over into units of its spread.
    limit_ : float
        Mean square of them beyond which a field is not the disc's.
    report_ : dict of str to float
        Held-out error of the stray field (T), and the limit.
    """

    common_: PolynomialRidge
    misfit_: PolynomialRidge
    whiten_: Array
    limit_: float
    report_: dict[str, float]

    def __init__(self, noise: float) -> None:
        self.noise = noise

    def fit(
        self, place: Array, rest: Array, uniform: Array, stray: Array, groups: Integers
    ) -> StrayField:
        """Learn what the disc does.

        Parameters
        ----------
        place : ndarray, shape (s, 3)
            Of the disc.
        rest : ndarray, shape (s, m)
            What the disc's model leaves over (T).
        uniform, stray : ndarray, shape (s, 3)
            Uniform part of what the disc's model leaves over, and the true stray field (T); NaN:
            taken as 0.
        groups : ndarray of int, shape (s,)
            What a split keeps together.

        Returns
        -------
        StrayField
            Itself.
        """
        seen = np.isfinite(uniform).all(axis=0)
        target = uniform - np.nan_to_num(stray)
        self.seen_ = np.flatnonzero(seen)
        self.common_ = PolynomialRidge(DEGREES).fit(place, target[:, seen], groups)
        self.misfit_ = PolynomialRidge(DEGREES).fit(place, rest, groups)
        _, number = np.unique(groups, return_inverse=True)
        fold = group_folds(np.asarray(number).reshape(-1), 3, 0)
        left, error = np.empty_like(rest), np.empty((len(rest), int(seen.sum())))
        for part in np.unique(fold):
            out, known = fold == part, fold != part
            known = known if known.any() else out
            misfit = PolynomialRidge(DEGREES).fit(place[known], rest[known], groups[known])
            common = PolynomialRidge(DEGREES).fit(
                place[known], target[known][:, seen], groups[known]
            )
            left[out] = rest[out] - misfit.predict(place[out])
            error[out] = common.predict(place[out]) - target[out][:, seen]
        spread = left.T @ left / len(left) + self.noise**2 * 0.1 * np.eye(rest.shape[1])
        value, vector = np.linalg.eigh(spread)
        self.whiten_ = vector / np.sqrt(value)
        odd = ((left @ self.whiten_) ** 2).mean(axis=1)
        self.limit_ = CERTAIN * float(np.quantile(odd, USUAL))
        self.report_ = {
            'held_out_rmse': float(np.sqrt((error**2).sum(axis=1).mean())),
            'oddness_limit': self.limit_,
        }
        return self

    def predict(self, place: Array, uniform: Array) -> Array:
        """Stray field (s, 3) (T) of places (s, 3) and uniform parts (s, 3) (T)."""
        field = np.full(uniform.shape, np.nan)
        field[:, self.seen_] = uniform[:, self.seen_] - self.common_.predict(place)
        return field

    def oddness(self, place: Array, rest: Array) -> tuple[Array, Bools]:
        """By what to swell covariances, and which rows are beyond the limit, shape (s,) both."""
        left = rest - self.misfit_.predict(place)
        odd = ((left @ self.whiten_) ** 2).mean(axis=1)
        return np.maximum(1.0, odd / self.limit_), odd > self.limit_
