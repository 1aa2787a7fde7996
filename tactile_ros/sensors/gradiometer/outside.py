"""What answers of the gradiometer are worth outside the temperatures of its fit.

A polynomial of a degree n that is at most 1 in absolute value from -1 to 1 is at most |T_n|
outside (Chebyshev, 1854). Models of a fit are squares of the temperature: all of an error may grow
as T_2. Only what held-out errors show of a cubic may grow as T_3.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.sensors.gradiometer.thermal import LEAST_RANGE
from tactile_ros.types import Array

ROWS = 10  # for a coefficient


def ends(beyond: Array, span: Array) -> Array:
    """How far temperatures lie from the middle of a span (2,) over half of it (s,), at least 1.

    `beyond` (s,) are the degrees by which they lie outside.
    """
    return np.asarray(1 + 2 * beyond / max(float(span[1] - span[0]), LEAST_RANGE))


def grown(cov: Array, bend: Array, ends: Array) -> Array:
    """Covariances (s, k, k) of errors at `ends` (s,), of those at 1 and the cubic (k,) there."""
    second, third = 2 * ends**2 - 1, (4 * ends**2 - 3) * ends
    more = np.sqrt(third**2 - 1)[:, None] * bend
    return np.asarray(cov * (second**2)[:, None, None] + more[:, :, None] * more[:, None])


def bent(errors: Array, warm: Array, place: Array) -> Array:
    """Size (k,) of the cubic of the temperature in held-out errors, and of what may hide it.

    Parameters
    ----------
    errors : ndarray, shape (s, k)
        Of answers.
    warm : ndarray, shape (s,)
        Temperatures.
    place : ndarray, shape (s, d)
        What the cubic may follow linearly.

    Returns
    -------
    ndarray, shape (k,)
        Root mean square of T_3 of the temperature, over its range, times a linear function of
        the place; all of an error where rows are few.
    """
    size: Array = np.sqrt((errors**2).mean(axis=0))
    width = np.ptp(warm)
    scaled = (place - place.mean(axis=0)) / np.maximum(place.std(axis=0), 1e-300)
    each = np.column_stack([np.ones(len(place)), scaled])
    count = each.shape[1]
    if len(errors) < 4 * ROWS * count or width == 0:
        return size
    u = 2 * (warm - warm.min())[:, None] / width - 1
    terms = np.column_stack([each, each * u, each * u**2, each * (4 * u**2 - 3) * u])
    found = np.linalg.lstsq(terms, errors, rcond=None)[0][-count:]
    return np.asarray(np.sqrt(((each @ found) ** 2).mean(axis=0)))
