"""Place and tilt of a disc magnet from what pixels see beside a uniform field.

Gauss-Newton steps on the tabulated field of the disc [3], after the projection that a uniform
field does not pass. What the config only starts from (gap, remanence, where the disc rests, the
tilt that comes with a shift, gains of the channels) is found from recordings alone, without a
truth: pixels see more numbers than a disc has freedoms, and over many frames those freedoms are
eliminated from the normal equations (Golub and Pereyra, Inverse Problems 19, 2003).
"""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.physics.disc_table import disc_table, table_disc
from tactile_ros.types import Array

GAP, REMANENCE, REST, LEANING, COUPLING, GAIN = 0.1, 0.1, 0.08, 0.03, 0.3, 0.01
MOST_ROWS = 300
ROUNDS = 8
STEPS, FEW_STEPS = 14, 4
SIMULATED, WIDER = 800, 0.1
DOUBT = 4.0
DAMPING, CALMER, WILDER = 1e-3, 0.2, 8.0
LONGEST = 0.25  # of the gap: how far one step goes
DEEPEST, SIDEWAYS, STEEP = 0.85, 1.2, 0.6  # of the gap, of the gap, rad
UPWARD = np.array([1.0, 1.0, 0.8, 1.0, 1.0])
RIGHT = 1e-3  # of the field: what a disc's model may be wrong by


class DiscInversion:
    """Find where a disc is from differences of pixels.

    Parameters
    ----------
    pixels : ndarray, shape (t, 3)
        (m).
    axes : ndarray, shape (n, 3)
        Direction that each of the n = c t channels measures, pixel by pixel.
    disc : ndarray, shape (4,)
        Gap to its near face, diameter, height (m), remanence (T).
    tilt : float
        Standard deviation of tilts beside those that come with a shift (rad); 0: none.

    Attributes
    ----------
    found_ : ndarray, shape (7 + n,)
        What was found of gap, remanence, rest, leaning, coupling and gains, in units of what the
        config is uncertain by.
    projection_ : ndarray, shape (n, m)
        To the differences that a uniform field does not change.
    sigma_ : float
        Of a difference (T).
    absolute_ : bool
        Whether readings are fields, not changes since rest.
    start_ : PolynomialRidge or None
        Where to begin, learned from the model; None before a fit.
    rest_ : ndarray, shape (1, n), or None
        Readings at rest (T); None before a fit.
    doubt_ : float
        Squares left over, beyond which a row is begun again from rest.
    """

    found_: Array
    projection_: Array
    sigma_: float
    absolute_: bool

    def __init__(self, pixels: Array, axes: Array, disc: Array, tilt: float = 0.0) -> None:
        self.pixels, self.axes, self.disc, self.tilt = pixels, axes, disc, tilt
        gap, diameter, height, _ = disc
        wide = float(np.hypot(*np.abs(pixels[:, :2]).max(axis=0)) + 1.2 * gap)
        low = float(pixels[:, 2].max())
        reach = (wide, 0.1 * gap - low + height / 2, 1.8 * gap - low + height / 2)
        self.table, self.grid = disc_table(float(diameter), float(height), reach)
        self.found_ = np.zeros(7 + len(axes))
        self.start_: PolynomialRidge | None = None
        self.doubt_ = np.inf
        self.rest_: Array | None = None

    def given(self, projection: Array, sigma: float, *, absolute: bool) -> DiscInversion:
        """Say what is measured: differences (n, m), noise of a channel (T), and from what."""
        self.projection_, self.absolute_ = projection, absolute
        self.sigma_ = float(np.hypot(sigma, 1e-9))
        return self

    @property
    def unknowns(self) -> int:
        """3 for a place, 5 with a tilt of its own."""
        return 5 if self.tilt > 0 else 3

    @property
    def report(self) -> dict[str, float]:
        """What was found beside the config: lengths (m), remanence (T), gains (1)."""
        found, gap = self.found_, float(self.disc[0])
        return {
            'gap': gap * float(1 + GAP * found[0]),
            'remanence': float(self.disc[3] * (1 + REMANENCE * found[1])),
            'rest_x': gap * REST * float(found[2]),
            'rest_y': gap * REST * float(found[3]),
            'tilt_per_shift': COUPLING * float(found[6]),
            'gain_spread': GAIN * float(found[7:].std()),
        }

    def fit(self, change: Array) -> DiscInversion:
        """Find what the config is uncertain of from readings (s, n) (T) alone."""
        rows = change[np.linspace(0, len(change) - 1, min(len(change), MOST_ROWS)).astype(int)]
        place = np.zeros((len(rows), self.unknowns))
        self.found_, self.rest_ = np.zeros_like(self.found_), None
        sigma = self._sigma(rows)
        best, least = self.found_, np.inf
        for turn in range(ROUNDS):
            place, _ = self._descend(rows, place, STEPS if turn == 0 else 3)
            slopes, error = self._slopes(rows, place)
            cost = float(np.minimum((error / sigma) ** 2, 25.0).sum() + self.found_ @ self.found_)
            if cost > 0.999 * least:
                break
            best, least = self.found_, cost
            self.found_ = best + self._step(slopes, error, place, sigma)
        self.found_ = best
        self.rest_ = self._absolute(np.zeros((1, 3)))[0]
        place, miss = self._descend(rows, 0 * place, STEPS)
        self._learn_starts(place)
        self.doubt_ = DOUBT * float(np.quantile((miss**2).sum(axis=1), 0.99)) + 25.0
        return self

    def _learn_starts(self, place: Array) -> None:
        """Learn where to begin, from the model itself around places (s, 3 or 5)."""
        low, high = place.min(axis=0), place.max(axis=0)
        room = WIDER * (high - low) + 0.02
        random = np.random.default_rng(0).uniform(size=(SIMULATED, self.unknowns))
        trial = low - room + random * (high - low + 2 * room)
        trial = self._inside(trial)
        self.start_ = PolynomialRidge((3,)).fit(self.field(trial)[0] @ self.projection_, trial)

    def _sigma(self, change: Array) -> Array:
        """Of a difference of every row, with what a model may be wrong by: (s, 1) (T)."""
        size = np.sqrt((change**2).mean(axis=1))
        return np.asarray(np.hypot(self.sigma_, RIGHT * size)[:, None])

    def _slopes(self, rows: Array, place: Array) -> tuple[Array, Array]:
        """How differences change with what is to be found (s, m, p), and their errors (s, m)."""
        seen, _ = self.field(place)
        start, step = self.found_, 1e-4
        slopes = np.empty((len(rows), self.projection_.shape[1], len(start)))
        for i in range(len(start)):
            self.found_ = start + step * np.eye(len(start))[i]
            slopes[..., i] = (self.field(place)[0] - seen) @ self.projection_ / step
        self.found_ = start
        return slopes, (rows - seen) @ self.projection_

    def _step(self, slopes: Array, error: Array, place: Array, sigma: Array) -> Array:
        """Change of what is to be found, after places are eliminated."""
        inner = self._inner(place) / sigma[..., None]
        slopes, error = slopes / sigma[..., None], error / sigma
        trust = 1 / np.maximum(1.0, (error**2).mean(axis=1) / 9)
        normal = np.einsum('smi,smj->sij', inner, inner) + np.diag(self._prior())
        across = np.einsum('smi,smp->sip', inner, slopes)
        solved = np.linalg.solve(normal, across)
        own = slopes - np.einsum('smi,sip->smp', inner, solved)
        left = np.einsum('s,smp,smq->pq', trust, own, slopes) + np.eye(slopes.shape[2])
        right = np.einsum('s,smp,sm->p', trust, own, error) - self.found_
        return np.asarray(np.linalg.solve(left, right))

    def _inner(self, place: Array) -> Array:
        """Change of differences with places and tilts, shape (s, m, 3 or 5)."""
        slope = self.field(place)[1]
        return np.asarray(np.einsum('nm,sni->smi', self.projection_, slope))

    def _prior(self) -> Array:
        """Inverse variances of a place (in gaps) and a tilt."""
        return np.array([1.0, 1.0, 1.0, *[1 / max(self.tilt, 1e-9) ** 2] * 2])[: self.unknowns]

    def field(self, place: Array) -> tuple[Array, Array]:
        """Readings of a disc moved from rest.

        Parameters
        ----------
        place : ndarray, shape (s, 3 or 5)
            Shift in gaps, and tilt (rad).

        Returns
        -------
        readings : ndarray, shape (s, n)
            (T).
        slopes : ndarray, shape (s, n, 3 or 5)
            (T).
        """
        readings, slopes = self._absolute(place)
        if not self.absolute_:
            rest = self.rest_
            rest = self._absolute(np.zeros((1, 3)))[0] if rest is None else rest
            readings = readings - rest
        return readings, slopes

    def _absolute(self, place: Array) -> tuple[Array, Array]:
        gap, _, height, remanence = self.disc
        found = self.found_
        coupling = COUPLING * found[6]
        centre = gap * place[:, :3] + gap * REST * np.array([found[2], found[3], 0.0])
        centre[:, 2] += gap * (1 + GAP * found[0]) + height / 2
        tilts = coupling * np.stack([-place[:, 1], place[:, 0]], axis=1) + LEANING * found[4:6]
        if place.shape[1] == 5:
            tilts = tilts + place[:, 3:]
        field, slope = table_disc(self.pixels, centre, tilts, self.table, self.grid)
        slope[..., :3] *= gap
        slope[..., 0] += coupling * slope[..., 4]
        slope[..., 1] -= coupling * slope[..., 3]
        gain = (1 + GAIN * found[7:]) * remanence * (1 + REMANENCE * found[1])
        axes = self.axes.reshape(len(self.pixels), -1, 3)
        readings = np.einsum('tci,sti->stc', axes, field).reshape(len(place), -1) * gain
        slopes = np.einsum('tci,stij->stcj', axes, slope[..., : place.shape[1]])
        return readings, slopes.reshape(len(place), len(gain), -1) * gain[:, None]

    def _inside(self, place: Array) -> Array:
        """Places (s, 3 or 5) that the table knows."""
        least = self._least
        return np.asarray(np.minimum(np.maximum(place, least), -least * UPWARD[: len(least)]))

    @property
    def _least(self) -> Array:
        """Farthest sideways, deepest and most tilted, shape (3 or 5,)."""
        return np.array([-SIDEWAYS, -SIDEWAYS, -DEEPEST, -STEEP, -STEEP])[: self.unknowns]

    def _descend(self, rows: Array, place: Array, steps: int) -> tuple[Array, Array]:
        """Places and errors over sigma (s, m) after damped steps: Marquardt, J. SIAM 11, 1963."""
        sigma, prior = self._sigma(rows), self._prior()
        damping = np.full((len(rows), 1), DAMPING)
        seen, slope = self.field(place)
        error = (rows - seen) @ self.projection_ / sigma
        cost = (error**2).sum(axis=1) + place**2 @ prior
        for _ in range(steps):
            inner = np.einsum('nm,sni->smi', self.projection_, slope) / sigma[..., None]
            normal = np.einsum('smi,smj->sij', inner, inner) + np.diag(prior)
            pull = np.einsum('smi,sm->si', inner, error) - prior * place
            trial = self._moved(place, normal, pull, damping)
            there, steep = self.field(trial)
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

    def _found(self, rows: Array) -> tuple[Array, Array]:
        """Places of readings and errors; begun again from rest where they explain little."""
        again = np.zeros((len(rows), self.unknowns))
        if self.start_ is None:
            return self._descend(rows, again, STEPS)
        near = self.start_.predict(rows @ self.projection_)
        place, miss = self._descend(rows, self._inside(near), FEW_STEPS)
        cost = (miss**2).sum(axis=1)
        doubtful = cost > self.doubt_
        if np.count_nonzero(doubtful):
            other, gap = self._descend(rows[doubtful], again[doubtful], STEPS)
            better = ((gap**2).sum(axis=1) < cost[doubtful])[:, None]
            place[doubtful] = np.where(better, other, place[doubtful])
            miss[doubtful] = np.where(better, gap, miss[doubtful])
        return place, miss

    def invert(self, change: Array) -> tuple[Array, Array]:
        """Places and what they leave unexplained.

        Parameters
        ----------
        change : ndarray, shape (s, n)
            Readings, less those at rest unless they are absolute (T).

        Returns
        -------
        place : ndarray, shape (s, 3 or 5)
            Shift in gaps, and tilt (rad); NaN where a reading is.
        rest : ndarray, shape (s, m)
            Differences that it does not explain (T).
        """
        lost = ~np.asarray(np.isfinite(change)).all(axis=1)
        rows = np.where(lost.reshape(-1, 1), 0.0, change)
        place, miss = self._found(rows)
        rest = miss * self._sigma(rows)
        place[lost], rest[lost] = np.nan, np.nan
        return place, rest
