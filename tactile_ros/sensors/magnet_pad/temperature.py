"""Change of the field at rest with the temperature of the magnets since the tare.

Magnets lose a part of their field with each degree, and the resting field is hundreds of times
what a light touch changes: a few degrees between tare and touch pass for a load. The chips tell
their own temperature alone, which the magnets follow in part.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.baseline import plausible_temperature
from tactile_ros.physics.temperature import REMANENCE_SLOPE

if TYPE_CHECKING:
    from tactile_ros.types import Array, Integers, Report, Signals

# of the slope: two sigma reach from magnets that stay cold beside warm chips to ferrite
UNSURE = 0.5
LEAST_UNSURE = 0.05  # however much was recorded
SIGMAS = 3.0  # of the thermometers, below which a difference may be their noise
SMALL = 0.3  # of the noise of a channel, in all channels together
TINY = 1e-18  # T2, far below the noise of any chip
MEDIAN = 0.954  # of the size of the difference of two normal numbers


class Warmth:
    """Of one pad.

    Attributes
    ----------
    slope_, unsure_ : float
        Change of the resting field with a degree, over itself (1 / degree); its sigma.
    thermometer_ : float
        Noise of the chips' mean temperature (degrees).
    told_ : bool
        Whether chips told temperatures in the fit.
    """

    def __init__(self) -> None:
        self.slope_ = REMANENCE_SLOPE
        self.unsure_ = UNSURE * abs(REMANENCE_SLOPE)
        self.thermometer_ = 0.0
        self.told_ = False

    @property
    def report(self) -> Report:
        """What was found of the magnets, where chips told temperatures."""
        found = {'per degree': self.slope_, 'sigma': self.unsure_}
        return {'found: change of the field at rest': found} if self.told_ else {}

    def fit(self, signals: Signals) -> Signals:
        """Learn from what rests at other temperatures than its tare; frames with what was learned.

        Ridge regression towards magnets of neodymium; however many frames, a tare counts once.
        """
        then_c, now_c = signals.rest_temperature_c, signals.temperature_c
        if then_c is None or now_c is None:
            return signals
        heeded = np.where(np.isfinite(then_c), now_c, np.nan)
        self.thermometer_ = _noise(heeded[signals.good])
        self.told_ = bool(np.isfinite(now_c[signals.good]).any())
        read = signals.values - signals.baseline
        rest = signals.good & (signals.in_contact == 0)
        lever = signals.baseline[rest] * self.rise(then_c[rest], now_c[rest])[:, None, None]
        self._learn(lever, read[rest], signals.baseline[rest])
        return replace(signals, delta=read - self.change(signals.baseline, then_c, now_c))

    def _learn(self, lever: Array, read: Array, base: Array) -> None:
        """Slope of readings (s, t, c) (T) over levers (s, t, c), field times degrees."""
        told = np.isfinite(lever) & np.isfinite(read)
        lever, read = np.where(told, lever, 0.0), np.where(told, read, 0.0)
        size, along = float(np.square(lever).sum()), float((lever * read).sum())
        if not size:
            return
        left = max(float(np.square(read).sum()) - along**2 / size, 0.0) / np.count_nonzero(told)
        tares = len(np.unique(base.reshape(len(base), -1), axis=0))
        prior, weight = self.unsure_**-2, tares / (len(base) * (left + TINY))
        known = prior + weight * size
        self.slope_ = (prior * self.slope_ + weight * along) / known
        self.unsure_ = max(known**-0.5, LEAST_UNSURE * abs(REMANENCE_SLOPE))

    def rise(self, then_c: Array, now_c: Array) -> Array:
        """Degrees (s,) by which chips (s, t) are warmer than at the tare; 0 where nobody told.

        What may be the noise of thermometers is taken for it, and what no chip can be for untold.
        """
        apart = plausible_temperature(now_c) - then_c
        told = np.isfinite(apart)
        count = np.count_nonzero(told, axis=1)
        rise = np.where(told, apart, 0.0).sum(axis=1) / np.maximum(count, 1)
        square = rise * rise
        return np.asarray(rise * square / (square + (SIGMAS * self.thermometer_) ** 2 + 1e-12))

    def change(self, base: Array, then_c: Array, now_c: Array | None) -> Array:
        """Change (s, t, c) of baselines (s, t, c) (T) since the chips told `then_c` (s, t)."""
        if now_c is None:
            return np.zeros_like(base)
        return np.asarray(base * (self.slope_ * self.rise(then_c, now_c))[:, None, None])

    def unsure(self, signals: Signals, noise: float) -> tuple[Integers, Array]:
        """Sigma of finite readings by it, where that is not far below `noise` (T).

        Returns
        -------
        rows : ndarray, shape (r,)
            Which.
        sigma : ndarray, shape (r, n)
            Of all their channels together, each with its sign (T).
        """
        then_c, now_c = signals.rest_temperature_c, signals.temperature_c
        channels = signals.baseline[0].size if len(signals.baseline) else 0
        if then_c is None or now_c is None or not noise:
            return np.zeros(0, np.int64), np.zeros((0, channels))
        by = self.unsure_ * self.rise(then_c, now_c)
        level = signals.baseline.reshape(len(by), -1)
        rows = np.flatnonzero(by * by * (level * level).sum(axis=1) > (SMALL * noise) ** 2)
        rows = rows[np.isfinite(signals.delta[rows]).all(axis=(1, 2))]
        return rows, by[rows, None] * level[rows]


def _noise(chips: Array) -> float:
    """Noise of the mean temperature of frames (s, t), which change slowly (degrees)."""
    told = np.isfinite(chips)
    chips, told = (part[:, told.any(axis=0)] for part in (chips, told))
    known = chips[told.all(axis=1)].mean(axis=1) if told.size else np.zeros(0)
    if len(known) < 2:
        return 0.0
    return float(np.median(np.abs(np.diff(known)))) / MEDIAN


def noise_of_rest(signals: Signals) -> float:
    """Standard deviation of resting readings, over all channels; 0 where nothing rests."""
    rest = signals.delta[signals.good & (signals.in_contact == 0)]
    return float(np.sqrt((rest**2).mean())) if len(rest) else 0.0
