"""Resistive sheet as a grid of links, solved for each frame: what a fitted map spares."""

from __future__ import annotations

import numpy as np

from tactile_ros.physics.resistive_sheet import network_potential
from tactile_ros.types import Array, Integers


def sheet_potential(size: Array, shape: tuple[int, int], border: Array, corners: Array) -> Array:
    """Potential of the whole sheet with some corners held.

    Parameters
    ----------
    size : ndarray, shape (2,)
        Of the sheet (m).
    shape : tuple of int
        Nodes along x and along y.
    border : ndarray, shape (4, n)
        Conductance of the border lines times length over the sheet conductance (m), along AB, BC,
        DC and AD, evenly spaced; a border of width w and ratio q has q w.
    corners : ndarray, shape (4,)
        Potentials held at A, B, C, D (fractions of the supply); NaN: left free. Two opposite
        corners are one of [5]'s excitations, three make a third one.

    Returns
    -------
    ndarray, shape (nx, ny)
        Potential at the nodes (fraction of the supply).

    Raises
    ------
    ValueError
        If no corner is held.
    """
    held = np.isfinite(corners)
    if not held.any():
        msg = 'corners of sheet_potential must hold at least one potential; received none'
        raise ValueError(msg)
    ends = _grid_links(size, shape, border)
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    fixed = np.array([number[0, 0], number[-1, 0], number[-1, -1], number[0, -1]])[held]
    return network_potential(*ends, number.size, fixed, corners[held]).reshape(shape)


def _grid_links(
    size: Array, shape: tuple[int, int], border: Array
) -> tuple[Integers, Integers, Array]:
    """Both ends of every link between neighbouring nodes, and its conductance over the sheet's."""
    nx, ny = shape
    step = size / (np.array(shape) - 1)
    number = np.arange(nx * ny).reshape(shape)
    along_x = np.full((nx - 1, ny), step[1] / step[0])
    along_y = np.full((nx, ny - 1), step[0] / step[1])
    # a link on the edge has sheet on one of its sides only
    along_x[:, [0, -1]] *= 0.5
    along_y[[0, -1]] *= 0.5
    knots = (np.arange(border.shape[1]) + 0.5) / border.shape[1]
    for side, column in ((0, 0), (2, -1)):
        middle = (np.arange(nx - 1) + 0.5) / (nx - 1)
        along_x[:, column] += np.interp(middle, knots, border[side]) / step[0]
    for side, row in ((3, 0), (1, -1)):
        middle = (np.arange(ny - 1) + 0.5) / (ny - 1)
        along_y[row] += np.interp(middle, knots, border[side]) / step[1]
    first = np.concatenate([number[:-1].ravel(), number[:, :-1].ravel()])
    second = np.concatenate([number[1:].ravel(), number[:, 1:].ravel()])
    return first, second, np.concatenate([along_x.ravel(), along_y.ravel()])
