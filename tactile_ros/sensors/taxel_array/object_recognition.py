"""Patches, surface and objects on the taxels, from forces: [4] Eqs. (3) and (4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.contact import PatchIds
from tactile_ros.estimators.contact_patches import PatchFinder
from tactile_ros.sensors.taxel_array.force_errors import judged_row
from tactile_ros.types import Array, Bools, FrameStatus, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.conditioning.equilibration import Equilibration
    from tactile_ros.estimators.contact_patches import Patches
    from tactile_ros.estimators.object_pose import Found, ObjectPose
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Bools, Columns, ContactState, Integers, Signals

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
    known: Columns, objects: ObjectPose, forces: Array, noise: Array, spread: Array, asked: Bools,
    usable: Bools, summed: tuple[Array, Array] | None,
    corrected: Callable[[int, Array], Array] | None = None,
) -> None:  # fmt: skip
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
    known: Columns, i: int, row: Array, found: Found, able: Bools, areas: Array,
    summed: tuple[Array, Array] | None, changed: bool,
) -> None:  # fmt: skip
    """Total force of row i with what its object hides, and taxels that contradict the object."""
    verdict = np.empty(len(row), np.int64)
    own = row if summed is None else summed[0][i]
    hidden, seen, variance, count = judged_row(
        row, own, found.cover, found.pressure, able, areas, COVERED, MUTE, LOUD, verdict
    )
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


def _mark(known: Columns, i: int, verdict: Integers) -> None:
    """Say which taxels of row i contradict the recognised object, and that they tell no force."""
    known['taxel_status'][i, verdict < 0] |= int(TaxelStatus.DEAD)
    known['taxel_status'][i, verdict > 0] |= int(TaxelStatus.STUCK)
    if 'taxel_force' in known:
        known['taxel_force'][i, verdict != 0] = np.nan


FAINT = 0.5  # of what counts as touched: enough where the frame as a whole is touched
LIGHT = 3.0  # constant errors of a taxel: less is no load
SIGMAS = 6.0  # of the noise: more is touched, though the baseline is of few frames
FASTEST = 2.0  # taxels that a patch may jump from one frame to the next
SECOND = 0.2  # of the strongest patch: from there on regressors of single touches are not asked


def ids_of(config: TaxelArrayConfig) -> PatchIds:
    """Ids of the patches of a new stream."""
    return PatchIds(FASTEST * float(np.sqrt(np.median(config.areas))))


class ArrayPatches:
    """Patches of one array.

    Parameters
    ----------
    config : TaxelArrayConfig
        Of the array.
    noise : ndarray, shape (t,)
        Of outputs at rest (fraction).
    law : Equilibration or None
        Forces of outputs; None: loads are outputs.
    floor : float
        Constant part of the error of a taxel's force (N).
    """

    def __init__(
        self, config: TaxelArrayConfig, noise: Array, law: Equilibration | None, floor: float
    ) -> None:
        self.finder = PatchFinder(config.positions, config.areas, config.most_contacts)
        # a few frames of rest of one taxel say little: none is quieter than most
        least = SIGMAS * np.maximum(noise, np.median(noise))
        if law is not None:
            least = np.maximum(law.forces(least[None])[0], LIGHT * floor)
            least = np.where(np.isfinite(least), least, np.nanmedian(least))
        self.least = least
        most = config.most_contacts
        there = np.arange(most) < np.arange(most + 1)[:, None]
        self.ranks: Integers = np.where(there, np.arange(most), -1)
        self.normals: Array = np.where(there[..., None], np.array([0.0, 0.0, 1.0]), np.nan)

    def add(
        self, known: Columns, load: Array, variance: Array, signals: Signals, ids: PatchIds,
        shared: Array | None, centred: bool,
    ) -> None:  # fmt: skip
        """List the patches of every row.

        Parameters
        ----------
        known : dict of str to ndarray, shape (s, ...)
            Estimates; changed in place.
        load, variance : ndarray, shape (s, t)
            Of each taxel: force (N), or output where no law is known; no NaN.
        signals : Signals
            Conditioned frames.
        ids : PatchIds
            Of the stream; moves on.
        shared : ndarray, shape (s,), or None
            Part by which the loads of a row err alike; None: loads are no forces.
        centred : bool
            The state's position is the centre of them.
        """
        touched = load > self.least
        asked = signals.good & (signals.in_contact != 0)
        touched &= asked[:, None]
        if 'label' in known and 'taxel_status' in known:
            bits = np.asarray(known['taxel_status'], np.uint8)
            touched &= (bits & np.uint8(TaxelStatus.STUCK)) == 0
        lone = np.flatnonzero(asked & ~touched.any(axis=1))
        if len(lone):  # something touches, and no taxel much: the most loaded one
            most = (load[lone] / self.least).argmax(axis=1)
            touched[lone, most] = load[lone, most] > FAINT * self.least[most]
        found = self.finder.find(load, variance, touched)
        if signals.stamp_ns is None:
            number = self.ranks[found.count]
        else:
            number = ids.number(
                found.label, found.count, found.position, signals.good, signals.restart,
                signals.begins,
            )  # fmt: skip
        known['contacts_id'] = number
        known['contacts_normal'] = self.normals[found.count]
        known['contacts_position'] = found.position
        known['contacts_position_cov'] = found.position_cov
        _share_force(known, found, shared)
        _agree(known, found, centred)


def add_sum(known: Columns, load: Array, variance: Array, shared: Array) -> None:
    """Total force with its covariance, of it a part that taxels share; `known` is changed."""
    if 'force' not in known:
        known['force'] = np.full((len(load), 3), np.nan)
        known['force_cov'] = np.full((len(load), 3, 3), np.nan)
    total = load.sum(axis=1)
    known['force'][:, 2] = total
    known['force_cov'][:, 2, 2] = variance.sum(axis=1) + np.square(shared * total)


def _share_force(known: Columns, found: Patches, shared: Array | None) -> None:
    """Normal force of every patch: what its taxels bear, or its share of a force that is told."""
    blank = np.empty((12, *found.load.shape))
    blank.fill(np.nan)
    force = blank[:3].reshape(*found.load.shape, 3)
    cov = blank[3:].reshape(*found.load.shape, 3, 3)
    told = np.asarray(known['force'], np.float64) if 'force' in known else None
    if shared is not None:  # loads are forces
        force[..., 2] = found.load
        cov[..., 2, 2] = found.variance + np.square(shared[:, None] * found.load)
    elif told is not None:
        share = found.load / np.nansum(found.load, axis=1, keepdims=True).clip(1e-300)
        force[..., 2] = share * told[:, 2:]
        own = np.asarray(known['force_cov'], np.float64)[:, 2, 2]
        cov[..., 2, 2] = share * own[:, None] + np.square((1 - share) * force[..., 2])
    if told is not None:
        alone: Bools = (found.count == 1) & np.isfinite(told[:, 2])
        force[alone, 0], cov[alone, 0] = told[alone], known['force_cov'][alone]
    known['contacts_force'], known['contacts_force_cov'] = force, cov


def _agree(known: Columns, found: Patches, centred: bool) -> None:
    """Let the strongest patch and the state's position say the same where no object does."""
    if 'position' not in known:
        if not centred:
            return
        known['position'], known['position_cov'] = (
            found.position[:, 0].copy(), found.position_cov[:, 0].copy()
        )  # fmt: skip
        return
    place, there = np.asarray(known['position']), found.count > 0
    free = there
    if 'label' in known:
        free = there & (np.asarray(known['label'], np.int64) < 0)
    if not np.count_nonzero(free):
        return
    if centred:
        known['position'][free] = found.position[free, 0]
        known['position_cov'][free] = found.position_cov[free, 0]
        return
    told = free & np.isfinite(place).any(axis=1)
    own = told & (found.count == 1)
    known['contacts_position'][own, 0] = place[own]
    known['contacts_position_cov'][own, 0] = known['position_cov'][own]
    second = found.load[:, 1] if found.load.shape[1] > 1 else np.zeros(len(place))
    several = told & (found.count > 1) & (np.nan_to_num(second) > SECOND * found.load[:, 0])
    # components that regressors never learned stay unknown
    unseen = np.where(np.isnan(place[several]), np.nan, 0.0)
    known['position'][several] = found.position[several, 0] + unseen
    known['position_cov'][several] = (
        found.position_cov[several, 0] + unseen[:, :, None] + unseen[:, None]
    )


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
