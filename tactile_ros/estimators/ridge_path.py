"""Ridge regression for many penalties at once, judged on held-out groups.

The eigenvectors of the normal matrix serve every penalty (Golub, Heath and Wahba, Technometrics
21, 1979), and the matrix without a fold is the whole one less that fold's.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Integers


def held_out_squares(
    terms: Array,
    target: Array,
    fold: Integers,
    strengths: Array,
    weighed: tuple[Array, Array] | None = None,
) -> Array:
    """Sum of squared errors on held-out folds for each penalty, as `held_out_each` has them.

    Returns
    -------
    ndarray, shape (n,)
        Sums over rows and components (unit of the target, squared).
    """
    return np.asarray(held_out_each(terms, target, fold, strengths, weighed).sum(axis=1))


def held_out_each(
    terms: Array,
    target: Array,
    fold: Integers,
    strengths: Array,
    weighed: tuple[Array, Array] | None = None,
) -> Array:
    """Sum of squared errors on held-out folds for each penalty and component.

    Parameters
    ----------
    terms : ndarray, shape (s, p)
        Centred terms.
    target : ndarray, shape (s, k)
        Centred targets.
    fold : ndarray of int, shape (s,)
        Fold of each row; with one fold only, the errors are those of the fit.
    strengths : ndarray, shape (n,)
        Penalties per row on the squares of the weights.
    weighed : tuple of ndarray, shapes (s, p) and (s, k), or None
        Terms and targets of the fit where they differ from those that are judged.

    Returns
    -------
    ndarray, shape (n, k)
        Sums over rows (unit of the target, squared).
    """
    learned, told = (terms, target) if weighed is None else weighed
    gram, moment = learned.T @ learned, learned.T @ told
    squares = np.zeros((len(strengths), target.shape[1]))
    names = np.unique(fold)
    for name in names:
        out = fold == name
        held, answer = terms[out], target[out]
        left = len(terms) - len(held) * (len(names) > 1)
        apart = (gram - learned[out].T @ learned[out], moment - learned[out].T @ told[out])
        value, vector, right = _spectrum(*(apart if len(names) > 1 else (gram, moment)))
        projected = held @ vector
        for i, strength in enumerate(strengths):
            damped = right / (value + strength * left)[:, None]
            squares[i] += ((projected @ damped - answer) ** 2).sum(axis=0)
    return squares


def ridge_weights(terms: Array, target: Array, strength: float) -> Array:
    """Weights (p, k) of centred terms (s, p) for centred targets (s, k) at a penalty per row."""
    value, vector, right = _spectrum(terms.T @ terms, terms.T @ target)
    return np.asarray(vector @ (right / (value + strength * len(terms))[:, None]))


def _spectrum(gram: Array, moment: Array) -> tuple[Array, Array, Array]:
    """Eigenvalues, eigenvectors, and the moments along them."""
    value, vector = np.linalg.eigh(gram)
    return np.maximum(value, 0.0), vector, vector.T @ moment
