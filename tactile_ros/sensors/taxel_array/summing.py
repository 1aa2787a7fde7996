"""Total force of an array and the centre of its pressure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.signals import Columns
    from tactile_ros.types import Array

BLUR = 0.09  # of a taxel's area: variance of a centre that one taxel tells
ACTIVE = 0.05  # of the largest load: more tells of the centre


def add_sum(known: Columns, load: Array, variance: Array, config: TaxelArrayConfig) -> None:
    """Total force, and where no position is known its centre, with covariances.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; changed in place.
    load, variance : ndarray, shape (s, t)
        Force of each taxel (N), and its variance (N2).
    config : TaxelArrayConfig
        Of the array.
    """
    samples = len(load)
    if 'force' not in known:
        known['force'] = np.full((samples, 3), np.nan)
        known['force_cov'] = np.full((samples, 3, 3), np.nan)
    known['force'][:, 2] = load.sum(axis=1)
    known['force_cov'][:, 2, 2] = variance.sum(axis=1)
    if 'position' in known:
        return
    share = np.maximum(load, 0.0)
    weight = np.maximum(share.sum(axis=1), 1e-12)[:, None]
    place = share @ config.positions / weight
    away = config.positions[None] - place[:, None]
    moved = (away * variance[..., None]).transpose(0, 2, 1)
    cov = moved @ away / weight[..., None] ** 2
    active = np.maximum((share > ACTIVE * share.max(axis=1, keepdims=True)).sum(axis=1), 1)
    cov[:, [0, 1], [0, 1]] += (BLUR * float(np.median(config.areas)) / active)[:, None]
    known['position'], known['position_cov'] = place, cov
