# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Faults of taxels and frames, by the readings and by the sensor's status bits."""

from __future__ import annotations

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Bytes, FrameStatus, Integers, Layout, TaxelStatus

STALE, SATURATED, ERROR, DEAD = (
    np.uint8(TaxelStatus[name]) for name in ('STALE', 'SATURATED', 'ERROR', 'DEAD')
)
# no tare may take a frame with a bad taxel (one that the fit found dead is left out), nor one of
# which no taxel says anything new
DAMAGED, SAYS_NOTHING = int(FrameStatus.BAD_TAXELS), STALE | DEAD
CLIPPED, OLD = int(FrameStatus.SATURATED), int(FrameStatus.STALE)
NOT_CALIBRATED, NO_BASELINE = int(FrameStatus.NOT_CALIBRATED), int(FrameStatus.NO_BASELINE)
FORBIDS_USE = NOT_CALIBRATED | DAMAGED | CLIPPED | OLD
NO_LIMIT = np.empty(0)
UNUSABLE = np.uint8(sum(TaxelStatus) - TaxelStatus.STALE)  # all but that


def taxel_faults(values: Array, status: Bytes | None, layout: Layout) -> Bytes:
    """Status bits (s, t) of the sensor, with what the raw readings (s, t, c) themselves show.

    ERROR where a reading is not finite, SATURATED where one reached the layout's limit, DEAD where
    a chip of several axes reads a field of exactly 0, from which noise keeps one that lives.
    """
    bits = np.zeros(values.shape[:2], np.uint8) if status is None else np.array(status, np.uint8)
    limit = NO_LIMIT if layout.saturation is None else layout.saturation
    axes = layout.unit == 'T' and values.shape[-1] > 1
    _fault_rows(np.ascontiguousarray(values), limit, axes, bits)
    return bits


@compiled
def _fault_rows(values: Array, limit: Array, axes: bool, bits: Bytes) -> None:
    """Add what readings show to bits; chips of several `axes` that read 0 are dead."""
    for s in range(values.shape[0]):
        for t in range(values.shape[1]):
            silent = axes
            for c in range(values.shape[2]):
                size = abs(values[s, t, c])
                silent &= size == 0.0
                if not np.isfinite(size):
                    bits[s, t] |= ERROR
                if limit.size > 0 and size >= limit[c]:
                    bits[s, t] |= SATURATED
            if silent:
                bits[s, t] |= DEAD


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


@compiled
def frame_status(
    bits: Bytes, delta: Array, baseline: Array, flags: Integers, valid: Bools
) -> None:
    """Add to flags (s,) of frames what bits (s, t) and changes (s, t, c) show; some are not valid.

    One STALE taxel makes the frame STALE: one that gets stuck is STALE before it is known as
    STUCK. Good readings without the baseline that they need say nothing: their change is NaN.
    """
    for s in range(len(bits)):
        unknown = lost = False
        for t in range(bits.shape[1]):
            if bits[s, t] & UNUSABLE:
                flags[s] |= DAMAGED
            if bits[s, t] & SATURATED:
                flags[s] |= CLIPPED
            if bits[s, t] & STALE:
                flags[s] |= OLD
            for c in range(delta.shape[2]):
                unknown |= np.isnan(delta[s, t, c])
                lost |= np.isnan(baseline[s, t, c])
        if unknown and lost:
            flags[s] |= NO_BASELINE
        valid[s] &= not unknown and flags[s] & FORBIDS_USE == 0


def usable_rows(bits: Bytes) -> Bools:
    """Frames (s,) of which every taxel (s, t) may be used."""
    if not np.count_nonzero(bits):
        return ~np.zeros(len(bits), bool)  # a third of the price of np.ones
    return np.asarray(~(bits & UNUSABLE).any(axis=1))
