# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Place on a resistive sheet from its potentials, which are harmonic functions of the place.

The potentials of a homogeneous sheet obey Laplace's equation ([5] Eq. (1)), so that their values
along the border tell them everywhere. The border carries nearly all of the current: along a side
every excitation falls from one corner's potential to the next one's in the same way, as uneven as
the border is. What the sheet itself takes is a small harmonic polynomial of each potential, and an
uneven sheet adds products of sines that are 0 on the border. Weights are a Bayesian linear
regression; a frame is inverted by Gauss-Newton steps on the terms themselves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.evidence_regression import HyperPrior, Moments, leave_groups_out
from tactile_ros.estimators.regression import fitted, training_rows
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from tactile_ros.estimators.evidence_regression import Prior

ORDER = 8  # of the harmonic polynomials
WAVES = 3  # along an axis, 0 on the border
SINES = 20  # along a side
OWN = 2 * ORDER + 1 + WAVES**2  # terms of one potential; those of the border follow
TERMS = OWN + 4 * SINES
ENDS = ((0, 1), (1, 2), (3, 2), (0, 3))  # corners A B C D at both ends of AB, BC, DC and AD
FREE = 11.5  # log of the prior sigma over the noise of what may be anything
POLYNOMIAL_DECAY, WAVE_FALL = 0.6, 3.0
# logs of the prior sigmas over the noise: of the border's first sine, its power over the number
# of the sine, of a polynomial of order two, and of the slowest wave
HYPER = HyperPrior(np.array([6.0, 1.5, 2.0, 1.0]), np.array([2.0, 0.3, 2.0, 2.0]))
# pads in the corners shorten all sides at both ends: sines of a sawtooth, and of a rounded one
EVEN = np.arange(1.0, SINES + 1) * (np.arange(1, SINES + 1) % 2 == 0)
PADS = np.stack([np.where(EVEN > 0, 1 / np.maximum(EVEN, 1), 0.0), EVEN / SINES**2], axis=1)
SAME = 1e-5  # m: places as near to each other are one
LEAST_NOISE = 1e-9
CELLS = 41  # along an edge, in which the covariance of the calibration is tabulated
MARGIN = 0.075  # of the longer edge: answers end that far beyond what was touched
STEPS, CLOSE, LONGEST = 20, 1e-7, 0.25  # of Gauss-Newton; of an edge: last and longest step


@compiled
def write_terms(place: Array, size: Array, out: Array) -> None:
    """Write all terms at a place (2,) and their derivatives by x and y, out (3, m)."""
    scale = 2.0 / max(size[0], size[1])
    zx, zy = (place[0] - 0.5 * size[0]) * scale, (place[1] - 0.5 * size[1]) * scale
    re, im = 1.0, 0.0
    out[0, 0], out[1, 0], out[2, 0] = 1.0, 0.0, 0.0
    for n in range(1, ORDER + 1):
        steep = n * scale
        a, b = 2 * n - 1, 2 * n
        out[1, a], out[2, a] = steep * re, -steep * im
        out[1, b], out[2, b] = steep * im, steep * re
        re, im = re * zx - im * zy, re * zy + im * zx
        out[0, a], out[0, b] = re, im
    at = 2 * ORDER + 1
    for i in range(1, WAVES + 1):
        along = float(i * math.pi / size[0])
        for j in range(1, WAVES + 1):
            across = float(j * math.pi / size[1])
            sx, sy = math.sin(along * place[0]), math.sin(across * place[1])
            out[0, at] = sx * sy
            out[1, at] = along * math.cos(along * place[0]) * sy
            out[2, at] = across * math.cos(across * place[1]) * sx
            at += 1
    for side in range(4):
        i = side % 2  # axis along the side
        j = 1 - i
        inward = 1.0 if side in (0, 3) else -1.0
        t, depth = place[i] / size[i], place[j] / size[j]
        if inward < 0.0:
            depth = 1.0 - depth
        rate = math.pi * size[j] / size[i]
        s1, c1 = math.sin(math.pi * t), math.cos(math.pi * t)
        near, far, both = math.exp(-rate * depth), math.exp(-rate * (2.0 - depth)), 1.0
        s, c, inner, outer, twice = 0.0, 1.0, 1.0, 1.0, math.exp(-2.0 * rate)
        for n in range(1, SINES + 1):
            s, c = s * c1 + c * s1, c * c1 - s * s1
            inner, outer, both = inner * near, outer * far, both * twice
            fade = (inner - outer) / (1.0 - both)
            slope = -n * rate * (inner + outer) / (1.0 - both)
            out[0, at] = s * fade
            out[1 + i, at] = n * math.pi / size[i] * c * fade
            out[1 + j, at] = inward * slope * s / size[j]
            at += 1


@compiled
def newton_step(
    u: Array, weights: Array, size: Array, p: Array, terms: Array, slope: Array, step: Array
) -> float:
    """Write slopes (k, 2) of the potentials at p (2,) and the step to u (k,); return the det."""
    write_terms(p, size, terms)
    slope[:] = 0.0
    gx, gy, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(u)):
        off = u[k]
        for m in range(weights.shape[1]):
            off -= weights[k, m] * terms[0, m]
            slope[k, 0] += weights[k, m] * terms[1, m]
            slope[k, 1] += weights[k, m] * terms[2, m]
        gx, gy = gx + slope[k, 0] * off, gy + slope[k, 1] * off
        xx, yy = xx + slope[k, 0] ** 2, yy + slope[k, 1] ** 2
        xy += slope[k, 0] * slope[k, 1]
    det = max(xx * yy - xy * xy, 1e-6 * xx * yy) + 1e-300
    step[0], step[1] = (yy * gx - xy * gy) / det, (xx * gy - xy * gx) / det
    for k in range(len(u)):  # slopes become gains of the place
        a, b = slope[k]
        slope[k, 0], slope[k, 1] = (yy * a - xy * b) / det, (xx * b - xy * a) / det
    return float(det)


@compiled
def invert_rows(
    u: Array, size: Array, weights: Array, box: Array, noise: float, cells: Array, place: Array,
    cov: Array,
) -> None:  # fmt: skip
    """Write places (s, 2) and covariances (s, 2, 2) of potentials (s, k); NaN where one is NaN.

    `place` is where the descent starts; `noise` is the variance of a potential, `cells`
    (n, n, k, k) the covariance of the calibration over the sheet, `box` the attribute.
    """
    count, far = u.shape[1], cells.shape[0] - 1
    terms, gain, step = np.empty((3, weights.shape[1])), np.empty((count, 2)), np.empty(2)
    for s in range(len(u)):
        if not np.isfinite(u[s]).all():
            place[s], cov[s] = np.nan, np.nan
            continue
        p = place[s]
        for _ in range(STEPS):
            newton_step(u[s], weights, size, p, terms, gain, step)
            moved = 0.0
            for i in range(2):
                new = p[i] + min(max(step[i], -LONGEST * size[i]), LONGEST * size[i])
                new = min(max(new, box[0, i]), box[1, i])
                moved = max(moved, abs(new - p[i]) / size[i])
                p[i] = new
            if moved < CLOSE:
                break
        cell = cells[int(p[0] / size[0] * far + 0.5), int(p[1] / size[1] * far + 0.5)]
        cov[s] = 0.0
        for k in range(count):
            for m in range(count):
                own = cell[k, m] + (noise if k == m else 0.0)
                for i in range(2):
                    for j in range(2):
                        cov[s, i, j] += gain[k, i] * own * gain[m, j]


@dataclass(frozen=True)
class Replicates:
    """Mean potentials at places, which may be touched repeatedly."""

    places: Array  # (n, 2) (m)
    means: Array  # (n, k)
    within: float  # standard deviation of a row about its place's mean; 0: no place is repeated
    least: float  # standard deviation of a mean that follows
    index: Integers  # (s,) place of each row

    @classmethod
    def of(cls, places: Array, potentials: Array) -> Replicates:
        """Means over rows at places (s, 2) with potentials (s, k)."""
        _, index, count = np.unique(
            np.round(places / SAME), axis=0, return_inverse=True, return_counts=True
        )
        index = np.asarray(index).reshape(-1)
        if len(count) > 0.5 * len(places):
            return cls(places, potentials, 0.0, 0.0, np.arange(len(places)))
        both = np.column_stack([places, potentials])
        means = np.stack([np.bincount(index, column) / count for column in both.T], axis=1)
        free = (len(both) - len(count)) * potentials.shape[1]
        within = float(np.sqrt(((potentials - means[index, 2:]) ** 2).sum() / free))
        least = within * float(np.sqrt((1.0 / count).mean()))
        return cls(means[:, :2], means[:, 2:], within, least, index)


class PotentialMap:
    """Potentials as almost harmonic functions of place, inverted frame by frame.

    The sheet of `size` (2,) (m) has a corner at the origin.
    """

    hyper_: Array  # (4,) hyperparameters
    weights_: Array  # (k, m) of the terms
    start_: Array  # (k + 1, 2) linear map from potentials to place
    box_: Array  # (2, 2) least and largest place (m)
    noise_: float  # standard deviation of a potential
    cells_: Array  # (n, n, k, k) covariance of the calibration over the sheet

    def __init__(self, size: Array) -> None:
        self.size = np.asarray(size, np.float64)

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PotentialMap:
        """Learn from potentials (s, k) at places (s, 2) (m)."""
        rows = training_rows(x, y, groups)
        self._fit(rows.x, rows.y)
        return self

    def _fit(self, x: Array, y: Array) -> tuple[Replicates, Array, Array]:
        """Fit; return the places, their terms (k, n, p), and a root of the weights' covariance."""
        known = Replicates.of(y, x)
        elementary = self._terms(known.places)[:, 0]
        target = known.means.T.reshape(-1, 1)
        count = known.means.shape[1]
        z = 2 * (known.places - self.size / 2) / self.size
        bilinear = np.column_stack([np.ones(len(z)), z, z[:, 0] * z[:, 1]])
        signs = np.array([[1, -1, -1, 1], [1, 1, -1, -1], [1, 1, 1, 1], [1, -1, 1, -1]])
        corners = (signs @ np.linalg.lstsq(bilinear, known.means, rcond=None)[0]).T
        build = self._combination(corners)
        terms = np.einsum('nm,kmp->knp', elementary, build)
        moments = Moments.of(terms.reshape(len(target), -1), target)
        self.hyper_ = HYPER.maximise(moments, _prior_of(count), known.least)
        weights, root, _ = moments.solve(np.exp(_prior_of(count)(self.hyper_)[0]))
        self.weights_ = build @ weights[:, 0]
        mean_noise = max(moments.left(weights, root), known.least, LEAST_NOISE)
        self.noise_ = known.within or mean_noise
        root = mean_noise * root
        plane = np.column_stack([x, np.ones(len(x))])
        self.start_ = np.asarray(np.linalg.lstsq(plane, y, rcond=None)[0])
        margin = MARGIN * self.size.max()
        self.box_ = np.stack(
            [
                np.maximum(known.places.min(axis=0) - margin, 0.0),
                np.minimum(known.places.max(axis=0) + margin, self.size),
            ]
        )
        line = np.linspace(0.0, 1.0, CELLS)
        grid = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1).reshape(-1, 2)
        elementary = self._terms(np.clip(grid * self.size, *self.box_))[:, 0]
        half = np.einsum('nm,kmp->nkp', elementary, build) @ root.T
        self.cells_ = (half @ half.transpose(0, 2, 1)).reshape(CELLS, CELLS, count, count)
        return known, terms, root / mean_noise

    def predict(self, x: Array) -> Array:
        """Places (s, 2) (m) for potentials (s, k)."""
        return self.place(x)[0]

    def place(self, x: Array) -> tuple[Array, Array]:
        """Places (s, 2) (m), and covariances (s, 2, 2) by noise and calibration (m2)."""
        fitted(self, 'cells_')
        # no product of matrices: its sums run otherwise for one frame than for many
        place = np.einsum('sk,ki->si', x, self.start_[:-1]) + self.start_[-1]
        place = np.minimum(np.maximum(place, self.box_[0]), self.box_[1])
        covariance = np.empty((len(x), 2, 2))
        invert_rows(
            x, self.size, self.weights_, self.box_, self.noise_**2, self.cells_, place, covariance
        )
        return place, covariance

    def fit_held_out(self, x: Array, y: Array, groups: Integers) -> tuple[Array, Array]:
        """Fit, and return errors (s, 2) (m), with their covariances, without each row's group.

        Both are by linearisation.
        """
        known, terms, root = self._fit(x, y)
        first = np.zeros(len(known.places), np.int64)
        first[known.index] = groups
        count = x.shape[1]
        mean_noise = max(known.least, LEAST_NOISE) if known.within else self.noise_
        stacked, own = terms.reshape(-1, terms.shape[2]), np.tile(first, count)
        table = self._terms(known.places)
        fit = np.einsum('nm,km->nk', table[:, 0], self.weights_)
        off, variance = leave_groups_out(
            stacked @ root.T, (known.means - fit).T.ravel() / mean_noise, own
        )
        off, variance = (mean_noise * off.reshape(count, -1)).T, variance.reshape(count, -1).T
        slope = np.einsum('nim,km->nki', table[:, 1:], self.weights_)
        gain = np.linalg.pinv(slope)[known.index]
        u = off[known.index] + x - known.means[known.index]
        wide = self.noise_**2 + mean_noise**2 * variance[known.index]
        errors = np.einsum('sik,sk->si', gain, u)
        return errors, np.einsum('sik,sk,sjk->sij', gain, wide, gain)

    def _terms(self, places: Array) -> Array:
        """Terms and derivatives (n, 3, m) at places (n, 2)."""
        table = np.empty((len(places), 3, TERMS))
        for place, row in zip(places, table, strict=True):
            write_terms(place, self.size, row)
        return table

    def _combination(self, corners: Array) -> Array:
        """Terms of the weights that are fitted (k, m, p), by the corners' potentials (k, 4).

        Each potential has its own weights; those of the border's sines and pads are shared.
        """
        count = len(corners)
        build = np.zeros((count, TERMS, count * OWN + 4 * SINES + PADS.shape[1]))
        lengths = self.size.max() / self.size[[0, 1, 0, 1]]
        for k in range(count):
            own = np.arange(OWN)
            build[k, own, k * OWN + own] = 1.0
            for side, (first, last) in enumerate(ENDS):
                fall = corners[k, last] - corners[k, first]
                at = np.arange(SINES)
                rows, columns = OWN + side * SINES + at, count * OWN + side * SINES + at
                build[k, rows, columns] = fall
                build[k, rows, -PADS.shape[1] :] = fall * lengths[side] * PADS
        return build


def _prior_of(count: int) -> Prior:
    """Prior of the weights of `count` potentials."""
    order = np.array([0, *np.repeat(np.arange(1, ORDER + 1), 2)])
    waves = np.arange(1, WAVES + 1)
    speed = np.log((waves[:, None] ** 2 + waves**2).ravel() / 2.0)
    number = np.tile(np.log(np.arange(1.0, SINES + 1)), 4)
    own = len(order) + len(speed)
    size = count * own + len(number) + PADS.shape[1]

    def prior(theta: Array) -> tuple[Array, Array]:
        sine, fall, polynomial, wave = theta
        level, along = np.empty(size), np.zeros((4, size))
        bent = order >= 2
        first = np.where(bent, polynomial + (order - 2) * math.log(POLYNOMIAL_DECAY), FREE)
        level[: count * own] = np.tile(
            np.concatenate([first, wave - WAVE_FALL / 2 * speed]), count
        )
        along[2, : count * own] = np.tile(np.concatenate([bent, 0 * speed]), count)
        along[3, : count * own] = np.tile(np.concatenate([0 * order, 0 * speed + 1]), count)
        level[count * own :] = sine
        level[count * own : count * own + len(number)] -= fall * number
        along[0, count * own :] = 1.0
        along[1, count * own : count * own + len(number)] = -number
        return level, along

    return prior
