"""Answers of the pad that go beyond what its calibration was told, and the flags of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors.magnet_pad.telling import STRAY
from tactile_ros.types import FrameStatus

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Columns

MARGIN = 1.1  # times the recorded forces: beyond them by chance
FIELDS = 3.0  # times the usual, of a component of a stray field
NOTHING = 0.5  # of how places spread over the pad: as unsure a place tells nothing
OUT_OF_RANGE, STRAY_FIELD = (
    np.int64(bit) for bit in (FrameStatus.OUT_OF_RANGE, FrameStatus.STRAY_FIELD)
)


def span_of(touches: Array) -> tuple[float, float]:
    """Sizes of forces (N), least and largest, of touches (s, 5) of `PadInversion.touches_`."""
    size = np.exp(touches[:, 2]) * np.sqrt(1 + (touches[:, 3:] ** 2).sum(axis=1))
    return float(size.min()), float(size.max())


def flag(known: Columns, touched: Bools, span: tuple[float, float] | None, length: float) -> None:
    """Add `status`, bits of `FrameStatus`, where an answer goes beyond what can be believed.

    Frames that neither a touch nor a field of the usual size explains, and whose place is all
    but unknown, are not `valid`.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Answers; changed in place. `odd` (s,), 1 where nothing explains a reading, is taken out.
    touched : ndarray of bool, shape (s,)
        Rows that may be touched.
    span : tuple of float, or None
        Least and largest force that was recorded (N); None: there is none.
    length : float
        Of the pad (m).
    """
    status = np.zeros(len(touched), np.int64)
    odd = touched & (np.asarray(known.pop('odd', status)) == 1)
    if np.count_nonzero(odd):
        status += odd * STRAY_FIELD
        along = np.asarray(known['position_cov'], np.float64)[:, 0, 0]
        known['valid'] = ~(odd & (along > (NOTHING * length) ** 2 / 12))
    if span is not None and 'force' in known:
        force = np.asarray(known['force'], np.float64)
        square = np.add.reduce(force * force, axis=1)
        least, most = (span[0] / MARGIN) ** 2, (span[1] * MARGIN) ** 2
        status += (touched & ((square < least) | (square > most))) * OUT_OF_RANGE
    if 'stray_field' in known:
        field = np.maximum.reduce(np.abs(known['stray_field']), axis=1)
        status |= (field > FIELDS * STRAY) * STRAY_FIELD
    if np.count_nonzero(status):
        known['status'] = status
