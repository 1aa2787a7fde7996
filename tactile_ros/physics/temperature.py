"""What temperature changes: Hall elements, remanence, lengths, stiffness; and that it lags.

Coefficients are typical: neodymium magnets lose 0.12 % of their remanence a degree (data sheets of
grade N), silicones and soft polyurethanes expand by 3e-4 a degree, and the modulus of a rubber is
that of its entropy, proportional to the absolute temperature (Treloar, The Physics of Rubber
Elasticity, 3rd ed., sec. 4.4). A chip tells its own temperature, not the magnet's.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

CALIBRATED_AT = 35.0  # degrees Celsius, of the chip [3]
REFERENCE = 20.0  # degrees Celsius, of magnets and rubbers
ZERO = 273.15
REMANENCE_SLOPE = -1.2e-3  # a degree
EXPANSION = 3e-4  # a degree, of soft bodies
KNOWN = (0.0, 50.0)  # degrees Celsius over which [3] fitted its polynomial
LEAST_SENSITIVITY = 0.1


def hall_sensitivity(
    temperature_c: Array, coefficients: Array, known: tuple[float, float] = KNOWN
) -> Array:
    """Raw over true reading of a Hall element: p0 + p1 dT + p2 dT^2, dT = T - 35 C.

    Parameters
    ----------
    temperature_c : ndarray, shape (...)
        Of the chip (degrees Celsius); NaN: unknown.
    coefficients : ndarray, shape (3,)
        p0, p1, p2.
    known : tuple of float
        Temperatures between which the polynomial was fitted; beyond them it stands still, since a
        parabola does not.

    Returns
    -------
    ndarray, shape (...)
        1 where the temperature is unknown.

    Notes
    -----
    [3] Eq. (1). `beyond` says by how much a temperature is outside.

    Examples
    --------
    >>> hall_sensitivity(np.array([35.0, 25.0, 150.0]), np.array([1.0, -0.005, 0.0])).tolist()
    [1.0, 1.05, 0.925]
    """
    # np.clip costs several times as much for one frame
    rise = np.minimum(np.maximum(temperature_c, known[0]), known[1]) - CALIBRATED_AT
    p0, p1, p2 = coefficients.tolist()
    found = p0 + p1 * rise + p2 * (rise * rise)
    return np.where(np.isfinite(found) & (found > LEAST_SENSITIVITY), found, 1.0)


def beyond(temperature_c: Array, known: tuple[float, float] = KNOWN) -> Array:
    """Degrees by which temperatures (...) are outside of the known ones; NaN stays NaN.

    Examples
    --------
    >>> beyond(np.array([20.0, 60.0, -5.0])).tolist()
    [0.0, 10.0, 5.0]
    """
    return np.abs(temperature_c - np.clip(temperature_c, *known))


def remanence_at(temperature_c: Array, remanence: float, slope: float = REMANENCE_SLOPE) -> Array:
    """Remanence (T) of a magnet that has `remanence` at 20 C, at temperatures (...).

    Examples
    --------
    >>> remanence_at(np.array([20.0, 45.0]), 1.4).round(4).tolist()
    [1.4, 1.358]
    """
    return np.asarray(remanence * (1 + slope * (temperature_c - REFERENCE)))


def length_at(temperature_c: Array, length: float, expansion: float = EXPANSION) -> Array:
    """Length (m) of a soft body that has `length` at 20 C, at temperatures (...).

    Examples
    --------
    >>> length_at(np.array([20.0, 70.0]), 2.5e-3).round(7).tolist()
    [0.0025, 0.0025375]
    """
    return np.asarray(length * (1 + expansion * (temperature_c - REFERENCE)))


def rubber_modulus_at(temperature_c: Array, modulus: float) -> Array:
    """Modulus (Pa) of a rubber that has `modulus` at 20 C, at temperatures (...).

    Examples
    --------
    >>> rubber_modulus_at(np.array([20.0, 50.0]), 1e5).round().tolist()
    [100000.0, 110234.0]
    """
    return np.asarray(modulus * (ZERO + temperature_c) / (ZERO + REFERENCE))


def following(temperature_c: Array, dt: Array, time_constant: float) -> Array:
    """Temperature of a body that follows another's with a time constant.

    Parameters
    ----------
    temperature_c : ndarray, shape (s,)
        Of what it follows; the body begins with the first.
    dt : ndarray, shape (s,)
        Time since the row before (s); the first is not used.
    time_constant : float
        Of the body (s).

    Returns
    -------
    ndarray, shape (s,)
        Exact where the other's temperature is constant between rows, however long they are.

    Raises
    ------
    ValueError
        If a time is negative.

    Examples
    --------
    >>> following(np.array([20.0, 30.0]), np.array([0.0, 60.0]), 60.0).round(3).tolist()
    [20.0, 26.321]
    """
    if (dt[1:] < 0).any():
        msg = f'dt of following must not be negative; received {dt[1:].min()}'
        raise ValueError(msg)
    found = np.empty(len(temperature_c))
    found[:1] = temperature_c[:1]
    for i in range(1, len(found)):
        share = -np.expm1(-dt[i] / time_constant)
        found[i] = found[i - 1] + share * (temperature_c[i] - found[i - 1])
    return found
