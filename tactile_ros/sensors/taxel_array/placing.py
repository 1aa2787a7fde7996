"""Recognised objects of many frames, as attributes of states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import FrameStatus, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.estimators.object_pose import Found, ObjectPose
    from tactile_ros.signals import Columns
    from tactile_ros.types import Array, Bools

HIDDEN = 0.01  # error of what silent taxels under an object bear, in parts
UNCORRECTED = 0.25  # error of a taxel's force before it is known how much of it is pressed
ROUNDS = 2  # of correction
COVERED, MUTE, LOUD = 0.7, 0.15, 0.25


def place_objects(
    known: Columns,
    objects: ObjectPose,
    forces: Array,
    noise: Array,
    spread: float,
    asked: Bools,
    usable: Bools,
    summed: tuple[float, float] | None,
    corrected: Callable[[int, Array], Array] | None = None,
) -> None:
    """Add label, pose, position and bad taxels of every asked row.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; changed in place.
    objects : ObjectPose
        What may lie there.
    forces : ndarray, shape (s, t)
        Of the taxels (any unit).
    noise : ndarray, shape (t,)
        Of them at rest.
    spread : float
        Their error in parts of the force.
    asked : ndarray, shape (s,)
        Rows in which something may lie.
    usable : ndarray, shape (t,)
        False: known to be dead.
    summed : tuple of float, or None
        Where the total force is a sum, in which the object tells what silent taxels bear: error
        of a taxel (N), and in parts of its force.
    corrected : callable or None
        Forces (t,) of a row once it is known how much of each taxel is covered (t,) (m2).
    """
    samples, taxels = forces.shape
    _make_room(known, samples, taxels)
    for i in np.flatnonzero(asked):
        row = forces[i]
        able = usable & np.isfinite(row)
        first = spread if corrected is None else max(spread, UNCORRECTED)
        found = objects.locate(np.nan_to_num(row), noise, able, first)
        for _ in range(0 if corrected is None or found.label < 0 else ROUNDS):
            assert corrected is not None
            row = corrected(int(i), found.cover)
            better = objects.locate(np.nan_to_num(row), noise, able, spread)
            if better.label < 0:
                break
            found = better
            known['taxel_force'][i] = row
        if found.label < 0:
            known['status'][i] = int(FrameStatus.ABSTAINED)
            continue
        _write(known, int(i), found)
        if summed is not None and not (able.all() and corrected is None):
            hidden = max(float(found.pressure * found.cover[~able].sum()), 0.0)
            seen = row[np.isfinite(row)]
            known['force'][i, 2] = seen.sum() + hidden
            variance = float((summed[0] ** 2 + np.square(summed[1] * seen)).sum())
            known['force_cov'][i, 2, 2] = variance + (HIDDEN * hidden) ** 2
        _mark(known, int(i), found, row, objects.areas)


def _make_room(known: Columns, samples: int, taxels: int) -> None:
    """Columns for what is to be said."""
    shapes = {
        'label_probability': (), 'yaw': (), 'yaw_std': (), 'object_pose': (4, 4),
        'object_pose_cov': (6, 6), 'position': (3,), 'position_cov': (3, 3),
    }  # fmt: skip
    for name, shape in shapes.items():
        if name not in known:
            known[name] = np.full((samples, *shape), np.nan)
    known['label'] = np.full(samples, -1, np.int64)
    known['symmetry'] = np.full(samples, -1, np.int64)
    known['status'] = np.zeros(samples, np.int64)
    if 'taxel_status' not in known:
        known['taxel_status'] = np.zeros((samples, taxels), np.uint8)


def _write(known: Columns, i: int, found: Found) -> None:
    """What was recognised in row i."""
    x, y, yaw = found.pose
    cos, sin = np.cos(yaw), np.sin(yaw)
    known['label'][i], known['label_probability'][i] = found.label, found.probability
    known['symmetry'][i] = found.order
    pose = np.eye(4)
    pose[:2, :2] = [[cos, -sin], [sin, cos]]
    pose[:2, 3] = x, y
    cov = np.zeros((6, 6))
    free = np.array([0, 1, 5])
    cov[free[:, None], free] = found.cov
    known['object_pose'][i], known['object_pose_cov'][i] = pose, cov
    known['position'][i], known['position_cov'][i] = pose[:3, 3], cov[:3, :3]
    if found.order > 0:
        known['yaw'][i], known['yaw_std'][i] = yaw, np.sqrt(found.cov[2, 2])


def _mark(known: Columns, i: int, found: Found, row: Array, areas: Array) -> None:
    """Taxels that contradict a recognised object: mute under it, or loud beside it."""
    expected = found.pressure * found.cover
    mute = (found.cover > COVERED * areas) & (row < MUTE * expected)
    loud = (found.cover < 1e-3 * areas) & (row > LOUD * found.pressure * areas)
    if mute.any() or loud.any():
        known['taxel_status'][i, mute] |= int(TaxelStatus.DEAD)
        known['taxel_status'][i, loud] |= int(TaxelStatus.STUCK)
        if 'taxel_force' in known:
            known['taxel_force'][i, mute | loud] = np.nan
