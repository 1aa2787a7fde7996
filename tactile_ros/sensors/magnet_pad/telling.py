"""Touches that answer readings, with a uniform outside field and without.

A reading that no touch explains is looked up by what the chips differ in, where the outside field
has a share of the metric; evidence weighs both answers. What is but a field touches nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_ros.estimators.touch_mixture import Linearised, Posterior, TouchMixture
from tactile_ros.sensors.magnet_pad.unfelt import Unfelt
from tactile_ros.types import Array, Bools, Integers

NEIGHBOURS, BLIND, SLACK = 16, 96, 1.0
STRAY = 0.3e-3  # T, of one component of stray fields that are met
CROSSED = 0.01  # of a stray field, by which crossed axes of a chip falsify it
SPREAD, STEEPER = 0.02, 2.0  # of gains, up to which readings are weighed so; for more than that
ODDS = -4.0  # logarithm, of a stray field against none
SIGMAS = 5.0  # as `conditioning.contact` has them
# place and force; then how much wider their covariance is, how far known touches are, the share
# of the noise in what readings may be wrong by, and the reading
ANSWERS = 6
FAR, NOISY, READING = 7, 8, 9


@dataclass(frozen=True)
class Told:
    """What readings tell.

    Attributes
    ----------
    mean, cov : ndarray, shape (s, 6) and (s, 6, 6)
        Place (m) and force (N).
    shares : ndarray, shape (s, n)
        Of the cells.
    stray : ndarray, shape (s, 3)
        Uniform outside field (T).
    odd : ndarray of bool, shape (s,)
        Readings that neither a touch nor a field of the usual size explains.
    far, noisy : ndarray, shape (s,)
        Distance from known touches (radii, at most 1); share of the noise of a channel in the
        variance of what readings may be wrong by.
    """

    mean: Array
    cov: Array
    shares: Array
    stray: Array
    odd: Bools
    far: Array
    noisy: Array


def widened(seen: Posterior, usual: float) -> Array:
    """Covariance (s, 6, 6) of place and force, as wide as the table is in doubt there.

    Wider yet where a touch leaves more of the reading unexplained than the usual misfit (Birge,
    Phys. Rev. 40, 1932).
    """
    factor = seen.mean[:, ANSWERS] * np.maximum(seen.misfit / usual, 1.0)
    return np.asarray(seen.cov * factor[:, None, None])


class UniformPart:
    """Uniform field in readings, and what remains.

    Parameters
    ----------
    common : ndarray, shape (d, 3)
        What a uniform field adds to the features, in sensor axes.
    """

    def __init__(self, common: Array) -> None:
        self.common = common
        self.solve = np.linalg.pinv(common).T

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Field (s, 3) in readings (s, d) (T), and the largest channel of what remains."""
        field = self.field(x)
        return field, np.abs(self.left(x, field)).max(axis=1)

    def field(self, x: Array) -> Array:
        """Field (s, 3) in readings (s, d) (T)."""
        # a row at a time: the same bits alone and among others
        return np.asarray(np.matmul(x[:, None], self.solve)[:, 0])

    def left(self, x: Array, field: Array) -> Array:
        """What remains (s, d) of readings less a field (s, 3) (T)."""
        return np.asarray(x - np.matmul(field[:, None], self.common.T)[:, 0])


class Telling:
    """Touches of a table that answer readings.

    Parameters
    ----------
    rows : Linearised
        Answers are place, force, and what follows them (`ANSWERS`).
    common : ndarray, shape (d, 3), or None
        As `UniformPart`; None: an outside field cannot be told.
    noise, contact : float
        Of a channel; largest channel, less a uniform field, beyond which something touches (T).
    usual, limit : float
        Misfit that most touches leave; from which an outside field is thought of.
    spread : float
        Of gains among chips: the share of a stray field that may be left in what is told.
    neighbours : int
        Touches that answer.
    """

    def __init__(
        self,
        rows: Linearised,
        common: Array | None,
        noise: float,
        contact: float,
        usual: float,
        limit: float,
        spread: float = SPREAD,
        neighbours: int = NEIGHBOURS,
    ) -> None:
        self.plain = TouchMixture(
            rows.of(READING), neighbours=neighbours, told=ANSWERS, slack=SLACK
        )
        self.noise, self.contact = noise, contact
        self.usual, self.limit = usual, limit
        self.entry = max(CROSSED, STEEPER * (spread - SPREAD))
        self.leak = max(CROSSED, spread)
        light = rows.readings, rows.answers[:, 3:ANSWERS]
        self.unfelt = Unfelt(*light, noise)
        self.part = self.blind = None
        if common is not None:
            part = self.part = UniformPart(common)
            left = part.left(light[0], part.field(light[0]))
            self.unfelt_beside = Unfelt(left, light[1], noise)
            beside = replace(rows, sigma=np.hypot(rows.sigma, self.entry * STRAY))
            self.blind = TouchMixture(beside, common, STRAY, neighbours=BLIND, told=ANSWERS)

    def __call__(self, x: Array, cells: Array) -> Told:
        """What finite readings x (s, d) (T) tell, with centres (n, 3) of cells (m)."""
        seen = self.plain(x)
        shares, stray = self.plain.shares(seen, cells), np.zeros((len(x), 3))
        unlike = seen.misfit > self.limit
        cov = widened(seen, self.usual)
        far, noisy = seen.mean[:, FAR], seen.mean[:, NOISY]
        told = Told(seen.mean[:, :ANSWERS], cov, shares, stray, unlike, far, noisy)
        if np.count_nonzero(unlike):
            rows = np.flatnonzero(unlike)
            if self.blind is None:
                told.mean[rows], told.cov[rows], shares[rows] = self.plain.at_large(x[rows], cells)
            else:
                self._mend(told, seen, x, cells, rows)
        return told

    def _mend(self, told: Told, seen: Posterior, x: Array, cells: Array, rows: Integers) -> None:
        """Weigh what readings of some rows say of touches beside a field, in place."""
        blind, part = self.blind, self.part
        assert blind is not None
        assert part is not None
        other = blind(x[rows])
        mean, cov = other.mean[:, :ANSWERS].copy(), other.cov.copy()
        named, odd = blind.shares(other, cells), np.asarray(other.misfit > self.limit)
        told.odd[rows] = odd
        if np.count_nonzero(odd):
            mean[odd], cov[odd], named[odd] = blind.at_large(x[rows[odd]], cells)
        lean = other.evidence - seen.evidence[rows] + ODDS
        lean = 1 / (1 + np.exp(-np.clip(lean, -50, 50)))
        lean[odd] = 1.0
        share, apart = lean[:, None], mean - told.mean[rows]
        between = (share * (1 - share))[:, :, None] * apart[:, :, None] * apart[:, None]
        left = x[rows] - other.mean[:, READING:]
        field = part(left)[0]
        leak = self.leak**2 * (field * field).sum(axis=1) / self.noise**2
        wider = np.maximum(other.misfit / x.shape[1], 1.0) * (1 + leak * other.mean[:, NOISY])
        cov[~odd] *= wider[~odd, None, None]
        told.cov[rows] += share[:, :, None] * (cov - told.cov[rows]) + between
        told.mean[rows] += share * apart
        told.shares[rows] += share * (named - told.shares[rows])
        told.stray[rows] = share * field

    def resting_field(self, x: Array) -> Array:
        """Uniform field (s, 3) (T) of readings (s, d) that nothing touches; 0 within noise."""
        assert self.part is not None
        field, _ = self.part(x)
        seen = np.abs(field).max(axis=1, keepdims=True) > SIGMAS * self.noise
        return np.where(seen, field, 0.0)

    def hidden(self, x: Array) -> Array:
        """Covariance (s, 3, 3) (N2) of saying that nothing touches, of readings (s, d)."""
        cov = self.unfelt(x)
        if self.part is not None:
            field = self.resting_field(x)
            rows = np.flatnonzero(field.any(axis=1))
            if len(rows):
                cov[rows] = self.unfelt_beside(self.part.left(x[rows], field[rows]))
        return cov

    def touching(self, x: Array) -> Bools:
        """Whether readings (s, d) are rather those of a touch than of a uniform field alone."""
        assert self.blind is not None
        assert self.part is not None
        touching = np.asarray(self.part(x)[1] > self.contact)
        if np.count_nonzero(touching) < len(x):
            weak = np.flatnonzero(~touching)
            touch = np.maximum(self.plain(x[weak]).evidence, self.blind(x[weak]).evidence)
            noise = float(np.hypot(self.noise, self.entry * STRAY))
            touching[weak] = touch > self.blind.of_causes(x[weak], noise)
        return touching
