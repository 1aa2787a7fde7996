"""Answers of the pad that go beyond what its calibration was told, and the flags of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors.magnet_pad.telling import STRAY
from tactile_ros.types import FrameStatus

if TYPE_CHECKING:
    from tactile_ros.signals import Columns
    from tactile_ros.types import Array, Bools, Integers

LOADS = 0.1  # logarithm of loads beyond those recorded that may be chance
FIELDS = 3.0  # times the usual, of a component of a stray field


def span_of(touches: Array) -> tuple[float, float]:
    """Sizes of forces (N), least and largest, of touches (s, 5) of `PadInversion.touches_`."""
    size = np.exp(touches[:, 2]) * np.sqrt(1 + (touches[:, 3:] ** 2).sum(axis=1))
    return float(size.min()), float(size.max())


def flags(known: Columns, touched: Bools, span: tuple[float, float] | None) -> Integers:
    """Bits of `FrameStatus` (s,) of answers that go beyond what can be believed.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Answers.
    touched : ndarray of bool, shape (s,)
        Rows that may be touched.
    span : tuple of float, or None
        Least and largest force that was recorded (N); None: there is none.
    """
    status = np.zeros(len(touched), np.int64)
    if span is not None and 'force' in known:
        size = np.linalg.norm(np.asarray(known['force'], np.float64), axis=1)
        margin = np.exp(LOADS)
        beyond = touched & ((size < span[0] / margin) | (size > span[1] * margin))
        status |= beyond * np.int64(FrameStatus.OUT_OF_RANGE)
    if 'stray_field' in known:
        field = np.abs(np.asarray(known['stray_field'], np.float64)).max(axis=1)
        status |= (field > FIELDS * STRAY) * np.int64(FrameStatus.STRAY_FIELD)
    return status
