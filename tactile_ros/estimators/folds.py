"""Folds that keep groups together: the only honest split of rows that belong together."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Integers


def group_folds(groups: Integers, folds: int, seed: int) -> Integers:
    """Deal groups to folds so that the folds hold about as many rows each.

    Parameters
    ----------
    groups : ndarray of int, shape (s,)
        What a split keeps together, numbered from 0.
    folds : int
        Number of folds; fewer where there are fewer groups.
    seed : int
        Of the deal.

    Returns
    -------
    ndarray of int, shape (s,)
        Fold of each row.

    Examples
    --------
    >>> fold = group_folds(np.array([0, 0, 1, 1, 2, 2]), 3, seed=0)
    >>> bool((fold[::2] == fold[1::2]).all()), sorted(set(fold.tolist()))
    (True, [0, 1, 2])
    """
    sizes = np.bincount(groups)
    order = np.random.default_rng(seed).permutation(len(sizes))
    order = order[np.argsort(-sizes[order], kind='stable')]
    folds = max(1, min(folds, len(sizes)))
    if sizes.min() == sizes.max():
        fold = np.empty(len(sizes), np.int64)
        fold[order] = np.arange(len(sizes)) % folds
        return np.asarray(fold[groups])
    load, fold = np.zeros(folds, np.int64), np.zeros(len(sizes), np.int64)
    for group in order:
        fold[group] = int(np.argmin(load))
        load[fold[group]] += sizes[group]
    return np.asarray(fold[groups])
