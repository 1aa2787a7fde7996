"""Touches drawn like recorded ones, and thinly everywhere else, with the reach of each.

Recorded touches, blurred by their distances from each other, say where touches are likely
(Parzen, Ann. Math. Stat. 33, 1962); some are spread evenly, since what was recorded is not all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.sensors.magnet_pad.response import EDGE
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig

SEED = 19
ANYWHERE = 0.2  # share of touches that are spread evenly
LOAD, SHEAR = 2.0, 1.0  # radii that a factor e of load, and a leaning of 1, count as
NEAR = 6  # neighbour whose distance is the reach
LEAST_REACH, MOST_REACH = 0.005, 0.3  # radii
LEAST_BLUR, MOST_BLUR = 0.02, 0.2
USUAL = 0.99  # share of known places that have another as near
WEAKER, HARDER = 1.6, 0.8  # logarithm of loads beyond the recorded ones
DECADE = 2.3  # of loads that are thought of at least, in logarithms


@dataclass(frozen=True)
class Touched:
    """Recorded touches.

    Attributes
    ----------
    x : ndarray, shape (s, d)
        Readings of live channels (T).
    place, force : ndarray, shape (s, 3)
        (m, N).
    groups, cells : ndarray of int, shape (s,)
        What a split keeps together; true cells, -1 unknown.
    """

    x: Array
    place: Array
    force: Array
    groups: Integers
    cells: Integers

    def in_order(self) -> Touched:
        """The same for every order of the rows."""
        order = np.lexsort(np.column_stack([self.x, self.place, self.force]).T[::-1])
        _, first, index = np.unique(self.groups[order], return_index=True, return_inverse=True)
        rank = np.empty(len(first), np.int64)
        rank[np.argsort(first)] = np.arange(len(first))
        return Touched(
            self.x[order], self.place[order], self.force[order],
            np.asarray(rank[index.reshape(-1)]), self.cells[order],
        )  # fmt: skip


def like_known(
    config: MagnetPadConfig, known: Array, count: int, *, leaning: bool, sharp: bool
) -> tuple[Array, Array]:
    """Draw touches.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pad.
    known : ndarray, shape (s, 5)
        Recorded touches: along (m), around (rad), logarithm of the load (N), leanings.
    count : int
        How many (n).
    leaning : bool
        Whether leanings count.
    sharp : bool
        Whether touches keep as near to recorded places as those lie to each other; else as near
        as recorded touches of like loads do.

    Returns
    -------
    touches : ndarray, shape (n, 5)
        As `known`; the same for the same arguments.
    reach : ndarray, shape (n,)
        Distance to neighbours (radii; see `LOAD` and `SHEAR`).
    """
    rng = np.random.default_rng(SEED)
    unit = np.array([1 / config.radius, 1.0, LOAD, SHEAR, SHEAR])
    unit[3:] *= leaning
    free = int(ANYWHERE * count)
    drawn = np.concatenate(
        [_blurred(known, unit, count - free, rng, sharp), _even(config, known, free, rng)]
    )
    least = float(np.arccos(EDGE))
    low, high = thought_of(known[:, 2])
    drawn[:, 0] = np.clip(drawn[:, 0], -config.length / 2, config.length / 2)
    drawn[:, 1] = np.clip(drawn[:, 1], least, np.pi - least)
    drawn[:, 2] = np.clip(drawn[:, 2], low, high)
    spots = drawn * unit
    near = min(NEAR + 1, count)
    reach = cKDTree(spots).query(spots, k=[near])[0][:, 0]
    return drawn, np.clip(reach, LEAST_REACH, MOST_REACH)


def thought_of(load: Array) -> tuple[float, float]:
    """Least and largest logarithm of loads of a table, by those of recorded touches (s,)."""
    low, high = float(load.min()), float(load.max())
    room = 0.5 * max(DECADE - (high - low), 0.0)
    return low - WEAKER - room, high + HARDER + room


def far_from(known: Array, places: Array, radius: float) -> Array:
    """Distance (s,) (radii, at most 1) of places (s, 2) from known ones (n, 2), beyond the usual.

    Both along (m) and around (rad); usual are the distances of known places from each other.
    """
    unit = np.array([1 / radius, 1.0])
    tree = cKDTree(known * unit)
    usual = np.quantile(tree.query(known * unit, k=[min(2, len(known))])[0], USUAL)
    return np.asarray(np.clip(tree.query(places * unit)[0] - usual, 0.0, 1.0))


def _blurred(
    known: Array, unit: Array, count: int, rng: np.random.Generator, sharp: bool
) -> Array:
    """Known touches (s, 5), each moved by half the distance to others like it."""
    spots = known * unit
    seen = spots[:, :2] if sharp else spots
    near = min(4, len(known) - 1)
    gap = cKDTree(seen).query(seen, k=[near + 1])[0][:, 0]
    pick = rng.integers(0, len(known), count)
    least = LEAST_REACH if sharp else LEAST_BLUR
    blur = np.clip(0.5 * gap, least, MOST_BLUR)[pick, None] * rng.normal(size=(count, 5))
    if sharp:
        blur[:, 2:] = MOST_BLUR * rng.normal(size=(count, 3))
    return np.asarray(known[pick] + blur * np.where(unit > 0, 1 / np.maximum(unit, 1e-9), 0.0))


def _even(config: MagnetPadConfig, known: Array, count: int, rng: np.random.Generator) -> Array:
    """Touches (n, 5) all over the pad, of all loads, leaning as known ones (s, 5) do."""
    even = np.empty((count, 5))
    even[:, 0] = config.length * (rng.uniform(size=count) - 0.5)
    even[:, 1] = np.arccos(rng.uniform(-EDGE, EDGE, count))
    even[:, 2] = rng.uniform(*thought_of(known[:, 2]), count)
    even[:, 3:] = known[rng.integers(0, len(known), count), 3:]
    return even
