"""Creep of a piezoresistive skin, printed and undone: what was pressed from what is read.

A load that is held makes the output creep up through a few Voigt elements (spring beside dashpot).
The inverse runs the same elements on the force that it has just found, so it needs no derivative,
its gain on noise is at most 1 at any rate, and a gap of any length is one exponential.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import available, compiled
from tactile_ros.types import Array, Bools, Integers

NS = 1e-9


@compiled
def fading(elapsed: float, tau: Array, weights: Array) -> None:
    """Weights (3, b) of old strain, last and new force after so many seconds; filled."""
    for b in range(len(tau)):
        part = elapsed / tau[b]
        decay, mean = math.exp(-part), -math.expm1(-part) / part
        weights[0, b], weights[1, b], weights[2, b] = decay, mean - decay, 1.0 - mean


@compiled
def answered(v: Array, share: Array, strain: Array, force: Array) -> None:
    """Forces (t,) behind crept ones, the strains as they are; filled."""
    for k in range(len(v)):
        bent = 0.0
        for b in range(len(share)):
            bent += share[b, k] * strain[b, k]
        force[k] = v[k] - bent


@compiled
def moved(
    v: Array, share: Array, weights: Array, strain: Array, last: Array, force: Array
) -> None:
    """Forces (t,) behind crept ones after a time; strains and last forces move on."""
    for k in range(len(v)):
        bent, stiff = 0.0, 0.0
        for b in range(len(share)):
            strain[b, k] = weights[0, b] * strain[b, k] + weights[1, b] * last[k]
            bent += share[b, k] * strain[b, k]
            stiff += share[b, k] * weights[2, b]
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
    """Forces (s, t) behind crept ones; whether the stream has begun, and its newest stamp."""
    weights = np.empty((3, len(tau)))
    for i in range(len(v)):
        if restart[i]:
            strain[:] = 0.0
            last[:] = 0.0
            begun = False
        if begun and stamp_ns[i] > newest:
            fading((stamp_ns[i] - newest) * NS, tau, weights)
            moved(v[i], share, weights, strain, last, forces[i])
            newest = stamp_ns[i]
            continue
        answered(v[i], share, strain, forces[i])
        if not begun:
            for k in range(len(last)):
                last[k] = 0.0 if math.isnan(forces[i, k]) else forces[i, k]
            begun, newest = True, stamp_ns[i]
    return begun, newest


def step_response(time: Array, gain: float, t1: float, ti: float, td: float) -> Array:
    """Step response of [4] Eq. (1), a PID element with a lag.

    Parameters
    ----------
    time : ndarray, shape (s,)
        Since the step (s).
    gain, t1, ti, td : float
        K, and the times of lag, integral and derivative (s).

    Returns
    -------
    ndarray, shape (s,)
        Output (unit of gain).

    Examples
    --------
    >>> step_response(np.array([0.0]), 2.0, 1.0, 4.0, 0.5).tolist()
    [1.0]
    """
    fading = (td / t1 + t1 / ti - 1.0) * np.exp(-time / t1)
    return np.asarray(gain * (1.0 + (time - t1) / ti + fading))


def voigt_strain(time: Array, stress: float, modulus: float, viscosity: float) -> Array:
    """Strain of a Voigt element under a stress held since 0: (s / E) (1 - exp(-E t / eta))."""
    return np.asarray(stress / modulus * -np.expm1(-modulus * time / viscosity))


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
        if available():
            state.looped(np.ascontiguousarray(v), stamp_ns, restart, self, forces)
            return forces
        for i in range(len(v)):
            if restart[i]:
                state.forget()
            forces[i] = self._next(v[i], int(stamp_ns[i]), state)
        return forces

    def _next(self, v: Array, stamp_ns: int, state: CreepState) -> Array:
        """Force of one frame (t,)."""
        if state.stamp_ns is None or stamp_ns <= state.stamp_ns:
            force = v - np.einsum('bt,bt->t', self.share, state.strain)
            if state.stamp_ns is None:
                state.last, state.stamp_ns = np.where(np.isnan(force), 0.0, force), stamp_ns
            return np.asarray(force)
        decay, before, now = _weights((stamp_ns - state.stamp_ns) * NS / self.tau)
        moved = decay * state.strain + before * state.last
        # the new force moves the strain too: one linear equation for each taxel
        force = v - np.einsum('bt,bt->t', self.share, moved)
        force = force / (1.0 + (self.share * now).sum(axis=0))
        held = np.where(np.isnan(force), state.last, force)
        state.strain, state.last, state.stamp_ns = moved + now * held, held, stamp_ns
        return np.asarray(force)


class CreepState:
    """Strain of every branch (b, t), last force (t,) and its stamp; None: nothing yet."""

    def __init__(self, strain: Array, last: Array) -> None:
        self.strain, self.last = strain, last
        self.stamp_ns: int | None = None

    def looped(
        self, v: Array, stamp_ns: Integers, restart: Bools, creep: Creep, forces: Array
    ) -> None:
        """As `Creep.undo`, by compiled loops; `forces` is filled."""
        begun, newest = undo_rows(
            v, stamp_ns, restart, creep.tau, creep.share, self.stamp_ns is not None,
            self.stamp_ns or 0, self.strain, self.last, forces,
        )  # fmt: skip
        self.stamp_ns = int(newest) if begun else None

    def forget(self) -> None:
        """Begin anew, as never pressed."""
        self.strain, self.last = np.zeros_like(self.strain), np.zeros_like(self.last)
        self.stamp_ns = None


def _weights(elapsed: Array) -> tuple[Array, Array, Array]:
    """Weights (b, 1) of old strain, last and new force, which is linear in between."""
    decay = np.exp(-elapsed)
    mean = -np.expm1(-elapsed) / elapsed
    return decay[:, None], (mean - decay)[:, None], (1.0 - mean)[:, None]


def strains(force: Array, tau: Array, stamp_ns: Integers, restart: Bools) -> Array:
    """Strains (s, b, t) of branches (b,) under known forces (s, t): the forward model."""
    strain = np.empty((len(force), len(tau), force.shape[1]))
    now = np.zeros(strain.shape[1:])
    for i in range(len(force)):
        if i == 0 or restart[i]:
            now = np.zeros_like(now)
        elif stamp_ns[i] > stamp_ns[i - 1]:
            weights = _weights((stamp_ns[i] - stamp_ns[i - 1]) * NS / tau)
            now = weights[0] * now + weights[1] * force[i - 1] + weights[2] * force[i]
        strain[i] = now
    return strain
