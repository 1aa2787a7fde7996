"""Place and tilt of a disc magnet from what pixels see beside a uniform field.

Gauss-Newton steps on the tabulated field of the disc [3], after the projection that a uniform
field does not pass. What the config only starts from (gap, remanence, where the disc rests, the
tilt that comes with a shift, gains of the channels) is found from recordings alone, without a
truth: pixels see more numbers than a disc has freedoms, and over many frames those freedoms are
eliminated from the normal equations (Golub and Pereyra, Inverse Problems 19, 2003).
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.estimators.disc_model import (
    CROSSED,
    GEOMETRY,
    OFFSETS,
    REMANENCE,
    RIGHT,
    WEAKENING,
    WEAKER,
    DiscModel,
    disc_row,
    heats,
)
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge, times
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array

CALMER, WILDER, DAMPING, LONGEST = 0.2, 8.0, 1e-3, 0.25
# both ways often end in one minimum: rounding must not choose between them
CLEARLY = 1 - 1e-6


@compiled
def solved(normal: Array, pull: Array, damping: float, matrix: Array, move: Array) -> None:
    """Solve (normal + damping of its diagonal) move = pull by Cholesky."""
    size = len(pull)
    for i in range(size):
        for k in range(i + 1):
            total = normal[i, k]
            if i == k:
                total *= 1 + damping
            for j in range(k):
                total -= matrix[i, j] * matrix[k, j]
            matrix[i, k] = math.sqrt(total) if i == k else total / matrix[k, k]
    for i in range(size):
        total = pull[i]
        for j in range(i):
            total -= matrix[i, j] * move[j]
        move[i] = total / matrix[i, i]
    for i in range(size - 1, -1, -1):
        total = move[i]
        for j in range(i + 1, size):
            total -= matrix[j, i] * move[j]
        move[i] = total / matrix[i, i]


@compiled
def missed(
    row: Array, seen: Array, rest: Array, projection: Array, sigma: float, error: Array
) -> float:
    """Differences (m,) that readings do not explain, over sigma; the sum of their squares."""
    total = 0.0
    for m in range(projection.shape[1]):
        left = 0.0
        for n in range(len(row)):
            left += (row[n] - (seen[n] - rest[n])) * projection[n, m]
        error[m] = left / sigma
        total += error[m] * error[m]
    return total


@compiled
def normals(
    place: Array, steep: Array, projection: Array, sigma: float, prior: Array, error: Array,
    normal: Array, pull: Array,
) -> None:  # fmt: skip
    """Normal equations (u, u) and their right side (u,) at a place."""
    unknowns = len(place)
    normal[:] = 0.0
    for k in range(unknowns):
        normal[k, k], pull[k] = prior[k], -prior[k] * place[k]
    inner = np.empty(unknowns)
    for m in range(projection.shape[1]):
        for k in range(unknowns):
            inner[k] = 0.0
            for n in range(len(steep)):
                inner[k] += projection[n, m] * steep[n, k]
            inner[k] /= sigma
        for i in range(unknowns):
            pull[i] += inner[i] * error[m]
            for k in range(i + 1):
                normal[i, k] += inner[i] * inner[k]


@compiled
def descend_row(
    row: Array, warm: float, place: Array, sigma: float, steps: int, disc: Array, pixels: Array,
    axes: Array, table: Array, grid: Array, rest: Array, projection: Array, prior: Array,
    least: Array, most: Array, error: Array, work: Array,
) -> float:  # fmt: skip
    """Move a place by damped steps; what is left over sigma, and the sum of its squares."""
    unknowns, channels = len(place), len(row)
    slope, seen, steep = np.empty((3, 5)), np.empty(channels), np.empty((channels, unknowns))
    steeper, trial, miss = np.empty((channels, unknowns)), np.empty(unknowns), np.empty(len(error))
    normal, matrix = np.empty((unknowns, unknowns)), np.empty((unknowns, unknowns))
    pull, move = np.empty(unknowns), np.empty(unknowns)
    damping = DAMPING
    disc_row(place, warm, disc, pixels, axes, table, grid, work, slope, seen, steep)
    square = missed(row, seen, rest, projection, sigma, error)
    cost = square
    for k in range(unknowns):
        cost += prior[k] * place[k] * place[k]
    normals(place, steep, projection, sigma, prior, error, normal, pull)
    for _ in range(steps):
        solved(normal, pull, damping, matrix, move)
        longest = np.abs(move).max()
        share = min(1.0, LONGEST / max(longest, 1e-12))
        for k in range(unknowns):
            trial[k] = min(max(place[k] + move[k] * share, least[k]), most[k])
        disc_row(trial, warm, disc, pixels, axes, table, grid, work, slope, seen, steeper)
        found = missed(row, seen, rest, projection, sigma, miss)
        price = found
        for k in range(unknowns):
            price += prior[k] * trial[k] * trial[k]
        if price <= cost * (1 + 1e-9):
            cost, square, damping = price, found, damping * CALMER
            place[:], error[:] = trial, miss
            normals(place, steeper, projection, sigma, prior, error, normal, pull)
        else:
            damping *= WILDER
    return square


@compiled
def descend_rows(
    rows: Array, warm: Array, places: Array, sigma: Array, steps: int, disc: Array, pixels: Array,
    axes: Array, table: Array, grid: Array, rest: Array, projection: Array, prior: Array,
    least: Array, most: Array, errors: Array,
) -> None:  # fmt: skip
    """Move places (s, u) of readings (s, n) by damped steps; errors over sigma (s, m)."""
    work = np.empty((10, 3))
    for s in range(len(rows)):
        descend_row(
            rows[s], warm[s], places[s], sigma[s], steps, disc, pixels, axes, table, grid, rest,
            projection, prior, least, most, errors[s], work,
        )  # fmt: skip


@compiled
def find_rows(
    rows: Array, warm: Array, places: Array, noise: float, right: float, steps: int, many: int,
    doubt: float, disc: Array, pixels: Array, axes: Array, table: Array, grid: Array, rest: Array,
    projection: Array, prior: Array, least: Array, most: Array, errors: Array, lefts: Array,
) -> None:  # fmt: skip
    """Places (s, u) of readings (s, n) from where they begin; again from rest where in doubt.

    What they leave unexplained goes into differences (s, m) and readings (s, n).
    """
    work, slope, unknowns = np.empty((10, 3)), np.empty((3, 5)), places.shape[1]
    seen, steep = np.empty(rows.shape[1]), np.empty((rows.shape[1], unknowns))
    other, miss = np.empty(unknowns), np.empty(errors.shape[1])
    for s in range(len(rows)):
        square = 0.0
        for n in range(rows.shape[1]):
            square += rows[s, n] * rows[s, n]
        if not math.isfinite(square):
            places[s, :], errors[s, :], lefts[s, :] = np.nan, np.nan, np.nan
            continue
        sigma = math.hypot(noise, right * math.sqrt(square / rows.shape[1]))
        for k in range(unknowns):
            places[s, k] = min(max(places[s, k], least[k]), most[k])
        cost = descend_row(
            rows[s], warm[s], places[s], sigma, steps, disc, pixels, axes, table, grid, rest,
            projection, prior, least, most, errors[s], work,
        )  # fmt: skip
        if cost > doubt:
            other[:] = 0.0
            again = descend_row(
                rows[s], warm[s], other, sigma, many, disc, pixels, axes, table, grid, rest,
                projection, prior, least, most, miss, work,
            )  # fmt: skip
            if again < CLEARLY * cost:
                places[s, :], errors[s, :] = other, miss
        disc_row(places[s], warm[s], disc, pixels, axes, table, grid, work, slope, seen, steep)
        for n in range(len(seen)):
            lefts[s, n] = rows[s, n] - (seen[n] - rest[n])
        for m in range(errors.shape[1]):
            errors[s, m] *= sigma


MOST_ROWS = 300
ROUNDS = 8
STEPS, FEW_STEPS = 14, 4
SIMULATED, WIDER = 800, 0.1
DOUBT = 4.0


class DiscInversion(DiscModel):
    """Find where a disc is from differences of pixels.

    Parameters and what was found are those of `DiscModel`.

    Attributes
    ----------
    start_ : PolynomialRidge or None
        Where to begin, learned from the model; None before a fit.
    """

    cost_: float  # squares that the fit left over
    unsure_: Array  # (9 + 5 n, 9 + 5 n) covariance of what was found
    start_: PolynomialRidge | None = None
    doubt_: float = np.inf  # squares left over, beyond which a row is begun again from rest

    def fit(
        self, change: Array, warm: Array | None = None, drift: Array | None = None
    ) -> DiscInversion:
        """Find what the config is uncertain of from readings alone.

        Parameters
        ----------
        change : ndarray, shape (s, n)
            As in `invert` (T).
        warm : ndarray, shape (s,), or None
            Temperatures of the disc, in a unit of the caller's, from that at which it has its
            remanence; None: always there.
        drift : ndarray, shape (s, 2), or None
            How readings follow the offsets of their channels; None: offsets are none.

        Returns
        -------
        DiscInversion
            Itself. Its places are those of readings less `drift` times `offset`.
        """
        rows, heat, drift = _some(change, warm, drift)
        self.rest_ = None
        self._set(np.zeros_like(self.found_))
        self._find(rows, heat, drift)
        rows = rows - drift @ self.offset
        self.rest_ = self._absolute(np.zeros((1, 3)), np.zeros(1))[0]
        vars(self).pop('_offset', None)
        place, miss = self._descend(rows, heat, np.zeros((len(rows), self.unknowns)), STEPS)
        self._learn_starts(place)
        self.doubt_ = DOUBT * float(np.quantile((miss**2).sum(axis=1), 0.99)) + 25.0
        return self

    def warmed(self, rise: float) -> Array:
        """What a disc at rest that is warmer by a unit, and higher by gaps, changes (n,) (T)."""
        place = np.array([[0.0, 0.0, rise]])
        warm, usual = self.field(place, np.ones(1))[0], self.field(0 * place, np.zeros(1))[0]
        return np.asarray(warm[0] - usual[0])

    def fields(self, place: Array, heat: Array) -> Array:
        """Readings (s, n) (T) of the disc at places (s, 3), nothing taken off."""
        return self.field(place, heat)[0] + self._offset

    def unsure_warmth(self, ways: Array) -> Array:
        """Covariance (2 m + 1, 2 m + 1) of drifts along ways (n, m) (T), and of weakening (1)."""
        count, wide = ways.shape
        taken = np.zeros((2 * wide + 1, len(self.found_)))
        drifts = np.einsum('k,nm,kl->kmln', OFFSETS, ways, np.eye(2))
        taken[:-1, self._offsets :] = drifts.reshape(2 * wide, 2 * count)
        taken[-1, WEAKENING] = WEAKER
        return np.asarray(taken @ self.unsure_ @ taken.T)

    def weaken(self, size: float) -> None:
        """Take another change of remanence with temperature."""
        found = self.found_.copy()
        found[WEAKENING] = size
        self._set(found)

    def leaves(self, change: Array, warm: Array, drift: Array | None = None) -> float:
        """How badly the best of such models explains readings, beginning from what was found.

        A difference of 20 between two temperatures is clear: twice the logarithm of a likelihood.
        """
        freedoms = min(len(change), MOST_ROWS) * (self.projection_.shape[1] - self.unknowns)
        self._find(*_some(change, warm, drift))
        return float(freedoms * np.log(self.cost_))

    def _find(self, rows: Array, heat: Array, drift: Array) -> None:
        """Find what the config is uncertain of."""
        place = np.zeros((len(rows), self.unknowns))
        sigma = self._sigma(rows)
        best, least = self.found_, np.inf
        for turn in range(ROUNDS):
            read = rows - drift @ self.offset
            place, _ = self._descend(read, heat, place, STEPS if turn == 0 else 3)
            slopes, error = self._slopes(read, heat, place, drift)
            left = float(np.minimum((error / sigma) ** 2, 25.0).sum())
            cost = left + float(self.found_ @ self.found_)
            if cost > 0.999 * least:
                break
            best, least, self.cost_ = self.found_, cost, left
            move, self.unsure_ = self._step(slopes, error, place, heat, sigma)
            self._set(best + move)
        self._set(best)

    def _learn_starts(self, place: Array) -> None:
        """Learn where to begin, from the model itself around places (s, 3 or 5)."""
        low, high = place.min(axis=0), place.max(axis=0)
        room = WIDER * (high - low) + 0.02
        random = np.random.default_rng(0).uniform(size=(SIMULATED, self.unknowns))
        trial = low - room + random * (high - low + 2 * room)
        trial = self._inside(trial)
        self.start_ = PolynomialRidge((3,)).fit(self.field(trial)[0] @ self.projection_, trial)

    def _slopes(self, rows: Array, heat: Array, place: Array, drift: Array) -> tuple[Array, Array]:
        """How differences change with what is to be found (s, m, p), and their errors (s, m)."""
        seen, _ = self.field(place, heat)
        start, step, count = self.found_, 1e-4, self.projection_.shape[1]
        slopes = np.empty((len(rows), count, len(start)))
        for i in range(GEOMETRY):
            self._set(start + step * np.eye(len(start))[i])
            slopes[..., i] = (self.field(place, heat)[0] - seen) @ self.projection_ / step
        self._set(start)
        crossing = self._crossing(place, heat).reshape(len(rows), count, -1)
        slopes[..., GEOMETRY : self._offsets] = crossing
        follows = np.einsum('sk,nm->smkn', drift * OFFSETS, self.projection_)
        slopes[..., self._offsets :] = follows.reshape(len(rows), count, -1)
        return slopes, (rows - seen) @ self.projection_

    def _crossing(self, place: Array, heat: Array) -> Array:
        """How differences change with gains and crossed axes, shape (s, m, n, 3)."""
        field = self._fields(place, heat)
        if not self.absolute_:
            field = field - self._fields(np.zeros((1, 3)), np.zeros(1))
        size = CROSSED * float(self.disc[3] * (1 + REMANENCE * self.found_[1]))
        field = size * np.repeat(field, len(self.axes) // len(self.pixels), axis=1)
        return np.asarray(np.einsum('nm,sni->smni', self.projection_, field))

    def _step(
        self, slopes: Array, error: Array, place: Array, heat: Array, sigma: Array
    ) -> tuple[Array, Array]:
        """Change of what is to be found, after places are eliminated, and its covariance."""
        inner = self._inner(place, heat) / sigma[..., None]
        slopes, error = slopes / sigma[..., None], error / sigma
        trust = 1 / np.maximum(1.0, (error**2).mean(axis=1) / 9)
        normal = np.einsum('smi,smj->sij', inner, inner) + np.diag(self._prior())
        across = np.einsum('smi,smp->sip', inner, slopes)
        solved = np.linalg.solve(normal, across)
        own = slopes - np.einsum('smi,sip->smp', inner, solved)
        left = np.einsum('s,smp,smq->pq', trust, own, slopes) + np.eye(slopes.shape[2])
        right = np.einsum('s,smp,sm->p', trust, own, error) - self.found_
        cov = np.linalg.inv(left)
        return np.asarray(cov @ right), cov

    def _inner(self, place: Array, heat: Array) -> Array:
        """Change of differences with places and tilts, shape (s, m, 3 or 5)."""
        slope = self.field(place, heat)[1]
        return np.asarray(np.einsum('nm,sni->smi', self.projection_, slope))

    def _descend(self, rows: Array, heat: Array, place: Array, steps: int) -> tuple[Array, Array]:
        """Places and errors over sigma (s, m) after damped steps: Marquardt, J. SIAM 11, 1963."""
        place, error = place.copy(), np.empty((len(rows), self.projection_.shape[1]))
        (geometry, axes), (prior, least, most) = self._model, self._bounds
        descend_rows(
            np.ascontiguousarray(rows), heat, place, self._sigma(rows)[:, 0], steps, geometry,
            self.pixels, axes, self.table, self.grid, self._offset, self.projection_, prior,
            least, most, error,
        )  # fmt: skip
        return place, error

    def invert(self, change: Array, warm: Array | None = None) -> tuple[Array, Array]:
        """Places and what they leave unexplained.

        Parameters
        ----------
        change : ndarray, shape (s, n)
            Readings, less those at rest unless they are absolute (T).
        warm : ndarray, shape (s,), or None
            As in the fit.

        Returns
        -------
        place : ndarray, shape (s, 3 or 5)
            Shift in gaps, and tilt (rad); NaN where a reading is.
        rest : ndarray, shape (s, m)
            Differences that it does not explain (T).
        """
        return self.explain(change, warm)[:2]

    def explain(self, change: Array, warm: Array | None = None) -> tuple[Array, Array, Array]:
        """Place and rest as in `invert`, and readings (s, n) (T) less those of the disc there."""
        heat = heats(change, warm)
        rows = np.ascontiguousarray(change)
        if self.start_ is None:
            near, steps = np.zeros((len(rows), self.unknowns)), STEPS
        else:
            near, steps = self.start_.predict(times(rows, self.projection_)), FEW_STEPS
        rest, left = np.empty((len(rows), self.projection_.shape[1])), np.empty(rows.shape)
        (geometry, axes), (prior, least, most) = self._model, self._bounds
        find_rows(
            rows, heat, near, self.sigma_, RIGHT, steps, STEPS, self.doubt_, geometry,
            self.pixels, axes, self.table, self.grid, self._offset, self.projection_, prior,
            least, most, rest, left,
        )  # fmt: skip
        return near, rest, left


def _some(change: Array, warm: Array | None, drift: Array | None) -> tuple[Array, Array, Array]:
    """Rows that suffice for a fit, their temperatures and how they follow offsets."""
    chosen = np.linspace(0, len(change) - 1, min(len(change), MOST_ROWS)).astype(int)
    drift = np.zeros((len(change), 2)) if drift is None else drift
    return change[chosen], heats(change, warm)[chosen], drift[chosen]
