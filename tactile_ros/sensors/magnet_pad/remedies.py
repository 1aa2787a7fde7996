"""The three remedies of [2] where the least force is not felt in every cell.

Where most cells feel too little, the body is too stiff; a few cells of their own need a magnet
near them; a block of adjacent cells needs a chip near it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from tactile_ros.sensors.magnet_pad.conditions import Wanted, least_forces
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.types import Array, Integers

MOST = 0.5  # share of the cells that feel too little, from which the body is too stiff
BLOCK = 3  # adjacent cells that make a block
MARGIN = 0.95


@dataclass(frozen=True)
class Remedy:
    """A change of the pad.

    Attributes
    ----------
    what, why, change : str
        Which of the three, what it answers to, and what is changed.
    config : MagnetPadConfig
        The pad with it.
    """

    what: str
    why: str
    change: str
    config: MagnetPadConfig


def stiffest(config: MagnetPadConfig, wanted: Wanted) -> float:
    """Largest shear modulus (Pa) at which every cell feels the least force; 0: none.

    Notes
    -----
    Displacements depend on force over modulus alone, so that the least force grows with it.
    """
    most = float(least_forces(config, wanted).max())
    return MARGIN * config.shear_modulus * wanted.force / most if np.isfinite(most) else 0.0


def blocks(cells: Array, weak: Integers) -> list[Integers]:
    """Sets of adjacent cells among the weak ones, centres (n, 3) (m), largest first."""
    if not len(weak):
        return []
    plan = cells[:, :2]
    x, y = (np.diff(np.unique(np.round(axis, 6))) for axis in plan.T)
    step = np.array([x.min() if len(x) else 1.0, y.min() if len(y) else 1.0])
    near = cdist(plan[weak] / step, plan[weak] / step, 'chebyshev') < 1.5
    count, label = connected_components(near, directed=False)
    parts = [weak[label == i] for i in range(count)]
    return sorted(parts, key=lambda part: (-len(part), int(part[0])))


def remedies(config: MagnetPadConfig, wanted: Wanted, force: Array) -> list[Remedy]:
    """What to change where forces (n,) (N) that are felt exceed the least one."""
    weak = np.flatnonzero(force > wanted.force)
    if not len(weak):
        return []
    found = []
    modulus = stiffest(config, wanted)
    if modulus > 0:
        why = 'most cells' if len(weak) > MOST * len(force) else 'max(F_min) is high'
        change = f'shear modulus {1e-6 * modulus:.3g} MPa for {1e-6 * config.shear_modulus:.3g}'
        found.append(Remedy('softer body', why, change, replace(config, shear_modulus=modulus)))
    for part in blocks(config.cells, weak):
        if len(part) >= BLOCK:
            found.append(_chip(config, part))
        else:
            found.append(_magnet(config, part))
    return found


def _words(cells: Integers) -> str:
    return 'cells ' + ', '.join(str(cell) for cell in cells.tolist())


def _magnet(config: MagnetPadConfig, cells: Integers) -> Remedy:
    """A magnet half way between the base and the surface under a few cells."""
    at = config.cells[cells].mean(axis=0)
    at[2] *= 0.6
    added = replace(
        config,
        magnet_positions=np.vstack([config.magnet_positions, at]),
        magnet_axes=np.vstack([config.magnet_axes, config.magnet_axes[:1]]),
    )
    change = f'a magnet at {1e3 * at[0]:.3g}, {1e3 * at[1]:.3g}, {1e3 * at[2]:.3g} mm'
    return Remedy('more magnets', f'a few: {_words(cells)}', change, added)


def _chip(config: MagnetPadConfig, cells: Integers) -> Remedy:
    """A chip under a block of adjacent cells."""
    at = np.append(config.cells[cells, :2].mean(axis=0), config.positions[:, 2].mean())
    turns = config.rotations
    added = replace(
        config,
        positions=np.vstack([config.positions, at]),
        rotations=None if turns is None else np.concatenate([turns, np.eye(3)[None]]),
    )
    change = f'a chip at {1e3 * at[0]:.3g}, {1e3 * at[1]:.3g} mm'
    return Remedy('extra chip', f'a block: {_words(cells)}', change, added)
