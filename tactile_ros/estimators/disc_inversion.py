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
    heats,
)
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge, times
from tactile_ros.physics.compiled import available, compiled
from tactile_ros.types import Array

CALMER, WILDER, DAMPING, LONGEST = 0.2, 8.0, 1e-3, 0.25
# both ways often end in one minimum: rounding must not choose between them
CLEARLY = 1 - 1e-6


@compiled
def lagrange(u: float) -> tuple[float, ...]:
    """Weights of four nodes at -1, 0, 1, 2, and their slopes."""
    a, b, c = u + 1, u - 1, u - 2
    return (
        -u * b * c / 6,
        a * b * c / 2,
        -a * u * c / 2,
        a * u * b / 6,
        -(b * c + u * c + u * b) / 6,
        (b * c + a * c + a * b) / 2,
        -(u * c + a * c + a * u) / 2,
        (u * b + a * b + a * u) / 6,
    )


@compiled
def table_point(
    x: float, y: float, z: float, table: Array, grid: Array
) -> tuple[float, float, float, float, float, float]:
    """Radial field over distance and axial field; their slopes over the distance, and depth."""
    p, q = (x * x + y * y) / grid[0] + 1, (-z - grid[1]) / grid[2]
    i = min(max(math.floor(p) - 1, 0), table.shape[0] - 4)
    j = min(max(math.floor(q) - 1, 0), table.shape[1] - 4)
    wi, wj = lagrange(p - i - 1), lagrange(q - j - 1)
    f = g = fs = gs = fz = gz = 0.0
    for a in range(4):
        rf = rg = tf = tg = 0.0
        for b in range(4):
            near, far = table[i + a, j + b, 0], table[i + a, j + b, 1]
            rf += near * wj[b]
            rg += far * wj[b]
            tf += near * wj[b + 4]
            tg += far * wj[b + 4]
        f += rf * wi[a]
        g += rg * wi[a]
        fs += rf * wi[a + 4]
        gs += rg * wi[a + 4]
        fz += tf * wi[a]
        gz += tg * wi[a]
    fs, gs = fs * (2 / grid[0]), gs * (2 / grid[0])
    return f, g, fs, gs, fz / -grid[2], gz / -grid[2]


@compiled
def turned(a: float, b: float, turn: Array) -> None:
    """Rotation (3, 3) by turns about x and y (rad)."""
    angle = math.hypot(a, b)
    half = 0.5 * angle
    sine = math.sin(angle) / angle if angle > 0 else 1.0
    share = math.sin(half) / half if angle > 0 else 1.0
    versine = 0.5 * share * share
    turn[0, 0], turn[1, 1] = 1 - versine * b * b, 1 - versine * a * a
    turn[2, 2] = math.cos(angle)
    turn[0, 1] = turn[1, 0] = versine * a * b
    turn[0, 2], turn[2, 0] = sine * b, -sine * b
    turn[1, 2], turn[2, 1] = -sine * a, sine * a


@compiled
def pixel_field(
    apart: Array, turn: Array, table: Array, grid: Array, work: Array, slope: Array
) -> tuple[float, float, float]:
    """Field of a turned disc at a point apart (3,) of it, and its slopes (3, 5)."""
    x = turn[0, 0] * apart[0] + turn[1, 0] * apart[1] + turn[2, 0] * apart[2]
    y = turn[0, 1] * apart[0] + turn[1, 1] * apart[1] + turn[2, 1] * apart[2]
    z = turn[0, 2] * apart[0] + turn[1, 2] * apart[1] + turn[2, 2] * apart[2]
    f, g, fs, gs, fz, gz = table_point(x, y, z, table, grid)
    own, half = work[:3], work[3:6]
    own[0, 0], own[1, 1], own[0, 1], own[1, 0] = (
        f + x * x * fs,
        f + y * y * fs,
        x * y * fs,
        x * y * fs,
    )
    own[0, 2], own[1, 2], own[2, 0], own[2, 1], own[2, 2] = x * fz, y * fz, x * gs, y * gs, gz
    bx = turn[0, 0] * f * x + turn[0, 1] * f * y + turn[0, 2] * g
    by = turn[1, 0] * f * x + turn[1, 1] * f * y + turn[1, 2] * g
    bz = turn[2, 0] * f * x + turn[2, 1] * f * y + turn[2, 2] * g
    for i in range(3):
        for k in range(3):
            half[i, k] = turn[i, 0] * own[0, k] + turn[i, 1] * own[1, k] + turn[i, 2] * own[2, k]
    for i in range(3):
        for k in range(3):
            slope[i, k] = -(
                half[i, 0] * turn[k, 0] + half[i, 1] * turn[k, 1] + half[i, 2] * turn[k, 2]
            )
    slope[0, 3], slope[1, 3], slope[2, 3] = 0.0, -bz, by
    slope[0, 4], slope[1, 4], slope[2, 4] = bz, 0.0, -bx
    for i in range(3):
        slope[i, 3] += slope[i, 2] * apart[1] - slope[i, 1] * apart[2]
        slope[i, 4] += slope[i, 0] * apart[2] - slope[i, 2] * apart[0]
    return bx, by, bz


@compiled
def disc_row(
    place: Array, warm: float, disc: Array, pixels: Array, axes: Array, table: Array, grid: Array,
    work: Array, slope: Array, seen: Array, steep: Array,
) -> None:  # fmt: skip
    """Readings (n,) of a disc at a place (u,), and their slopes (n, u)."""
    unknowns = len(place)
    gap, coupling = disc[0], disc[4]
    x, y = gap * place[0] + disc[1], gap * place[1] + disc[2]
    z = gap * place[2] + disc[3]
    lean = coupling * (1 - disc[8] * place[2])
    a, b = -lean * place[1] + disc[5], lean * place[0] + disc[6]
    if unknowns == 5:
        a, b = a + place[3], b + place[4]
    turn, apart = work[6:9], work[9]
    turned(a, b, turn)
    strength = 1 + disc[7] * warm
    channels = len(axes) // len(pixels)
    for p in range(len(pixels)):
        apart[0], apart[1], apart[2] = pixels[p, 0] - x, pixels[p, 1] - y, pixels[p, 2] - z
        bx, by, bz = pixel_field(apart, turn, table, grid, work, slope)
        for i in range(3):
            for k in range(3):
                slope[i, k] *= gap
            slope[i, 0] += lean * slope[i, 4]
            slope[i, 1] -= lean * slope[i, 3]
            sideways = place[0] * slope[i, 4] - place[1] * slope[i, 3]
            slope[i, 2] -= coupling * disc[8] * sideways
        for n in range(p * channels, (p + 1) * channels):
            ax, ay, az = axes[n, 0] * strength, axes[n, 1] * strength, axes[n, 2] * strength
            seen[n] = ax * bx + ay * by + az * bz
            for k in range(unknowns):
                steep[n, k] = ax * slope[0, k] + ay * slope[1, k] + az * slope[2, k]


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
    doubt_ : float
        Squares left over, beyond which a row is begun again from rest.
    cost_ : float
        Squares that the fit left over.
    unsure_ : ndarray, shape (9 + 5 n, 9 + 5 n)
        Covariance of what was found.
    """

    cost_: float
    unsure_: Array
    start_: PolynomialRidge | None = None
    doubt_: float = np.inf

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
        field, _ = self._fields(place, heat)
        if not self.absolute_:
            field = field - self._fields(np.zeros((1, 3)), np.zeros(1))[0]
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
        sigma, prior = self._sigma(rows), self._prior()
        damping = np.full((len(rows), 1), DAMPING)
        seen, slope = self.field(place, heat)
        error = (rows - seen) @ self.projection_ / sigma
        cost = (error**2).sum(axis=1) + place**2 @ prior
        for _ in range(steps):
            inner = np.einsum('nm,sni->smi', self.projection_, slope) / sigma[..., None]
            normal = np.einsum('smi,smj->sij', inner, inner) + np.diag(prior)
            pull = np.einsum('smi,sm->si', inner, error) - prior * place
            trial = self._moved(place, normal, pull, damping)
            there, steep = self.field(trial, heat)
            miss = (rows - there) @ self.projection_ / sigma
            price = (miss**2).sum(axis=1) + trial**2 @ prior
            better = price <= cost * (1 + 1e-9)
            cost = np.where(better, price, cost)
            better = better[:, None]
            place, error = np.where(better, trial, place), np.where(better, miss, error)
            slope = np.where(better[..., None], steep, slope)
            damping = np.where(better, damping * CALMER, damping * WILDER)
        return place, error

    def _moved(self, place: Array, normal: Array, pull: Array, damping: Array) -> Array:
        """Places after one damped step, inside the table."""
        index = np.arange(self.unknowns)
        damped = normal.copy()
        damped[:, index, index] *= 1 + damping
        move = np.linalg.solve(damped, pull[..., None])[..., 0]
        longest = np.abs(move).max(axis=1, keepdims=True)
        moved = place + move * np.minimum(1.0, LONGEST / np.maximum(longest, 1e-12))
        return self._inside(moved)

    def _found(self, rows: Array, heat: Array) -> tuple[Array, Array]:
        """Places of readings and errors; begun again from rest where they explain little."""
        again = np.zeros((len(rows), self.unknowns))
        if self.start_ is None:
            near, steps = again, STEPS
        else:
            near, steps = self._inside(self.start_.predict(rows @ self.projection_)), FEW_STEPS
        place, miss = self._descend(rows, heat, near, steps)
        cost = (miss**2).sum(axis=1)
        doubtful = cost > self.doubt_
        if np.count_nonzero(doubtful):
            other, gap = self._descend(rows[doubtful], heat[doubtful], again[doubtful], STEPS)
            better = ((gap**2).sum(axis=1) < CLEARLY * cost[doubtful])[:, None]
            place[doubtful] = np.where(better, other, place[doubtful])
            miss[doubtful] = np.where(better, gap, miss[doubtful])
        return place, miss

    def _compiled(self, rows: Array, heat: Array) -> tuple[Array, Array, Array]:
        """The same by compiled loops, with the readings that are left over."""
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
        if available():
            return self._compiled(np.ascontiguousarray(change), heat)
        lost = ~np.asarray(np.isfinite(change)).all(axis=1)
        rows = np.where(lost.reshape(-1, 1), 0.0, change)
        place, miss = self._found(rows, heat)
        rest, left = miss * self._sigma(rows), rows - self.field(place, heat)[0]
        place[lost], rest[lost], left[lost] = np.nan, np.nan, np.nan
        return place, rest, left


def _some(change: Array, warm: Array | None, drift: Array | None) -> tuple[Array, Array, Array]:
    """Rows that suffice for a fit, their temperatures and how they follow offsets."""
    chosen = np.linspace(0, len(change) - 1, min(len(change), MOST_ROWS)).astype(int)
    drift = np.zeros((len(change), 2)) if drift is None else drift
    return change[chosen], heats(change, warm)[chosen], drift[chosen]
