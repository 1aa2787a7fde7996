"""What magnets of every strength do to answers, row by row, for a compiler.

The same as the arrays of `magnets`, to rounding. A field is strength squared times one covariance,
beside an even part, so that its products with slopes are made once for all strengths.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.estimators.polynomial_rows import product_rows
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array

INEXACT = 0.05  # of what a magnet does: slopes differ from place to place, and bend


@compiled
def crossed(a: Array, b: Array, c: Array) -> None:
    """Product (i, j) of a (i, n) and the transpose of b (j, n)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            total = 0.0
            for n in range(a.shape[1]):
                total += a[i, n] * b[j, n]
            c[i, j] = total


def whitened(
    square: Array | float, even: Array | float, blur: Array | float, left: Array, shown: Array,
    level: Array, seen: Array, right: Array,
) -> Array | float:  # fmt: skip
    """Log likelihood of what is left (r,); `right` (r, 1 + k) becomes it and answers, whitened.

    `shown` and `level`, of shape (r + k, r + k), are covariances that a field of strength 1, and
    an even one, give to what is left and to answers. Arrays may have further axes, for many such
    at once: rounding is the same.
    """
    count, evidence = len(left), 0.0 * square
    for i in range(count):
        for j in range(i + 1):
            total = square * shown[i, j] + even * level[i, j]
            total = total + blur if i == j else total
            for n in range(j):
                total = total - seen[i, n] * seen[j, n]
            seen[i, j] = np.sqrt(total) if i == j else total / seen[j, j]
        for k in range(right.shape[1]):
            at = count + k - 1
            total = square * shown[i, at] + even * level[i, at] if k > 0 else 0 * square + left[i]
            for n in range(i):
                total = total - seen[i, n] * right[n, k]
            right[i, k] = total / seen[i, i]
        evidence = evidence - 0.5 * right[i, 0] * right[i, 0] - np.log(seen[i, i])
    return evidence


def answered(
    square: Array | float, even: Array | float, shown: Array, level: Array, right: Array,
    told: Array, doubt: Array,
) -> None:  # fmt: skip
    """Answers (k,) and their covariance (k, k), of `right` of `whitened`."""
    count = len(right)
    for k in range(len(told)):
        told[k] = right[0, 1 + k] * right[0, 0]
        for i in range(1, count):
            told[k] += right[i, 1 + k] * right[i, 0]
        for n in range(k + 1):
            total = square * shown[count + k, count + n] + even * level[count + k, count + n]
            total = (1 + INEXACT**2) * total
            for i in range(count):
                total = total - right[i, 1 + k] * right[i, 1 + n]
            doubt[k, n] = total
            doubt[n, k] = total


whitened_row, answered_row = compiled(whitened), compiled(answered)


@compiled
def mixed(share: Array, told: Array, doubt: Array, mean: Array, cov: Array) -> None:
    """Mean (k,) and covariance (k, k) of normals (j, k) with logarithms (j,) of shares."""
    most, total = share.max(), 0.0
    for j in range(len(share)):
        share[j] = math.exp(share[j] - most)
        total += share[j]
    mean[:], cov[:] = 0.0, 0.0
    for j in range(len(share)):
        share[j] /= total
        for k in range(len(mean)):
            mean[k] += share[j] * told[j, k]
    for j in range(len(share)):
        for k in range(len(mean)):
            apart = told[j, k] - mean[k]
            for n in range(len(mean)):
                cov[k, n] += share[j] * (doubt[j, k, n] + apart * (told[j, n] - mean[n]))


@compiled
def weighed_rows(
    ways: Array, rest: Array, answer: Array, field: Array, left: Array, noise: Array,
    strength: Array, even: Array, usual: Array, mean: Array, cov: Array,
) -> None:  # fmt: skip
    """Means (s, k) and covariances (s, k, k) of answers over strengths (s, j).

    Parameters
    ----------
    ways : ndarray, shape (s, r, m)
        Directions that show fields, among what is left over.
    rest, answer : ndarray, shape (s, m, m), (s, k, m)
        Slopes of what is left over, and of answers (1, unit over T).
    field : ndarray, shape (m, m)
        Covariance of differences of a magnet of strength 1.
    left, noise : ndarray, shape (s, m), (s,)
        What is left over, and the noise of each freedom of it (T).
    strength, even, usual : ndarray, shape (s, j), (s,), (s, j)
        Of magnets (T), variance of an even field (T2), logarithm of how usual a strength is.
    mean, cov : ndarray
        To be filled.
    """
    count, answers, width = ways.shape[1], answer.shape[1], answer.shape[2]
    steep = np.empty((count + answers, width))
    spread, shown = np.empty_like(steep), np.empty((count + answers, count + answers))
    level, share = np.empty_like(shown), np.empty(strength.shape[1])
    shows, seen, right = np.empty(count), np.empty((count, count)), np.empty((count, 1 + answers))
    told, doubt = np.empty((len(share), answers)), np.empty((len(share), answers, answers))
    for s in range(len(ways)):
        product_rows(ways[s], rest[s], steep[:count])
        steep[count:] = answer[s]
        product_rows(steep, field, spread)
        crossed(spread, steep, shown)
        crossed(steep, steep, level)
        crossed(ways[s], left[s : s + 1], shows.reshape(count, 1))
        for j in range(len(share)):
            square = strength[s, j] ** 2
            blur = noise[s] ** 2 + INEXACT**2 * square
            evidence = whitened_row(square, even[s], blur, shows, shown, level, seen, right)
            answered_row(square, even[s], shown, level, right, told[j], doubt[j])
            share[j] = usual[s, j] + evidence
        mixed(share, told, doubt, mean[s], cov[s])
