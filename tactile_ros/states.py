"""From estimates to states: what contact and faults allow, and the list of patches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tactile_ros.conditioning.faults import frame_faults, judged_rows
from tactile_ros.conditioning.rest import Rest
from tactile_ros.signals import Columns, Estimation, Signals
from tactile_ros.types import (
    STATE_FIELDS,
    Array,
    Bools,
    Bytes,
    FrameStatus,
    Integers,
    TaxelStatus,
)

MEASURES_OF_NOTHING = frozenset({'force', 'torque', 'taxel_force', 'deformation'})
ALWAYS = frozenset(
    {'stray_field', 'force_cov', 'torque_cov', 'slip', 'slip_probability', 'status'}
)
FORBIDS_USE = int(
    FrameStatus.NOT_CALIBRATED | FrameStatus.BAD_TAXELS | FrameStatus.SATURATED | FrameStatus.STALE
)
NOT_CALIBRATED, NO_BASELINE = int(FrameStatus.NOT_CALIBRATED), int(FrameStatus.NO_BASELINE)
FLAT_NORMAL = np.array([[[0.0, 0.0, 1.0]]])


def apply_contact(known: Columns, contact: npt.NDArray[np.int8], good: Bools) -> None:
    """Blank what unusable and untouched frames cannot tell; forces of the untouched are 0.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; changed in place.
    contact : ndarray, shape (s,)
        1, 0, -1 unknown.
    good : ndarray, shape (s,)
        Rows that may be estimated from.
    """
    untouched = contact == 0
    spoilt, free = np.count_nonzero(good) < len(good), np.count_nonzero(untouched) > 0
    if not (spoilt or free):
        return
    for name in known:
        if name in ('status', 'taxel_status', 'valid'):
            continue
        column, blank = known[name], STATE_FIELDS[name][2]
        if free and name in MEASURES_OF_NOTHING:
            column[untouched] = np.where(np.isnan(column[untouched]), np.nan, 0.0)
        elif free and name not in ALWAYS:
            column[untouched] = blank
        if spoilt:
            column[~good] = blank


def conditioned(
    rest: Rest,
    estimation: Estimation,
    read: tuple[Array, Bytes, Array | None],
    when: tuple[Integers | None, Bools],
    levels: tuple[Array, Array],
    tare: Bools | None = None,
) -> Signals:
    """Frames less their baseline, with what they say about contact.

    Parameters
    ----------
    rest : Rest
        Of the pipeline.
    estimation : Estimation
        Of its sensor.
    read : tuple of ndarray, shapes (s, t, c), (s, t) and (s, t), the last of them or None
        Readings, NaN where unusable (unit of values); bits of `TaxelStatus`; what the chips told
        (degrees Celsius).
    when : tuple of ndarray, shapes (s,), or None, and (s,)
        Stamps; rows before which memory is forgotten.
    levels : tuple of ndarray, shapes (s, t, ...) and (s,)
        Baselines as `Rest.level` has them, and their variance over that of a frame.
    tare : ndarray, shape (s,), or None
        Rows that are known to rest.

    Returns
    -------
    Signals
        Of all frames.
    """
    usable, bits, chips = read
    (base, warmth), doubt = rest.parted(levels[0]), levels[1]
    delta = usable - base if rest.tared else usable
    if warmth is not None and rest.tared:
        delta = delta - estimation.warmed(base, warmth, chips)  # type: ignore[attr-defined]
    good, seen = judged_rows(estimation, bits, delta, base)
    contact = rest.contact(seen, good, tare)
    return Signals(
        usable, delta, base, chips, *when, contact, good,
        doubt=doubt, rest_temperature_c=warmth,
    )  # fmt: skip


def told(estimation: Estimation, signals: Signals) -> Signals:
    """Frames with what the sensor itself says of contact, if it does not show in every channel."""
    contact = getattr(estimation, 'contact', None)
    return signals if contact is None else replace(signals, in_contact=contact(signals))


def add_flags(known: Columns, signals: Signals, bits: Bytes, lacks: int) -> None:
    """Say of every frame what is wrong with it, and whether it may be used for control.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; changed in place. A `status`, `taxel_status` or `valid` of the estimators' own
        is kept beside the rest.
    signals : Signals
        Conditioned frames.
    bits : ndarray, shape (s, t)
        Of `TaxelStatus`.
    lacks : int
        Of `lacking`.
    """
    flags = np.array([lacks], np.int64).repeat(len(bits))
    if 'status' in known:
        flags = flags | known['status'].astype(np.int64)
    if np.count_nonzero(bits):
        flags = flags | frame_faults(bits)
    # good readings without the baseline that they need say nothing: their change is NaN
    seeing, missing = signals.good, np.isnan(signals.delta)
    if np.count_nonzero(missing):
        seeing = seeing & ~missing.any(axis=(1, 2))
        lost = np.isnan(signals.baseline).any(axis=(1, 2))
        flags = flags | lost * np.int64(NO_BASELINE)
    known['in_contact'] = signals.in_contact
    found = known.get('taxel_status')
    known['taxel_status'] = bits if found is None else bits | found.astype(np.uint8)
    known['status'] = flags
    usable = known.get('valid', True)
    known['valid'] = seeing & (flags & FORBIDS_USE == 0) & usable


def lacking(calibrated: bool, tared: bool) -> int:
    """Bits of `FrameStatus` for what a pipeline lacks in all frames."""
    return (0 if calibrated else NOT_CALIBRATED) | (0 if tared else NO_BASELINE)


def add_dead(known: Columns, bits: Bytes, dead: Bools) -> None:
    """Say which taxels (t,) are dead, and that nothing is measured there; `known` is changed."""
    found = known.get('taxel_status', bits).astype(np.uint8)
    known['taxel_status'] = np.asarray(found | dead * np.uint8(TaxelStatus.DEAD), np.uint8)
    for name in ('taxel_force', 'deformation'):
        if name in known:
            known[name][:, dead] = np.nan


def add_patches(known: Columns, number: Integers) -> None:
    """List the one patch that a position or a force speaks of; sensors may bring their own.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; changed in place.
    number : ndarray, shape (s,)
        Id of the patch, -1 where nothing touches.
    """
    if 'contacts_id' in known or not ('position' in known or 'force' in known):
        return
    there = number >= 0
    everywhere = np.count_nonzero(there) == len(there)
    known['contacts_id'] = number[:, None]
    normal = FLAT_NORMAL.repeat(len(number), axis=0)
    known['contacts_normal'] = normal if everywhere else _where(there, normal)
    for name in ('position', 'position_cov', 'force', 'force_cov'):
        if name in known:
            column = known[name][:, None]
            known[f'contacts_{name}'] = column if everywhere else _where(there, column)


def _where(there: Bools, column: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """A column with NaN where nothing is there."""
    shape = (-1,) + (1,) * (column.ndim - 1)
    return np.where(there.reshape(shape), column, np.nan)
