"""What recorded loads do not tell of an array: taxels, loads, holds, its rest, its give.

Forces larger than any that was told are flagged here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.beyond_told import BEYOND
from tactile_ros.regression.untold import KIND, untold_loads, untold_past
from tactile_ros.types import FrameStatus

if TYPE_CHECKING:
    from tactile_ros.conditioning.viscoelastic import Creep
    from tactile_ros.types import Array, Bools, Columns, Report, Signals

FEWEST_ROWS = 5  # of a taxel


def told(truth: Columns, name: str, good: Bools) -> Array | None:
    """Truth of the taxels in usable rows (s,); None where it is too little."""
    if name not in truth:
        return None
    known = np.asarray(truth[name], np.float64)[good]
    return known if (np.isfinite(known).sum(axis=0) >= FEWEST_ROWS).any() else None


def untold(signals: Signals, truth: Columns, silent: Bools, creep: Creep | None) -> Report:
    """What frames with their truth leave open.

    Parameters
    ----------
    signals : Signals
        Conditioned frames (s).
    truth : dict of str to ndarray, shape (s, ...)
        As in a Recording.
    silent : ndarray, shape (t,)
        Taxels that are dead or stuck.
    creep : Creep or None
        What was found of the skin's past.

    Returns
    -------
    dict of str to dict
        Names that begin with `KIND`, each with its figures.
    """
    blank = np.full((len(signals.good), len(silent)), np.nan)
    force = np.asarray(truth.get('taxel_force', blank), np.float64)[signals.good]
    crept = 0.0 if creep is None else float(creep.share.sum(axis=0).max())
    found = {**untold_loads(force), **untold_past(signals, crept)}
    pressed = (np.nan_to_num(force) > 0).any(axis=0) | silent
    if pressed.any() and not pressed.all():
        found[f'{KIND}taxels that were never pressed'] = {'taxels': float((~pressed).sum())}
    if not np.isfinite(np.asarray(truth.get('deformation', blank), np.float64)).any():
        found[f'{KIND}shape factor (no truth of deformation): the array counts as rigid'] = {}
    return found


def flag_beyond(known: Columns, forces: Array, most: Array, asked: Bools) -> None:
    """Say of rows where a taxel bears more than any load that was told of it.

    Taxels that have a status of their own do not count.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; `status` is added.
    forces : ndarray, shape (s, t)
        Of the taxels (N); NaN: not read.
    most : ndarray, shape (t,)
        Largest force of each taxel that was told (N).
    asked : ndarray, shape (s,)
        Rows that may be touched.
    """
    beyond = forces > BEYOND * most
    if not np.count_nonzero(beyond):
        return
    if 'taxel_status' in known:
        beyond &= np.asarray(known['taxel_status'], np.uint8) == 0
    status = np.asarray(known.get('status', np.zeros(len(forces))), np.int64)
    known['status'] = status | (asked & beyond.any(axis=1)) * np.int64(FrameStatus.OUT_OF_RANGE)
