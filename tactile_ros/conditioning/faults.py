"""What the readings and the sensor's status bits say about taxels, and about the frame."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tactile_ros.types import (
    Array,
    Bools,
    Bytes,
    Frame,
    FrameStatus,
    Integers,
    Layout,
    Recording,
    TaxelStatus,
)

# no tare may take a frame with a bad taxel (one that the fit found dead is left out), nor one of
# which no taxel says anything new
DAMAGED = int(FrameStatus.BAD_TAXELS)
SAYS_NOTHING = np.uint8(TaxelStatus.STALE | TaxelStatus.DEAD)
Number = TypeVar('Number', bound=np.generic)

UNUSABLE = np.uint8(
    TaxelStatus.SATURATED
    | TaxelStatus.STUCK
    | TaxelStatus.ERROR
    | TaxelStatus.WRAPPED
    | TaxelStatus.DEAD
)


def taxel_faults(values: Array, status: Bytes | None, layout: Layout) -> Bytes:
    """Status bits of the sensor, with what the readings themselves show.

    Parameters
    ----------
    values : ndarray, shape (s, t, c)
        Raw readings (unit of values).
    status : ndarray, shape (s, t), or None
        Bits of `TaxelStatus` from the sensor.
    layout : Layout
        Unit of the channels, and the magnitude at which each clips.

    Returns
    -------
    ndarray, shape (s, t)
        ERROR is added where a reading is not finite, SATURATED where one reached its limit, DEAD
        where a chip of several axes reads a field of exactly 0 and others do not: noise keeps a
        chip that lives from that.
    """
    size = np.abs(values)
    limit = np.inf if layout.saturation is None else layout.saturation
    axes = layout.unit == 'T' and values.shape[-1] > 1
    # false for NaN too, so that the common case costs a pass or two
    if np.count_nonzero(size < limit) == size.size and not (
        axes and np.count_nonzero(size) < size.size
    ):
        clean = np.zeros(values.shape[:2], np.uint8)
        return clean if status is None else status
    clipped = (size >= limit).any(axis=-1)
    lost = ~np.isfinite(values).all(axis=-1)
    bits = clipped * np.uint8(TaxelStatus.SATURATED) | lost * np.uint8(TaxelStatus.ERROR)
    if axes:
        silent = (size == 0).all(axis=-1)
        silent &= ~silent.all(axis=-1, keepdims=True)
        bits = bits | silent * np.uint8(TaxelStatus.DEAD)
    return np.asarray(bits if status is None else bits | status, np.uint8)


def refused_readings(estimation: object, values: Array, bits: Bytes) -> tuple[Array, Bytes]:
    """Readings (s, t, c), NaN with ERROR where the sensor says that they cannot be.

    Its `impossible(values)`, where it has one, says so of every taxel (s, t).
    """
    asked = getattr(estimation, 'impossible', None)
    wrong = None if asked is None else asked(values)
    if wrong is None or not np.count_nonzero(wrong):
        return values, bits
    bits = np.asarray(bits | wrong * np.uint8(TaxelStatus.ERROR), np.uint8)
    return np.where(wrong[..., None], np.nan, values), bits


def usable_readings(
    estimation: object, recording: Recording, layout: Layout
) -> tuple[Array, Bytes]:
    """Readings (s, t, c) of a recording, NaN where they must not be used, and why (s, t)."""
    bits = taxel_faults(recording.values, recording.status, layout)
    return refused_readings(estimation, without_faults(recording.values, bits), bits)


def without_faults(values: Array, bits: Bytes) -> Array:
    """Readings (s, t, c) with NaN at taxels that must not be used."""
    if not np.count_nonzero(bits):
        return values
    unusable = (bits & UNUSABLE) > 0
    return np.asarray(np.where(unusable[..., None], np.nan, values))


def dead_throughout(bits: Bytes) -> Bools | None:
    """Taxels (t,) that no row (s, t) could use; None if there is none, or no other."""
    dead: Bools = np.all((bits & UNUSABLE) > 0, axis=0)
    return dead if dead.any() and not dead.all() else None


def set_aside(values: Array, bits: Bytes, dead: Bools | None) -> tuple[Array, Bytes]:
    """Readings (s, t, c) with 0 and bits (s, t) without a fault at taxels (t,) known as dead."""
    if dead is None:
        return values, bits
    return np.where(dead[:, None], 0.0, values), np.where(dead, np.uint8(0), bits)


def frame_faults(bits: Bytes) -> Integers:
    """Bits of `FrameStatus` (s,) that follow from the bits of taxels (s, t).

    One STALE taxel makes the frame STALE, which is estimated but not valid: a taxel that gets
    stuck is STALE before it can be known as STUCK.
    """
    spoilt = (bits & UNUSABLE).any(axis=1) * np.int64(FrameStatus.BAD_TAXELS)
    clipped = (bits & TaxelStatus.SATURATED).any(axis=1) * np.int64(FrameStatus.SATURATED)
    stale = (bits & TaxelStatus.STALE).any(axis=1) * np.int64(FrameStatus.STALE)
    return np.asarray(spoilt | clipped | stale)


def usable_rows(bits: Bytes) -> Bools:
    """Frames (s,) of which every taxel (s, t) may be used."""
    if not np.count_nonzero(bits):
        return ~np.zeros(len(bits), bool)  # a third of the price of np.ones
    return np.asarray(~(bits & UNUSABLE).any(axis=1))


def judged_rows(estimation: object, bits: Bytes, delta: Array, base: Array) -> tuple[Bools, Array]:
    """Frames that may be estimated from, and the deviations that tell contact.

    Parameters
    ----------
    estimation : object
        Its `sees_enough(bits)`, where it has one, says which frames (s,) tell enough without
        their faulty taxels; else every taxel is needed.
    bits : ndarray, shape (s, t)
        Of `TaxelStatus`.
    delta, base : ndarray, shape (s, t, c)
        Deviations from the baseline, and the baseline (unit of values); NaN: unknown.

    Returns
    -------
    good : ndarray, shape (s,)
        Whether to estimate.
    told : ndarray, shape (s, t, c)
        Deviations; 0 of a taxel that was not read and need not be.
    """
    enough = getattr(estimation, 'sees_enough', None)
    if enough is None or not np.count_nonzero(bits):
        return usable_rows(bits), delta
    return enough(bits), np.where(np.isnan(delta) & np.isfinite(base), 0.0, delta)


def frame_readings(
    frame: Frame, layout: Layout, estimation: object = None
) -> tuple[Array, Bytes, Array | None]:
    """What a frame says, as a batch of one.

    Parameters
    ----------
    frame : Frame
        Of t taxels and c channels.
    layout : Layout
        As in `taxel_faults`.
    estimation : object
        As in `refused_readings`.

    Returns
    -------
    values : ndarray, shape (1, t, c)
        Readings (unit of values), NaN at taxels that must not be used.
    bits : ndarray, shape (1, t)
        Of `taxel_faults`.
    temperature_c : ndarray, shape (1, t), or None
        What the chips report.

    Raises
    ------
    ValueError
        If status or temperatures are not one per taxel.
    """
    values = np.asarray(frame.values, np.float64)[None]
    status = _row('status', frame.status, values.shape[1], np.uint8)
    chips = _row('temperature_c', frame.temperature_c, values.shape[1], np.float64)
    bits = taxel_faults(values, status, layout)
    return *refused_readings(estimation, without_faults(values, bits), bits), chips


def _row(
    name: str, value: npt.ArrayLike | None, taxels: int, dtype: type[Number]
) -> npt.NDArray[Number] | None:
    """A column of one frame, shape (1, t), None where it has none."""
    if value is None:
        return None
    row = np.array(value, dtype)  # a copy: the state keeps it
    if row.shape != (taxels,):
        msg = f'{name} of Frame must have shape ({taxels},); received {row.shape}'
        raise ValueError(msg)
    return row[None]
