"""Surface of what is gripped, from how deep each taxel gives way: [4] Eqs. (3) and (4)."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array


def surface_points(positions: Array, deformation: Array) -> Array:
    """Points of the object's surface.

    Parameters
    ----------
    positions : ndarray, shape (t, 3)
        Centres of the untouched taxels (m).
    deformation : ndarray, shape (s, t)
        How far each gives way along -z (m): shape factor times output; NaN unknown.

    Returns
    -------
    ndarray, shape (s, t, 3)
        NaN where nothing touches.

    Notes
    -----
    [4] Eq. (3) divides the deformation by the output, which is 0/0 without touch: the shape factor
    is a calibrated function instead, and that of a rigid array is 0.

    Examples
    --------
    >>> surface_points(np.zeros((2, 3)), np.array([[1e-3, 0.0]])).tolist()
    [[[0.0, 0.0, -0.001], [nan, nan, nan]]]
    """
    points = np.broadcast_to(positions, (len(deformation), *positions.shape)).copy()
    points[..., 2] -= np.where(np.isnan(deformation), 0.0, deformation)
    points[~(deformation > 0)] = np.nan
    return points
