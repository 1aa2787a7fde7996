# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Model inversion: bundle adjustment with priors for calibration, MAP by Gauss-Newton for frames.

A sensor with physics is a forward model ``readings = h(state, parameters)`` with Gaussian priors
on both. `calibrate` estimates the states of all frames and the shared parameters together: states
are eliminated frame by frame by the Schur complement, so that its cost is linear in frames.
`invert` estimates the state of each frame at fixed parameters. Both give the Laplace covariance;
that of the parameters widens every answer, and what a recording did not determine stays at its
prior. Nuisance quantities (stray field, temperature, error of the baseline) are states with
priors. Answers (force, torque, place) are functions of state and parameters; references of them
enter the calibration with noise of their own and a robust loss.

Sources: B. Triggs et al., Bundle adjustment, a modern synthesis (2000), sec. 6; J. Nocedal and
S. Wright, Numerical Optimization (2006), ch. 10; C. Bishop, Pattern Recognition (2006), sec. 4.4.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from tactile_ros.estimators.covariance import scaled
from tactile_ros.physics.compiled import call_model, compiled, inlined, model_address

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Array, Integers

    Model = Callable[[Array, Array, Array, Array, Array, Array], None]

DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-12, 1e8
HUBER = 2.0  # sigma from which the residual of a reference counts linearly
MOST_STEPS = 60
GAIN = 1e-9  # of the cost, below which a step ends the descent
SETTLE = 4  # steps in which states follow the parameters
FIXED, TINY = 1e-9, 1e-12  # sigma of a state that is fixed in some frames; of none
SMALLEST = 1e-300


@dataclass(frozen=True)
class ModelPrior:
    """Forward models with the priors of state and parameters.

    A model is ``function(state (n,), parameters (k,), data, out (m,), by_state (m, n),
    by_parameter (m, k))``, compiled, and writes its outputs and both Jacobians, which come with
    zeros. Where nobody asks for the second it has no rows and must not be written.
    """

    readings: Model  # m of them
    answers: Model  # l of them
    noise: Array  # (m,) standard deviation of readings; inf: not used
    answer_noise: Array  # (l,) standard deviation of reference answers
    # (n,) prior of the state; sigma inf: none, 0: fixed
    state: Array
    state_sigma: Array
    # (k,) prior of the parameters; sigma 0: fixed
    parameters: Array
    parameter_sigma: Array
    data: Array = field(default_factory=lambda: np.zeros(0))  # constants: tables, nominal places

    @property
    def parameter_information(self) -> Array:
        """Inverse variance of the parameters' prior, shape (k,); 0 where they are fixed."""
        free = self.parameter_sigma > 0
        return np.where(free, 1.0 / np.where(free, self.parameter_sigma, 1.0) ** 2, 0.0)


@dataclass  # as Signals, frozen it costs a frame 2 us
class Frames:
    """Readings of frames with the prior of each: all arrays are contiguous, one row a frame."""

    readings: Array
    prior: Array
    information: Array  # (s, n) inverse variance of the prior
    noise: Array
    free: Integers  # (d,) states that are estimated; the others stay where they start

    def of(self, rows: Integers) -> Frames:
        """Some of the frames."""
        return Frames(
            self.readings[rows], self.prior[rows], self.information[rows], self.noise[rows],
            self.free,
        )  # fmt: skip


@dataclass(frozen=True)
class Calibration:
    """Estimated parameters."""

    # (k,) and (k, k) estimate and Laplace covariance; a fixed parameter has zeros
    parameters: Array
    covariance: Array
    states: Array  # (s, n) of the frames
    cost: float  # half the sum of squared normalised residuals and prior terms
    converged: bool  # before the largest number of steps

    def shared(self, prior: ModelPrior, own: Array) -> Calibration:
        """Part of the calibration that other recordings share.

        By sigmas `own` (k,), such as the noise of its tare, parameters differ from those of others
        beside their prior: of what was found only shares stay.
        """
        usual = prior.parameter_sigma
        share = 1 / (1 + np.square(own / np.maximum(usual, TINY)))
        away = self.parameters - prior.parameters
        covariance = scaled(self.covariance, share)
        covariance[np.diag_indices(len(share))] += (1 - share) * usual**2
        return replace(self, parameters=prior.parameters + share * away, covariance=covariance)

    @cached_property
    def root(self) -> Array:
        """Lower triangle (k, k) whose product with its transpose is the covariance."""
        scale = np.sqrt(np.diagonal(self.covariance))
        free = scale > 0
        root = np.zeros_like(self.covariance)
        unit = self.covariance[np.ix_(free, free)] / np.outer(scale[free], scale[free])
        size, ways = np.linalg.eigh(unit)
        upper = np.asarray(np.linalg.qr((ways * np.sqrt(np.maximum(size, 0.0))).T, mode='r'))
        root[np.ix_(free, free)] = scale[free][:, None] * upper.T
        return root


@dataclass
class Posterior:
    """Most probable states of frames, and answers with their covariance."""

    states: Array  # (s, n)
    # (s, l) and (s, l, l), Laplace's by noise, prior and parameter covariance
    answers: Array
    answer_covariance: Array
    chi_square: Array  # (s,) squared normalised residuals and prior terms


@inlined
def _factor(matrix: Array) -> bool:
    """Cholesky factor in place, lower triangle; False where the matrix is not positive."""
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i != j:
                matrix[i, j] = total / matrix[j, j]
            elif total > 0.0:
                matrix[i, i] = np.sqrt(total)
            else:
                return False
    return True


@inlined
def _substitute(factor: Array, right: Array) -> None:
    """Solve in place for every column by a Cholesky factor."""
    n, columns = right.shape
    for i in range(n):
        for k in range(i):
            for c in range(columns):
                right[i, c] -= factor[i, k] * right[k, c]
        for c in range(columns):
            right[i, c] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            for c in range(columns):
                right[i, c] -= factor[k, i] * right[k, c]
        for c in range(columns):
            right[i, c] /= factor[i, i]


@inlined
def _weigh(
    values: Array, out: Array, sigma: Array, huber: float, residual: Array, weight: Array
) -> float:
    """Write residuals and weights of one frame, 0 where not measured; return their cost."""
    cost = 0.0
    for m in range(values.size):
        residual[m], weight[m] = 0.0, 0.0
        if np.isfinite(values[m]) and np.isfinite(sigma[m]):
            residual[m] = values[m] - out[m]
            z = abs(residual[m]) / sigma[m]
            weight[m] = 1.0 / sigma[m] ** 2
            if z > huber:
                weight[m] *= huber / z
                cost += huber * z - 0.5 * huber**2
            else:
                cost += 0.5 * z * z
    return cost


@inlined
def _accumulate(
    residual: float, w: float, by_state: Array, by_parameter: Array, used: Integers, a: Array,
    b: Array, c: Array, gx: Array, gp: Array,
) -> None:  # fmt: skip
    """Add a weighted residual to the normal equations a, b, lower c with right sides gx, gp.

    Slopes by parameters count where they are `used`.
    """
    n = len(b)
    for i in range(n):
        slope = w * by_state[i]
        if slope != 0.0:
            gx[i] += slope * residual
            for j in range(n):
                a[i, j] += slope * by_state[j]
            for t in used:
                b[i, t] += slope * by_parameter[t]
    if c.shape[0] == 0:
        return
    for s in range(used.size):
        slope = w * by_parameter[used[s]]
        gp[used[s]] += slope * residual
        for t in used[: s + 1]:
            c[used[s], t] += slope * by_parameter[t]


@compiled
def _frame(
    readings: Model, answers: Model, y: Array, f: Array, noise: Array, answer_noise: Array,
    prior: Array, information: Array, free: Integers, x: Array, p: Array, data: Array,
    a: Array, b: Array, c: Array, gx: Array, gp: Array,
) -> float:  # fmt: skip
    """Write the normal equations of a frame, add to those of the parameters; return the cost.

    Of a b without columns, and a c without rows, nothing is written.
    """
    n, k, asked, cost = free.size, p.size, b.shape[1] > 0, 0.0
    unused, nowhere = np.empty(0), np.empty(0, np.int64)
    a[:], b[:], gx[:] = 0.0, 0.0, 0.0
    for t in range(n):
        i = free[t]
        if information[i] > 0.0:
            a[t, t] = information[i]
            gx[t] = information[i] * (prior[i] - x[i])
            cost += 0.5 * gx[t] * (prior[i] - x[i])
    for part in range(2):
        values, sigma = (y, noise) if part == 0 else (f, answer_noise)
        m = values.size
        if m == 0:
            continue
        out, residual, weight = np.empty(m), np.empty(m), np.empty(m)
        by_state, by_parameter = np.zeros((m, x.size)), np.zeros((m if asked else 0, k))
        if part == 0:
            call_model(readings, x, p, data, out, by_state, by_parameter)
            cost += _weigh(values, out, sigma, np.inf, residual, weight)
        else:
            call_model(answers, x, p, data, out, by_state, by_parameter)
            cost += _weigh(values, out, sigma, HUBER, residual, weight)
        for i in range(m):
            for t in range(n):
                by_state[i, t] = by_state[i, free[t]]
        for i in range(m):
            if weight[i] != 0.0:
                slope = by_parameter[i] if asked else unused
                used = np.flatnonzero(slope) if asked else nowhere
                _accumulate(residual[i], weight[i], by_state[i], slope, used, a, b, c, gx, gp)
    return cost


@compiled
def _descend(
    readings: Model, answers: Model, y: Array, f: Array, noise: Array, answer_noise: Array,
    prior: Array, information: Array, free: Integers, p: Array, data: Array, x: Array,
    most_steps: int,
) -> float:  # fmt: skip
    """Descend from x to the best state of one frame by damped Gauss-Newton; return its cost."""
    n, none, square, flat = free.size, np.empty(0), np.empty((0, 0)), np.empty((free.size, 0))
    gx, right, slope, trial = np.empty(n), np.empty((n, 1)), np.empty(n), x.copy()
    a, system, there = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    cost = _frame(
        readings, answers, y, f, noise, answer_noise, prior, information, free, x, p, data, a,
        flat, square, gx, none,
    )  # fmt: skip
    damping = DAMPING
    for _ in range(most_steps):
        system[:], right[:, 0] = a, gx
        for i in range(n):
            system[i, i] *= 1.0 + damping
        new = np.inf
        if _factor(system):
            _substitute(system, right)
            gained = 0.0  # twice what the step promises
            for t in range(n):
                gained += right[t, 0] * gx[t]
                trial[free[t]] = x[free[t]] + right[t, 0]
            if gained <= GAIN * (1e-3 + cost):
                x[:] = trial
                break
            new = _frame(
                readings, answers, y, f, noise, answer_noise, prior, information, free, trial, p,
                data, there, flat, square, slope, none,
            )  # fmt: skip
        if new <= cost:
            damping = max(0.1 * damping, LEAST_DAMPING)
            x[:], a[:], gx[:], cost = trial, there, slope, new
        else:
            damping *= 10.0
            if damping > MOST_DAMPING:
                break
    return cost


@compiled
def _frames(
    readings: Model, answers: Model, y: Array, f: Array, noise: Array, answer_noise: Array,
    prior: Array, information: Array, free: Integers, x: Array, p: Array, data: Array,
    a: Array, b: Array, c: Array, gx: Array, gp: Array,
) -> float:  # fmt: skip
    """Let states (s, n) follow the parameters by few steps, write their equations; return cost."""
    cost = 0.0
    for s in range(x.shape[0]):
        _descend(
            readings, answers, y[s], f[s], noise[s], answer_noise, prior[s], information[s], free,
            p, data, x[s], SETTLE,
        )  # fmt: skip
        cost += _frame(
            readings, answers, y[s], f[s], noise[s], answer_noise, prior[s], information[s], free,
            x[s], p, data, a[s], b[s], c, gx[s], gp,
        )  # fmt: skip
    return cost


class Equations:
    """Normal equations of all frames and parameters where states follow the parameters."""

    def __init__(self, model: ModelPrior, frames: Frames, f: Array, x: Array, p: Array) -> None:
        count, n, k = len(x), len(frames.free), len(p)
        self.x, self.p, self.free = x.copy(), p, frames.free
        self.a, self.b = np.empty((count, n, n)), np.empty((count, n, k))
        self.gx, self.c, self.gp = np.empty((count, n)), np.zeros((k, k)), np.zeros(k)
        self.cost = _frames(
            model_address(model.readings), model_address(model.answers), frames.readings, f,
            frames.noise, model.answer_noise, frames.prior, frames.information, frames.free,
            self.x, p, model.data, self.a, self.b, self.c, self.gx, self.gp,
        )  # fmt: skip
        information, off = model.parameter_information, model.parameters - p
        self.cost += 0.5 * float(information @ off**2)
        self.c += np.tril(self.c, -1).T + np.diag(information)
        self.gp += information * off
        fixed = information == 0
        self.c[fixed], self.c[:, fixed], self.gp[fixed], self.b[:, :, fixed] = 0, 0, 0, 0
        self.c[fixed, fixed] = 1.0

    def reduced(self, damping: float) -> tuple[Array, Array, Array] | None:
        """Halfway solved states, and the Schur complement with its right side; None: singular."""
        self.size = 1 / np.sqrt(np.maximum(np.einsum('sii->si', self.a), SMALLEST))
        unit = self.a * self.size[:, :, None] * self.size[:, None]
        try:
            self.factor = np.linalg.cholesky(unit + damping * np.eye(len(self.free)))
        except LinAlgError:
            return None
        right = np.concatenate([self.b, self.gx[..., None]], axis=2) * self.size[..., None]
        half = _forward_substituted(self.factor, right)
        flat = half.reshape(-1, half.shape[2])
        cross = flat.T @ flat
        c = self.c + damping * np.diag(np.diag(self.c)) - cross[:-1, :-1]
        return half, c, self.gp - cross[:-1, -1]

    def step(self, damping: float) -> tuple[Array, Array] | None:
        """States and parameters after a damped step; None where the system is singular."""
        if (reduced := self.reduced(damping)) is None:
            return None
        half, c, gp = reduced
        try:
            change = cho_solve(cho_factor(c), gp)
        except LinAlgError:
            return None
        right = half[..., -1] - half[..., :-1] @ change
        x, upper = self.x.copy(), np.swapaxes(self.factor, 1, 2)
        x[:, self.free] += self.size * np.linalg.solve(upper, right[..., None])[..., 0]
        return x, self.p + change


def _forward_substituted(lower: Array, right: Array) -> Array:
    """Solutions (s, n, k) of lower triangular systems (s, n, n), all s at once."""
    found = right.copy()
    for i in range(lower.shape[1]):
        found[:, i] -= (lower[:, i, None, :i] @ found[:, :i])[:, 0]
        found[:, i] /= lower[:, i, i, None]
    return found


def calibrate(
    model: ModelPrior, frames: Frames, references: Array, states: Array, *,
    begin: Array | None = None, most_steps: int = MOST_STEPS, gain: float = GAIN,
) -> Calibration:  # fmt: skip
    """Estimate the parameters and the states of all frames together (bundle adjustment).

    References (s, l) are of the answers, NaN: unknown. Descents start at `states` (s, n) and at
    the parameters `begin` (k,), by default their prior; they end after so many steps, or where one
    gains less of the cost than `gain`. Raises ValueError if a state is determined neither by
    readings nor by its prior.
    """
    f, x = (np.array(v, np.float64, order='C') for v in (references, states))
    p = np.array(model.parameters if begin is None else begin, np.float64)
    now, damping, converged = Equations(model, frames, f, x, p), DAMPING, False
    for _ in range(most_steps):
        step = now.step(damping)
        trial = step and Equations(model, frames, f, *step)
        if trial and trial.cost < now.cost:
            gained, damping = now.cost - trial.cost, max(0.1 * damping, LEAST_DAMPING)
            now = trial
            converged = gained <= gain * trial.cost
        else:
            damping *= 10
            converged = damping > MOST_DAMPING
        if converged:
            break
    if (reduced := now.reduced(0.0)) is None:
        msg = 'a state is determined neither by readings nor by its prior'
        raise ValueError(msg)
    free = model.parameter_information > 0
    covariance = np.zeros_like(reduced[1])
    information = reduced[1][np.ix_(free, free)]
    # in units of the prior no eigenvalue is below 1, whatever rounding says
    sigma = model.parameter_sigma[free]
    size, ways = np.linalg.eigh(information * np.outer(sigma, sigma))
    root = sigma[:, None] * ways / np.sqrt(np.maximum(size, 1.0))
    covariance[np.ix_(free, free)] = root @ root.T
    return Calibration(now.p, covariance, now.x, now.cost, converged)


@compiled
def _carry(
    factor: Array, b: Array, by_state: Array, by_parameter: Array, root: Array, out: Array
) -> None:  # fmt: skip
    """Write the covariance (l, l) of quantities with slopes (l, n) and (l, k)."""
    solved = by_state.T.copy()
    _substitute(factor, solved)
    spread = np.dot(by_parameter - np.dot(solved.T, b), root)
    by_noise, by_fit = np.dot(by_state, solved), np.dot(spread, spread.T)
    for i in range(len(out)):
        for j in range(i + 1):
            out[i, j] = out[j, i] = by_noise[i, j] + by_fit[i, j]


@compiled
def _posterior(
    readings: Model, answers: Model, y: Array, prior: Array, noise: Array, information: Array,
    free: Integers, p: Array, data: Array, root: Array, starts: Array, x: Array,
    out: Array, covariance: Array, costs: Array,
) -> float:  # fmt: skip
    """Best state of every frame near its start, and its answers; return the sum of costs."""
    n, k, count = free.size, p.size, out.shape[1]
    a, b, none, square = np.empty((n, n)), np.empty((n, k)), np.empty(0), np.empty((0, 0))
    for s in range(x.shape[0]):
        now, costs[s] = starts[s].copy(), np.inf
        x[s], out[s], covariance[s] = np.nan, np.nan, np.nan
        cost = _descend(
            readings, answers, y[s], none, noise[s], none, prior[s], information[s], free, p, data,
            now, MOST_STEPS,
        )  # fmt: skip
        if cost < np.inf:
            costs[s], x[s] = cost, now
        _frame(
            readings, answers, y[s], none, noise[s], none, prior[s], information[s], free, x[s], p,
            data, a, b, square, np.empty(n), none,
        )  # fmt: skip
        if not (np.isfinite(costs[s]) and _factor(a)):
            continue
        if count > 0:
            by_state, by_parameter = np.zeros((count, x.shape[1])), np.zeros((count, k))
            call_model(answers, x[s], p, data, out[s], by_state, by_parameter)
            by_state = by_state[:, free]
            _carry(a, b, by_state, by_parameter, root, covariance[s])
    return float(costs.sum())


@compiled
def nearest(readings: Array, ways: Array, seen: Array, table: Array, starts: Array) -> None:
    """Write the first states (s, ...) of starts from the row of a table (g, ...) that reads alike.

    `seen` (g, d) are the readings of the table projected by `ways` (m, d), as readings (s, m) are;
    NaN counts as 0.
    """
    point = np.empty(ways.shape[1])
    for s in range(len(readings)):
        point[:], size, found = 0.0, np.inf, 0
        for m in range(ways.shape[0]):
            if np.isfinite(readings[s, m]):
                for d in range(point.size):
                    point[d] += readings[s, m] * ways[m, d]
        for g in range(len(seen)):
            away = 0.0
            for d in range(point.size):
                away += (seen[g, d] - point[d]) ** 2
            if away < size:
                size, found = away, g
        starts[s, : table.shape[1]] = table[found]


def invert(model: ModelPrior, fit: Calibration, frames: Frames, starts: Array) -> Posterior:
    """Estimate the state of every frame by itself (MAP), and the answers that follow.

    Descents begin at starts (s, n). A frame whose state is undetermined has NaN.
    """
    (count, n), wide = starts.shape, len(model.answer_noise)
    x, out, costs = np.empty((count, n)), np.empty((count, wide)), np.empty(count)
    covariance = np.empty((count, wide, wide))
    _posterior(
        model_address(model.readings), model_address(model.answers), frames.readings, frames.prior,
        frames.noise, frames.information, frames.free, fit.parameters, model.data, fit.root,
        np.ascontiguousarray(starts, np.float64), x, out, covariance, costs,
    )  # fmt: skip
    return Posterior(x, out, covariance, 2 * costs)
