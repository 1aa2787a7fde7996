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
    from tactile_ros.signals import Columns, Signals
    from tactile_ros.types import Array, Bools, Integers

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

    def add(
        self,
        known: Columns,
        load: Array,
        variance: Array,
        signals: Signals,
        ids: PatchIds,
        measured: tuple[bool, bool],
    ) -> None:
        """List the patches of every row.

        Parameters
        ----------
        known : dict of str to ndarray, shape (s, ...)
            Estimates; changed in place.
        load, variance : ndarray, shape (s, t)
            Of each taxel: force (N), or output where no law is known; NaN: unknown.
        signals : Signals
            Conditioned frames.
        ids : PatchIds
            Of the stream; moves on.
        measured : tuple of bool
            Loads are forces; the state's position is the centre of them.
        """
        touched = (load > self.least) & (signals.good & (signals.in_contact != 0))[:, None]
        if 'label' in known and 'taxel_status' in known:
            bits = np.asarray(known['taxel_status'], np.uint8)
            touched &= (bits & np.uint8(TaxelStatus.STUCK)) == 0
        found = self.finder.find(np.nan_to_num(load), variance, touched)
        number = _numbered(found, signals, ids)
        known['contacts_id'] = number
        normal = np.full((*found.load.shape, 3), np.nan)
        normal[number >= 0] = 0.0, 0.0, 1.0
        known['contacts_normal'] = normal
        known['contacts_position'] = found.position
        known['contacts_position_cov'] = found.position_cov
        _share_force(known, found, measured[0])
        _agree(known, found, measured[1])


def _numbered(found: Patches, signals: Signals, ids: PatchIds) -> Integers:
    """Ids (s, k); those of independent frames begin with 0 in each."""
    if signals.stamp_ns is None:
        rank = np.arange(found.load.shape[1])
        return np.where(rank < found.count[:, None], rank, -1)
    return ids.number(
        found.label, found.count, found.position, signals.good, signals.restart, signals.begins
    )


def _share_force(known: Columns, found: Patches, measured: bool) -> None:
    """Normal force of every patch: what its taxels bear, or its share of a force that is told."""
    force = np.full((*found.load.shape, 3), np.nan)
    cov = np.full((*force.shape, 3), np.nan)
    told = np.asarray(known['force'], np.float64) if 'force' in known else None
    if measured:
        force[..., 2], cov[..., 2, 2] = found.load, found.variance
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
        return
    place = np.asarray(known['position'])
    label = np.asarray(known.get('label', np.full(len(place), -1)), np.int64)
    lying = label >= 0
    second = found.load[:, 1] if found.load.shape[1] > 1 else np.zeros(len(place))
    several = (found.count > 1) & (np.nan_to_num(second) > SECOND * found.load[:, 0])
    told = np.isfinite(place).any(axis=1)
    ask = (found.count > 0) & ~lying & told & (centred | several)
    unseen = np.where(np.isnan(place[ask]), np.nan, 0.0)
    known['position'][ask] = found.position[ask, 0] + unseen
    blind = unseen[:, :, None] + unseen[:, None]
    known['position_cov'][ask] = found.position_cov[ask, 0] + blind
    own = (found.count > 0) & ~lying & told & ~ask & (found.count == 1)
    known['contacts_position'][own, 0] = place[own]
    known['contacts_position_cov'][own, 0] = known['position_cov'][own]
