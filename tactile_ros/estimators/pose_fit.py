"""One end of a descent: a pose, its covariance, and what it was fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.place_rows import covariance_of
from tactile_ros.estimators.readings import PRIOR, Fits, Readings
from tactile_ros.physics import compiled

if TYPE_CHECKING:
    from tactile_ros.estimators.coverage_error import ModelError
    from tactile_ros.estimators.coverage_model import TaxelPoints, Variant
    from tactile_ros.types import Array


@dataclass
class Fit:
    """One end of a descent: parameters, covariance (m, m), cost; the descents and which."""

    variant: Variant
    params: Array
    pressure: float
    cov: Array
    cost: float
    cover: Array
    fits: Fits
    index: int
    error: ModelError
    chance: float = 1.0


def fit_of(fits: Fits, i: int, readings: Readings, points: TaxelPoints) -> Fit:
    """One of the descents, with the covariance of its parameters."""
    free, places = fits.params.shape[1], fits.variant.places
    unit = fits.variant.unit[:free]
    error = points.errors[fits.variant.label] if places is None else places.error
    cov = _covariance(fits, i, readings)[:free, :free] * (unit[:, None] * unit)
    cov.reshape(-1)[:: free + 1] += np.square(error.shared * unit)
    return Fit(
        fits.variant,
        fits.params[i],
        float(fits.pressure[i]),
        cov,
        float(fits.cost[i]),
        fits.cover[i],
        fits,
        i,
        error,
    )


def _covariance(fits: Fits, i: int, readings: Readings) -> Array:
    """Of parameters, half from misfits where they are, half from their common size."""
    if compiled.available() and fits.variant.places is not None:
        return covariance_of(
            fits.normal[i], fits.slopes[:, i], fits.share[i], readings.force, fits.cover[i],
            float(fits.pressure[i]),
        )  # fmt: skip
    inverse = np.linalg.inv(fits.normal[i])
    share, j = fits.share[i], fits.slopes[:, i]
    miss = readings.force - fits.pressure[i] * fits.cover[i]
    excess = share * np.square(miss)
    size = np.abs(j).max(axis=0)
    told = int(np.count_nonzero((size > 1e-3 * size.max()) & (share > 0)))
    spare = max(told - len(inverse), 0)
    common = min(max((float(excess.sum()) + PRIOR) / (spare + PRIOR), 0.1), 9.0)
    if spare < 12:
        return np.asarray(inverse * common)
    part = (j * (share * excess)) @ j.T * (told / spare)
    return np.asarray(0.5 * inverse * common + 0.5 * inverse @ part @ inverse)
