"""How likely each class is to have pressed, and that none of them has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array

NONE = 0.1  # how often something presses that is none of the classes
UNLIKE = 4.6  # logarithm of the misfit, over which that is spread: a factor of a hundred
UNTOLD = 0.7  # deviation of that logarithm where no press tells it
LEAST_TOLD = 0.6  # presses of one head do not tell how others differ
FEW = 5  # presses, as which what is usual counts


def usual_misfit(misfits: Array) -> tuple[float, float]:
    """How well classes fit what they are: middle of the logarithm, and how far above it comes.

    Parameters
    ----------
    misfits : ndarray, shape (n,)
        Over their variance, of held-out presses that were named rightly.
    """
    if not len(misfits):
        return 0.0, UNTOLD
    found = np.log(np.maximum(misfits, 1e-3))
    weight = len(found) / (len(found) + FEW)
    usual = weight * float(np.median(found))
    above = np.square(np.maximum(found - usual, 0.0))
    square = 2 * weight * above.mean() + (1 - weight) * UNTOLD**2
    return usual, max(float(np.sqrt(square)), LEAST_TOLD)


def none_chance(misfits: Array, usual: float, vary: float) -> Array:
    """Probability that what pressed is none of the classes, from the best one's misfit (n,).

    Others fit anyhow, within a wide factor; classes as held-out presses do, or better.
    """
    away = np.maximum(np.log(np.maximum(misfits, 1e-3)) - usual, 0.0) / vary
    fits = np.exp(-0.5 * np.square(away)) / (np.sqrt(2 * np.pi) * vary)
    return np.asarray(NONE / UNLIKE / (NONE / UNLIKE + (1 - NONE) * fits))


def class_chances(scores: Array, misfits: Array, usual: float, vary: float) -> tuple[Array, Array]:
    """Probabilities of classes, shape (n, k), and that it is none of them (n,).

    Parameters
    ----------
    scores, misfits : ndarray, shape (n, k)
        Twice the negative log-likelihood; misfit over its variance. Infinite: far away.
    usual, vary : float
        Of `usual_misfit`.
    """
    n = np.arange(len(scores))
    best = scores.argmin(axis=1)
    low, misfit = scores[n, best], misfits[n, best]
    near = np.isfinite(low)
    none = np.where(near, none_chance(np.where(near, misfit, 1.0), usual, vary), 1.0)
    with np.errstate(invalid='ignore'):
        away = np.where(near[:, None], scores - low[:, None], np.inf)
    # where nothing fits well, differences of misfits say less
    likely = np.exp(-0.5 * away / np.where(near, np.maximum(misfit, 1.0), 1.0)[:, None])
    total = np.maximum(likely.sum(axis=1), 1e-30)
    return ((1 - none) / total)[:, None] * likely, none
