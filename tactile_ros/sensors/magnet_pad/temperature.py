"""Change of the field at rest with the temperature of the magnets since the tare.

Magnets lose a part of their field with each degree, and the resting field is hundreds of times
what a light touch changes: a few degrees between tare and touch pass for a load. The chips measure
their own temperature alone, which the magnets follow in part.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.baseline import plausible_temperature
from tactile_ros.physics.temperature import REMANENCE_SLOPE

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Integers, Report, Signals

# of the slope: two sigma hold magnets that stay cold beside warm chips, and ferrite
PRIOR = 0.5
LEAST_SIGMA = 0.05  # of the slope, however much was recorded
SIGMAS = 3.0  # of the thermometers, below which a difference may be their noise
SMALL = 0.3  # of the noise of a channel, in all channels together
TINY = 1e-18  # T2, far below the noise of any chip
MEDIAN = 0.954  # of the size of the difference of two normal numbers
WARMER = 3.0  # degrees beyond those of the fit, from which frames are out of range


class ThermalDrift:
    """Resting field of one pad over the temperature.

    Attributes
    ----------
    slope_, sigma_ : float
        Change of the resting field with a degree, over itself (1 / degree); its sigma.
    thermometer_ : float
        Noise of the chips' mean temperature (degrees).
    span_ : ndarray, shape (2,)
        Least and highest temperature of a chip in the fit (degrees Celsius); NaN: none measured.
    """

    def __init__(self) -> None:
        self.slope_, self.sigma_ = REMANENCE_SLOPE, PRIOR * abs(REMANENCE_SLOPE)
        self.thermometer_, self.span_ = 0.0, np.full(2, np.nan)
        self.fitted_ = False

    @property
    def report(self) -> Report:
        """Slope, and temperatures of the recording."""
        if not self.fitted_:
            return {}
        if not np.isfinite(self.span_).all():
            return {'not told: temperature (no chip told one)': {}}
        ends = {'least': float(self.span_[0]), 'most': float(self.span_[1])}
        return {
            'found: change of the field at rest': {
                'per degree': self.slope_, 'sigma': self.sigma_,
            },
            'not told: temperatures beyond those recorded (C)': ends,
        }  # fmt: skip

    def fit(self, signals: Signals) -> ThermalDrift:
        """Learn from what rests at other temperatures than its tare.

        Ridge regression towards magnets of neodymium; however many frames, a tare counts once.
        """
        then_c, now_c, self.fitted_ = signals.rest_temperature_c, signals.temperature_c, True
        if then_c is None or now_c is None:
            return self
        measured = now_c[signals.good]
        if np.isfinite(measured).any():
            self.span_ = np.array([np.nanmin(measured), np.nanmax(measured)])
        self.thermometer_ = _noise(np.where(np.isfinite(then_c), now_c, np.nan)[signals.good])
        rest = signals.good & (signals.in_contact == 0)
        base, change = signals.baseline[rest], (signals.values - signals.baseline)[rest]
        lever = base * self.rise(then_c[rest], now_c[rest])[:, None, None]
        known = np.isfinite(lever) & np.isfinite(change)
        lever, change = np.where(known, lever, 0.0), np.where(known, change, 0.0)
        size, along = float(np.square(lever).sum()), float((lever * change).sum())
        if size:
            left = max(float(np.square(change).sum()) - along**2 / size, 0.0) / known.sum()
            tares = len(np.unique(base.reshape(len(base), -1), axis=0))
            prior, weight = self.sigma_**-2, tares / (len(base) * (left + TINY))
            information = prior + weight * size
            self.slope_ = (prior * self.slope_ + weight * along) / information
            self.sigma_ = max(information**-0.5, LEAST_SIGMA * abs(REMANENCE_SLOPE))
        return self

    def corrected(self, signals: Signals) -> Signals:
        """Frames less the change of their baselines."""
        then_c, now_c = signals.rest_temperature_c, signals.temperature_c
        if then_c is None or now_c is None:
            return signals
        drift = self.change(signals.baseline, then_c, now_c)
        return replace(signals, delta=signals.values - signals.baseline - drift)

    def rise(self, then_c: Array, now_c: Array) -> Array:
        """Degrees (s,) by which chips (s, t) are warmer than at the tare; 0 where none measured.

        What may be the noise of thermometers is taken for it, and implausible ones are left out.
        """
        apart = plausible_temperature(now_c) - then_c
        known = np.isfinite(apart)
        rise = np.where(known, apart, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
        square = rise * rise
        return np.asarray(rise * square / (square + (SIGMAS * self.thermometer_) ** 2 + 1e-12))

    def change(self, base: Array, then_c: Array, now_c: Array | None) -> Array:
        """Change (s, t, c) of baselines (s, t, c) (T) since chips measured `then_c` (s, t)."""
        if now_c is None:
            return np.zeros_like(base)
        return np.asarray(base * (self.slope_ * self.rise(then_c, now_c))[:, None, None])

    def uncertainty(self, signals: Signals, noise: float) -> tuple[Integers, Array]:
        """Finite rows (r,) that the slope's sigma moves by more than a part of `noise` (T).

        And by how much (r, c), in all channels together, each with its sign (T).
        """
        then_c, now_c = signals.rest_temperature_c, signals.temperature_c
        level = signals.baseline.reshape(len(signals.good), -1)
        if then_c is None or now_c is None:
            return np.zeros(0, np.int64), level[:0]
        by = self.sigma_ * self.rise(then_c, now_c)
        rows = np.flatnonzero(by * by * (level * level).sum(axis=1) > (SMALL * noise) ** 2)
        rows = rows[np.isfinite(signals.delta[rows]).all(axis=(1, 2))]
        return rows, by[rows, None] * level[rows]

    def out_of_range(self, signals: Signals) -> Bools:
        """Rows (s,) of which a chip is clearly warmer or colder than in the fit."""
        chips = signals.temperature_c
        if chips is None or not np.isfinite(self.span_).all():
            return np.zeros(len(signals.good), bool)
        low, high = self.span_
        return np.asarray(((chips < low - WARMER) | (chips > high + WARMER)).any(axis=1))


def _noise(chips: Array) -> float:
    """Noise of the mean temperature of frames (s, t), which change slowly (degrees)."""
    chips = chips[:, np.isfinite(chips).any(axis=0)]
    known = chips[np.isfinite(chips).all(axis=1)].mean(axis=1) if chips.size else np.zeros(0)
    return float(np.median(np.abs(np.diff(known)))) / MEDIAN if len(known) > 1 else 0.0


def noise_of_rest(signals: Signals) -> float:
    """Standard deviation of resting readings, over all channels; 0 where nothing rests."""
    rest = signals.delta[signals.good & (signals.in_contact == 0)]
    return float(np.sqrt((rest**2).mean())) if len(rest) else 0.0
