# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Objects and patches of contact in the columns of a state, from the forces of the taxels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactile_ros.conditioning.contact import PatchIds
from tactile_ros.conditioning.equilibration import Equilibration
from tactile_ros.estimators.contact_patches import Patches, PatchFinder
from tactile_ros.estimators.covariance import scaled
from tactile_ros.estimators.object_pose import Found, ObjectPose
from tactile_ros.physics.coverage import area_share
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
from tactile_ros.types import Array, Bools, Columns, FrameStatus, Signals, TaxelStatus

UNCORRECTED = 0.25  # error of a taxel's force before it is known how much of it is pressed
ROUNDS = 2  # of correction
COVERED, MUTE, LOUD = 0.7, 0.15, 0.25  # of a taxel, and of the expected force
FASTEST = 2.0  # taxels that a patch may jump from one frame to the next
FAINT = 0.5  # of what counts as touched: enough where the frame as a whole is touched
PRESSED = 0.05  # of a taxel: of less the area law says nothing
SECOND = 0.2  # of the strongest patch: from there on regressors of single touches are not asked
SHAPES: dict[str, tuple[int, ...]] = {
    'label_probability': (), 'yaw': (), 'yaw_std': (), 'object_pose': (4, 4),
    'object_pose_cov': (6, 6), 'position': (3,), 'position_cov': (3, 3),
}  # fmt: skip


def place_objects(
    columns: Columns, objects: ObjectPose, forces: Array, noise: Array, spread: Array,
    asked: Bools, usable: Bools, corrected: Callable[[int, Array], Array] | None,
) -> None:  # fmt: skip
    """Add label, pose, position and bad taxels of every asked row (s,) to `columns`.

    Taxels have forces (s, t), NaN where not read, of a `noise` (t,) at rest and a relative error
    `spread` (s, t); those not `usable` (t,) are dead. `corrected` gives the forces (t,) of a row
    once it is known how much of each taxel is covered (t,) (m2).
    """
    samples = len(forces)
    for name, shape in SHAPES.items():
        if name not in columns or not name.startswith('position'):
            columns[name] = np.full((samples, *shape), np.nan)
    columns['label'], columns['symmetry'] = np.full((2, samples), -1)
    columns['status'] = np.zeros(samples, np.int64)
    columns.setdefault('taxel_status', np.zeros(forces.shape, np.uint8))
    for i in np.flatnonzero(asked):
        row = forces[i]
        able = usable & np.isfinite(row)
        first = spread[i] if corrected is None else np.maximum(spread[i], UNCORRECTED)
        found = objects.locate(np.nan_to_num(row), noise, able, first)
        for _ in range(ROUNDS if corrected is not None and found.label >= 0 else 0):
            assert corrected is not None
            row = corrected(int(i), found.cover)
            better = objects.locate(np.nan_to_num(row), noise, able, spread[i])
            if better.label < 0:
                break
            found = better
            columns['taxel_force'][i] = row
        if found.label < 0:
            columns['status'][i] = int(FrameStatus.ABSTAINED)
            continue
        _write(columns, int(i), found)
        _weigh(columns, int(i), row, found, able, objects.areas, corrected is not None)


def _write(columns: Columns, i: int, found: Found) -> None:
    """Write the object of row i."""
    x, y, yaw = found.pose
    columns['label'][i], columns['label_probability'][i] = found.label, found.probability
    columns['symmetry'][i] = found.order
    columns['object_pose'][i] = np.eye(4)
    cos, sin = np.cos(yaw), np.sin(yaw)
    columns['object_pose'][i, :2, :2] = (cos, -sin), (sin, cos)
    columns['object_pose'][i, :2, 3] = x, y
    columns['position'][i] = x, y, 0.0
    cov, plane = np.zeros((6, 6)), np.array([0, 1, 5])
    cov[plane[:, None], plane] = found.cov
    columns['object_pose_cov'][i], columns['position_cov'][i] = cov, cov[:3, :3]
    if found.order > 0:
        columns['yaw'][i], columns['yaw_std'][i] = yaw, np.sqrt(found.cov[2, 2])


def _weigh(
    columns: Columns, i: int, row: Array, found: Found, able: Bools, areas: Array, changed: bool
) -> None:
    """Mark taxels that contradict the object of row i; add the forces that it hides."""
    full = found.pressure * found.cover
    mute = able & (found.cover > COVERED * areas) & (row < MUTE * full)
    loud = able & (found.cover < 1e-3 * areas) & (row > LOUD * found.pressure * areas)
    columns['taxel_status'][i, mute] |= np.uint8(TaxelStatus.DEAD)
    columns['taxel_status'][i, loud] |= np.uint8(TaxelStatus.STUCK)
    if 'taxel_force' not in columns:
        return
    columns['taxel_force'][i, mute | loud] = np.nan
    lost = mute | ~able
    if 'force' in columns and (changed or lost.any() or loud.any()):
        seen = float(row[able & ~mute & ~loud].sum())
        hidden = max(float(found.expected[lost].sum()), 0.0)
        columns['force'][i, 2] = seen + hidden
        # the error of the pressure is that of the forces which tell it
        grown = (seen + hidden) / seen if seen > 0 else 1.0
        columns['force_cov'][i] = scaled(columns['force_cov'][i], np.array([1.0, 1.0, grown]))


class ArrayPatches:
    """Patches of one array, of taxels that bear more than `least` (t,)."""

    def __init__(self, config: TaxelArrayConfig, least: Array) -> None:
        self.finder = PatchFinder(config.positions, config.areas, config.most_contacts)
        self.least = least

    @staticmethod
    def ids(config: TaxelArrayConfig) -> PatchIds:
        """Ids of the patches of a new stream."""
        return PatchIds(FASTEST * float(np.sqrt(np.median(config.areas))))

    def add(
        self, columns: Columns, load: Array, variance: Array, signals: Signals, ids: PatchIds,
        shared: Array | None, centred: bool,
    ) -> None:  # fmt: skip
        """List the patches of every row in `columns`; `ids` of the stream move on.

        Loads (s, t) without NaN are forces (N) that err alike by the part `shared` (s,) of each
        row, or outputs where that is None. `centred`: the state's position is that of the patches.
        """
        asked = signals.good & (signals.in_contact != 0)
        touched = (load > self.least) & asked[:, None]
        if 'label' in columns and 'taxel_status' in columns:
            bits = np.asarray(columns['taxel_status'], np.uint8)
            touched &= (bits & np.uint8(TaxelStatus.STUCK)) == 0
        lone = np.flatnonzero(asked & ~touched.any(axis=1))
        if len(lone):  # the most loaded one, where the frame as a whole is touched
            most = (load[lone] / self.least).argmax(axis=1)
            touched[lone, most] = load[lone, most] > FAINT * self.least[most]
        found = self.finder.find(load, variance, touched)
        there = np.arange(found.load.shape[1]) < found.count[:, None]
        if signals.stamp_ns is None:
            columns['contacts_id'] = np.where(there, np.arange(there.shape[1]), -1)
        else:
            columns['contacts_id'] = ids.number(
                found.label, found.count, found.position, signals.good, signals.restart,
                signals.begins,
            )  # fmt: skip
        columns['contacts_normal'] = np.where(there[..., None], (0.0, 0.0, 1.0), np.nan)
        columns['contacts_position'] = found.position
        columns['contacts_position_cov'] = found.position_cov
        _share_force(columns, found, shared)
        _agree(columns, found, centred)


def _share_force(columns: Columns, found: Patches, shared: Array | None) -> None:
    """Normal force of every patch: the sum of its taxels, or its share of a regressed force."""
    force = np.full((*found.load.shape, 3), np.nan)
    cov = np.full((*force.shape, 3), np.nan)
    whole = columns.get('force')
    if shared is not None:  # loads are forces
        force[..., 2] = found.load
        cov[..., 2, 2] = found.variance + np.square(shared[:, None] * found.load)
    elif whole is not None:
        share = found.load / np.nansum(found.load, axis=1, keepdims=True).clip(1e-300)
        force[..., 2] = share * whole[:, 2:]
        own = columns['force_cov'][:, 2, 2]
        cov[..., 2, 2] = share * own[:, None] + np.square((1 - share) * force[..., 2])
    if whole is not None:
        alone = (found.count == 1) & np.isfinite(whole[:, 2])
        force[alone, 0], cov[alone, 0] = whole[alone], columns['force_cov'][alone]
    columns['contacts_force'], columns['contacts_force_cov'] = force, cov


def _agree(columns: Columns, found: Patches, centred: bool) -> None:
    """Let the strongest patch and the state's position say the same where no object does."""
    free = found.count > 0
    if 'position' not in columns:
        if centred:
            columns['position'] = found.position[:, 0].copy()
            columns['position_cov'] = found.position_cov[:, 0].copy()
        return
    if 'label' in columns:
        free = free & (np.asarray(columns['label'], np.int64) < 0)
    if 'yaw' in columns:  # what is turned is an object, of one patch or of several
        free = free & np.isnan(columns['yaw'])
    position, cov = columns['position'], columns['position_cov']
    if centred:
        position[free], cov[free] = found.position[free, 0], found.position_cov[free, 0]
        return
    seen = free & np.isfinite(position).any(axis=1)
    own = seen & (found.count == 1)
    columns['contacts_position'][own, 0] = position[own]
    columns['contacts_position_cov'][own, 0] = cov[own]
    second = found.load[:, 1] if found.load.shape[1] > 1 else np.zeros(len(free))
    several = seen & (found.count > 1) & (np.nan_to_num(second) > SECOND * found.load[:, 0])
    # components that regressors never learned stay unknown
    blank = np.where(np.isnan(position[several]), np.nan, 0.0)
    position[several] = found.position[several, 0] + blank
    cov[several] = found.position_cov[several, 0] + blank[:, :, None] + blank[:, None]


def partly_pressed(
    law: Equilibration, output: Array, force: Array, cover: Array, areas: Array, area_law: Array
) -> Array:
    """Forces (t,) of taxels of which an object covers a part (N), by [4] Eq. (2).

    The law gives forces of outputs (t,) of taxels that are wholly pressed; `force` (t,) is that
    with creep undone, `cover` and `areas` (t,) are covered and whole (m2).
    """
    plain = law.forces(output[None])[0]
    partly = (cover > PRESSED * areas) & (plain > 0)
    whole = law.forces((output / area_share(cover, areas, area_law))[None])[0]
    ratio = whole / np.where(partly, plain, 1.0)
    return np.asarray(np.where(partly, force * ratio, force))
