"""Which model of the blocks' field this pad needs: dipoles in growing number, or the closed form.

A scene is what the body does to its magnets under touches: shifts and turns. Readings are changes
since rest, as a tared pad has them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.dipoles import in_chip_axes
from tactile_ros.physics.fidelity import BLOCK_COST, DIPOLE_COST, Choice, Model, choose
from tactile_ros.physics.magnet_blocks import EXACT, Blocks

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array

EDGES = (1, 2, 3, 4)


def blocks_of(config: MagnetPadConfig, edge_nodes: int) -> Blocks:
    """Magnets of a pad as so many dipoles along an edge."""
    return Blocks.along(
        config.magnet_positions,
        config.magnet_axes,
        config.magnet_size,
        config.remanence,
        edge_nodes,
    )


def block_field(config: MagnetPadConfig, edge_nodes: int) -> Model:
    """Change of the readings (s, n) from states (s, 6 m) of m magnets: shifts (m), turns (rad)."""
    blocks, count = blocks_of(config, edge_nodes), len(config.magnet_positions)
    still = np.zeros((1, count, 3))
    level = blocks.field(config.positions, still, still)

    def readings(states: Array) -> Array:
        moved, turned = states.reshape(len(states), 2, count, 3).transpose(1, 0, 2, 3)
        change = blocks.field(config.positions, moved, turned) - level
        return in_chip_axes(change, config.rotations).reshape(len(states), -1)

    dipoles = edge_nodes**3
    cost = BLOCK_COST if edge_nodes == EXACT else DIPOLE_COST * dipoles
    named = {EXACT: 'exact blocks', 1: 'dipole a block'}
    name = named.get(edge_nodes, f'{dipoles} dipoles a block')
    pairs = count * len(config.positions)
    return Model(name, readings, cost * pairs, size=(edge_nodes,))


def block_model(
    config: MagnetPadConfig, noise: float, moved: Array, turned: Array, *, every: bool = False
) -> Choice:
    """The cheapest model of the blocks; its size is the dipoles along an edge.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pad.
    noise : float
        Of a reading (T).
    moved, turned : ndarray, shape (s, m, 3)
        Shifts (m) and turns (rad) of the magnets in the scene; some hundreds.
    every : bool
        Measure all models.

    Returns
    -------
    Choice
        `choice.size[0]` is what `Blocks` takes as `edge_nodes`.
    """
    states = np.stack([moved, turned], axis=1).reshape(len(moved), -1)
    models = [block_field(config, n) for n in EDGES]
    return choose(models, block_field(config, EXACT), states, noise, every=every)
