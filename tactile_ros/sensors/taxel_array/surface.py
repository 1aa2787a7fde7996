"""Surface of what is gripped, from how deep each taxel gives way: [4] Eqs. (3) and (4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array, Bools

if TYPE_CHECKING:
    from tactile_ros.conditioning.equilibration import Equilibration
    from tactile_ros.types import ContactState


def surface_points(positions: Array, deformation: Array, touched: Bools | None = None) -> Array:
    """Points of the object's surface.

    Parameters
    ----------
    positions : ndarray, shape (t, 3)
        Centres of the untouched taxels (m).
    deformation : ndarray, shape (s, t)
        How far each gives way along -z (m): shape factor times output; NaN: rigid.
    touched : ndarray, shape (s, t), or None
        Where something lies; None: where a taxel gives way.

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
    points[~(deformation > 0 if touched is None else touched)] = np.nan
    return points


def touched_surface(
    positions: Array, state: ContactState, least: Array, shape: Equilibration | None
) -> Array:
    """Surface under one frame.

    Parameters
    ----------
    positions : ndarray, shape (t, 3)
        Centres of the untouched taxels (m).
    state : ContactState
        Of the frame. Where it knows no deformation the array counts as rigid: it gives way
        nowhere.
    least : ndarray, shape (t,)
        Load beyond which a taxel is touched; outputs where no forces are known.
    shape : Equilibration or None
        Deformation of outputs.

    Returns
    -------
    ndarray, shape (t, 3)
        NaN where nothing touches, and everywhere where neither force nor deformation is known.
    """
    depth, force = state.deformation[None], state.taxel_force[None]
    touched = force > least
    if shape is not None and not np.isfinite(force).any():
        touched = depth > shape.forces(least[None])
    return np.asarray(surface_points(positions, depth, touched)[0])
