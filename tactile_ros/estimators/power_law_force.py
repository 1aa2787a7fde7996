# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Force of a touch on a resistive film by a power law whose factors vary smoothly over it [5].

The logarithm of the force over that of an air gap is linear in the logarithm of the film's
resistance R - Rx. Its offset and slope, and what the gap adds, are Gaussian processes over the
sheet with a Matern spectrum, of reduced rank: sums of cosines (A. Solin and S. Sarkka, Statistics
and Computing 30, 2020). Their sizes and length are chosen by evidence. What a wrong Rx adds, a
part of it and a constant, is the same all over the sheet.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.covariance import scale_by_groups
from tactile_ros.estimators.evidence_regression import HyperPrior, Moments, leave_groups_out
from tactile_ros.estimators.regression import fitted, training_rows
from tactile_ros.physics.resistive_sheet import SeriesResistance
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from tactile_ros.estimators.evidence_regression import Prior

WIDTH = 1.25  # half period of the slowest cosine over the sheet, so that slopes are free there
MOST_WAVES = 16
WAVES = np.array([MOST_WAVES, MOST_WAVES, 7])  # at most, along an axis, of each field
DENSE = 1.3  # waves along an axis over touches along it
FIELDS = 3  # of a constant, the film's logarithm, and the film
# logs of the prior sigmas of what is the same all over: of the fields, a constant and a part of Rx
MEAN = np.log([10.0, 2.0, 0.3, 0.3, 0.1])
ORDER = 2.5  # of the Matern kernel: smoother ones understate what is between touches (Stein 1999)
# logs of the fields' sizes, of their length over the longer edge, and of the size of a part
# without length over that of the rest
HYPER = HyperPrior(np.log([0.15, 0.05, 0.05, 0.25, 0.1]), np.array([1.2, 1.2, 1.5, 0.6, 1.0]))
GAPS = (0.0, 0.3, 0.6, 0.8, 0.9)  # of the lightest force
CREEP = math.log(0.03)  # log of the prior sigma of a further feature: a film creeps by percents
UNKNOWN_NOISE = 0.01
FLATTEST = -0.2  # slope of the logarithm of force over that of the film
FEWEST, MOST_ROWS = 12, 3000
BEYOND = 0.15  # of the range of the film's logarithm, in which the curve goes on
LEAST_FILM = 0.02  # of R
LEAST_FORCE = 1e-6  # N
MOST_ERROR = 5.0  # of the logarithm of a held-out force
CORNER = 1.14  # products of two fast cosines are left out
MORE = 0.4  # logarithm of the largest answer over the largest force of the fit
CHOSEN = ('waves_', 'hyper_', 'gap_', 'steep_')
CELLS = 41  # along an edge, in which the variance of the calibration is tabulated
LEVELS = 3


class PowerLawForce:
    """Logarithm of force by that of the film's resistance, with smoothly varying factors.

    Features are x and y in units of the sheet's edges (0 to 1), the resistance R in units of the
    divider's R0, and any further ones in which the logarithm of the force is linear, such as what
    a film has crept; targets are forces above 0.

    Parameters
    ----------
    noise : float
        Standard deviation of the divider's reading R0 / (R0 + R); 0: unknown.
    size : ndarray, shape (2,), or None
        Edges of the sheet; None: a square.
    series : SeriesResistance or None
        Nominal Rx over R0; None: 0.
    """

    waves_: Array  # (3, 2) number of cosines of each field along x and y
    hyper_: Array  # (5,) hyperparameters
    gap_: float  # force that the air gap takes (N)
    steep_: float  # slope of the logarithm of force over that of the film, all over the sheet
    film_: Array  # (3,) least and largest film over R0, and the middle of its logarithm
    table_: Array  # (n n, 3) factors of cosines of the fields
    wrong_: Array  # (2,) of a constant and of a part of Rx, over the film
    linear_: Array  # (m,) weights of the further features
    linear_covariance_: Array  # (m, m) theirs
    noise_: Array  # (2,) variance of the divider over the squared film, or of an unknown noise
    cells_: Array  # (g, g, 3) log variance of the calibration, by powers of the film's logarithm
    most_: float  # logarithm of the largest answer

    def __init__(
        self, noise: float = 0.0, size: Array | None = None, series: SeriesResistance | None = None
    ) -> None:
        self.noise = noise
        self.size = np.ones(2) if size is None else np.asarray(size, np.float64)
        self.series = SeriesResistance(self.size, 1.0, 0.0) if series is None else series

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PowerLawForce:
        """Learn from features (s, 3..) and forces (s, 1) (N); rows without force are left out."""
        rows = training_rows(x, y, groups)
        self.fit_held_out(rows.x, rows.y, rows.groups)
        return self

    def fit_held_out(
        self, x: Array, y: Array, groups: Integers, like: PowerLawForce | None = None
    ) -> tuple[Array, Array]:
        """Fit, and return errors (s,) (N) and variances (s,) (N2) without each row's group.

        Rows are as in `fit`, and finite; those without force or beyond `MOST_ROWS` give NaN.
        Hyperparameters are those of `like`, where there is one, rather than chosen.
        """
        there = np.flatnonzero((y[:, 0] > 0) | (y[:, 0] <= 0).all())
        there = there[np.linspace(0, len(there) - 1, min(len(there), MOST_ROWS)).astype(np.int64)]
        x, force, groups = x[there], y[there, 0], groups[there]
        if like is None:
            self._choose(x, np.maximum(force, LEAST_FORCE), len(np.unique(groups)))
        else:
            vars(self).update({name: getattr(like, name) for name in CHOSEN})
        net = np.maximum(force - self.gap_, LEAST_FORCE)
        moments, _, terms, scatter = self._moments(x, net)
        weights, root, noise = moments.solve(np.exp(self._prior(x.shape[1] - 3)(self.hyper_)[0]))
        noise = max(moments.left(weights, root), noise, 1e-9)
        self._keep(weights[:, 0], noise * root, x.shape[1] - 3)
        self.noise_ = np.array([0.0, noise**2 * UNKNOWN_NOISE**2])
        if self.noise > 0:
            self.noise_ = np.array([(noise * self.noise * self.steep_) ** 2, 0.0])
        self.most_ = float(np.log(net).max()) + MORE
        sigma = noise * np.sqrt(scatter)
        half = noise * (terms @ root.T) / sigma[:, None]
        off, variance = leave_groups_out(
            half, (np.log(net) - terms @ weights[:, 0]) / sigma, groups
        )
        estimate = net * np.exp(np.clip(-off * sigma, -MOST_ERROR, MOST_ERROR))
        errors, variances = np.full((2, len(y)), np.nan)
        scale = scale_by_groups(off * sigma, variance * sigma**2, sigma**2, groups)
        self.cells_[:, :, 0] += math.log(scale)
        errors[there] = estimate - net
        variances[there] = (1 + scale * variance) * (sigma * net) ** 2
        return errors, variances

    def predict(self, x: Array) -> Array:
        """Forces (s, 1) (N)."""
        return self.force(x)[0][:, None]

    def force(self, x: Array) -> tuple[Array, Array]:
        """Forces (s,) (N) for features (s, 3..), and variances (s,) by calibration and noise.

        The variance is relative to the square of the force over the gap.
        """
        fitted(self, 'cells_')
        places = np.clip(np.nan_to_num(x[:, :2]), 0.0, 1.0)
        series = self.series.at(x[:, :2])
        film = np.clip(x[:, 2] - series, *self.film_[:2])
        shapes = self._shapes(film)
        # no product of matrices: its sums run otherwise for one frame than for many
        total = np.einsum('sp,pk->sk', _cosines(places / WIDTH), self.table_)
        level = np.einsum('sk,sk->s', total, shapes)
        level += self.wrong_[0] * self.film_[0] / film + self.wrong_[1] * series / film
        level += np.einsum('sm,m->s', x[:, 3:], self.linear_[: x.shape[1] - 3])
        a, b = (places * (CELLS - 1) + 0.5).astype(np.int64).T
        known = np.einsum('sl,sl->s', self.cells_[a, b], shapes[:, 1:2] ** np.arange(LEVELS))
        ratio = np.square((1.0 + x[:, 2]) ** 2 / film)
        variance = self.noise_[0] * ratio + self.noise_[1] + np.exp(known)
        return np.exp(np.minimum(level, self.most_)) + self.gap_, variance

    def _choose(self, x: Array, force: Array, places: int) -> None:
        """Choose waves, gap and hyperparameters by evidence of touches at places."""
        extent = np.maximum(np.ptp(x[:, :2], axis=0), 0.05) * self.size
        step = float(np.sqrt(np.prod(extent) / max(places, 1)))
        count = np.round(DENSE * WIDTH * self.size / step) + 1
        self.waves_ = np.clip(count, np.minimum(4, WAVES)[:, None], WAVES[:, None])
        self.hyper_ = HYPER.mean
        self.gap_, self.steep_ = 0.0, -1.0
        if len(force) < FEWEST:
            return
        found = []
        for share in GAPS:
            self.gap_, self.steep_ = share * float(force.min()), -1.0
            film, net = np.log(self._film_of_fit(x)), np.log(force - self.gap_)
            if np.ptp(film) > 1e-6:
                self.steep_ = min(float(np.polyfit(film, net, 1)[0]), FLATTEST)
            moments, volume, _, _ = self._moments(x, force - self.gap_)
            prior = self._prior(x.shape[1] - 3)(self.hyper_)[0]
            found.append((moments.evidence(np.exp(prior))[0] + volume, self.gap_, self.steep_))
        _, self.gap_, self.steep_ = max(found)
        moments = self._moments(x, force - self.gap_)[0]
        self.hyper_ = HYPER.maximise(moments, self._prior(x.shape[1] - 3))

    def _moments(self, x: Array, net: Array) -> tuple[Moments, float, Array, Array]:
        """Moments of forces over the gap, log volume of their weights, terms and scatter (s,)."""
        film, scatter = self._film_of_fit(x), self._scatter(x)
        target = np.log(net)[:, None]
        terms = self._terms(x[:, :2], film, x[:, 3:])
        volume = -0.5 * float(np.log(scatter).sum()) - float(target.sum())
        return Moments.of(terms, target, 1 / scatter), volume, terms, scatter

    def _film_of_fit(self, x: Array) -> Array:
        """Film (s,) over R0 of the rows of a fit, which sets the range."""
        film = x[:, 2] - self.series.at(x[:, :2])
        level = np.log(np.maximum(film, np.maximum(LEAST_FILM * x[:, 2], 1e-6)))
        low, high = float(level.min()), float(level.max())
        more = BEYOND * max((high - low) / 2, 1e-3)
        self.film_ = np.array([np.exp(low - more), np.exp(high + more), (low + high) / 2])
        return np.clip(film, self.film_[0], self.film_[1])

    def _scatter(self, x: Array) -> Array:
        """Variance (s,) of the logarithm of a force about the curve of its place."""
        if self.noise <= 0:
            return np.full(len(x), UNKNOWN_NOISE**2)
        ratio = (1.0 + x[:, 2]) ** 2 / self._film_of_fit(x)
        return np.asarray((self.noise * self.steep_ * ratio) ** 2)

    def _terms(self, places: Array, film: Array, linear: Array) -> Array:
        """Terms (s, p): what is the same all over, the fields, and the further features."""
        shapes = self._shapes(film)
        cosines = _cosines(np.clip(places, 0.0, 1.0) / WIDTH)
        fields = [shapes[:, k, None] * cosines[:, self._entries(k)] for k in range(FIELDS)]
        wrong = np.stack([self.film_[0] / film, self.series.at(places) / film], axis=1)
        return np.concatenate([shapes, wrong, *fields, linear], axis=1)

    def _shapes(self, film: Array) -> Array:
        """Shapes (s, 3) of the curve of a film (s,), one of each field."""
        level = np.log(film) - self.film_[2]
        return np.stack([np.ones_like(level), level, film / self.film_[1]], axis=1)

    def _entries(self, field: int) -> Integers:
        """Products of cosines of a field, numbered as `_cosines` has them."""
        wave, (along, across) = np.arange(MOST_WAVES), self.waves_[field]
        used = np.hypot(wave[:, None] / along, wave / across) < CORNER
        used &= (wave[:, None] < along) & (wave < across)
        used[0, 0] = False
        return np.flatnonzero(used.ravel())

    def _prior(self, linear: int) -> Prior:
        """Prior of the terms with some further features."""
        steps = math.pi / WIDTH * np.arange(MOST_WAVES)[:, None] * (self.size.max() / self.size)
        speed = np.hypot(steps[:, None, 0], steps[None, :, 1]).ravel()
        speeds = [speed[self._entries(field)] for field in range(FIELDS)]

        def prior(theta: Array) -> tuple[Array, Array]:
            levels, slopes = [MEAN], [np.zeros((len(theta), len(MEAN)))]
            for field, own in enumerate(speeds):
                square = (own * math.exp(theta[FIELDS])) ** 2 / (2 * ORDER)
                share = (1 + square) ** -(ORDER + 1)
                share /= share.sum() + 1e-300
                fine = math.exp(2 * theta[FIELDS + 1]) / max(len(own), 1)
                change = np.zeros((len(theta), len(own)))
                steep = -2 * (ORDER + 1) * square / (1 + square)
                change[FIELDS] = 0.5 * share / (share + fine) * (steep - share @ steep)
                change[FIELDS + 1] = fine / (share + fine)
                change[field] = 1.0
                levels.append(theta[field] + 0.5 * np.log(share + fine))
                slopes.append(change)
            levels.append(np.full(linear, CREEP))
            slopes.append(np.zeros((len(theta), linear)))
            return np.concatenate(levels), np.concatenate(slopes, axis=1)

        return prior

    def _keep(self, weights: Array, root: Array, linear: int) -> None:
        """Keep weights (p,) and the variance by the root (p, p) of their covariance as tables."""
        table, at = np.zeros((MOST_WAVES**2, FIELDS)), len(MEAN)
        for field in range(FIELDS):
            entries = self._entries(field)
            table[entries, field] = weights[at : at + len(entries)]
            table[0, field] = weights[field]
            at += len(entries)
        self.table_ = table
        self.wrong_, self.linear_ = weights[FIELDS : len(MEAN)], weights[at:]
        self.linear_covariance_ = root[:, at:].T @ root[:, at:]
        line = np.linspace(0.0, 1.0, CELLS)  # middles of the cells over the sheet's edges
        grid = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1).reshape(-1, 2)
        low, high, middle = self.film_
        levels, found = np.linspace(np.log(low), np.log(high), LEVELS) - middle, []
        for level in levels:
            film = np.full(len(grid), np.exp(level + middle))
            half = self._terms(grid, film, np.zeros((len(grid), linear))) @ root.T
            found.append(np.log(np.einsum('sp,sp->s', half, half) + 1e-300))
        powers = levels[:, None] ** np.arange(LEVELS)
        self.cells_ = np.linalg.solve(powers, np.array(found)).T.reshape(CELLS, CELLS, LEVELS)


def _cosines(places: Array) -> Array:
    """Products of cosines (s, n * n) at places (s, 2) in units of their half period."""
    angle = places[:, :, None] * (math.pi * np.arange(MOST_WAVES))
    waves = np.cos(angle)
    return np.asarray((waves[:, 0, :, None] * waves[:, 1, None, :]).reshape(len(places), -1))
