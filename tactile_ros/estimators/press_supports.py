"""Presses as supports of classes, with what templates say of depth, place, turn and shape."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import RANK, USUAL, Supports

if TYPE_CHECKING:
    from tactile_ros.estimators.press_bank import PressBank
    from tactile_ros.estimators.press_search import Matches
    from tactile_ros.estimators.press_window import PressVectors
    from tactile_ros.types import Array, Integers

FREER = 5.0  # times the usual: how far the origin of an unknown shape may be aside


def plain_supports(presses: PressVectors, labels: Integers, number: Integers) -> Supports:
    """Supports (n), windows of presses by number, of which no model tells anything."""
    n, d = presses.pattern.shape
    return Supports(
        labels, presses.pattern, presses.powers, presses.frames, np.ones(n), np.zeros((n, 3, d)),
        np.zeros((n, 2, d)), np.full((n, d), np.nan), np.zeros((n, RANK, d)), number,
    )  # fmt: skip


def modelled_supports(
    presses: PressVectors, labels: Integers, number: Integers, matches: Matches, bank: PressBank,
    basis: Array,
) -> Supports:  # fmt: skip
    """Supports (n) with what the best template of each tells.

    Parameters
    ----------
    presses : PressVectors
        n presses.
    labels, number : ndarray, shape (n,)
        Their classes, and which press each is a window of.
    matches : Matches
        Of the presses.
    bank : PressBank
        Templates.
    basis : ndarray, shape (d, 3)
        Orthonormal patterns of a uniform field.
    """
    best = np.arange(len(labels)), matches.cost.argmin(axis=1)
    pose, middle = matches.pose[best], matches.fitted[best]
    slopes = matches.slopes[best][:, :3] * USUAL[:, None]
    terms = bank.at(best[1], pose[:, :3])[:, 0, 1:]
    grown = pose[:, 3, None] ** np.arange(1, 4)
    factors = [
        _shape_factors(bank, presses.pattern[i], pose[i, :2], raised, middle[i], slopes[i], basis)
        for i, raised in enumerate(presses.powers * grown)
    ]
    return Supports(
        labels, presses.pattern, presses.powers, presses.frames, np.ones(len(labels)), slopes,
        terms * grown[:, 1:, None], middle, np.array(factors).reshape(-1, RANK, middle.shape[1]),
        number,
    )  # fmt: skip


def _shape_factors(
    bank: PressBank, pattern: Array, place: Array, raised: Array, middle: Array, slopes: Array,
    basis: Array,
) -> Array:  # fmt: skip
    """Factors (r, d) of a covariance of what shapes can do at a place, from what heads do."""
    turns = [one.turns for one in bank.heads]
    head = np.repeat(np.arange(len(turns)), turns)
    turn = np.concatenate([np.arange(n) for n in turns])
    step = np.array([one.sector / one.turns for one in bank.heads])
    poses = np.column_stack([np.tile(place, (len(turn), 1)), turn * step[head]])
    other = np.einsum('p,npd->nd', raised, bank.at(head, poses)[:, 0])
    own = other - (other @ basis) @ basis.T
    size = (own @ pattern) / np.square(own).sum(axis=1)
    away = (size[:, None] * other - middle) / np.sqrt(len(other))
    rows, sizes, _ = np.linalg.svd(np.concatenate([away, FREER * slopes]).T, full_matrices=False)
    found = np.zeros((RANK, len(middle)))
    count = min(RANK, len(sizes))
    found[:count] = (rows * sizes).T[:count]
    return found
