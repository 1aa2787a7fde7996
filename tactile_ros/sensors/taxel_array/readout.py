"""What the read-out adds to the outputs of taxels: crosstalk of the matrix, area that is pressed.

Both are options of the config, off by default. Crosstalk is undone before anything is learned, so
that laws and recognition see taxels that stand alone. The area law needs to know how much of a
taxel is pressed, which only a recognised object tells.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.area_law import area_share
from tactile_ros.physics.crosstalk import alone, divided, without_floating, without_grounded

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.conditioning.equilibration import Equilibration
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Bools, Integers, Signals

SAME_LINE = 1e-6  # m
PRESSED = 0.05  # of a taxel: of less the area law says nothing
BELOW = -0.1  # of the range: a converter reads no less than ground, but for its offset


def below_ground(values: Array) -> Bools:
    """Taxels (s, t) of readings (s, t, c) that no converter can read.

    Examples
    --------
    >>> below_ground(np.array([[[0.4], [-0.4], [-0.001]]])).tolist()
    [[False, True, False]]
    """
    return np.asarray((values < BELOW).any(axis=-1))


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
        known = lines_of(config.positions) if lines is None else lines.astype(np.int64)
        self.row, self.column = known.T
        self.shape = tuple(known.max(axis=0) + 1)

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
        told = np.nan_to_num(np.maximum(mixed, 0.0))
        matrix = np.zeros((len(mixed), *self.shape))
        matrix[:, self.row, self.column] = told
        if self.kind == 'grounded':
            clean = divided(without_grounded(matrix))
        else:
            seen, where = np.unique(matrix, axis=0, return_inverse=True)
            clean = np.stack([divided(without_floating(alone(one))) for one in seen])
            clean = clean[where.reshape(-1)]
        found = clean[:, self.row, self.column]
        # what reads less than nothing is noise, and stays
        found = found + np.minimum(np.nan_to_num(mixed), 0.0)
        return np.asarray(np.where(np.isnan(mixed), np.nan, found))


def area_correction(
    law: Equilibration, output: Array, forces: Array, areas: Array, area_law: Array
) -> Callable[[int, Array], Array]:
    """Forces of a frame once it is known how much of each taxel an object covers.

    Parameters
    ----------
    law : Equilibration
        Forces of outputs of taxels that are wholly pressed.
    output, forces : ndarray, shape (s, t)
        Outputs above the baseline, and forces by the law, creep undone (N).
    areas : ndarray, shape (t,)
        Of the taxels (m2).
    area_law : ndarray, shape (4,)
        p1..p4 of [4] Eq. (2).

    Returns
    -------
    callable
        Row and covered area (t,) (m2) -> forces (t,) (N).
    """
    forces = forces.copy()  # what is corrected is written where these came from

    def corrected(i: int, cover: Array) -> Array:
        row = output[i][None]
        share = area_share(cover, areas, area_law)
        plain = law.forces(row)[0]
        partly = (cover > PRESSED * areas) & (plain > 0)
        ratio = law.forces(row / share)[0] / np.where(partly, plain, 1.0)
        return np.asarray(np.where(partly, forces[i] * ratio, forces[i]))

    return corrected
