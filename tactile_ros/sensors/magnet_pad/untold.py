"""What recorded touches do not tell of a pad: loads, places and leanings beyond theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.signals import Report
    from tactile_ros.types import Array

KIND = 'not told: '
UPRIGHT = 1e-3  # of a force along the axis (rms): touches below it press along the normal
LEANS = 0.1  # the same of the nominal touches, of which a quarter lean by up to 0.5 rad
FAR, NODES = 0.5, (41, 21)  # radii to the next touch; places that are asked
GAP = 0.02  # share of the surface


def upright(force: Array) -> bool:
    """Whether forces (s, 3) (N), where they are known, never have a part along the axis."""
    known = force[np.isfinite(force).all(axis=1)]
    return bool(len(known)) and bool((known[:, 0] ** 2).sum() < UPRIGHT**2 * (known**2).sum())


def lonely(config: MagnetPadConfig) -> Report:
    """What one chip alone leaves open, where a scene has fields from outside."""
    if len(config.positions) > 1 or not config.stray_term:
        return {}
    return {f'{KIND}outside fields (one chip takes most of them for touches)': {}}


def untold(config: MagnetPadConfig, touches: Array) -> Report:
    """What touches (s, 5) leave open; columns as `PadInversion.touches_` has them."""
    least, most = (float(np.exp(find(touches[:, 2]))) for find in (np.min, np.max))
    found = {f'{KIND}loads beyond those recorded (N)': {'least': least, 'most': most}}
    share = untouched(config, touches)
    if share > GAP:
        found[f'{KIND}places half a radius from the next touch'] = {'share of the pad': share}
    return found


def untouched(config: MagnetPadConfig, touches: Array) -> float:
    """Share of the pad, as seen from above, that is far from all touches (s, 5)."""
    unit = np.array([1 / config.radius, 1.0])
    along = config.length * np.linspace(-0.5, 0.5, NODES[0])
    around = np.arccos(np.linspace(-1.0, 1.0, NODES[1]))
    places = np.stack(np.meshgrid(along, around), axis=-1).reshape(-1, 2)
    far = cKDTree(touches[:, :2] * unit).query(places * unit)[0]
    return float((far > FAR).mean())
