# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Contact by the divider at a stated false-alarm rate, drift of its rest, and creep of the film.

Contact shows in the divider alone: the foil of an untouched skin may float, and its potentials
then read garbage, in the baseline too. Where rests show that, potentials are taken as they are
read, and only the divider is less its baseline.

The logarithm of the force is the static curve's plus shares of fading means of the past force, in
units of the force now. A touch elsewhere meets fresh film; one that is drawn along leaves behind
what has crept, where the recording shows that.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

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

    The threshold is the quantile of Student's distribution, the posterior predictive one of a
    resting frame, at which `FALSE_ALARM` of untouched frames lie beyond. `noise` is the standard
    deviation of the divider's reading; NaN: estimated from rest.
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
STILL = 0.05  # of the touch's edge: moves that are noise
ROUNDS = 3  # in which a force and its own share of the means settle
FORCE, X, Y, MEANS = 0, 1, 2, 3  # columns of the state


@compiled
def overlap(state: Array, x: float, y: float, edge: float) -> float:
    """Share of a touch at a place with the one of the state, which follows it."""
    share = 1.0
    for i, now in ((X, x), (Y, y)):
        if math.isnan(state[i]):
            state[i] = now
        off = now - state[i]
        moved = max(abs(off) - STILL * edge, 0.0)
        share *= max(1.0 - moved / edge, 0.0)
        state[i] += math.copysign(moved, off)
    return share


@compiled
def creep_rows(
    static: Array, places: Array, stamp_ns: Integers, restart: Bools, rates: Array, law: Array,
    shares: Array, state: Array, clock: Integers, force: Array, ratios: Array,
) -> None:  # fmt: skip
    """Write forces (s,) without creep and the fading means over them (s, m).

    `static` (s,) are forces of the static curve: 0 where nothing touches; NaN: unusable, the last
    one holds. `rates` (m,) are 1 / time constants, `law` (3,) the edge of a touch (m), the largest
    ratio and the force of the air gap (N), `shares` (m,) those of the ratios in the logarithm of
    the force. Of the stream, `state` (3 + m,) holds last force, place and means, `clock` (2,)
    whether it has begun, and its newest stamp.
    """
    count = len(rates)
    means, old, fresh = np.empty(count), np.empty(count), np.empty(count)
    for s in range(len(static)):
        begins = restart[s] or clock[0] == 0
        if begins:
            state[:], state[X], state[Y] = 0.0, math.nan, math.nan
            clock[0], clock[1] = 1, stamp_ns[s]
        elapsed = max(stamp_ns[s] - clock[1], 0) * 1e-9
        newer, held = elapsed > 0.0, math.isnan(static[s])
        share = 1.0
        if newer and static[s] > 0.0 and math.isfinite(law[0]) and math.isfinite(places[s, 0]):
            share = overlap(state, places[s, 0], places[s, 1], law[0])
        for i in range(count):
            old[i], fresh[i] = state[MEANS + i], 0.0
            if newer:
                phase = rates[i] * elapsed
                decay, average = math.exp(-phase), -math.expm1(-phase) / phase
                old[i] = share * (decay * old[i] + (average - decay) * state[FORCE])
                fresh[i] = 1.0 - average
        now = state[FORCE] if held else static[s]
        first = now - law[2]
        for _ in range(ROUNDS):
            total = 0.0
            for i in range(count):
                means[i] = old[i] + fresh[i] * now
                ratios[s, i] = min(means[i] / now, law[1]) if now > 0.0 else 0.0
                total += shares[i] * ratios[s, i]
            if not held and now > law[2]:
                now = first * math.exp(total) + law[2]
        force[s] = math.nan if held else now
        if newer or begins:
            state[FORCE], clock[1] = now, stamp_ns[s]
            state[MEANS:] = means


class FilmMemory:
    """Past of one stream, one frame at a time or many with the same numbers."""

    def __init__(self) -> None:
        self._state = np.zeros(MEANS + len(TIME_CONSTANTS))
        self._clock = np.zeros(2, np.int64)

    def __call__(
        self, creep: FilmCreep, static: Array, places: Array, stamp_ns: Integers, restart: Bools
    ) -> tuple[Array, Array]:
        """Forces (s,) (N) without creep, and the ratios (s, m) of the means; see `creep_rows`."""
        force, ratios = np.empty(len(static)), np.empty((len(static), len(TIME_CONSTANTS)))
        law = np.array([creep.edge, creep.most, creep.gap])
        creep_rows(
            static, places, stamp_ns, restart, 1 / TIME_CONSTANTS, law, creep.shares_,
            self._state, self._clock, force, ratios,
        )  # fmt: skip
        return force, ratios


class FilmCreep:
    """Shares of the past in the logarithm of a force.

    Parameters
    ----------
    edge : float
        Of a touch (m), where the past counts by place; infinite: wherever it was.
    most : float
        Largest ratio of a fading mean to the force; 1: a film loses what it has crept as the
        load goes.
    gap : float
        Force that the air gap takes, which does not creep (N).
    """

    shares_: Array  # (m,) of the ratios, 0 before a fit
    covariance_: Array  # (m, m) theirs

    def __init__(self, edge: float = np.inf, most: float = 1.0, gap: float = 0.0) -> None:
        self.edge, self.most, self.gap = edge, most, gap
        self.report_: dict[str, float] = {}
        self.shares_ = np.zeros(len(TIME_CONSTANTS))
        self.covariance_ = np.zeros((len(TIME_CONSTANTS),) * 2)

    def variance(self, ratios: Array) -> Array:
        """Variance (s,) of the logarithm of a force by the shares and their variation."""
        # no product of matrices: its sums run otherwise for one frame than for many
        total = np.einsum('sm,m->s', ratios, self.shares_)
        own = np.einsum('sm,mk,sk->s', ratios, self.covariance_, ratios)
        return np.asarray((VARIATION * total) ** 2 + own)
