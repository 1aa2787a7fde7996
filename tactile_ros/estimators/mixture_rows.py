"""A mixture of Gaussians row by row, for a compiler: the loops that `touch_mixture` has as arrays.

Every row of the table lies in one piece: reading, gain of each freedom, change of each answer with
each freedom, answers, one over the variance, logarithm of the share.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Integers


@compiled
def one_row(z: Array, row: Array, inside: Array, part: Array) -> float:
    """Misfit of features (d,) to a row of the table; fills its answers (k,)."""
    channels, freedoms, count = len(z), len(inside), len(part)
    lead = channels * (1 + freedoms)
    own = lead + count * freedoms
    misfit = 0.0
    for i in range(channels):
        misfit += (z[i] - row[i]) ** 2
    for j in range(freedoms):
        total = 0.0
        for i in range(channels):
            total += row[channels * (1 + j) + i] * (z[i] - row[i])
        inside[j] = total
        misfit -= total * total
    for k in range(count):
        total = row[own + k]
        for j in range(freedoms):
            total += row[lead + k * freedoms + j] * inside[j]
        part[k] = total
    return float(misfit * row[own + count])


@compiled
def mixture_rows(
    z: Array,
    index: Integers,
    table: Array,
    freedoms: int,
    outcome: Array,
    cov: Array,
    parts: Array,
    weight: Array,
) -> None:
    """Fill what features say.

    Parameters
    ----------
    z : ndarray, shape (s, d)
        Features in the metric.
    index : ndarray of int, shape (s, m)
        Rows of the table.
    table : ndarray, shape (n, w)
        One piece for each row.
    freedoms : int
        Of a touch (q).
    outcome : ndarray, shape (s, k + 2)
        Mean, logarithm of the likelihood, least misfit; overwritten like the following.
    cov : ndarray, shape (s, c, c)
        Zeros; of the first c answers.
    parts, weight : ndarray, shape (s, m, k) and (s, m)
        Of the rows.
    """
    count = parts.shape[2]
    inside = np.empty(freedoms)
    for s in range(len(z)):
        best, least, whole = -math.inf, math.inf, 0.0
        for m in range(index.shape[1]):
            row = table[index[s, m]]
            misfit = one_row(z[s], row, inside, parts[s, m])
            least = min(least, misfit)
            weight[s, m] = row[-1] - 0.5 * misfit
            best = max(best, weight[s, m])
        outcome[s] = 0.0
        for m in range(index.shape[1]):
            weight[s, m] = math.exp(weight[s, m] - best)
            whole += weight[s, m]
        for m in range(index.shape[1]):
            weight[s, m] /= whole
            for k in range(count):
                outcome[s, k] += weight[s, m] * parts[s, m, k]
        outcome[s, count], outcome[s, count + 1] = best + math.log(whole), least
        for m in range(index.shape[1]):
            add_spread(table[index[s, m]], freedoms, weight[s, m], parts[s, m], outcome[s], cov[s])


@compiled
def add_spread(
    row: Array, freedoms: int, share: float, part: Array, mean: Array, cov: Array
) -> None:
    """Add the share of a row of the table to a covariance: within the row, and off the mean."""
    count = len(part)
    lead = len(row) - 2 - count - count * freedoms
    variance = 1 / row[-2]
    for a in range(len(cov)):
        for b in range(a + 1):
            total = 0.0
            for j in range(freedoms):
                total += row[lead + a * freedoms + j] * row[lead + b * freedoms + j]
            added = share * (variance * total + (part[a] - mean[a]) * (part[b] - mean[b]))
            cov[a, b] += added
            if a != b:
                cov[b, a] += added


@compiled
def share_rows(parts: Array, weight: Array, centres: Array, shares: Array) -> None:
    """Add the weight of parts (s, m, k) to the centre (n, 3) that their place is nearest to."""
    for s in range(len(parts)):
        for m in range(parts.shape[1]):
            best, least = 0, math.inf
            for n in range(len(centres)):
                far = 0.0
                for i in range(3):
                    far += centres[n, i] * (0.5 * centres[n, i] - parts[s, m, i])
                if far < least:
                    best, least = n, far
            shares[s, best] += weight[s, m]
