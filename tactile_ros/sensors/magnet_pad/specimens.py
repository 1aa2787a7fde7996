"""Pads that differ from their config as specimens do, and what they read.

Magnets sit and chips read otherwise than the config says, bodies are stiffer, stiffen under load
and are held by their base as they like, tips have any size. What a nominal model says of touches
of such pads tells how far it may be trusted.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors.magnet_pad.nominal import (
    LOADS,
    TIPS,
    Presses,
    change_of_field,
    spread_presses,
)

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array

COUNT, TOUCHES = 40, 40
MISPLACED, RAISED = 0.01, 0.03  # radii; of the height
GAINS = 0.03  # of chips and of the magnets that they see most, and of crossed axes
STIFFNESS, STIFFENING = 0.2, 0.3  # logarithms, of the modulus and under the largest load
BONDS = (-0.5, 1.5)


def specimens(config: MagnetPadConfig, noise: float) -> tuple[Array, Array]:
    """Readings of touches of many specimens, the same for the same config.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pads.
    noise : float
        Of a channel (T).

    Returns
    -------
    readings : ndarray, shape (s, 3 t)
        Changes since rest (T).
    truth : ndarray, shape (s, 6)
        Places (m) and forces (N).
    """
    readings, truth = [], []
    for seed in range(COUNT):
        rng, presses = np.random.default_rng(seed), spread_presses(config, TOUCHES, seed)
        change = _read(config, presses, rng)
        readings.append(change + noise * rng.normal(size=change.shape))
        truth.append(np.column_stack([presses.places(config.radius), presses.force]))
    return np.concatenate(readings), np.concatenate(truth)


def _read(config: MagnetPadConfig, presses: Presses, rng: np.random.Generator) -> Array:
    """Changes (s, 3 t) (T) of touches of one specimen."""
    magnets = config.magnet_positions * np.array([1, 1, np.exp(RAISED * rng.normal())])
    magnets = magnets + MISPLACED * config.radius * rng.normal(size=magnets.shape)
    most = LOADS[1] * config.shear_modulus * config.radius**2
    give = -STIFFNESS * rng.normal() - STIFFENING * rng.uniform() * presses.size / most
    one = np.ones(len(presses.along))
    touches = replace(
        presses,
        force=np.exp(give)[:, None] * presses.force,
        tip=config.radius * rng.uniform(*TIPS) * one,
        bond=rng.uniform(*BONDS) * one,
    )
    change = change_of_field(replace(config, magnet_positions=magnets), touches)
    chips = len(config.positions)
    gains = np.eye(3) + GAINS * rng.normal(size=(chips, 3, 3))
    return np.asarray(np.einsum('tij,stj->sti', gains, change).reshape(len(one), 3 * chips))
