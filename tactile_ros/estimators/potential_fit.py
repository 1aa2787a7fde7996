"""How likely terms and priors of a sheet's potentials make what touches have told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.estimators.evidence import Moments
from tactile_ros.estimators.repeated_places import ToldPlaces
from tactile_ros.estimators.sheet_potentials import Kind, SheetPotentials, bilinear_corners
from tactile_ros.types import Array

UNLIKELY = 0.01  # share of the evidence of the likeliest prior
LEAST_NOISE = 1e-9
ROUNDS = 2  # in which the corners' potentials settle


@dataclass(frozen=True)
class PotentialFit:
    """Terms of one kind, and the evidence of each of their priors.

    Attributes
    ----------
    basis : SheetPotentials
        The terms.
    moments : Moments
        Of the terms and the potentials.
    spreads : ndarray, shape (m, p)
        Priors.
    levels : ndarray, shape (m,)
        Logarithms of their evidence.
    """

    basis: SheetPotentials
    moments: Moments
    spreads: Array
    levels: Array

    @property
    def best(self) -> Array:
        """Weights (p,) by the likeliest prior."""
        return self.moments.solve(self.spreads[int(self.levels.argmax())])[0][:, 0]

    def average(self, least: float) -> tuple[Array, Array, float]:
        """Weights (p,), a square root (p, p) of their covariance, and the noise, over priors.

        They are averaged by the priors' evidence: few places do not tell one prior from another,
        and what the likely ones disagree in is doubt. The noise is not below `least`.
        """
        share = np.exp(self.levels - self.levels.max())
        likely = np.flatnonzero(share > UNLIKELY)
        share = share[likely] / share[likely].sum()
        found = [self.moments.solve(self.spreads[i]) for i in likely]
        floor = max(least, LEAST_NOISE)
        noises = [max(s, self.moments.left(w, root), floor) for w, root, s in found]
        weights = np.array([one[0][:, 0] for one in found])
        mean = share @ weights
        apart = (weights - mean) * np.sqrt(share)[:, None]
        sizes = np.sqrt(share) * noises
        roots = [size * one[1] for size, one in zip(sizes, found, strict=True)]
        root = np.linalg.qr(np.concatenate([*roots, apart]), mode='r')
        return np.asarray(mean), np.asarray(root), float(np.sqrt(share @ np.square(noises)))


def likeliest_of(kind: Kind, size: Array, known: ToldPlaces) -> PotentialFit:
    """Fit terms of one kind to the potentials of places on a sheet of a size (2,) (m)."""
    corners = bilinear_corners(known.places, known.told, size)
    target = known.told.T.reshape(-1, 1)
    for _ in range(ROUNDS):
        basis = SheetPotentials(size, kind, corners)
        terms = basis.terms(known.places)
        moments = Moments.of(terms.reshape(len(target), -1), target)
        spreads = basis.spreads()
        levels = np.array([moments.evidence(spread, known.least) for spread in spreads])
        found = PotentialFit(basis, moments, spreads, levels)
        if kind != 'border':
            break
        corners = basis.corners_of(found.best)
    return found
