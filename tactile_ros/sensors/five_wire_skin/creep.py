# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Creep of the film: the share of a reading that past loads have left where the skin is touched.

The logarithm of the force is the static curve's plus shares of fading means of the past force, in
units of the force now. A touch elsewhere meets fresh film; one that is drawn along leaves behind
what has crept, where the recording shows that.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Integers

TIME_CONSTANTS = np.array([0.3, 1.0, 4.0, 16.0, 64.0])  # s
VARIATION = 0.15  # of what is taken off: no two places of a film creep alike
STILL = 0.05  # of the touch's edge: moves that are noise
ROUNDS = 3  # in which a force and its own share of the means settle
FORCE, X, Y, MEANS = 0, 1, 2, 3  # columns of the state


@compiled
def overlap(state: Array, x: float, y: float, edge: float) -> float:
    """Share of a touch at a place with the one of the state, which follows it."""
    share = 1.0
    for i, now in ((X, x), (Y, y)):
        if math.isnan(state[i]):
            state[i] = now
        off = now - state[i]
        moved = max(abs(off) - STILL * edge, 0.0)
        share *= max(1.0 - moved / edge, 0.0)
        state[i] += math.copysign(moved, off)
    return share


@compiled
def creep_rows(
    static: Array, places: Array, stamp_ns: Integers, restart: Bools, rates: Array, law: Array,
    shares: Array, state: Array, clock: Integers, force: Array, ratios: Array,
) -> None:  # fmt: skip
    """Write forces (s,) without creep and the fading means over them (s, m).

    Parameters
    ----------
    static : ndarray, shape (s,)
        Forces of the static curve (N); 0 where nothing touches; NaN: unusable, the last one holds.
    places, stamp_ns, restart : ndarray, shapes (s, 2), (s,) and (s,)
        Of the touches (m); acquisition times; frames before which the past is forgotten.
    rates, law : ndarray, shapes (m,) and (3,)
        1 / time constants (1/s); edge of a touch (m), inf: the past counts wherever it was; the
        largest ratio; force of the air gap (N).
    shares : ndarray, shape (m,)
        Of the ratios, in the logarithm of the force.
    state, clock : ndarray, shapes (3 + m,) and (2,)
        Of the stream: last force, place and means; whether it has begun, newest stamp.
    """
    count = len(rates)
    means, old, fresh = np.empty(count), np.empty(count), np.empty(count)
    for s in range(len(static)):
        begins = restart[s] or clock[0] == 0
        if begins:
            state[:], state[X], state[Y] = 0.0, math.nan, math.nan
            clock[0], clock[1] = 1, stamp_ns[s]
        elapsed = max(stamp_ns[s] - clock[1], 0) * 1e-9
        newer, held = elapsed > 0.0, math.isnan(static[s])
        share = 1.0
        if newer and static[s] > 0.0 and math.isfinite(law[0]) and math.isfinite(places[s, 0]):
            share = overlap(state, places[s, 0], places[s, 1], law[0])
        for i in range(count):
            old[i], fresh[i] = state[MEANS + i], 0.0
            if newer:
                phase = rates[i] * elapsed
                decay, average = math.exp(-phase), -math.expm1(-phase) / phase
                old[i] = share * (decay * old[i] + (average - decay) * state[FORCE])
                fresh[i] = 1.0 - average
        now = state[FORCE] if held else static[s]
        first = now - law[2]
        for _ in range(ROUNDS):
            total = 0.0
            for i in range(count):
                means[i] = old[i] + fresh[i] * now
                ratios[s, i] = min(means[i] / now, law[1]) if now > 0.0 else 0.0
                total += shares[i] * ratios[s, i]
            if not held and now > law[2]:
                now = first * math.exp(total) + law[2]
        force[s] = math.nan if held else now
        if newer or begins:
            state[FORCE], clock[1] = now, stamp_ns[s]
            state[MEANS:] = means


class FilmMemory:
    """Past of one stream, one frame at a time or many with the same numbers."""

    def __init__(self) -> None:
        self._state = np.zeros(MEANS + len(TIME_CONSTANTS))
        self._clock = np.zeros(2, np.int64)

    def __call__(
        self, creep: FilmCreep, static: Array, places: Array, stamp_ns: Integers, restart: Bools
    ) -> tuple[Array, Array]:
        """Forces (s,) (N) without creep, and the ratios (s, m) of the means; see `creep_rows`."""
        force, ratios = np.empty(len(static)), np.empty((len(static), len(TIME_CONSTANTS)))
        law = np.array([creep.edge, creep.most, creep.gap])
        creep_rows(
            static, places, stamp_ns, restart, 1 / TIME_CONSTANTS, law, creep.shares_,
            self._state, self._clock, force, ratios,
        )  # fmt: skip
        return force, ratios


class FilmCreep:
    """Shares of the past in the logarithm of a force.

    Parameters
    ----------
    edge : float
        Of a touch (m), where the past counts by place; infinite: wherever it was.
    most : float
        Largest ratio of a fading mean to the force; 1: a film loses what it has crept as the
        load goes.

    gap : float
        Force that the air gap takes, which does not creep (N).

    Attributes
    ----------
    shares_, covariance_ : ndarray, shapes (m,) and (m, m)
        Of the ratios, 0 before a fit.
    """

    def __init__(self, edge: float = np.inf, most: float = 1.0, gap: float = 0.0) -> None:
        self.edge, self.most, self.gap = edge, most, gap
        self.report_: dict[str, float] = {}
        self.shares_ = np.zeros(len(TIME_CONSTANTS))
        self.covariance_ = np.zeros((len(TIME_CONSTANTS),) * 2)

    def variance(self, ratios: Array) -> Array:
        """Variance (s,) of the logarithm of a force by the shares and their variation."""
        # no product of matrices: its sums run otherwise for one frame than for many
        total = np.einsum('sm,m->s', ratios, self.shares_)
        own = np.einsum('sm,mk,sk->s', ratios, self.covariance_, ratios)
        return np.asarray((VARIATION * total) ** 2 + own)
