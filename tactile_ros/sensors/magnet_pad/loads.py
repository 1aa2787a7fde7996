"""How unsure answers are beyond the loads of a recording.

What a response learned on the lighter half of the loads errs by on the heavier half tells how
errors grow with the distance to the loads that were recorded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Integers

HALF = 0.5  # of the largest load: lighter touches are the lesson, heavier ones the test
FEWEST, RATIO = 40, 1.5  # light and heavy touches, and the largest load over the least, that tell
MOST = 300  # touches of each that are looked at
UNTOLD = (0.1, 0.3)  # radii and share of a force, the largest load farther on: as of specimens
QUANTILES = {1: 0.6827, 2: 0.9545}  # of what is normal, inside so many sigmas


@dataclass(frozen=True)
class LoadReach:
    """Loads of a recording, and how errors grow where a load is farther by the largest of them.

    Attributes
    ----------
    least, most : float
        Of the recording (N).
    times_place, times_force : float
        Of what is stated: standard deviations that are added.
    told : bool
        Whether the loads told it; else `untold` does.
    radius : float
        Of the pad (m).
    """

    least: float
    most: float
    radius: float
    times_place: float = 0.0
    times_force: float = 0.0
    told: bool = False

    def beyond(self, load: Array) -> Array:
        """Distance (s,) of loads (N) from those recorded, over the largest of them."""
        outside = np.maximum(load - self.most, self.least - load)
        return np.asarray(np.maximum(outside, 0.0) / self.most)

    def widen(self, mean: Array, cov: Array) -> None:
        """Add to covariances (s, 6, 6) of places (m) and forces (N) what loads ask for."""
        force = mean[:, 3:]
        away = self.beyond(np.sqrt(np.add.reduce(force * force, axis=1)))
        rows = np.flatnonzero(away)
        if not len(rows):
            return
        far = away[rows]
        wider = np.repeat([self.times_place, self.times_force], 3) * far[:, None]
        wider = np.sqrt(1 + wider * wider)
        cov[rows] *= wider[:, :, None] * wider[:, None, :]
        if not self.told:
            cov[rows] += untold(mean[rows], far, self.radius)


def untold(mean: Array, far: Array, radius: float) -> Array:
    """Covariance (s, 6, 6) of places and forces (s, 6) at distances of which nothing is known.

    Distances are over the largest load, or over the radius (m) of the pad.
    """
    place, share = UNTOLD
    cov, force = np.zeros((len(mean), 6, 6)), share * far[:, None] * mean[:, 3:]
    cov[:, :3, :3] = (place * radius * far)[:, None, None] ** 2 * np.eye(3)
    cov[:, 3:, 3:] = force[:, :, None] * force[:, None, :]
    return cov


def split(load: Array) -> tuple[Integers, Integers] | None:
    """Some rows of the lighter and of the heavier loads (s,); None where they tell nothing."""
    light, heavy = (np.flatnonzero((load <= HALF * load.max()) == part) for part in (True, False))
    if min(len(light), len(heavy)) < FEWEST or load[light].max() < RATIO * load[light].min():
        return None
    return light[:: -(-len(light) // MOST)], heavy[:: -(-len(heavy) // MOST)]


def growth(away: Array, error: Array) -> float:
    """Sigmas that are to be added at a distance of 1.

    Parameters
    ----------
    away, error : ndarray, shape (s,) and (s, k)
        Distances from the loads that were learned from; errors over what is stated of them.
    """
    tried = np.concatenate([[0.0], np.geomspace(0.1, 100.0, 61)])
    wider = np.sqrt(1 + (tried[:, None] * away) ** 2)[:, :, None]
    # what is normal in the middle may not be so in its tails
    enough = np.logical_and.reduce(
        [
            np.quantile(np.abs(error) / wider, share, axis=(1, 2)) <= sigmas
            for sigmas, share in QUANTILES.items()
        ]
    )
    return float(tried[np.argmax(enough)] if enough.any() else tried[-1])
