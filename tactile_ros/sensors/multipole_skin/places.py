"""Where heads pressed, and how surely: errors of templates, and of the head that is named."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm

if TYPE_CHECKING:
    from tactile_ros.estimators.press_search import Matches
    from tactile_ros.types import Array, Bools, Integers

WITNESSES = 2, 3  # heads, least and most, that tell where an undrawn one presses
INSIDE = 0.6827  # of errors, one stated deviation
USUAL_ERRORS = 10  # as stated, that are added to those that were found
FLOORS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0])  # of the usual deviation
SMALLEST = 0.3  # scale
TAIL = 4.0  # degrees of freedom of errors: some are of a wrong turn


@dataclass(frozen=True)
class Spread:
    """Errors of places over what the covariance of templates says.

    Attributes
    ----------
    scale : float
        By what stated deviations are too small.
    floor : float
        Deviation that the clearest press has too (m): chips and bands err alike for all of it.
    """

    scale: float
    floor: float


def fitted_spread(away: Array, sigma: Array, doubt: Array) -> Spread:
    """Scale and floor that errors of places ask for.

    Parameters
    ----------
    away : ndarray, shape (n, 2)
        Errors (m).
    sigma, doubt : ndarray, shape (n, 2)
        Deviations (m) by the covariance of templates, and beside it by what else it may be.
    """
    found: list[tuple[float, float, float]] = []
    for floor in float(np.median(sigma)) * FLOORS:
        own = np.maximum(np.hypot(sigma, floor), 1e-12)
        scale = _scale((np.square(away) - np.square(doubt)) / np.square(own))
        total = np.hypot(scale * own, doubt)
        square = np.square(away / total)
        told = -np.log(total) - 0.5 * (TAIL + 1) * np.log1p(square / TAIL)
        found.append((float(told.sum()), scale, float(scale * floor)))
    return Spread(*max(found)[1:])


def _scale(squares: Array) -> float:
    """By what stated deviations are too small: as much as two in three errors ask for.

    Some errors of a usual size are added, since few presses say little.
    """
    usual = np.square(norm.ppf((np.arange(USUAL_ERRORS) + 0.5) / USUAL_ERRORS))
    found = np.quantile(np.concatenate([squares.ravel(), usual]), INSIDE)
    return float(np.sqrt(max(found, SMALLEST**2)))


def named_places(
    matches: Matches, which: Integers, sectors: Array, orders: Integers, spread: Spread
) -> tuple[Array, Array]:
    """Pose (n, 4) and covariance (n, 4, 4) of heads by number (n,), if they are what pressed.

    Parameters
    ----------
    matches : Matches
        Of the presses.
    which : ndarray, shape (n,)
        Heads.
    sectors, orders : ndarray, shape (heads,)
        Turns after which they look the same (rad), and orders of symmetry.
    spread : Spread
        Of places.
    """
    rows = np.arange(len(which)), which
    pose, cov = matches.pose[rows], spread.scale**2 * matches.cov[rows]
    sector, free = sectors[which], orders[which] == 0
    pose[:, 2] -= sector * np.round(pose[:, 2] / sector)
    if free.any():
        pose[free, 2] = 0.0
        cov[free, 2, :] = cov[free, :, 2] = 0.0
        cov[free, 2, 2] = np.pi**2 / 3
    cov[:, 0, 0] += spread.floor**2
    cov[:, 1, 1] += spread.floor**2
    return pose, cov


def witnesses(matches: Matches) -> Array:
    """Weights (n, heads) of the heads that tell where another shape pressed: those that fit best.

    All are 0 where there are too few.
    """
    n, heads = matches.cost.shape
    found = np.zeros((n, heads))
    if heads >= WITNESSES[0]:
        best = np.argsort(matches.cost, axis=1)[:, : WITNESSES[1]]
        found[np.arange(n)[:, None], best] = 1 / best.shape[1]
    return found


def undrawn_places(matches: Matches, rows: Bools, spread: Spread) -> tuple[Array, Array]:
    """Pose and covariance of shapes that nobody drew: places alone, as several heads say.

    The heads that fit best disagree by about as much as all of them are wrong.
    """
    weight = witnesses(matches)[rows]
    pose, cov = np.full((len(weight), 4), np.nan), np.full((len(weight), 4, 4), np.nan)
    if weight.any():
        said = matches.pose[rows][..., :2]
        pose[:, :2] = np.einsum('nh,nhi->ni', weight, said)
        within = np.einsum('nh,nhij->nij', weight, matches.cov[rows][..., :2, :2])
        between = scattered(weight, said - pose[:, None, :2])
        cov[:, :2, :2] = spread.scale**2 * within + between + spread.floor**2 * np.eye(2)
    return pose, cov


def scattered(weight: Array, away: Array) -> Array:
    """Covariance (n, 2, 2) of places that are so far away (n, heads, 2), by weights (n, heads)."""
    return np.asarray(np.matmul(np.swapaxes(weight[..., None] * away, 1, 2), away))
