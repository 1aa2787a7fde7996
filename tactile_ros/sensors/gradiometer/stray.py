"""Stray field of the gradiometer: what the pixels' mean holds beside the disc, and its warning.

A uniform field is told from the disc's by the disc's place. A magnet nearby is not uniform; that
part of its gradient which no place of the disc explains shows it, and says how far to trust.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.estimators.polynomial_rows import spread
from tactile_ros.estimators.uncertainty import CalibratedCovariance
from tactile_ros.types import Array, Bools, Integers

DEGREES = (1, 2, 3, 4)
USUAL, CERTAIN = 0.99, 0.9999  # of what clean frames leave over
BEYOND = 1.5  # times the oddest that is certain
FEW_FREEDOMS = 3.0  # two sigmas of Student's t of about two freedoms, over those of normal ones


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
        odd = ((left / self.spread_.sigma(place)) ** 2).mean(axis=1)
        self.usual_ = float(np.quantile(odd, USUAL))
        self.limit_ = BEYOND * float(np.quantile(odd, CERTAIN))
        self.blind_ = float(np.quantile(np.sqrt((error**2).sum(axis=1)), USUAL))
        self.report_ = {
            'held_out_rmse': float(np.sqrt((error**2).sum(axis=1).mean())),
            'oddness_limit': self.limit_,
        }
        return self

    def predict(
        self, place: Array, uniform: Array, rest: Array
    ) -> tuple[Array, Array, Array, Bools]:
        """Stray field, what of it may disturb differences, and where it certainly does.

        Of a magnet's gradient a part hides in the disc's place; the part that shows in what the
        model leaves over tells how large the whole may be.

        Parameters
        ----------
        place : ndarray, shape (s, 3 + h)
            Of the disc, and temperatures.
        uniform, rest : ndarray, shape (s, r), (s, m)
            Uniform part along the axes that are measured, and differences, that the disc's model
            leaves over (T).

        Returns
        -------
        field : ndarray, shape (s, r)
            Stray field (T).
        excess : ndarray, shape (s,)
            What of a gradient may show in all differences together (T); 0: none is likely.
        size : ndarray, shape (s,)
            Of the stray field; 0 where it may be none (T).
        odd : ndarray of bool, shape (s,)
            The differences are certainly not the disc's.
        """
        usual, count = self.usual_field_.predict(place), uniform.shape[1]
        field = uniform - usual[:, :count]
        sigma = spread(self.spread_, place)
        odd = (((rest - usual[:, count:]) / sigma) ** 2).mean(axis=1)
        size = np.sqrt(np.maximum((field**2).sum(axis=1) - self.blind_**2, 0.0))
        near = (odd > self.usual_) | (size > 0)
        shown = np.where(near, np.sqrt(odd * (sigma**2).sum(axis=1)), 0.0)
        return field, FEW_FREEDOMS * shown, size, odd > self.limit_


def gradient_patterns(pixels: Array, response: Array) -> Array:
    """Readings of each kind of gradient of a field without sources, of 1 T / m.

    Parameters
    ----------
    pixels : ndarray, shape (t, 3)
        (m).
    response : ndarray, shape (n, 3)
        Of the n = c t channels to a uniform field.

    Returns
    -------
    ndarray, shape (5, n)
        Of the symmetric tensors without trace, orthonormal (T).
    """
    kinds = np.zeros((5, 3, 3))
    kinds[0, 0, 1], kinds[1, 0, 2], kinds[2, 1, 2] = np.sqrt([0.5] * 3)
    kinds = kinds + kinds.transpose(0, 2, 1)
    kinds[3] = np.diag([1, -1, 0]) / np.sqrt(2)
    kinds[4] = np.diag([1, 1, -2]) / np.sqrt(6)
    apart = np.repeat(pixels - pixels.mean(axis=0), len(response) // len(pixels), axis=0)
    return np.asarray(np.einsum('ni,kij,nj->kn', response, kinds, apart))
