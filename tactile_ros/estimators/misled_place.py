"""What leads a place astray, told by force: errors of temperatures, found beside the elastomer.

Places that are wrong by what nobody measured (drifts of channels, a disc that weakens or warms
otherwise than thought) make force scatter about any polynomial of the place. Sizes of such errors,
and the elastomer's rise and softening, are found together by Gauss-Newton steps, the polynomial
eliminated (Golub and Pereyra, Inverse Problems 19, 2003).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.estimators.polynomial_ridge import monomials
from tactile_ros.types import Array

DEGREES, ROWS = {3: 20, 4: 35, 5: 56}, 6  # coefficients of each; rows for one of them
ROUNDS, STEP, CLOSER = 5, 1e-3, 1e-4
ELASTOMER = np.array([0.02, 0.1, 0.01])  # usual rise, softening and its curve over a unit


@dataclass(frozen=True)
class Misled:
    """What was found.

    Attributes
    ----------
    sizes : ndarray, shape (p,)
        Of each error, over its usual size.
    cov : ndarray, shape (p, p)
        Their covariance.
    rise : float
        Of the height for a unit of temperature (its unit).
    """

    sizes: Array
    cov: Array
    rise: float


def misled(
    place: Array, moves: Array, heat: Array, later: Array, force: Array, begun: Array
) -> Misled:
    """Find the sizes of errors of places.

    Parameters
    ----------
    place : ndarray, shape (s, 3)
        With the errors, less those of size `begun`; the third is the height.
    moves : ndarray, shape (s, p, 3)
        What each error of its usual size adds to places.
    heat, later : ndarray, shape (s,)
        Temperature of the elastomer, in a unit of the caller's, and what the last error of its
        usual size adds to it.
    force : ndarray, shape (s, k)
        That holds the places.
    begun : ndarray, shape (p,)
        Sizes that places and temperature are already free of.

    Returns
    -------
    Misled
        Sizes that leave least of force about a polynomial of the place.
    """
    degree = max((d for d, n in DEGREES.items() if len(place) > ROWS * n), default=3)
    target = force / np.maximum(force.std(axis=0), 1e-300)
    centre, scale = place.mean(axis=0), np.maximum(place.std(axis=0), 1e-300)
    count = len(begun)

    def left(found: Array) -> Array:
        more = found[:count] - begun
        warm = heat - later * more[-1]
        rise, stiff, curve = ELASTOMER * found[count:]
        there = place - (moves * more[:, None]).sum(axis=1)
        there[:, 2] -= rise * warm
        terms = monomials((there - centre) / scale, degree)
        terms = np.column_stack([np.ones(len(terms)), terms])
        terms *= np.exp(stiff * warm + curve * warm**2)[:, None]
        basis, _ = np.linalg.qr(terms)
        return np.asarray(target - basis @ (basis.T @ target)).ravel()

    found, prior = np.concatenate([begun, np.zeros(len(ELASTOMER))]), np.eye(count + 3)
    cov: Array = prior
    best, least = found, np.inf
    for _ in range(ROUNDS):
        miss = left(found)
        square = float(miss @ miss)
        if square >= (1 - CLOSER) * least:
            break
        best, least = found, square
        variance = square / max(len(miss) - len(found), 1) + 1e-300
        slopes = [(left(found + STEP * one) - miss) / STEP for one in prior]
        matrix = np.stack(slopes, axis=1)
        cov = np.asarray(np.linalg.inv(matrix.T @ matrix / variance + prior))
        found = found - cov @ (matrix.T @ miss / variance + found)
    return Misled(best[:count], cov[:count, :count], float(ELASTOMER[0] * best[count]))
