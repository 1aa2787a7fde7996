"""Creep of a piezoresistive skin, and its inverse: the force behind a crept reading.

A load that is held makes the output creep up through a few Voigt elements (spring beside dashpot).
The inverse runs the same elements on the force that it has just computed, so it needs no
derivative, its gain on noise is at most 1 at any rate, and a gap of any length is one exponential.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers

NS = 1e-9


@compiled
def branch_weights(elapsed: float, tau: Array, weights: Array) -> None:
    """Fill weights (3, b) of old strain, last and new force, which is linear in between."""
    for b in range(len(tau)):
        part = elapsed / tau[b]
        decay, mean = math.exp(-part), -math.expm1(-part) / part
        weights[0, b], weights[1, b], weights[2, b] = decay, mean - decay, 1.0 - mean


@compiled
def undo_row(
    v: Array, share: Array, weights: Array, strain: Array, last: Array, force: Array
) -> None:
    """Fill forces (t,) behind crept ones after a time; strains and last forces move on."""
    for k in range(len(v)):
        bent, stiff = 0.0, 0.0
        for b in range(len(share)):
            strain[b, k] = weights[0, b] * strain[b, k] + weights[1, b] * last[k]
            bent += share[b, k] * strain[b, k]
            stiff += share[b, k] * weights[2, b]
        # the new force moves the strain too: one linear equation for each taxel
        force[k] = (v[k] - bent) / (1.0 + stiff)
        if not math.isnan(force[k]):
            last[k] = force[k]
        for b in range(len(share)):
            strain[b, k] += weights[2, b] * last[k]


@compiled
def undo_rows(
    v: Array, stamp_ns: Integers, restart: Bools, tau: Array, share: Array, begun: bool,
    newest: int, strain: Array, last: Array, forces: Array,
) -> tuple[bool, int]:  # fmt: skip
    """Fill forces (s, t) behind crept ones; true once a stream has begun, and its newest stamp."""
    weights = np.empty((3, len(tau)))
    for i in range(len(v)):
        if restart[i]:
            strain[:] = 0.0
            last[:] = 0.0
            begun = False
        if begun and stamp_ns[i] > newest:
            branch_weights((stamp_ns[i] - newest) * NS, tau, weights)
            undo_row(v[i], share, weights, strain, last, forces[i])
            newest = stamp_ns[i]
            continue
        for k in range(len(last)):
            bent = 0.0
            for b in range(len(share)):
                bent += share[b, k] * strain[b, k]
            forces[i, k] = v[i, k] - bent
            if not begun:
                last[k] = 0.0 if math.isnan(forces[i, k]) else forces[i, k]
        if not begun:
            begun, newest = True, stamp_ns[i]
    return begun, newest


class Creep:
    """State-space inverse: v = F + sum_i c_i x_i with tau_i dx_i/dt = F - x_i.

    Parameters
    ----------
    tau : ndarray, shape (b,)
        Time constants of the branches (s).
    share : ndarray, shape (b, t)
        Share of each branch in the settled output, at least 0.

    Examples
    --------
    >>> creep = Creep(np.array([1.0]), np.array([[0.5]]))
    >>> v = 1 + 0.5 * -np.expm1(-np.arange(3.0))[:, None]
    >>> stamps = np.arange(3) * 1_000_000_000
    >>> creep.undo(v, stamps, np.zeros(3, bool), creep.start()).round(2).ravel().tolist()
    [1.0, 1.0, 1.0]
    """

    def __init__(self, tau: Array, share: Array) -> None:
        self.tau = np.asarray(tau, np.float64)
        self.share = np.asarray(share, np.float64)

    def start(self) -> CreepState:
        """State of a skin that was never pressed."""
        return CreepState(np.zeros(self.share.shape), np.zeros(self.share.shape[1]))

    def undo(self, v: Array, stamp_ns: Integers, restart: Bools, state: CreepState) -> Array:
        """Forces behind crept ones, frame by frame.

        Parameters
        ----------
        v : ndarray, shape (s, t)
            Forces as a law without memory reads them (N); NaN: not measured.
        stamp_ns : ndarray, shape (s,)
            Acquisition times; a frame that is not newer is answered from the state as it is.
        restart : ndarray, shape (s,)
            Frames before which the past is forgotten.
        state : CreepState
            Moves on.

        Returns
        -------
        ndarray, shape (s, t)
            Forces (N); NaN where nothing was measured: there the last one is held inside.
        """
        forces = np.empty(v.shape)
        begun, newest = undo_rows(
            np.ascontiguousarray(v), stamp_ns, restart, self.tau, self.share,
            state.stamp_ns is not None, state.stamp_ns or 0, state.strain, state.last, forces,
        )  # fmt: skip
        state.stamp_ns = int(newest) if begun else None
        return forces


class CreepState:
    """Strain of every branch (b, t), last force (t,) and its stamp; None: nothing yet."""

    def __init__(self, strain: Array, last: Array) -> None:
        self.strain, self.last = strain, last
        self.stamp_ns: int | None = None


def strains(force: Array, tau: Array, stamp_ns: Integers, restart: Bools) -> Array:
    """Strains (s, b, t) of branches (b,) under forces (s, t): the forward model."""
    strain = np.empty((len(force), len(tau), force.shape[1]))
    now, weights = np.zeros(strain.shape[1:]), np.empty((3, len(tau)))
    for i in range(len(force)):
        if i == 0 or restart[i]:
            now = np.zeros_like(now)
        elif stamp_ns[i] > stamp_ns[i - 1]:
            branch_weights((stamp_ns[i] - stamp_ns[i - 1]) * NS, tau, weights)
            old, last, new = weights[:, :, None]
            now = old * now + last * force[i - 1] + new * force[i]
        strain[i] = now
    return strain
