"""What recorded touches of any skin leave open: other loads, longer holds, its rest unloaded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, Integers, Report, Signals

KIND = 'not told: '
LIGHT = 1e-3  # of the largest load: less is none


def untold_loads(force: Array) -> Report:
    """Loads beyond those recorded, from told forces of any shape (N); NaN where unknown."""
    known = np.nan_to_num(force)
    known = known[known > LIGHT * known.max(initial=0.0)]
    if not len(known):
        return {f'{KIND}force (no truth of loads)': {}}
    span = {'least': float(known.min()), 'most': float(known.max())}
    return {f'{KIND}loads beyond those recorded (N)': span}


def untold_past(signals: Signals, crept: float) -> Report:
    """What is open of a skin's past, of which a held load leaves a share `crept`; 0: none known.

    Without tare rows before the first touch of a stream, its rest is that of frames between
    touches, in which a skin that creeps has not forgotten: what it crept is then taken for rest,
    or guessed.
    """
    found: Report = {}
    if not _rests_first(signals):
        share = {'share of a load that rests may still hold': crept} if crept > 0 else {}
        found[f'{KIND}rest before any load (no tare rows)'] = share
    if signals.stamp_ns is None:
        found[f'{KIND}creep (frames without stamps)'] = {}
    else:
        found[f'{KIND}holds beyond the longest (s)'] = {'longest': longest_hold(signals)}
    return found


def _rests_first(signals: Signals) -> bool:
    """Whether every stream with a touch is tared before the first of them."""
    if signals.tare is None or not signals.tare.any():
        return False
    begins = np.arange(len(signals.tare)) == 0
    begins |= False if signals.begins is None else signals.begins
    tares = np.cumsum(signals.tare)
    before: Integers = (tares - signals.tare)[begins][np.cumsum(begins) - 1]
    return not ((signals.in_contact == 1) & (tares == before)).any()


def longest_hold(signals: Signals) -> float:
    """Duration of the longest touch (s) of stamped frames; 0: there is none."""
    assert signals.stamp_ns is not None
    touched = signals.in_contact == 1
    first = touched & (~np.roll(touched, 1) | signals.restart)
    first[:1] = touched[:1]
    begun = np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))
    lasted = signals.stamp_ns - signals.stamp_ns[begun]
    return 1e-9 * float(lasted[touched].max(initial=0))
