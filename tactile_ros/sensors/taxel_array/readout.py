"""Circuits of the matrix: crosstalk between its lines, and taxels that are partly pressed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.coverage import area_share
from tactile_ros.physics.crosstalk import alone, divided, without_floating, without_grounded

if TYPE_CHECKING:
    from tactile_ros.conditioning.equilibration import Equilibration
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Integers, Signals

SAME_LINE = 1e-6  # m
PRESSED = 0.05  # of a taxel: of less the area law says nothing


def lines_of(positions: Array) -> Integers:
    """Row and column (t, 2) of taxels, by their y and x.

    Raises
    ------
    ValueError
        If two taxels would lie on the same crossing.
    """
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
    config : TaxelArrayConfig
        Its `crosstalk` says what the other lines do; 'none' changes nothing.
    """

    def __init__(self, config: TaxelArrayConfig) -> None:
        self.kind = config.crosstalk
        if self.kind == 'none':
            return
        lines = config.matrix_lines
        stated = lines_of(config.positions) if lines is None else lines.astype(np.int64)
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


def partly_pressed(
    law: Equilibration, output: Array, force: Array, cover: Array, areas: Array, area_law: Array
) -> Array:
    """Forces (t,) of taxels of which an object covers a part (N), by [4] Eq. (2).

    Parameters
    ----------
    law : Equilibration
        Forces of outputs of taxels that are wholly pressed.
    output, force : ndarray, shape (t,)
        Outputs above the baseline, and forces by the law, creep undone (N).
    cover, areas : ndarray, shape (t,)
        Covered and whole areas (m2).
    area_law : ndarray, shape (4,)
        p1..p4.
    """
    plain = law.forces(output[None])[0]
    partly = (cover > PRESSED * areas) & (plain > 0)
    whole = law.forces((output / area_share(cover, areas, area_law))[None])[0]
    ratio = whole / np.where(partly, plain, 1.0)
    return np.asarray(np.where(partly, force * ratio, force))
