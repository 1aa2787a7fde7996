"""The disc's model from a recording that warms: lag, drifts of channels and what expands.

The disc's model tells drifts and lag as far as pixels see more than three freedoms; force tells
the rest, since an elastomer's force is a smooth function of the disc's true place. Each is found
with the other, and what neither tells stays in a covariance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.disc_model import WEAKENING, WEAKER
from tactile_ros.estimators.misled_place import misled
from tactile_ros.estimators.warm_polynomial import WarmPolynomial

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.estimators.disc_inversion import DiscInversion
    from tactile_ros.sensors.gradiometer.readings import Readings
    from tactile_ros.types import Array, Bools, Integers, Signals

CLEARLY = 20.0  # chi square by which a lag must explain more than none
FEWEST_FORCES, MOST_FORCES = 100, 1500
LATER = 0.05  # of the logarithm of a time constant
FARTHEST = 3.0  # of these
TOUCH = 2e-5  # T: a small change of one difference
FINER, GOLDEN = 7, 0.618
TURNS = 3  # each is found with the others


class WarmFit:
    """One fit of a disc's model.

    Parameters
    ----------
    signals : Signals
        Of the recording.
    readings : Readings
        Learned from the same; what rests at other temperatures read is learned here.
    fresh : callable
        A disc's model that has learned nothing.
    warmth : callable
        Temperatures of the disc (s,) that lags behind the chip by a time constant (s).
    resting, rows, force : ndarray, shape (s,), (m,), (s, 3)
        Rows that rest; indices of those to learn from; force (N), NaN where none was told.

    Attributes
    ----------
    lag : float
        Time constant in use (s).
    change : ndarray, shape (s, n)
        Changes of field as readings tell them by now (T).
    """

    def __init__(
        self,
        signals: Signals,
        readings: Readings,
        fresh: Callable[[], DiscInversion],
        warmth: Callable[[float], Array],
        resting: Bools,
        rows: Integers,
        force: Array,
    ) -> None:
        self.signals, self.readings, self.fresh, self.warmth = signals, readings, fresh, warmth
        self.resting, self.rows, self.force = resting, rows, force
        told = rows[np.isfinite(force[rows]).all(axis=1)]
        self.told = _spread(told) if len(told) >= FEWEST_FORCES else told[:0]
        self.change = readings.change(signals)
        self.lag, self.seeks_lag = 0.0, False

    def fit(self, lag: float) -> DiscInversion:
        """Learn the disc's model; a lag of 0 is sought, another one is taken."""
        self.lag = lag
        if self.readings.warm_ and lag == 0:
            self._learn_lag()
            self.seeks_lag = self.lag > 0
        disc = self._learn_disc()
        if self.readings.rest_ is not None and len(self.told):
            self._learn_from_force(disc)
        elif self.readings.rest_ is not None:
            self.readings.rest_.unsure_ = disc.unsure_warmth(disc.projection_)[:-1, :-1]
        return disc

    def _since_rest(self, warm: Array) -> Array:
        """Temperatures of the disc (s,) from that of the rests of the fit."""
        rest = warm[self.resting]
        return warm - (rest.mean() if len(rest) else 0.0)

    def _learn_lag(self) -> None:
        """Take the time constant with which the disc's model, and force, are explained best."""
        disc, costs, drift = self.fresh(), {}, self.readings.drifts(self.signals)

        def left(lag: float) -> float:
            if lag not in costs:
                costs[lag] = self._left(disc, self._since_rest(self.warmth(lag)), drift)
            return costs[lag]

        best = min([0.0, *(float(lag) for lag in self.readings.lags_)], key=left)
        if best == 0 or left(best) > left(0.0) - CLEARLY:
            return
        low, high = best / 3, best * 3
        for _ in range(FINER):  # golden section of the logarithm
            first, second = low**GOLDEN * high ** (1 - GOLDEN), low ** (1 - GOLDEN) * high**GOLDEN
            low, high = (low, second) if left(first) < left(second) else (first, high)
        near = sorted(sorted((lag for lag in costs if lag > 0), key=left)[:3])
        best = float(_lowest(np.log(near), np.array([left(lag) for lag in near])))
        self.lag = float(np.clip(np.exp(best), near[0], near[-1]))

    def _left(self, disc: DiscInversion, heat: Array, drift: Array) -> float:
        """Twice the negative logarithm of the likelihood of temperatures (s,) of the disc."""
        rows, told = self.rows, self.told
        cost = disc.leaves(self.change[rows], heat[rows], drift[rows])
        if not len(told):
            return cost
        force, read = self.force[told], self.change[told] - drift[told] @ disc.offset
        seen = np.column_stack([disc.invert(read, heat[told])[0], heat[told]])
        share = WarmPolynomial((3,)).leaves(seen, force) / force.size
        return cost + force.size * float(np.log(share))

    def _learn_disc(self) -> DiscInversion:
        """Learn the disc's model and what rests at other temperatures read."""
        readings, rows = self.readings, self.rows
        warm = self.warmth(self.lag)
        heat, offset = self._since_rest(warm), np.zeros((2, self.change.shape[1]))
        for _ in range(TURNS):
            drift = readings.drifts(self.signals)
            disc = self.fresh().fit(self.change[rows], heat[rows], drift[rows])
            if readings.rest_ is None:
                break
            offset = offset + disc.offset
            rise = self._rise(disc, self.change - drift @ disc.offset, heat)
            self._take(warm, disc.warmed(rise), offset)
            heat = warm
        return disc

    def _take(self, warm: Array, warmer: Array, offset: Array) -> None:
        """Let readings know what rests at other temperatures read."""
        self.readings.learn_warm_rest(self.signals, self.resting, warm, warmer, offset)
        self.change = self.readings.change(self.signals)

    def _rise(self, disc: DiscInversion, change: Array, heat: Array) -> float:
        """By how much a warmer disc rests higher (gaps over a unit), told by force; 0: untold."""
        if not len(self.told):
            return 0.0
        place = disc.invert(change[self.told], heat[self.told])[0]
        model = WarmPolynomial((3,))
        model.leaves(np.column_stack([place, heat[self.told]]), self.force[self.told])
        return float(model.rise_[0])

    def _learn_from_force(self, disc: DiscInversion) -> None:
        """Learn drifts, lag and what warmth does to remanence together, from force."""
        rest, told, force = self.readings.rest_, self.told, self.force[self.told]
        assert rest is not None
        base, weakening, lag = rest.offset_, disc.found_[WEAKENING], self.lag
        ways = disc.projection_
        usual = np.asarray(np.linalg.cholesky(disc.unsure_warmth(ways)))
        sizes = np.zeros(len(usual) + 1)
        for _ in range(TURNS):
            warm = self.warmth(self.lag)
            later = LATER * self._later(warm)[told]
            place = disc.invert(self.change[told], warm[told])[0]
            amiss = self._amiss(disc, place, warm[told], later, usual)
            moves = self._moves(disc, place, warm[told], amiss)
            found = misled(place, moves, warm[told], -later, force, sizes)
            sizes = found.sizes
            *drift, weaker = usual @ sizes[:-1]
            disc.weaken(weakening + weaker / WEAKER)
            if self.seeks_lag:
                self.lag = lag * float(np.exp(LATER * np.clip(sizes[-1], -FARTHEST, FARTHEST)))
            offset = base + np.reshape(drift, (2, -1)) @ ways.T
            self._take(self.warmth(self.lag), disc.warmed(found.rise), offset)
        cov = (usual @ found.cov[:-1, :-1] @ usual.T)[:-1, :-1]
        assert self.readings.rest_ is not None
        self.readings.rest_.unsure_ = cov

    def _later(self, warm: Array) -> Array:
        """Change of the disc's temperatures (s,) by a larger logarithm of its time constant."""
        if not self.seeks_lag:
            return np.zeros(len(warm))
        return (self.warmth(self.lag * np.exp(LATER)) - warm) / LATER

    def _amiss(
        self, disc: DiscInversion, place: Array, heat: Array, later: Array, usual: Array
    ) -> Array:
        """What errors of usual sizes add to changes of told rows, shape (s, p, n) (T)."""
        drift = self.readings.drifts(self.signals)[self.told]
        each = np.einsum('sk,nm->skmn', drift, disc.projection_)
        field = disc.fields(place, heat)
        each = each.reshape(len(field), -1, field.shape[1])
        one = np.concatenate([each, (heat[:, None] * field)[:, None]], axis=1)
        weaker = WEAKER * disc.found_[WEAKENING] * later[:, None]
        amiss = np.einsum('spn,pq->sqn', one, usual)
        return np.concatenate([amiss, (weaker * field)[:, None]], axis=1)

    def _moves(self, disc: DiscInversion, place: Array, heat: Array, amiss: Array) -> Array:
        """What additions (s, p, n) (T) to changes of told rows do to places (s, p, 3)."""
        change, ways = self.change[self.told], disc.projection_
        slopes = [(disc.invert(change + TOUCH * way, heat)[0] - place) / TOUCH for way in ways.T]
        return np.asarray(np.einsum('spn,nm,msi->spi', amiss, ways, np.array(slopes)))


def _spread(rows: Integers) -> Integers:
    """No more rows than are learned from, evenly spread."""
    few = np.linspace(0, len(rows) - 1, min(len(rows), MOST_FORCES))
    return np.asarray(rows[few.astype(int)])


def _lowest(x: Array, y: Array) -> float:
    """Where the parabola through three points is lowest; the lowest point, where it is not."""
    bend, slope, _ = np.polyfit(x - x[1], y, 2)
    return float(x[1] - slope / (2 * bend) if bend > 0 else x[np.argmin(y)])
