"""How the output of a taxel depends on how much of it is pressed, at one load.

[4] Fig. 1 and Eq. (2): the same force on a larger part of a taxel gives another current. Eq. (1),
the step response of a PID element with a lag, is the same curve with the area in place of time.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

LEAST = 0.05  # of a taxel's whole output: no correction is larger than its inverse


def area_current(area: Array, law: Array) -> Array:
    """Current at an area, p1 + p2 A + p3 exp(-A / p4).

    Parameters
    ----------
    area : ndarray
        Pressed (m2).
    law : ndarray, shape (4,)
        p1, p2 (1 / m2), p3 and p4 (m2); the unit of p1 and p3 is that of the current.

    Returns
    -------
    ndarray
        Of the shape of `area`.

    Notes
    -----
    [4] Eq. (2).

    Examples
    --------
    >>> float(area_current(np.array(0.0), np.array([1.0, 0.0, -1.0, 1e-5])))
    0.0
    """
    p1, p2, p3, p4 = law
    return np.asarray(p1 + p2 * area + p3 * np.exp(-area / p4))


def law_of_response(gain: float, t1: float, ti: float, td: float) -> Array:
    """p1..p4 of the step response K (1 + (t - T1)/TI + (TD/T1 + T1/TI - 1) exp(-t/T1)).

    Notes
    -----
    [4] Eq. (1) with the area for the time: T1, TI and TD are areas (m2).
    """
    return np.array([gain * (1 - t1 / ti), gain / ti, gain * (td / t1 + t1 / ti - 1), t1])


def area_share(area: Array, whole: Array, law: Array) -> Array:
    """Output of taxels of which only a part is pressed, over that of the whole at the same load.

    Parameters
    ----------
    area, whole : ndarray, shape (..., t) and (t,)
        Pressed, and of the taxels (m2).
    law : ndarray, shape (4,)
        As in `area_current`.

    Returns
    -------
    ndarray, shape (..., t)
        At least 0.05: less says nothing about the load.

    Examples
    --------
    >>> area_share(np.array([1e-5]), np.array([2e-5]), np.array([0.0, 1.0, 0.0, 1.0])).tolist()
    [0.5]
    """
    part = np.clip(area, 0.0, whole)
    return np.asarray(np.maximum(area_current(part, law) / area_current(whole, law), LEAST))
