"""A specimen under heads that press it: three known ones, then a new one to be learned."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors.multipole_skin.signal import NOISE, SPECIMEN, Pressing, played
from tactile_ros.sensors.multipole_skin.specimen import Specimen
from tactile_ros.types import Outline

if TYPE_CHECKING:
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Recording

NEW = Outline('bar_20x6', (1e-3 * np.array([[-10, -3], [10, -3], [10, 3], [-10, 3]], float),))
KNOWN = 3  # heads that press
BEFORE, TAUGHT, AFTER = 6, 5, 16  # presses of the scene
SHOTS = 3  # presses from which the new head is learned
CALIBRATING = 12  # presses of one head
SPAN = 18e-3  # m, of places from the middle
DEPTH = (0.4e-3, 0.8e-3)
RETURNS = 5e-5, 0.01  # m and rad, by which the new head comes back


def _anywhere(rng: np.random.Generator, count: int) -> Array:
    """Poses (n, 3) at random."""
    return np.column_stack([rng.uniform(-SPAN, SPAN, (count, 2)), rng.uniform(-3, 3, count)])


def one_head(config: MultipoleSkinConfig, seed: int = 0) -> Recording:
    """Presses of the first head alone, by which the skin is calibrated; truth is known."""
    rng = np.random.default_rng([1, seed])
    poses, depths = _anywhere(rng, CALIBRATING), rng.uniform(*DEPTH, CALIBRATING)
    labels = np.zeros(CALIBRATING, np.int64)
    pressing = Pressing(config.objects, labels, poses, depths)
    return played(Specimen(config, seed=SPECIMEN), pressing, NOISE, seed)


def new_head(config: MultipoleSkinConfig, seed: int = 0, noise: float | None = None) -> Recording:
    """Three heads anywhere; then a new one again and again at one place; then all four.

    Parameters
    ----------
    config : MultipoleSkinConfig
        Of the sensor; of its `objects` three press.
    seed : int
        Of presses and noise.
    noise : float or None
        Of a channel (T); None: that of the chips.

    Returns
    -------
    Recording
        With truth; the label of the new head follows those of `objects`.
    """
    rng = np.random.default_rng([2, seed])
    heads, new = len(config.objects), len(config.objects)
    known = rng.permutation(heads)[:KNOWN]
    mixed = np.append(known, new)[rng.permutation(np.arange(AFTER) % (KNOWN + 1))]
    labels = np.concatenate([rng.choice(known, BEFORE), np.full(TAUGHT, new), mixed])
    poses = _anywhere(rng, len(labels))
    again = labels == new
    apart = np.array([RETURNS[0], RETURNS[0], RETURNS[1]])
    poses[again] = poses[BEFORE] + apart * rng.normal(size=(int(again.sum()), 3))
    depths = rng.uniform(*DEPTH, len(labels))
    sigma = NOISE if noise is None else noise
    pressing = Pressing((*config.objects, NEW), labels, poses, depths)
    return played(Specimen(config, seed=SPECIMEN), pressing, sigma, seed)
