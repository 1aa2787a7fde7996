# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Crosstalk between rows and columns of a passive matrix of taxels, and its inverse.

Crossings are resistors, and current finds its way over others as the lines that are not selected
let it; floating ones give a resistance distance (Klein and Randic, J. Math. Chem. 12, 1993).
Conductances are in units of 1 / R0, the resistor below each column; outputs are shares of supply.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_ros.types import Array, Integers, Signals

LEAK = 1e-6  # of the largest conductance: what ties lines that nothing presses to the rest
FLOOR, NOTHING = 1e-5, 1e-7  # of the largest conductance: less is none; the least that is tried
CLOSE = 2e-4  # of the largest conductance: readings that are met as well are met
ROUNDS, STEPS, DAMPING, ENOUGH = 15, 15, 1e-5, 1e-6
LONGEST = 3.0  # logarithm by which a conductance falls in one round


def alone(output: Array) -> Array:
    """Conductance (1 / R0) of a crossing that is the only one: u = g / (1 + g).

    Examples
    --------
    >>> alone(np.array([0.0, 0.5])).tolist()
    [0.0, 1.0]
    """
    return np.asarray(output / (1.0 - np.minimum(output, 1 - 1e-9)))


def divided(conductance: Array) -> Array:
    """Output (fraction) of a conductance (1 / R0) above R0."""
    return np.asarray(conductance / (1.0 + conductance))


def without_grounded(output: Array) -> Array:
    """Conductances (..., r, c) (1 / R0) behind outputs of a matrix whose rows are all driven.

    By Kirchhoff the other crossings of a column pull it to ground: g_ij = u_ij / (1 - sum_k u_kj).

    Examples
    --------
    >>> without_grounded(np.array([[0.25], [0.5]])).tolist()
    [[1.0], [2.0]]
    """
    room = 1.0 - output.sum(axis=-2, keepdims=True)
    return np.asarray(output / np.maximum(room, 1e-9))


def without_floating(measured: Array) -> Array:
    """Conductances (r, c) (1 / R0) of crossings behind those of lines while all others float.

    Notes
    -----
    Damped least squares over logarithms of conductances, from above: no crossing conducts more
    than is measured across it. A conductance dg changes G_ij by G_ij^2 times the square of the
    potential that a unit current through ij leaves across it: products with all of these are
    products of matrices of the lines, so that each round takes conjugate gradients.
    """
    top = float(measured.max(initial=0.0))
    if top <= 0:
        return np.zeros(measured.shape)
    wanted = np.maximum(measured, 0.0) / top
    highest = np.maximum(wanted, FLOOR)
    crossing = highest.copy()
    for _ in range(ROUNDS):
        inverse = _inverse(crossing)
        seen = 1.0 / _pair_resistance(inverse, len(crossing))
        residual = seen - wanted
        if np.abs(residual).max() < CLOSE:
            break
        step = np.clip(_descended(inverse, seen, crossing, residual), -LONGEST, 1.0)
        crossing = np.clip(crossing * np.exp(step), NOTHING, highest)
    return np.where(crossing > FLOOR, crossing, 0.0) * top


def _laplacian(conductance: Array) -> Array:
    """Laplacian of a network (r + c, r + c): rows first."""
    rows, columns = (np.diag(conductance.sum(axis=axis)) for axis in (1, 0))
    return np.block([[rows, -conductance], [-conductance.T, columns]])


def _inverse(conductance: Array) -> Array:
    """Inverse of the Laplacian, every line tied to ground a little."""
    network = _laplacian(conductance)
    top = max(float(conductance.max(initial=0.0)), 1e-30)
    network[np.diag_indices(len(network))] += LEAK * top
    return np.asarray(np.linalg.inv(network))


def _pair_resistance(matrix: Array, rows: int) -> Array:
    """m_ii + m_jj - 2 m_ij for rows i and columns j."""
    diagonal = np.diag(matrix)
    return np.asarray(diagonal[:rows, None] + diagonal[None, rows:] - 2 * matrix[:rows, rows:])


def _descended(inverse: Array, seen: Array, crossing: Array, residual: Array) -> Array:
    """Change of logarithms of conductances that takes the residual away, least squares."""

    def applied(change: Array) -> Array:
        return _pair_resistance(inverse @ _laplacian(change) @ inverse, len(seen))

    left = -crossing * applied(seen**2 * residual)
    step, way = np.zeros(seen.shape), left.copy()
    size = first = float(np.square(left).sum())
    for _ in range(STEPS):
        if size <= ENOUGH * first:
            break
        ahead = seen**2 * applied(crossing * way)
        turned = crossing * applied(seen**2 * ahead) + DAMPING * way
        length = size / float((way * turned).sum())
        step += length * way
        left -= length * turned
        before, size = size, float(np.square(left).sum())
        way = left + size / before * way
    return step


SAME_LINE = 1e-6  # m


def lines_of(positions: Array) -> Integers:
    """Row and column (t, 2) of taxels, by their y and x; ValueError where two share a crossing."""
    steps = np.rint(positions[:, 1::-1] / SAME_LINE).astype(np.int64)
    lines = np.stack([np.unique(s, return_inverse=True)[1].reshape(-1) for s in steps.T], axis=1)
    if len(np.unique(lines, axis=0)) < len(lines):
        msg = 'matrix_lines of TaxelArrayConfig must be given: two taxels have the same x and y'
        raise ValueError(msg)
    return lines


class Unmixing:
    """Outputs of a matrix as if every crossing stood alone.

    Parameters
    ----------
    kind : str
        State of the other lines: 'none' (nothing is changed), 'grounded' or 'floating'.
    positions, lines : ndarray, shape (t, 3) and (t, 2)
        Centres of the taxels (m); row and column of each, None: by its y and x.
    """

    def __init__(self, kind: str, positions: Array, lines: Array | None) -> None:
        self.kind = kind
        if self.kind == 'none':
            return
        stated = lines_of(positions) if lines is None else lines.astype(np.int64)
        self.row, self.column = stated.T
        self.shape = tuple(stated.max(axis=0) + 1)

    def __call__(self, signals: Signals) -> Signals:
        """Signals whose values, baseline and their difference are without crosstalk."""
        if self.kind == 'none':
            return signals
        values = self.outputs(signals.values[..., 0])
        rest = self.outputs(signals.baseline[..., 0])
        delta = np.where(np.isnan(signals.delta[..., 0]), np.nan, values - rest)
        return replace(
            signals, values=values[..., None], baseline=rest[..., None], delta=delta[..., None]
        )

    def outputs(self, mixed: Array) -> Array:
        """Outputs (s, t) without crosstalk; a taxel that was not read conducts nothing."""
        matrix = np.zeros((len(mixed), *self.shape))
        matrix[:, self.row, self.column] = np.nan_to_num(np.maximum(mixed, 0.0))
        if self.kind == 'grounded':
            clean = divided(without_grounded(matrix))
        else:
            seen, where = np.unique(matrix, axis=0, return_inverse=True)
            clean = np.stack([divided(without_floating(alone(one))) for one in seen])
            clean = clean[where.reshape(-1)]
        # readings below zero are noise, and stay
        found = clean[:, self.row, self.column] + np.minimum(np.nan_to_num(mixed), 0.0)
        return np.asarray(np.where(np.isnan(mixed), np.nan, found))
