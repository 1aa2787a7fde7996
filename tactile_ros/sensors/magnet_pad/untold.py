"""What recordings do not tell of a pad: loads, places, leanings, temperatures beyond theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array, Bools, Report, Signals

KIND = 'not told: '
ENDS = ('least', 'most')
UPRIGHT = 1e-3  # of a force along the axis (rms): touches below it press along the normal
LEANS = 0.1  # the same of the nominal touches, of which a quarter lean by up to 0.5 rad
FAR, NODES = 0.5, (41, 21)  # radii to the next touch; places that are asked
GAP = 0.02  # share of the surface
WARMER = 3.0  # degrees beyond those of the fit: the resting field changes by several noises


def upright(force: Array) -> bool:
    """Whether forces (s, 3) (N), where they are known, never have a part along the axis."""
    known = force[np.isfinite(force).all(axis=1)]
    return bool(len(known)) and bool((known[:, 0] ** 2).sum() < UPRIGHT**2 * (known**2).sum())


def lonely(config: MagnetPadConfig) -> Report:
    """What one chip alone leaves open, where a scene has fields from outside."""
    if len(config.positions) > 1 or not config.stray_term:
        return {}
    return {f'{KIND}outside fields (one chip takes most of them for touches)': {}}


def temperatures(signals: Signals) -> tuple[float, float]:
    """Least and highest temperature of chips in good rows (degrees Celsius); NaN: none told."""
    chips = signals.temperature_c
    known = np.zeros(0) if chips is None else chips[signals.good]
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if len(known) else (np.nan, np.nan)


def elsewhere(span: tuple[float, ...]) -> Report:
    """Temperatures that nothing was recorded at; () before a fit."""
    if not span:
        return {}
    if not np.isfinite(span).all():
        return {f'{KIND}temperature (no chip told one)': {}}
    return {f'{KIND}temperatures beyond those recorded (C)': dict(zip(ENDS, span, strict=True))}


def outside(span: tuple[float, ...], signals: Signals) -> Bools:
    """Rows (s,) of which a chip is clearly warmer or colder than in the fit."""
    chips = signals.temperature_c
    if chips is None or not span:
        return np.zeros(len(signals.good), bool)
    low, high = span
    return np.asarray(((chips < low - WARMER) | (chips > high + WARMER)).any(axis=1))


def untold(config: MagnetPadConfig, touches: Array) -> Report:
    """What touches (s, 5) leave open; columns as `PadInversion.touches_` has them."""
    ends = (float(np.exp(find(touches[:, 2]))) for find in (np.min, np.max))
    found = {f'{KIND}loads beyond those recorded (N)': dict(zip(ENDS, ends, strict=True))}
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
