"""What the resting reading tells of the state of a skin, and how strange that state is.

Presses leave a set that recovers slowly, in the resting reading and in the stiffness (the Mullins
effect and stress relaxation of filled elastomers: Diani, Fayolle and Gilormini, Eur. Polym. J. 45,
2009). Where along that way a skin is shifts its gain. A resting reading that was never seen says
how little is known about the gain: a Gaussian process over resting readings, conditioned on the
nearest one seen, keeps the share 1 - exp(-(d / l)^2) of its variance at the distance d, l being
the length over which it varies (Rasmussen and Williams, Gaussian Processes, 2006, eq. 2.26).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_ros.estimators.kernel_ridge import spread_out
from tactile_ros.estimators.training import fitted
from tactile_ros.types import Array, Integers

LEAST_WIDTH = 1e-4
TINY = float(np.finfo(np.float64).tiny)


class RestingState:
    """The main way along which resting readings move within runs, and the readings seen.

    Parameters
    ----------
    slack : float
        How far beyond the range that was seen the state is followed, in ranges: what another
        day shifts for other reasons counts for no more than that.
    most : int
        Largest number of resting readings kept.

    Attributes
    ----------
    centre_, direction_ : ndarray, shape (d,)
        Mean resting reading (unit of the rests), and unit vector of the way; 0 where rests never
        moved.
    low_, high_ : float
        Range of the state that is followed (unit of the rests).
    known_ : ndarray, shape (n, d)
        Resting readings seen, less the centre (unit of the rests).
    width_ : float
        Root mean square length of the deviation from a run's mean (unit of the rests).
    tells_ : bool
        Whether a reading tells its run: there are several, and no two runs share one.

    Examples
    --------
    >>> state = RestingState().fit(np.array([[0.0, 5], [4, 5]]), np.zeros(2, np.int64))
    >>> state.along(np.array([[2.0, 5], [99, 5]])).tolist()
    [[0.0], [3.0]]
    >>> state.strangeness(np.array([[4.0, 5], [6, 5]])).round(3).tolist()
    [0.0, 0.632]
    """

    centre_: Array
    direction_: Array
    low_: float
    high_: float
    known_: Array
    width_: float
    tells_: bool

    def __init__(self, slack: float = 0.25, most: int = 32) -> None:
        self.slack = slack
        self.most = most

    def fit(self, rests: Array, runs: Integers) -> RestingState:
        """Learn from the resting reading under each row.

        Parameters
        ----------
        rests : ndarray, shape (s, d)
            Resting readings, finite.
        runs : ndarray of int, shape (s,)
            Run of each row.

        Returns
        -------
        RestingState
            Itself.
        """
        self.centre_ = rests.mean(axis=0)
        moved = rests - self.centre_
        within = rests.copy()
        for run in np.unique(runs):
            within[runs == run] -= within[runs == run].mean(axis=0)
        value, vector = np.linalg.eigh(within.T @ within / len(within))
        floor = LEAST_WIDTH * float(np.sqrt((rests**2).sum(axis=1).mean())) + TINY**0.5
        self.width_ = max(float(np.sqrt(max(value.sum(), 0.0))), floor)
        # a sign of its own, so that equal rests give equal numbers on every machine
        way = vector[:, -1] * np.sign(vector[np.argmax(np.abs(vector[:, -1])), -1])
        self.direction_ = way if self.width_ > floor else np.zeros_like(way)
        state = moved @ self.direction_
        beyond = self.slack * float(np.ptp(state))
        self.low_, self.high_ = float(state.min()) - beyond, float(state.max()) + beyond
        seen = np.unique(moved, axis=0)
        self.known_ = seen[spread_out(seen, self.most)]
        each = sum(len(np.unique(moved[runs == run], axis=0)) for run in np.unique(runs))
        self.tells_ = 1 < len(seen) == each
        for name in ('_table', '_latest'):
            vars(self).pop(name, None)
        return self

    def along(self, rests: Array) -> Array:
        """State of rests (s, d) along the way, shape (s, 1) (unit of the rests)."""
        return self.read(rests)[0]

    def strangeness(self, rests: Array) -> Array:
        """Share, 0 to 1, of the variance between states left at rests (s, d), shape (s,)."""
        return self.read(rests)[1]

    def read(self, rests: Array) -> tuple[Array, Array]:
        """Both at once, which a frame has time for.

        Parameters
        ----------
        rests : ndarray, shape (s, d)
            Resting readings.

        Returns
        -------
        along, strangeness : ndarray, shapes (s, 1), (s,)
            State along the way (unit of the rests), and the share of the variance between states
            that is left.

        Raises
        ------
        NotCalibratedError
            Before a fit.
        """
        fitted(self, 'width_')
        if len(rests) > 1:
            return self._read(rests)
        # the rest under successive frames is the same until the baseline moves
        name = rests.tobytes()
        answer = self._latest.get(name)
        if answer is None:
            answer = self._read(rests)
            self._latest.clear()
            self._latest[name] = answer
        return answer

    @cached_property
    def _latest(self) -> dict[bytes, tuple[Array, Array]]:
        """Answer for the rest that was asked for last."""
        return {}

    def _read(self, rests: Array) -> tuple[Array, Array]:
        ways, level, ends = self._table
        moved = rests - self.centre_
        table = moved @ ways
        table += level
        state = np.maximum(table[:, :1], ends[:1])
        np.minimum(state, ends[1:], out=state)
        # twice the product less the squares of both: less the squared distance, over the width
        near = np.maximum.reduce(table[:, 1:], axis=1)
        near -= (moved * moved).sum(axis=1) / self.width_**2
        np.minimum(near, 0.0, out=near)
        return state, -np.expm1(near, out=near) if self.tells_ else np.ones(len(rests))

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """Way and readings that rests are multiplied by, what is added, ends of the range."""
        known, unit = self.known_, self.width_**2
        ways = np.concatenate([self.direction_[:, None], 2 * known.T / unit], axis=1)
        level = np.concatenate([np.zeros(1), -(known * known).sum(axis=1) / unit])
        return ways, level, np.array([self.low_, self.high_])
