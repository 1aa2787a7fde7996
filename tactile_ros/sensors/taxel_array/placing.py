"""Recognised objects of many frames, as attributes of states."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics import compiled
from tactile_ros.sensors.taxel_array.force_rows import judged_row
from tactile_ros.types import FrameStatus, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.estimators.object_pose import Found, ObjectPose
    from tactile_ros.types import Array, Bools, Columns, Integers

UNCORRECTED = 0.25  # error of a taxel's force before it is known how much of it is pressed
ROUNDS = 2  # of correction
COVERED, MUTE, LOUD = 0.7, 0.15, 0.25
SHAPES: dict[str, tuple[int, ...]] = {
    'label_probability': (), 'yaw': (), 'yaw_std': (), 'object_pose': (4, 4),
    'object_pose_cov': (6, 6), 'position': (3,), 'position_cov': (3, 3),
}  # fmt: skip
SIZES = [int(np.prod(shape)) for shape in SHAPES.values()]
NOBODY = np.array([[-1], [-1], [0]])  # label, symmetry, status


def place_objects(
    known: Columns,
    objects: ObjectPose,
    forces: Array,
    noise: Array,
    spread: Array,
    asked: Bools,
    usable: Bools,
    summed: tuple[Array, Array] | None,
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
    spread : ndarray, shape (s, t)
        Their error in parts of the force.
    asked : ndarray, shape (s,)
        Rows in which something may lie.
    usable : ndarray, shape (t,)
        False: known to be dead.
    summed : tuple of ndarray, shape (s, t) and (s,), or None
        Where the total force is a sum, in which the object tells what silent taxels bear:
        variances of the forces, and the part of their sum by which those of a row err alike.
    corrected : callable or None
        Forces (t,) of a row once it is known how much of each taxel is covered (t,) (m2).
    """
    samples, taxels = forces.shape
    _make_room(known, samples, taxels)
    for i in np.flatnonzero(asked):
        row = forces[i]
        read = np.isfinite(row)
        able = usable & read
        own = spread[i]
        first = own if corrected is None else np.maximum(own, UNCORRECTED)
        found = objects.locate(np.where(read, row, 0.0), noise, able, first)
        for _ in range(0 if corrected is None or found.label < 0 else ROUNDS):
            assert corrected is not None
            row = corrected(int(i), found.cover)
            better = objects.locate(np.nan_to_num(row), noise, able, own)
            if better.label < 0:
                break
            found = better
            known['taxel_force'][i] = row
        if found.label < 0:
            known['status'][i] = int(FrameStatus.ABSTAINED)
            continue
        _write(known, int(i), found)
        _weigh(known, int(i), row, found, able, objects.areas, summed, corrected is not None)


def _weigh(
    known: Columns,
    i: int,
    row: Array,
    found: Found,
    able: Bools,
    areas: Array,
    summed: tuple[Array, Array] | None,
    changed: bool,
) -> None:
    """Total force of row i with what its object hides, and taxels that contradict the object."""
    verdict = np.empty(len(row), np.int64)
    own = row if summed is None else summed[0][i]
    hidden, seen, variance, count = _judged(row, own, found, able, areas, verdict)
    if summed is not None and (count < len(row) or changed):
        known['force'][i, 2] = seen + max(hidden, 0.0)
        # what is hidden follows the pressure that the seen ones tell
        grown = (seen + hidden) / seen if seen > 0 else 1.0
        variance = variance * grown**2 + (found.unsure * hidden) ** 2
        variance += (summed[1][i] * (seen + hidden)) ** 2
        known['force_cov'][i, 2, 2] = variance
    if np.count_nonzero(verdict):
        _mark(known, i, verdict)


def _make_room(known: Columns, samples: int, taxels: int) -> None:
    """Columns for what is to be said."""
    blank = np.empty(sum(SIZES) * samples)
    blank.fill(np.nan)
    end = 0
    for (name, shape), size in zip(SHAPES.items(), SIZES, strict=True):
        start, end = end, end + size * samples
        if name not in known:
            known[name] = blank[start:end].reshape(samples, *shape)
    known['label'], known['symmetry'], known['status'] = NOBODY.repeat(samples, axis=1)
    if 'taxel_status' not in known:
        known['taxel_status'] = np.zeros((samples, taxels), np.uint8)


def _write(known: Columns, i: int, found: Found) -> None:
    """What was recognised in row i."""
    x, y, yaw = found.pose.tolist()
    cos, sin = math.cos(yaw), math.sin(yaw)
    known['label'][i], known['label_probability'][i] = found.label, found.probability
    known['symmetry'][i] = found.order
    known['object_pose'][i] = (
        (cos, -sin, 0.0, x), (sin, cos, 0.0, y), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    )  # fmt: skip
    known['position'][i] = x, y, 0.0
    cov = known['object_pose_cov'][i]
    cov[:] = 0.0
    cov[:2, :2], cov[:2, 5], cov[5, :2] = found.cov[:2, :2], found.cov[:2, 2], found.cov[2, :2]
    cov[5, 5] = found.cov[2, 2]
    known['position_cov'][i] = cov[:3, :3]
    if found.order > 0:
        known['yaw'][i], known['yaw_std'][i] = yaw, np.sqrt(found.cov[2, 2])


def _judged(
    row: Array, own: Array, found: Found, able: Bools, areas: Array, verdict: Integers
) -> tuple[float, float, float, int]:
    """As `judged_row`: what a recognised object hides, and what is seen and agrees with it."""
    cover, pressure = found.cover, found.pressure
    if compiled.available():
        shares = (COVERED, MUTE, LOUD)
        return judged_row(row, own, cover, pressure, able, areas, *shares, verdict)
    mute = (cover > COVERED * areas) & (row < MUTE * pressure * cover)
    verdict[:] = (cover < 1e-3 * areas) & (row > LOUD * pressure * areas)
    verdict -= mute
    clear = able & (verdict == 0)
    hidden = float(pressure * cover[mute | ~able].sum())
    return hidden, float(row[clear].sum()), float(own[clear].sum()), int(clear.sum())


def _mark(known: Columns, i: int, verdict: Integers) -> None:
    """Say which taxels of row i contradict the recognised object, and that they tell no force."""
    known['taxel_status'][i, verdict < 0] |= int(TaxelStatus.DEAD)
    known['taxel_status'][i, verdict > 0] |= int(TaxelStatus.STUCK)
    if 'taxel_force' in known:
        known['taxel_force'][i, verdict != 0] = np.nan
