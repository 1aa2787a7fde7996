"""Prior of four smooth fields, and the one that makes a calibration likeliest.

The fields are factors of four shapes of a curve: a constant, a logarithm, the inverse of a film's
resistance and the resistance itself. Their sizes, the length over which they vary and the share
of them that has no length are chosen by the evidence, with wide priors of what skins are like.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from tactile_ros.estimators.smooth_fields import MOST_WAVES

if TYPE_CHECKING:
    from tactile_ros.estimators.evidence import Moments
    from tactile_ros.estimators.smooth_fields import SmoothFields
    from tactile_ros.types import Array

SHAPES = 4
SERIES, SERIES_LENGTH = 2, 0.4  # the field of a wrong series resistance, which is the sheet's
MEAN = (10.0, 2.0, 0.3, 0.3, 0.1)  # prior spreads of what is the same everywhere, and of a bend
EXPECTED = np.log([0.15, 0.05, 0.03, 0.05, 0.25, 0.03])  # four sizes, length, share without
SURE = np.array([1.2, 1.2, 1.5, 1.5, 0.5, 1.0])  # spreads of those logarithms
BOUNDS = ((-7.0, 1.5), (-7.0, 1.0), (-8.0, 0.0), (-8.0, 0.5), (-2.7, 0.5), (-7.0, -0.7))
ROUNDS = 40


def prior_spread(fields: tuple[SmoothFields, ...], prior: Array) -> tuple[Array, Array]:
    """Prior spreads of the terms of a curve whose factors vary.

    Parameters
    ----------
    fields : tuple of SmoothFields
        Of the four shapes.
    prior : ndarray, shape (6,)
        Logarithms of the sizes of the fields (1), of their length over the longer edge of the
        sheet, and of the share of their size that has no length.

    Returns
    -------
    spread : ndarray, shape (p,)
        Of five terms that are the same everywhere, then of those of the fields.
    along : ndarray, shape (6, p)
        Slopes of its logarithm along `prior`.
    """
    starts = np.cumsum([len(MEAN)] + [len(one.entry) for one in fields])
    level, along = np.log(np.resize(MEAN, starts[-1])), np.zeros((len(prior), starts[-1]))
    length, fine = np.exp(prior[SHAPES:])
    for shape, one in enumerate(fields):
        own, is_series = slice(starts[shape], starts[shape + 1]), shape == SERIES
        known, slopes = one.spread(SERIES_LENGTH if is_series else length, fine)
        level[own], along[shape, own] = prior[shape] + known, 1.0
        along[SHAPES, own] = 0.0 if is_series else slopes[0]
        along[SHAPES + 1, own] = slopes[1]
    return np.exp(level), along


def shape_table(fields: tuple[SmoothFields, ...], weights: Array, shape: int) -> Array:
    """Factors (n, n) of cosines of one shape, from the weights (p,) of all terms."""
    first = len(MEAN) + sum(len(one.entry) for one in fields[:shape])
    own, table = fields[shape], np.zeros((MOST_WAVES, MOST_WAVES))
    part = own.table(weights[first : first + len(own.entry), None])[:, :, 0]
    table[: len(part), : len(part)] = part
    table[0, 0] += weights[shape]
    return table


def likeliest(
    moments: Moments, fields: tuple[SmoothFields, ...], start: Array
) -> tuple[float, Array]:
    """Evidence, and the prior (6,) that makes the targets of a regression likeliest.

    Parameters
    ----------
    moments : Moments
        Of the terms that `prior_spread` speaks of.
    fields : tuple of SmoothFields
        Of the four shapes.
    start : ndarray, shape (6,)
        Where the search begins.
    """

    def cost(prior: Array) -> tuple[float, Array]:
        spread, along = prior_spread(fields, prior)
        level, slope = moments.slope(spread)
        off = (prior - EXPECTED) / SURE
        return 0.5 * float(off @ off) - level, off / SURE - along @ slope

    options = {'maxiter': ROUNDS, 'ftol': 1e-6}
    found = minimize(cost, start, jac=True, method='L-BFGS-B', bounds=BOUNDS, options=options)
    return -float(found.fun), np.asarray(found.x)
