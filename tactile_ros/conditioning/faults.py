"""What the readings and the sensor's status bits say about taxels, and about the frame."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Bytes, FrameStatus, Integers, TaxelStatus

UNUSABLE = np.uint8(
    TaxelStatus.SATURATED
    | TaxelStatus.STUCK
    | TaxelStatus.ERROR
    | TaxelStatus.WRAPPED
    | TaxelStatus.DEAD
)


def taxel_faults(values: Array, status: Bytes | None, limit: Array) -> Bytes:
    """Status bits of the sensor, with what the readings themselves show.

    Parameters
    ----------
    values : ndarray, shape (s, t, c)
        Raw readings (unit of values).
    status : ndarray, shape (s, t), or None
        Bits of `TaxelStatus` from the sensor.
    limit : ndarray, shape (c,)
        Magnitude at which a channel clips; inf: never.

    Returns
    -------
    ndarray, shape (s, t)
        ERROR is added where a reading is not finite, SATURATED where one reached its limit.
    """
    with np.errstate(invalid='ignore'):
        clipped = (np.abs(values) >= limit).any(axis=-1)
    lost = ~np.isfinite(values).all(axis=-1)
    bits = clipped * np.uint8(TaxelStatus.SATURATED) | lost * np.uint8(TaxelStatus.ERROR)
    return np.asarray(bits if status is None else bits | status, np.uint8)


def without_faults(values: Array, bits: Bytes) -> Array:
    """Readings (s, t, c) with NaN at taxels that must not be used."""
    unusable = (bits & UNUSABLE) > 0
    if not unusable.any():
        return values
    return np.asarray(np.where(unusable[..., None], np.nan, values))


def frame_faults(bits: Bytes) -> Integers:
    """Bits of `FrameStatus` (s,) that follow from the bits of taxels (s, t)."""
    flags = np.zeros(len(bits), np.int64)
    if bits.any():
        flags |= np.where((bits & UNUSABLE).any(axis=1), FrameStatus.BAD_TAXELS, 0)
        clipped = (bits & TaxelStatus.SATURATED).any(axis=1)
        flags |= np.where(clipped, FrameStatus.SATURATED, 0)
        stale = (bits & TaxelStatus.STALE).all(axis=1)
        flags |= np.where(stale, FrameStatus.STALE, 0)
    return flags
