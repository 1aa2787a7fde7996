"""Force on a piezoresistive skin by a power law whose coefficients vary smoothly over the sheet.

The film's resistance is R - Rx, that of the film alone, and falls as a power of the force. Its
logarithm tells that of the force by a short polynomial whose coefficients are smooth functions of
place: sums of cosines with a prior of their own smoothness (a Gaussian process of reduced rank,
Solin and Sarkka, Statistics and Computing 30, 2020). Smoothness, size of the variation and
series resistance are those that make the calibration likeliest.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from tactile_ros.estimators.evidence import Moments
from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.types import Array, Integers

WAVES = (10, 8, 4)  # cosines along x and y of constant, exponent and bend
BENDS = 4  # powers of the logarithm that are the same everywhere
SERIES = (0.0, 0.5, 1.0, 1.5)  # share of the nominal series resistance
PRIOR = (20.0, 50.0, 20.0)  # spread over the noise of what is the same everywhere
FEWEST = 12
MORE = 0.4  # logarithm of the largest answer over the largest force told
BEYOND = 0.15  # of the range of the logarithm, in which the curve goes on
START = ((2.0, 1.0, -1.0, 0.4), (4.0, 3.0, 0.0, 0.4), (6.0, 5.0, 1.0, 0.4))
EXPECTED = (3.0, 2.0, 0.0, 0.4)  # of logarithms of sizes and smoothness
SURENESS = (0.02, 0.02, 0.02, 2.0)
TRIALS = 160
FINER = 0.05  # share of the spread between places that rows of one place have
STEP = (1.0, 1.0, 2.0, 0.4)


class PowerForce:
    """Logarithm of force as a polynomial of that of the film's resistance, varying over the sheet.

    Features are x and y in units of the sheet (0 to 1), the resistance R and the nominal Rx, both
    in units of the divider's; targets are forces above 0.

    Parameters
    ----------
    noise : float
        Of the divider's reading, R0 / (R0 + R).

    Attributes
    ----------
    series_ : float
        Share of the nominal series resistance in use.
    range_ : ndarray, shape (4,)
        Middle and half width of the logarithm of resistance, and its seen ends, -1 to 1.
    weights_ : ndarray, shape (p,)
        Of the terms.
    root_ : ndarray, shape (p, p)
        Square root of their covariance.
    noise_ : float
        Relative spread of a force about the curve of its place.
    reading_ : float
        Spread by the divider's noise at R = R0, over `noise_`.
    most_ : float
        Logarithm of the largest answer.
    prior_ : ndarray, shape (4,)
        Logarithms of the variation of each coefficient over the noise, and smoothness.
    """

    series_: float
    range_: Array
    weights_: Array
    root_: Array
    noise_: float
    reading_: float
    most_: float
    prior_: Array

    def __init__(self, noise: float = 0.0) -> None:
        self.noise = noise

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PowerForce:
        """Learn from features (s, 4) and forces (s, 1) (N); rows without force are left out."""
        rows = training_rows(x, y, groups)
        there = rows.y[:, 0] > 0
        rows = rows.take(there if there.any() else np.ones(len(there), bool))
        target = np.log(np.maximum(rows.y[:, :1], 1e-6))
        shares = SERIES if len(target) >= FEWEST else (1.0,)
        coarse = [(self._learn(rows.x, target, share, START[:1])[0], share) for share in shares]
        _, self.prior_ = self._learn(rows.x, target, max(coarse)[1], START)
        terms = self._terms(rows.x)
        self.most_ = float(target.max()) + MORE
        weight = 1 / (1 + self._reading(rows.x) ** 2)
        moments = Moments.of(terms, target, weight)
        weights, root, noise = moments.solve(_spread(self.prior_))
        left = float(((target - terms @ weights) ** 2 * weight[:, None]).sum())
        used = float(np.einsum('ij,ij->', root @ moments.gram, root))
        self.noise_ = max(noise, float(np.sqrt(left / max(len(target) - used, 1.0))), 1e-6)
        self.weights_, self.root_ = weights[:, 0], root * self.noise_
        return self

    def predict(self, x: Array) -> Array:
        """Forces (s, 1) (N)."""
        return predict_rows(x, 4, lambda known: self.force(known)[0][:, None])

    def force(self, x: Array) -> tuple[Array, Array]:
        """Forces (s,) (N) and their spreads (s,), of calibration and noise together (N)."""
        fitted(self, 'weights_')
        terms = self._terms(x)
        force = np.exp(np.minimum(terms @ self.weights_, self.most_))
        spread = terms @ self.root_.T
        noise = self.noise_**2 * (1 + self._reading(x) ** 2)
        sigma = np.sqrt(noise + np.einsum('sp,sp->s', spread, spread))
        return force, force * sigma

    def stated(self, x: Array) -> tuple[Array, Array]:
        """Forces (s, 1) and spreads of their errors (s, 1) (N)."""
        force, spread = self.force(x)
        return force[:, None], spread[:, None]

    def _learn(
        self, x: Array, target: Array, share: float, starts: tuple[tuple[float, ...], ...]
    ) -> tuple[float, Array]:
        """Evidence and prior at a share of the series resistance, which is set."""
        self.series_ = share
        level = self._logarithm(x)
        low, high = float(level.min()), float(level.max())
        half = max((high - low) / 2, 1e-3)
        self.range_ = np.array([(low + high) / 2, half, -1.0 - BEYOND, 1.0 + BEYOND])
        self._set_reading(level, target[:, 0])
        moments = Moments.of(self._terms(x), target, 1 / (1 + self._reading(x) ** 2))

        def cost(prior: Array) -> float:
            doubt = (np.array(SURENESS) * (prior - np.array(EXPECTED)) ** 2).sum()
            return float(doubt - moments.evidence(_spread(prior)))

        best, least = np.array(starts[0]), cost(np.array(starts[0]))
        for start in starts if len(target) >= FEWEST else ():
            simplex = np.array(start) + np.concatenate([np.zeros((1, 4)), np.diag(STEP)])
            trials = TRIALS // (4 if len(starts) == 1 else 1)
            options = {'maxfev': trials, 'initial_simplex': simplex, 'fatol': 0.02}
            found = minimize(cost, start, method='Nelder-Mead', options=options)
            if found.fun < least:
                best, least = np.asarray(found.x), float(found.fun)
        return -least, best

    def _set_reading(self, level: Array, target: Array) -> None:
        """How much the divider's noise moves the force's logarithm, over its other spread."""
        self.reading_ = 0.0
        if len(target) >= FEWEST and self.noise > 0.0 and np.ptp(level) > 0:
            steep = np.polyfit(level, target, 1)
            rough = float(np.std(target - np.polyval(steep, level)))
            self.reading_ = self.noise * abs(float(steep[0])) / (FINER * rough + 1e-3)

    def _reading(self, x: Array) -> Array:
        """Spread (s,) by the divider's noise, over the rest: more where the curve is flat."""
        film = np.maximum(x[:, 2] - self.series_ * x[:, 3], 1e-6)
        return np.asarray(self.reading_ * np.minimum((1 + x[:, 2]) ** 2 / film, 1e6))

    def _logarithm(self, x: Array) -> Array:
        """Logarithm of the film's resistance (s,), over that of the divider."""
        film = x[:, 2] - self.series_ * x[:, 3]
        return np.log(np.maximum(film, np.maximum(0.02 * x[:, 2], 1e-6)))

    def _terms(self, x: Array) -> Array:
        """Terms (s, p): powers of the logarithm, and products with cosines of place."""
        middle, half, low, high = self.range_
        level = (self._logarithm(x) - middle) / half
        inside = np.minimum(np.maximum(level, low), high)[:, None]
        angle = np.minimum(np.maximum(x[:, :2], -0.1), 1.1)[:, :, None] * _ANGLES
        waves = np.cos(angle)
        table = (waves[:, 0, :, None] * waves[:, 1, None, :]).reshape(len(x), -1)[:, _ALL]
        rising = inside**_POWERS
        return np.concatenate([rising[:, :BENDS], table * rising[:, _BEND]], axis=1)


def _spread(prior: Array) -> Array:
    """Prior spread (p,) of each term over the noise, from logarithms of sizes and smoothness."""
    size = np.exp(np.clip(prior[:3], -12.0, 9.0))[_BEND]
    length = np.exp(np.clip(prior[3], -2.0, 3.0))
    fading = 1.0 / (1.0 + (_FREQUENCY / length) ** 2) ** 1.5
    same = np.array([PRIOR[min(i, 2)] for i in range(BENDS)]) * np.array([1e3, 1e3, 1.0, 1.0])
    return np.concatenate([same[:BENDS], size * fading])


_COUNT = max(WAVES)
_GAP = 1.25  # half period of the slowest cosine over the sheet, so that its slope is free there
_ANGLES = np.pi / _GAP * np.arange(_COUNT)
_POWERS = np.arange(max(BENDS, len(WAVES)))


def _chosen() -> tuple[Integers, Integers, Array]:
    """Entry in the table of products, coefficient, and frequency of each varying term."""
    entry, bend, frequency = [], [], []
    for power, waves in enumerate(WAVES):
        for i in range(waves):
            for j in range(waves):
                if 0 < i + j < waves + waves // 2:
                    entry.append(i * _COUNT + j)
                    bend.append(power)
                    frequency.append(float(np.hypot(i, j)))
    return np.array(entry), np.array(bend), np.array(frequency)


_ALL, _BEND, _FREQUENCY = _chosen()
