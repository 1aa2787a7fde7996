"""What recorded touches do not tell of a sheet: places, loads, holds, how it rests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.regression.untold import KIND, untold_loads, untold_past

if TYPE_CHECKING:
    from tactile_ros.types import Array, Columns, Report, Signals

FOR_PLACE, FOR_FORCE = 25, 49  # places that a map and a film need
CELL = 0.05  # of the sheet: touches as near to each other are of one place
FAR, GAP, NODES = 0.2, 0.02, 41  # of the sheet to the next touch; share of it; places asked


def untold(size: Array, signals: Signals, truth: Columns, crept: float) -> Report:
    """What frames with their truth leave open.

    Parameters
    ----------
    size : ndarray, shape (2,)
        Of the sheet (m).
    signals : Signals
        Conditioned frames (s) with the divider's contact.
    truth : dict of str to ndarray, shape (s, ...)
        As in a Recording.
    crept : float
        Share of a load that the film's past was found to hold; 0: none.

    Returns
    -------
    dict of str to dict
        Names that begin with `KIND`, each with its figures.
    """
    blank = np.full((len(signals.good), 3), np.nan)
    force = np.asarray(truth.get('force', blank), np.float64)[:, 2]
    places = np.asarray(truth.get('position', blank), np.float64)[signals.good, :2] / size
    places = places[np.isfinite(places).all(axis=1)]
    found = {**untold_loads(force[signals.good]), **untold_past(signals, crept)}
    if (signals.in_contact != 0).all():
        found[f'{KIND}contact (no untouched rows)'] = {}
    if not len(places):
        return {**found, f'{KIND}place (no truth): the formula of [5] serves': {}}
    return {**found, **_between(places)}


def _between(places: Array) -> Report:
    """What touches at places (n, 2), in parts of the sheet, leave open between them."""
    found: Report = {}
    count = len(np.unique(np.round(places / CELL), axis=0))
    for what, wanted in (('place', FOR_PLACE), ('force', FOR_FORCE)):
        if count < wanted:
            figures = {'places': float(count), 'wanted': float(wanted)}
            found[f'{KIND}{what} between so few places'] = figures
    line = np.linspace(0.0, 1.0, NODES)
    asked = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    share = float((cKDTree(places).query(asked)[0] > FAR).mean())
    if share > GAP:
        found[f'{KIND}places far from all touches'] = {'share of the sheet': share}
    return found
