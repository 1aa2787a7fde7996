"""The patches of an array as contacts: what lies where, how hard, and since when.

One patch alone is the contact of the state: it has its position and its force, unless an object
was recognised, whose origin need not be pressed. Of several, each has its own centre of pressure
and the sum of its taxels; the state's position is that of the strongest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.patch_ids import PatchIds
from tactile_ros.estimators.patches import PatchFinder
from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from tactile_ros.conditioning.equilibration import Equilibration
    from tactile_ros.estimators.patches import Patches
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Bools, Columns, Integers, Signals

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
        self,
        config: TaxelArrayConfig,
        noise: Array,
        law: Equilibration | None,
        floor: float,
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
        self,
        known: Columns,
        load: Array,
        variance: Array,
        signals: Signals,
        ids: PatchIds,
        shared: Array | None,
        centred: bool,
    ) -> None:
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
