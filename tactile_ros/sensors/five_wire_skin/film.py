# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Contact by the divider at a stated false-alarm rate, drift of its rest, and creep of the film.

Contact shows in the divider alone: the foil of an untouched skin may float, and its potentials
then read garbage, in the baseline too. Where rests show that, potentials are taken as they are
read, and only the divider is less its baseline.

The logarithm of the force is the static curve's plus shares of fading means of the past force, in
units of the force now; both are those of the static curve, which creep changes alike.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.estimators.power_law_force import PowerLawForce
from tactile_ros.types import Array, Bools, Columns, Integers, Signals

FALSE_ALARM = 1e-6  # share of untouched frames that may be called touched
NOISE, NOISE_ROWS = 5e-4, 3  # of a divider before any rest; resting rows that it counts for
UNCALIBRATED = 0.01  # threshold without resting rows
FLOATING = 0.01  # standard deviation of a resting potential from which the foil floats
LIGHTEST = 0.01
DIVIDER = 2  # its channel
LEAST, MOST = -1.0, 2.0  # of the supply: no wire reads more than twice of it
BELOW = -0.1  # of the supply: a converter reads no less than ground, but for its offset
RAIL = 1.0  # of the divider: no resistance at all, so a short or a converter at its end


def implausible_taxels(values: Array) -> Bools:
    """Readings (..., c) of which no wire can read so much or so little, or a divider at its end.

    Examples
    --------
    >>> implausible_taxels(np.array([[0.5, 0.5, 0.9], [0.5, 0.5, 1.0], [3.0, 0.5, 0.2]])).tolist()
    [False, True, True]
    >>> implausible_taxels(np.array([[0.5, -0.5, 0.2]])).tolist()
    [True]
    """
    outside = (values > MOST) | (values < BELOW)
    return np.asarray(outside.any(axis=-1) | (values[..., DIVIDER] >= RAIL))


class ContactGate:
    """Contact from the deviation of the divider from its rest.

    Beyond the threshold lie `FALSE_ALARM` of untouched frames, by Student's distribution, their
    posterior predictive one (Gelman et al., Bayesian Data Analysis, sec. 3.2). `noise` is the
    standard deviation of the divider's reading; NaN: estimated from rest.
    """

    rest_: Array  # (c,) level of readings at rest; 0 where they float
    variance_: Array  # (c,) theirs
    still_: Bools  # (c,) readings that rest at a level
    threshold_: float  # deviation of the divider's reading
    undecided_: bool  # the fit had no rest to distinguish contact from
    subthreshold_: float  # mean square of forces that do not close the air gap (N2)

    def __init__(self, noise: float, channels: int = 3) -> None:
        self.noise = noise
        self.rest_, self.variance_ = np.zeros(channels), np.zeros(channels)
        self.still_ = np.arange(channels) == DIVIDER
        self.threshold_, self.undecided_, self.subthreshold_ = UNCALIBRATED, False, 0.0
        self.report_: dict[str, float] = {}

    def fit(self, signals: Signals, truth: Columns) -> ContactGate:
        """Learn rest and threshold from frames with truth (s, ...)."""
        blank = np.full((len(signals.good), 3), np.nan)
        force = np.nan_to_num(np.asarray(truth.get('force', blank), np.float64)[:, 2])
        position = np.asarray(truth.get('position', blank), np.float64)
        label = np.asarray(truth.get('in_contact', np.full(len(blank), -1)), np.int64)
        self.undecided_ = bool((signals.in_contact[signals.good] < 0).all())
        touched = (np.isfinite(position).any(axis=1) & (label != 0)) | (label == 1) | (force > 0)
        resting = (label == 0) | ((signals.in_contact == 0) & ~touched)
        values = signals.values[resting & signals.good, 0]
        potentials = np.arange(len(self.rest_)) != DIVIDER
        self.threshold_ = UNCALIBRATED
        if len(values) > 1:
            self.still_ = ~potentials | (values.std(axis=0)[potentials] < FLOATING).all()
            self.rest_ = np.where(self.still_, values.mean(axis=0), 0.0)
            self.variance_ = np.where(self.still_, values.var(axis=0, ddof=1), 0.0)
            self._choose_threshold(len(values))
        deviation = self._deviation(self.readings(signals))
        loaded, felt = signals.good & (force > 0), deviation > self.threshold_
        light, heavy = force[loaded & ~felt], force[loaded & felt]
        lightest = float(np.quantile(heavy, LIGHTEST)) if len(heavy) else 0.0
        self.subthreshold_ = float((light**2).mean()) if len(light) else (0.1 * lightest) ** 2
        self.report_ = {
            'threshold_divider': self.threshold_,
            'false_alarm_rate': FALSE_ALARM,
            'lightest_felt': lightest,
        }
        if len(light):
            self.report_['threshold_force'] = float(np.quantile(light, 0.95))
        return self

    def _choose_threshold(self, count: int) -> None:
        """Threshold from the noise of `count` resting rows, or the stated one."""
        free = count - 1.0 + NOISE_ROWS
        noise = math.sqrt(((count - 1) * self.variance_[DIVIDER] + NOISE_ROWS * NOISE**2) / free)
        if np.isnan(self.noise):
            self.noise = noise
        elif self.noise > 0:
            noise, free = self.noise, 1e9
        quantile = float(stdtrit(free, 1 - FALSE_ALARM / 2))
        self.threshold_ = quantile * noise * math.sqrt(1 + 1 / count)

    def readings(self, signals: Signals) -> Array:
        """Potentials and divider (s, c), less the drift of their rest since the fit.

        A rest that lies within its noise of the fit's has not moved: a short tare would add its
        own noise to every frame. So the drift is shrunk by the variance of a rest.
        """
        drift = signals.baseline[:, 0] - self.rest_
        with np.errstate(over='ignore'):
            square = drift * drift
        moved = self.still_ & (square > self.variance_) & (square < math.inf)
        kept = 1.0 - self.variance_ / np.where(moved, square, 1.0)
        x = signals.values[:, 0] - np.where(moved, kept * drift, 0.0)
        return np.clip(x, LEAST, MOST)

    def contact(self, signals: Signals, x: Array) -> npt.NDArray[np.int8]:
        """Contact (s,) by the divider of readings x (s, c): 1, 0, -1 unknown; 0 of tare rows.

        Where a fit had no rest to judge by, and of unusable frames, it is as the pipeline says.
        """
        if self.undecided_:
            return signals.in_contact
        felt = self._deviation(x) > self.threshold_
        if signals.tare is not None:
            felt &= ~signals.tare
        return np.where(signals.good, felt.view(np.int8), signals.in_contact)

    def _deviation(self, x: Array) -> Array:
        """Distance (s,) of the divider's reading from its rest."""
        return np.asarray(np.abs(x[:, DIVIDER] - self.rest_[DIVIDER]))


TIME_CONSTANTS = np.array([0.3, 1.0, 4.0, 16.0, 64.0])  # s
VARIATION = 0.15  # of what is taken off: no two places of a film creep alike
MOST_RATIO = 1.0  # of a fading mean to the force: a film loses what it has crept as the load goes


class FilmCreep:
    """Shares of the past in the logarithm of a force, beside a static curve."""

    shares_: Array  # (m,) of the ratios of fading means to the force, 0 before a fit
    covariance_: Array  # (m, m) theirs

    def __init__(self, curve: PowerLawForce) -> None:
        self.curve_ = curve
        self.report_: dict[str, float] = {}
        self.shares_ = np.zeros(len(TIME_CONSTANTS))
        self.covariance_ = np.zeros((len(TIME_CONSTANTS),) * 2)

    def undo(
        self, static: Array, stamp_ns: Integers, restart: Bools, memory: FadingMemory
    ) -> tuple[Array, Array]:
        """Forces (s,) (N) without creep, and ratios (s, m) of the fading means to the force.

        `static` (s,) are forces of the static curve: 0 where nothing touches; NaN: unusable.
        """
        means, gap = memory(static[:, None], stamp_ns, restart)[:, :, 0], self.curve_.gap_
        pressed = static > 0
        ratios = np.minimum(means / np.where(pressed, static, math.inf)[:, None], MOST_RATIO)
        # no product of matrices: its sums run otherwise for one frame than for many
        grown = np.exp(np.einsum('sm,m->s', ratios, self.shares_))
        return np.where(static > gap, (static - gap) * grown + gap, static), ratios

    def variance(self, ratios: Array) -> Array:
        """Variance (s,) of the logarithm of a force by the shares and their variation."""
        # no product of matrices: its sums run otherwise for one frame than for many
        total = np.einsum('sm,m->s', ratios, self.shares_)
        own = np.einsum('sm,mk,sk->s', ratios, self.covariance_, ratios)
        return np.asarray((VARIATION * total) ** 2 + own)
