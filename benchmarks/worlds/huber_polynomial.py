# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The chain of [3] with the loss that it prints: Huber's, with an L1 penalty."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.polynomial_force import LEAST_SHARE, PolynomialForce

if TYPE_CHECKING:
    from tactile_ros.types import Array

HUBER = 1.345  # of the residuals' scale (Huber, Robust Statistics, 1981)
ROUNDS = 300
PENALTY = 1e-6  # of the L1 norm, per row, of weights of standardised features


class HuberPolynomial(PolynomialForce):
    """The chain with weights of least loss, iterated until they stand."""

    def _solved(self, terms: Array, target: Array) -> Array:
        weights, shift = huber_l1(terms, target, super()._solved(terms, target))
        self.level_ = self.level_ + shift
        return weights


def huber_l1(terms: Array, target: Array, weights: Array) -> tuple[Array, Array]:
    """Weights (p, k) and level (k,) that minimise Huber's loss with an L1 penalty."""
    count = terms.shape[1]
    terms = np.concatenate([terms, np.ones((len(terms), 1))], axis=1)
    found = np.concatenate([weights, np.zeros((1, weights.shape[1]))])
    for k in range(target.shape[1]):
        w = found[:, k]
        for _ in range(ROUNDS):
            error = target[:, k] - terms @ w
            scale = 1.4826 * np.median(np.abs(error)) + np.finfo(float).tiny
            trust = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(error), 1e-300))
            shrink = PENALTY * len(terms) * scale / np.maximum(np.abs(w), 1e-9 * np.abs(w).max())
            root = np.sqrt(trust)[:, None]
            shrink[count:] = 0.0  # the level is free
            left = np.concatenate([root * terms, np.diag(np.sqrt(shrink))])
            right = np.concatenate([root[:, 0] * target[:, k], np.zeros(len(w))])
            new = np.linalg.lstsq(left, right, rcond=LEAST_SHARE)[0]
            moved, w = float(np.abs(new - w).max()), new
            if moved <= 1e-6 * np.abs(w).max():
                break
        found[:, k] = w
    return found[:count], found[count]
