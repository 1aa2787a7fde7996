# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hall sensitivity, remanence and lag: effects of temperature.

Coefficients are typical: neodymium magnets lose 0.12 % of their remanence a degree (data sheets of
grade N), silicones and soft polyurethanes expand by 3e-4 a degree. A chip measures its own
temperature, not the magnet's.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array

CALIBRATED_AT = 35.0  # degrees Celsius, of the chip [3]
REFERENCE = 20.0  # degrees Celsius, of magnets and rubbers
REMANENCE_SLOPE = -1.2e-3  # a degree
EXPANSION = 3e-4  # a degree, of soft bodies
FITTED = (0.0, 50.0)  # degrees Celsius over which [3] fitted its polynomial
LEAST_SENSITIVITY = 0.1
COLDEST, HOTTEST = -60.0, 200.0  # degrees Celsius, of any chip


def plausible_temperature(chips: Array) -> Array:
    """Temperatures (..., t) (degrees Celsius), NaN where no chip can have them.

    Exactly 0 on all chips of a frame is what boards send that measure none.
    """
    found = np.array(chips, np.float64, order='C')
    blank_implausible(found.reshape(-1, found.shape[-1]))
    return found


@compiled
def blank_implausible(chips: Array) -> int:
    """Make temperatures (s, t) NaN as above; frames that have none then, though some came."""
    refused = 0
    for frame in chips:
        measured = came = left = False
        for one in frame:
            measured |= one != 0.0
        for t in range(len(frame)):
            came |= not np.isnan(frame[t])
            if not (measured and COLDEST <= frame[t] <= HOTTEST):
                frame[t] = np.nan
            left |= not np.isnan(frame[t])
        refused += came and not left
    return refused


def hall_sensitivity(
    temperature_c: Array, coefficients: Array, fitted: tuple[float, float] = FITTED
) -> Array:
    """Raw over true reading (...) of a Hall element: p0 + p1 dT + p2 dT^2, dT = T - 35 C.

    Parameters
    ----------
    temperature_c : ndarray, shape (...)
        Of the chip (degrees Celsius); NaN: unknown, which gives 1.
    coefficients : ndarray, shape (3,)
        p0, p1, p2.
    fitted : tuple of float
        Temperatures between which the polynomial was fitted, beyond which it stands still.

    Notes
    -----
    [3] Eq. (1).

    Examples
    --------
    >>> hall_sensitivity(np.array([35.0, 25.0, 150.0]), np.array([1.0, -0.005, 0.0])).tolist()
    [1.0, 1.05, 0.925]
    """
    ratio = np.empty(np.shape(temperature_c))
    flat = np.ascontiguousarray(temperature_c, np.float64).reshape(-1)
    _hall_ratios(flat, coefficients, fitted[0], fitted[1], ratio.reshape(-1))
    return ratio


@compiled
def hall_ratio(temperature_c: float, coefficients: Array, low: float, high: float) -> float:
    """Sensitivity of one element as `hall_sensitivity` has it."""
    rise = min(max(temperature_c, low), high) - CALIBRATED_AT
    ratio = coefficients[0] + coefficients[1] * rise + coefficients[2] * (rise * rise)
    usable = math.isfinite(temperature_c) and math.isfinite(ratio) and ratio > LEAST_SENSITIVITY
    return ratio if usable else 1.0


@compiled
def _hall_ratios(
    temperature_c: Array, coefficients: Array, low: float, high: float, ratio: Array
) -> None:
    for i in range(len(ratio)):
        ratio[i] = hall_ratio(temperature_c[i], coefficients, low, high)


def remanence_at(temperature_c: Array, remanence: float) -> Array:
    """Remanence (...) (T) at temperatures of a magnet that has `remanence` at 20 C.

    Examples
    --------
    >>> remanence_at(np.array([20.0, 45.0]), 1.4).round(4).tolist()
    [1.4, 1.358]
    """
    return np.asarray(remanence * (1 + REMANENCE_SLOPE * (temperature_c - REFERENCE)))


def following(temperature_c: Array, dt: Array, time_constant: float) -> Array:
    """Temperature (s,) of a body that follows another's with a time constant (s).

    It begins with the first of `temperature_c` (s,); `dt` (s,) is the time since the row before,
    and ValueError is raised if one is negative. Exact where the other is constant between rows.

    Examples
    --------
    >>> following(np.array([20.0, 30.0]), np.array([0.0, 60.0]), 60.0).round(3).tolist()
    [20.0, 26.321]
    """
    if (dt[1:] < 0).any():
        msg = f'dt of following must not be negative; received {dt[1:].min()}'
        raise ValueError(msg)
    body = np.array(temperature_c, np.float64)
    share = -np.expm1(-dt / time_constant)
    for i in range(1, len(body)):
        body[i] = body[i - 1] + share[i] * (temperature_c[i] - body[i - 1])
    return body
