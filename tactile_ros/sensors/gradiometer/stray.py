"""Stray field of the gradiometer: what the pixels' mean holds beside the disc, and its warning.

A uniform field is told from the disc's by the disc's place. A magnet nearby is not uniform; that
part of its gradient which no place of the disc explains shows it, and says how far to trust.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.estimators.polynomial_rows import spread
from tactile_ros.estimators.uncertainty import CalibratedCovariance
from tactile_ros.sensors.gradiometer.magnets import FREEDOMS
from tactile_ros.types import Array, Bools, Integers

DEGREES = (1, 2, 3, 4)
USUAL, CERTAIN = 0.99, 0.9999  # of what clean frames leave over
BEYOND = 1.5  # times the oddest that is certain
LEAST = 1e-12  # T, of what is left over where a fit saw but one reading


@dataclass(frozen=True)
class Seen:
    """What readings tell beside the disc.

    Attributes
    ----------
    field : ndarray, shape (s, r)
        Stray field (T).
    left : ndarray, shape (s, m)
        Differences that the disc's model leaves over, less those that it always does (T).
    noise : ndarray, shape (s,)
        Of each freedom of them in clean frames (T).
    size : ndarray, shape (s,)
        Of the stray field (T); 0 where it may be none.
    near, odd : ndarray of bool, shape (s,)
        A field that is not the disc's is likely; the differences are certainly not the disc's.
    """

    field: Array
    left: Array
    noise: Array
    size: Array
    near: Bools
    odd: Bools


class StrayField:
    """Uniform field beside the disc's, and how odd the differences are.

    Parameters
    ----------
    slow : int
        How many temperatures follow the disc's place.

    Attributes
    ----------
    usual_field_ : PolynomialRidge
        Uniform field that is left beside the disc's model where there is none, and what the model
        leaves over, of its place.
    spread_ : CalibratedCovariance
        Of what is left over then.
    usual_, limit_ : float
        Mean square of what is left over, in units of its spread, that clean frames reach now and
        then, and beyond which a field is not the disc's.
    blind_ : float
        Size of a stray field (T) that clean frames seem to have now and then.
    report_ : dict of str to float
        Held-out error of the stray field (T), and the limit.
    """

    usual_field_: PolynomialRidge
    spread_: CalibratedCovariance
    usual_: float
    limit_: float
    blind_: float
    report_: dict[str, float]

    def __init__(self, slow: int = 0) -> None:
        self.slow = slow

    def fit(
        self,
        place: Array,
        rest: Array,
        uniform: Array,
        stray: Array,
        groups: Integers,
    ) -> StrayField:
        """Learn what the disc does.

        Parameters
        ----------
        place : ndarray, shape (s, 3 + h)
            Of the disc, and temperatures.
        rest : ndarray, shape (s, m)
            What the disc's model leaves over (T).
        uniform, stray : ndarray, shape (s, r)
            Uniform part of what the disc's model leaves over, along the axes that are measured,
            and the true stray field (T); NaN: taken as 0.
        groups : ndarray of int, shape (s,)
            What a split keeps together.

        Returns
        -------
        StrayField
            Itself.
        """
        both = np.column_stack([uniform - np.nan_to_num(stray), rest])
        self.usual_field_ = PolynomialRidge(DEGREES, self.slow).fit(place, both, groups)
        _, number = np.unique(groups, return_inverse=True)
        fold = group_folds(np.asarray(number).reshape(-1), 3, 0)
        said = np.empty_like(both)
        for part in np.unique(fold):
            out, known = fold == part, fold != part
            known = known if known.any() else out
            model = PolynomialRidge(DEGREES, self.slow).fit(
                place[known], both[known], groups[known]
            )
            said[out] = model.predict(place[out])
        count = uniform.shape[1]
        error, left = said[:, :count] - both[:, :count], rest - said[:, count:]
        self.spread_ = CalibratedCovariance().fit(place, left, groups)
        odd = ((left / np.maximum(self.spread_.sigma(place), LEAST)) ** 2).mean(axis=1)
        self.usual_ = float(np.quantile(odd, USUAL))
        self.limit_ = BEYOND * float(np.quantile(odd, CERTAIN))
        self.blind_ = float(np.quantile(np.sqrt((error**2).sum(axis=1)), USUAL))
        self.report_ = {
            'held_out_rmse': float(np.sqrt((error**2).sum(axis=1).mean())),
            'oddness_limit': self.limit_,
        }
        return self

    def predict(self, place: Array, uniform: Array, rest: Array) -> Seen:
        """Stray field, what of it may disturb differences, and where it certainly does.

        Parameters
        ----------
        place : ndarray, shape (s, 3 + h)
            Of the disc, and temperatures.
        uniform, rest : ndarray, shape (s, r), (s, m)
            Uniform part along the axes that are measured, and differences, that the disc's model
            leaves over (T).

        Returns
        -------
        Seen
            Of every row.
        """
        usual, count = self.usual_field_.predict(place), uniform.shape[1]
        field, left = uniform - usual[:, :count], rest - usual[:, count:]
        sigma = np.maximum(spread(self.spread_, place), LEAST)
        odd = ((left / sigma) ** 2).mean(axis=1)
        size = np.sqrt(np.maximum((field**2).sum(axis=1) - self.blind_**2, 0.0))
        near = (odd > self.usual_) | (size > 0)
        noise = np.sqrt((sigma**2).sum(axis=1) / max(rest.shape[1] - FREEDOMS, 1))
        return Seen(field, left, noise, size, near, odd > self.limit_)
