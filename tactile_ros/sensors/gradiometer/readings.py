"""Readings of the gradiometer as changes of field: temperature, baseline, axes and margins."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactile_ros.estimators.disc_model import OFFSETS
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.sensors.gradiometer.thermal import (
    LEAST_RANGE,
    STRONGEST,
    THIRD,
    UNIT,
    WEAKEST,
    chip_temperature,
    lags_told,
    sensitivity,
    thermometer_noise,
)
from tactile_ros.sensors.gradiometer.untold import told_ago, unsure_chips, wandering
from tactile_ros.sensors.gradiometer.warm_rest import WarmRest

if TYPE_CHECKING:
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.types import Array, Bools, Columns, Signals

NOISE = 3e-6  # T, where nothing tells it: of [3] at room temperature
SIGMAS = 4.0  # within which a clipped reading may fall below the range
MOST_MARGIN = 0.01  # of the range
FEWEST_RESTING, UNEVEN = 10, 2  # in succession, that tell noise beside warming; their steps
CLEAR = 20.0  # sigmas of the disc at rest beyond which it tells the baseline's temperature


class Readings:
    """Change of field of one gradiometer.

    Parameters
    ----------
    config : GradiometerConfig
        Axes, sensitivity and noise.

    Attributes
    ----------
    axes : ndarray, shape (n, 3)
        Direction of each channel; 0 for dead ones.
    noise : float
        Of a channel (T).
    absolute_ : bool
        Readings came without a baseline.
    level_ : ndarray, shape (n,)
        Mean field at rest (T).
    usual_ : float
        Mean temperature of the fit (degrees Celsius); NaN: none was told.
    warm_ : bool
        Temperatures of the fit differed.
    lags_ : ndarray, shape (m,)
        Time constants by which the disc may lag behind the chip (s).
    span_ : ndarray, shape (2,)
        Least and highest temperature of the fit (degrees Celsius); infinite: none was told.
    rest_ : WarmRest or None
        Readings at rest over temperatures; None: all of the fit were alike.
    thermometer_ : float
        Noise of the chip's thermometer (degrees); 0: no stream told it.
    wander_ : ndarray, shape (3, m)
        How far temperatures go, of `wandering`.
    """

    def __init__(self, config: GradiometerConfig) -> None:
        self.sensitivity = config.sensitivity
        turned = config.rotations
        turned = np.tile(np.eye(3), (len(config.positions), 1, 1)) if turned is None else turned
        self.axes = np.ascontiguousarray(turned[:, :, [0, 2]].transpose(0, 2, 1)).reshape(-1, 3)
        stated = NOISE if config.noise is None else float(np.max(config.noise))
        self.noise = stated if np.isfinite(stated) else NOISE
        self.absolute_ = False
        self.level_ = np.zeros(len(self.axes))
        self.usual_ = float('nan')
        self.warm_ = False
        self.lags_ = np.zeros(0)
        self.span_ = np.array([-np.inf, np.inf])
        self.rest_: WarmRest | None = None
        self.thermometer_, self.wander_ = 0.0, np.zeros((3, 1))
        self.fitted_ = False
        self.noise_is_stated = config.noise is not None

    def fit(self, signals: Signals, resting: Bools) -> Readings:
        """Learn level, noise and temperatures from frames and which of them (s,) rest."""
        rows, self.fitted_ = signals.good, True
        flat = signals.values.reshape(len(rows), len(self.axes))
        if rows.any():
            dead = (flat[rows] == 0).all(axis=0)
            self.axes = np.where(dead[:, None] & ~dead.all(), 0.0, self.axes)
        self.absolute_ = not np.nan_to_num(signals.baseline[rows]).any()
        chip = chip_temperature(signals)
        if chip is not None and np.isfinite(chip[rows]).any():
            seen = chip[rows & np.isfinite(chip)]
            self.usual_ = float(seen.mean())
            self.span_ = np.array([seen.min(), seen.max()])
            self.warm_ = bool(seen.max() - seen.min() > LEAST_RANGE)
            self.lags_ = lags_told(signals) if self.warm_ else self.lags_
            self.thermometer_ = thermometer_noise(signals, chip)
            now = np.where(rows & (told_ago(signals) == 0), chip, np.nan)
            self.wander_ = wandering(signals, now, self.thermometer_)
        self._learn_rest(signals, resting if resting.any() else rows)
        if not self.noise_is_stated and resting.sum() > 10:
            self.noise = _noise(signals, resting) or self.noise
        return self

    def _learn_rest(self, signals: Signals, rows: Bools) -> None:
        if self.absolute_ or not rows.any():
            return
        base = signals.baseline[rows] / self._sensitivity(signals)[rows]
        self.level_ = base.reshape(len(base), len(self.axes)).mean(axis=0)
        vars(self).pop('_pattern', None)

    def learn_warm_rest(
        self, signals: Signals, rows: Bools, disc: Array, warmer: Array, offset: Array
    ) -> None:
        """Learn what rests at other temperatures read.

        Parameters
        ----------
        signals : Signals
            Of the fit.
        rows : ndarray, shape (s,)
            Those that rest.
        disc : ndarray, shape (s,)
            Temperature of the disc (units of 25 degrees from the usual one).
        warmer : ndarray, shape (n,)
            What a unit of it changes at rest (T).
        offset : ndarray, shape (2, n)
            Of every channel, as found by now (T).
        """
        if self.absolute_ or not rows.any():
            return
        rest = WarmRest(self.axes, self.sensitivity, self.usual_)
        rest.offset_ = offset
        base = signals.baseline[rows].reshape(-1, len(self.axes))
        self.rest_ = rest.fit(base, self._chip(signals)[rows], disc[rows], warmer)
        self.level_ = self.rest_.level_
        vars(self).pop('_pattern', None)

    def _chip(self, signals: Signals) -> Array:
        """Temperature of the chips (s,) (units from the usual one); 0 unknown."""
        chip = chip_temperature(signals)
        if chip is None:
            return np.zeros(len(signals.good))
        return np.asarray(np.nan_to_num((chip - self.usual_) / UNIT))

    def drifts(self, signals: Signals) -> Array:
        """How changes follow the drifts of their channels, shape (s, 2); 0 where none is found."""
        if self.rest_ is None or signals.temperature_c is None:
            return np.zeros((len(signals.good), 2))
        base = signals.baseline.reshape(-1, len(self.axes))
        return self.rest_.drifts(self._chip(signals), self.rest_.temperatures(base))

    def unsure_drifts(self, signals: Signals) -> Array:
        """The same, (s, 2); where temperatures of the fit were alike, from that of the tare."""
        if self.warm_ or signals.temperature_c is None or not np.isfinite(self.usual_):
            return self.drifts(signals)
        base = signals.baseline.reshape(-1, len(self.axes))
        steep = UNIT * (self.steepness - REMANENCE_SLOPE)
        tare = 0.0 if self.absolute_ else (1 - self._strength(base)) / steep
        return np.column_stack([self._chip(signals) - tare, np.zeros(len(base))])

    def unsure_drift(self, count: int) -> Array:
        """Covariance (2 m, 2 m) (T2) of drifts of m differences, one power after the other."""
        if self.rest_ is not None:
            return self.rest_.unsure_
        return np.asarray(np.kron(np.diag(OFFSETS**2), np.eye(count)))

    def unsure_chips(self, signals: Signals) -> Array | None:
        """What temperatures (s, t) that are not told now are wrong by (degrees); None: all are."""
        return unsure_chips(signals, self.wander_) if np.isfinite(self.usual_) else None

    def unknown(self, signals: Signals) -> Bools:
        """Rows (s,) whose temperatures may be any of a fit in which they differed, or any."""
        unsure, most = self.unsure_chips(signals), self.wander_[1, -1] / np.sqrt(2)
        if unsure is None:
            return np.zeros(len(signals.good), bool)
        if not self.warm_:  # held ones are as near to those of the fit as they were
            return np.isinf(told_ago(signals)) | (signals.temperature_c is None)
        return np.asarray(unsure.mean(axis=1) > (1 - 1e-9) * most)

    def warmer_chips(self, field: Array, unsure: Array) -> Array:
        """Changes of fields (s, n) (T) where chips are told warmer than they are (s, t)."""
        drift = 0.0 if self.rest_ is None else self.rest_.offset_[0] / UNIT
        every = np.repeat(unsure, len(self.axes) // unsure.shape[1], axis=1)
        return np.asarray((self.steepness * field - drift) * every)

    def _sensitivity(self, signals: Signals) -> Array:
        """Of every reading, shape (s, t, 1); 1 where a fit was told no temperature."""
        if signals.temperature_c is None or not np.isfinite(self.usual_):
            return np.ones((len(signals.good), 1, 1))
        chip, told = signals.temperature_c, np.isfinite(signals.temperature_c)
        if np.count_nonzero(told) < told.size:
            mean = chip_temperature(signals)
            assert mean is not None
            mean = np.where(np.isfinite(mean), mean, self.usual_)
            chip = np.where(told, chip, mean[:, None])
        return sensitivity(chip, self.sensitivity)[..., None]

    @property
    def steepness(self) -> float:
        """Relative change of fields for a degree that the thermometer is wrong by (1 / degree)."""
        warm = self.usual_ + np.array([-0.5, 0.5])
        low, high = sensitivity(warm, self.sensitivity)
        return float((low - high) / (0.5 * (low + high)))

    def change(self, signals: Signals) -> Array:
        """Change of field since rest, or the field, shape (s, n) (T)."""
        shape = (len(signals.good), len(self.axes))
        if signals.temperature_c is None or not np.isfinite(self.usual_):
            return signals.delta.reshape(shape)
        field = signals.values / self._sensitivity(signals)
        if self.absolute_:
            return np.asarray(field.reshape(shape))
        base = signals.baseline.reshape(shape)
        if self.rest_ is not None:
            return self._warm_change(signals, base)
        return np.asarray(field.reshape(shape) - base / self._strength(base)[:, None])

    def _warm_change(self, signals: Signals, base: Array) -> Array:
        """Change of field since a rest at the usual temperature, (s, n) (T)."""
        assert self.rest_ is not None
        field = signals.values.reshape(base.shape) - self.rest_.drift(self._chip(signals))
        field = field.reshape(signals.values.shape) / self._sensitivity(signals)
        warm = self.rest_.temperatures(base)
        return np.asarray(field.reshape(base.shape) - self.rest_.usual_rest(base, warm))

    def _strength(self, base: Array) -> Array:
        """How strong the disc at rest was when baselines (s, n) were read, against the fit."""
        pattern, size = self._pattern
        if size < (CLEAR * self.noise) ** 2:
            return np.ones(len(base))
        found = np.add.reduce(base * pattern, axis=1) / size
        found = np.where(np.isfinite(found), found, 1.0)
        return np.minimum(np.maximum(found, WEAKEST), STRONGEST)

    @cached_property
    def _pattern(self) -> tuple[Array, float]:
        """Level of the disc at rest less its mean over the pixels, shape (n,), and its square."""
        pixels = self.level_.reshape(-1, 2)
        pattern = (pixels - pixels.mean(axis=0)).reshape(-1)
        return pattern, float(pattern @ pattern)


def _noise(signals: Signals, resting: Bools) -> float:
    """Noise of a channel (T) by resting rows (s,); of streams, what changes slowly left aside."""
    size = float(np.sqrt(signals.delta[resting].var(axis=0).mean()))
    if signals.stamp_ns is None or len(resting) < FEWEST_RESTING:
        return size
    # every row of a tare begins a baseline: streams are told apart by their times
    step = sliding_window_view(np.diff(signals.stamp_ns), 3)
    even = (step.min(axis=1) > 0) & (step.max(axis=1) <= UNEVEN * step.min(axis=1))
    even &= sliding_window_view(resting, 4).all(axis=1)
    third = np.diff(signals.values, 3, axis=0)[even]
    if len(third) < FEWEST_RESTING:
        return size
    return min(size, float(np.sqrt((third**2).mean() / THIRD)))


def margins(signals: Signals, config: GradiometerConfig, noise: float) -> Bools:
    """Rows (s,) with a reading so near its limit that noise may hide that it is clipped."""
    if config.saturation is None:
        return np.zeros(len(signals.good), bool)
    limit = np.asarray(config.saturation, float)
    edge = limit - np.minimum(SIGMAS * noise, MOST_MARGIN * limit)
    return np.asarray((np.abs(signals.values) >= edge).any(axis=(1, 2)))


def at_rest(signals: Signals, truth: Columns) -> Bools:
    """Rows (s,) that truth, or the readings, call untouched."""
    force = np.asarray(truth.get('force', np.full((len(signals.good), 3), np.nan)), float)
    free = np.nan_to_num(np.abs(force), nan=0.0).max(axis=1) == 0
    if 'in_contact' in truth:
        return np.asarray(np.asarray(truth['in_contact']) == 0)
    return np.asarray(free | (signals.in_contact == 0))
