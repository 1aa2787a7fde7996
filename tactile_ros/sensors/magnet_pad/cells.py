"""Cells of the pad from places: a place belongs to the cell whose centre is nearest."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Integers

PLAN, SPACE = (0, 1), (0, 1, 2)
AGREES = 0.97
BLOCK = 512
DRAWS = 64


def _draws(width: int) -> Array:
    """Points of a unit Gaussian, shape (64, width), whose mean is 0 and covariance 1."""
    half = np.random.default_rng(5).normal(size=(DRAWS // 2, width))
    points = np.concatenate([half, -half])
    spread = np.linalg.cholesky(points.T @ points / len(points))
    return np.asarray(np.linalg.solve(spread, points.T).T)


POINTS = {len(columns): _draws(len(columns)) for columns in (PLAN, SPACE)}


def nearest(places: Array, cells: Array, columns: tuple[int, ...]) -> Integers:
    """Number (s,) of the cell (n, 3) nearest to places (s, 3), by some coordinates.

    Examples
    --------
    >>> nearest(np.array([[0.1, 0, 9.0]]), np.array([[1.0, 0, 0], [0, 0, 0]]), (0, 1)).tolist()
    [1]
    """
    index = list(columns)
    centre = cells[:, index] - cells[:, index].mean(axis=0)
    at = places[:, index] - cells[:, index].mean(axis=0)
    return np.asarray((at @ centre.T - 0.5 * (centre**2).sum(axis=1)).argmax(axis=1))


def extent(cells: Array) -> Array:
    """Variance (3,) of places inside a cell along each axis (m2), by the gaps of centres (n, 3).

    Examples
    --------
    >>> (1e6 * extent(np.array([[0.0, 0, 0], [6e-3, 0, 0]]))).round(3)
    array([3., 0., 0.])
    """
    steps = [max(len(np.unique(np.round(axis, 6))) - 1, 1) for axis in cells.T]
    return np.asarray((np.ptp(cells, axis=0) / steps) ** 2 / 12)


def partition(places: Array, told: Integers, cells: Array) -> tuple[int, ...]:
    """Coordinates by which the nearest centre is the cell that truth told; () if by none.

    Parameters
    ----------
    places : ndarray, shape (s, 3)
        True places (m); the height may be NaN.
    told : ndarray of int, shape (s,)
        True cells.
    cells : ndarray, shape (n, 3)
        Centres (m).
    """
    share = {}
    for columns in (SPACE, PLAN):
        known = np.isfinite(places[:, list(columns)]).all(axis=1)
        if known.any():
            right = nearest(places[known], cells, columns) == told[known]
            share[columns] = float(right.mean())
    best = max(share, key=lambda c: share[c], default=())
    return best if best and share[best] >= AGREES else ()


def shares_of_cells(places: Array, cov: Array, cells: Array, columns: tuple[int, ...]) -> Array:
    """Probability (s, n) of each cell, for Gaussian places.

    Parameters
    ----------
    places, cov : ndarray, shape (s, 3) and (s, 3, 3)
        Mean (m) and covariance (m2); finite in `columns`.
    cells : ndarray, shape (n, 3)
        Centres (m).
    columns : tuple of int
        Coordinates by which the nearest centre counts.

    Returns
    -------
    ndarray, shape (s, n)
        Shares of 64 points spread like the place, and half a point for the cell of its mean.
    """
    index = np.array(columns)
    inner = cov[:, index[:, None], index]
    size = np.trace(inner, axis1=1, axis2=2)[:, None, None]
    root = np.linalg.cholesky(inner + (1e-9 * size + 1e-18) * np.eye(len(index)))
    shares = np.empty((len(places), len(cells)))
    for i in range(0, len(places), BLOCK):
        part = slice(i, i + BLOCK)
        spread = np.einsum('sij,pj->spi', root[part], POINTS[len(index)])
        at = np.full((*spread.shape[:2], 3), np.nan)
        at[..., index] = places[part][:, None, index] + spread
        hit = nearest(at.reshape(-1, 3), cells, columns).reshape(-1, DRAWS)
        row = np.arange(len(hit))[:, None] * len(cells)
        count = np.bincount((row + hit).ravel(), minlength=len(hit) * len(cells))
        shares[part] = count.reshape(len(hit), len(cells))
        own = nearest(places[part], cells, columns)
        shares[part][np.arange(len(hit)), own] += 0.5
    return shares / (DRAWS + 0.5)
