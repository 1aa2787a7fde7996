"""How likely a fitted object is against the others: its evidence, by Laplace's method.

A part that fits in one narrow way is less likely than one that fits as well in many.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.coverage_model import LEAST_WIDTH, MOST_WIDTH
from tactile_ros.estimators.readings import PRIOR
from tactile_ros.physics.tubes import PROFILES

if TYPE_CHECKING:
    from tactile_ros.estimators.coverage_error import ModelError
    from tactile_ros.estimators.readings import Fits, Readings

BROKEN = 0.05  # of the taxels, which then read anything up to the largest force
UNIFORM = 12.0  # over the squared width of an even prior: what it knows


def log_evidence(
    fits: Fits, i: int, readings: Readings, error: ModelError, reach: float, scale: float
) -> float:
    """Logarithm of the probability density of the readings, of one mode of one object.

    Parameters
    ----------
    fits : Fits
        Descents.
    i : int
        Which of them.
    readings : Readings
        What was fitted.
    error : ModelError
        Of the model.
    reach : float
        Of the array: places are as likely everywhere on it (m).
    scale : float
        By which errors are larger than stated, squared.

    Returns
    -------
    float
        Up to a constant of the frame.
    """
    variant, slopes, pressure = fits.variant, fits.slopes[:, i], float(fits.pressure[i])
    unit, free = variant.unit, len(slopes) - 1
    wide = [2 * reach / unit[0], 2 * reach / unit[1]]
    if free > 2:
        wide.append(2 * math.pi / max(variant.order, 1) / unit[2])
    if free > 3:
        wide.append((MOST_WIDTH - LEAST_WIDTH) * variant.radius / unit[3])
    edges = error.edge * (slopes[0] ** 2 + slopes[1] ** 2) + error.floor * readings.top**2
    variance = scale * (readings.variance + edges)
    squared = np.square(readings.force - pressure * fits.cover[i]) / variance
    sound = (1 - BROKEN) * np.exp(-0.5 * squared) / np.sqrt(2 * math.pi * variance)
    told = sound + BROKEN / readings.top
    normal = (slopes * (readings.usable * sound / told / variance)) @ slopes.T
    normal += np.diag(np.append(UNIFORM / np.square(wide), 1.0))
    room = 0.5 * free * math.log(2 * math.pi) - 0.5 * float(np.linalg.slogdet(normal)[1])
    profiles = len(PROFILES) if variant.tube else 1
    told = float(np.log(told) @ readings.usable)
    return told + room - float(np.log(wide).sum()) - math.log(profiles)


def common_scale(cost: float, readings: Readings, free: int) -> float:
    """By how much errors are larger than stated, squared, as the best fit tells it; 1 at least."""
    spare = max(readings.count - free, 0)
    return max((cost + PRIOR) / (spare + PRIOR), 1.0)
