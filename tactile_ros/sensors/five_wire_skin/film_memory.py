"""What a film has felt where it is touched now: fading means of the force, by place.

A film creeps where it is pressed. A touch elsewhere meets film that has not crept, and one that is
drawn along leaves what has: of the past counts what a square touch shares with where it was.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers

STILL = 0.05  # of the touch's edge: moves that are noise
SECONDS_PER_NS = 1e-9
FORCE, X, Y, MEANS = 0, 1, 2, 3  # columns of what is kept


@compiled
def overlap(kept: Array, x: float, y: float, edge: float) -> float:
    """Share of a touch at a place with the one that is kept (3..), which follows it."""
    share = 1.0
    for i, now in ((X, x), (Y, y)):
        if math.isnan(kept[i]):
            kept[i] = now
        off = now - kept[i]
        beyond = max(abs(off) - STILL * edge, 0.0)
        share *= max(1.0 - beyond / edge, 0.0)
        kept[i] += math.copysign(beyond, off)
    return share


@compiled
def memory_rows(
    force: Array,
    places: Array,
    elapsed: Array,
    rates: Array,
    edge: float,
    kept: Array,
    means: Array,
) -> None:
    """Fill fading means (s, m) of forces (s,) at places (s, 2); what is kept (3 + m,) moves on.

    Parameters
    ----------
    force : ndarray, shape (s,)
        0 where nothing touches; NaN: unusable, the last one is held.
    places : ndarray, shape (s, 2)
        Of the touches (m); NaN, or where nothing touches: they do not count.
    elapsed : ndarray, shape (s,)
        Since the frame before (s); 0: not newer, not remembered; below 0: a stream begins.
    rates : ndarray, shape (m,)
        1 / time constants (1/s).
    edge : float
        Of a touch (m); infinite: the past counts wherever it was.
    """
    for s in range(len(force)):
        if elapsed[s] < 0.0:
            kept[:] = 0.0
        now = kept[FORCE] if math.isnan(force[s]) else force[s]
        if elapsed[s] < 0.0:
            kept[FORCE], kept[X], kept[Y] = now, math.nan, math.nan
        elif elapsed[s] > 0.0:
            share = 1.0
            # true of no NaN: a frame that was lost moves the touch nowhere
            if force[s] > 0.0 and math.isfinite(edge) and math.isfinite(places[s, 0]):
                share = overlap(kept, places[s, 0], places[s, 1], edge)
            for i in range(len(rates)):
                phase = rates[i] * elapsed[s]
                decay = math.exp(-phase)
                average = -math.expm1(-phase) / phase
                old = decay * kept[MEANS + i] + (average - decay) * kept[FORCE]
                kept[MEANS + i] = share * old + (1.0 - average) * now
            kept[FORCE] = now
        for i in range(len(rates)):
            means[s, i] = kept[MEANS + i]


class FilmMemory:
    """Fading means of one stream, one frame at a time or many with the same numbers.

    Parameters
    ----------
    time_constants : ndarray, shape (m,)
        Of the means (s).
    edge : float
        Of a touch (m); infinite: the past counts wherever it was.
    """

    def __init__(self, time_constants: Array, edge: float) -> None:
        self._rates, self._edge = 1.0 / time_constants, edge
        self.reset()

    def reset(self) -> None:
        """Forget the past: what came before counts as rest."""
        self._kept = np.zeros(MEANS + len(self._rates))
        self._newest_ns: int | None = None

    def __call__(self, force: Array, places: Array, stamp_ns: Integers, restart: Bools) -> Array:
        """Means (s, m) after each frame, 0 at the first one of a stream.

        Parameters
        ----------
        force : ndarray, shape (s,)
            0 where nothing touches; NaN: unusable.
        places : ndarray, shape (s, 2)
            Of the touches (m).
        stamp_ns : ndarray, shape (s,)
            Acquisition times; a frame that is not newer than the last one is not remembered.
        restart : ndarray, shape (s,)
            Frames before which the past is forgotten.
        """
        means = np.empty((len(force), len(self._rates)))
        elapsed = self._elapsed(stamp_ns, restart)
        memory_rows(force, places, elapsed, self._rates, self._edge, self._kept, means)
        return means

    def _elapsed(self, stamp_ns: Integers, restart: Bools) -> Array:
        """Seconds (s,) since the newest frame before; 0: not newer, below 0: a stream begins."""
        elapsed, newest = np.empty(len(stamp_ns)), self._newest_ns
        for i, (now, begins) in enumerate(zip(stamp_ns.tolist(), restart.tolist(), strict=True)):
            if begins or newest is None:
                elapsed[i], newest = -1.0, now
            else:
                elapsed[i] = max(now - newest, 0) * SECONDS_PER_NS
                newest = max(now, newest)
        self._newest_ns = newest
        return elapsed
