"""Model inversion: bundle adjustment with priors for calibration, MAP by Gauss-Newton for frames.

A sensor with physics is a forward model ``readings = h(state, parameters)`` with Gaussian priors
on both. `calibrate` estimates the states of all frames and the shared parameters together: states
are eliminated frame by frame by the Schur complement, so that its cost is linear in frames.
`invert` estimates the state of each frame at fixed parameters, from several starts. Both give the
Laplace covariance; that of the parameters widens every answer, and what a recording did not
determine stays at its prior. Nuisance quantities (stray field, temperature, error of the baseline)
are states with priors. Answers (force, torque, place) are functions of state and parameters;
references of them enter the calibration with noise of their own and a robust loss.

Sources: B. Triggs et al., Bundle adjustment, a modern synthesis (2000), sec. 6; J. Nocedal and
S. Wright, Numerical Optimization (2006), ch. 10; C. Bishop, Pattern Recognition (2006), sec. 4.4.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from tactile_ros.physics.compiled import compiled, compiled_with_models

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Array

    Model = Callable[[Array, Array, Array, Array, Array, Array], None]

DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-12, 1e8
HUBER = 2.0  # sigma from which the residual of a reference counts linearly
MOST_STEPS = 60
GAIN = 1e-9  # of the cost, below which a step ends the descent


@dataclass(frozen=True)
class ModelPrior:
    """Forward models with the priors of state and parameters.

    A model is ``function(state (n,), parameters (k,), data, out (m,), by_state (m, n),
    by_parameter (m, k))``, compiled, and writes its outputs and both Jacobians; the Jacobians come
    with zeros.

    Attributes
    ----------
    readings, answers : callable
        Forward models of m readings and of l answers.
    noise : ndarray, shape (m,)
        Standard deviation of readings; inf: not used.
    answer_noise : ndarray, shape (l,)
        Standard deviation of reference answers.
    state, state_sigma : ndarray, shape (n,)
        Prior of the state; inf: none.
    parameters, parameter_sigma : ndarray, shape (k,)
        Prior of the parameters; sigma 0: fixed.
    data : ndarray, shape (d,)
        Constants of the models: tables, nominal places.
    """

    readings: Model
    answers: Model
    noise: Array
    answer_noise: Array
    state: Array
    state_sigma: Array
    parameters: Array
    parameter_sigma: Array
    data: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def state_information(self) -> Array:
        """Inverse variance of the state's prior, shape (n,)."""
        return np.asarray(1.0 / self.state_sigma**2)

    @property
    def parameter_information(self) -> Array:
        """Inverse variance of the parameters' prior, shape (k,); 0 where they are fixed."""
        free = self.parameter_sigma > 0
        return np.where(free, 1.0 / np.where(free, self.parameter_sigma, 1.0) ** 2, 0.0)


@dataclass(frozen=True)
class Calibration:
    """Estimated parameters.

    Attributes
    ----------
    parameters, covariance : ndarray, shapes (k,) and (k, k)
        Estimate and Laplace covariance; a fixed parameter has zeros.
    states : ndarray, shape (s, n)
        Of the frames.
    cost : float
        Half the sum of squared normalised residuals and prior terms.
    converged : bool
        Whether the descent ended before its largest number of steps.
    """

    parameters: Array
    covariance: Array
    states: Array
    cost: float
    converged: bool


@dataclass(frozen=True)
class Posterior:
    """States and answers of frames with their covariance.

    Attributes
    ----------
    states, covariance : ndarray, shapes (s, n) and (s, n, n)
        Most probable state; Laplace covariance by noise, prior and parameter covariance.
    answers, answer_covariance : ndarray, shapes (s, l) and (s, l, l)
        Answers there, and their covariance by the same formula.
    chi_square : ndarray, shape (s,)
        Twice the cost: squared normalised residuals and prior terms.
    """

    states: Array
    covariance: Array
    answers: Array
    answer_covariance: Array
    chi_square: Array


@compiled
def no_answers(
    state: Array, parameters: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """Model without an answer."""


@compiled
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


@compiled
def _substitute(factor: Array, right: Array) -> None:
    """Solve in place for every column by a Cholesky factor."""
    n, columns = right.shape
    for c in range(columns):
        for i in range(n):
            for k in range(i):
                right[i, c] -= factor[i, k] * right[k, c]
            right[i, c] /= factor[i, i]
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                right[i, c] -= factor[k, i] * right[k, c]
            right[i, c] /= factor[i, i]


@compiled
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


@compiled
def _accumulate(
    residual: Array, weight: Array, by_state: Array, by_parameter: Array,
    a: Array, b: Array, c: Array, gx: Array, gp: Array,
) -> None:  # fmt: skip
    """Add weighted residuals to the normal equations a, b, c with right sides gx, gp."""
    n, k = b.shape
    for m in range(residual.size):
        w = weight[m]
        if w == 0.0:
            continue
        for i in range(n):
            slope = w * by_state[m, i]
            gx[i] += slope * residual[m]
            for j in range(n):
                a[i, j] += slope * by_state[m, j]
            for j in range(k):
                b[i, j] += slope * by_parameter[m, j]
        for i in range(k):
            slope = w * by_parameter[m, i]
            if slope != 0.0:
                gp[i] += slope * residual[m]
                for j in range(k):
                    c[i, j] += slope * by_parameter[m, j]


@compiled
def _frame(
    readings: Model, answers: Model, y: Array, f: Array, noise: Array, answer_noise: Array,
    prior: Array, information: Array, x: Array, p: Array, data: Array,
    a: Array, b: Array, c: Array, gx: Array, gp: Array,
) -> float:  # fmt: skip
    """Write the normal equations of a frame, add to those of the parameters; return the cost."""
    n, k = b.shape
    cost = 0.0
    a[:], b[:], gx[:] = 0.0, 0.0, 0.0
    for i in range(n):
        if information[i] > 0.0:
            a[i, i] = information[i]
            gx[i] = information[i] * (prior[i] - x[i])
            cost += 0.5 * gx[i] * (prior[i] - x[i])
    for part in range(2):
        values, sigma = (y, noise) if part == 0 else (f, answer_noise)
        m = values.size
        if m == 0:
            continue
        out, residual, weight = np.empty(m), np.empty(m), np.empty(m)
        by_state, by_parameter = np.zeros((m, n)), np.zeros((m, k))
        if part == 0:
            readings(x, p, data, out, by_state, by_parameter)
            cost += _weigh(values, out, sigma, np.inf, residual, weight)
        else:
            answers(x, p, data, out, by_state, by_parameter)
            cost += _weigh(values, out, sigma, HUBER, residual, weight)
        _accumulate(residual, weight, by_state, by_parameter, a, b, c, gx, gp)
    return cost


@compiled_with_models('22112121133221')
def _frames(
    readings: Model, answers: Model, y: Array, f: Array, noise: Array, answer_noise: Array,
    prior: Array, information: Array, x: Array, p: Array, data: Array,
    a: Array, b: Array, c: Array, gx: Array, gp: Array,
) -> float:  # fmt: skip
    """Normal equations of all frames at states (s, n) and parameters; return the cost."""
    cost = 0.0
    for s in range(x.shape[0]):
        cost += _frame(
            readings, answers, y[s], f[s], noise, answer_noise, prior[s], information,
            x[s], p, data, a[s], b[s], c, gx[s], gp,
        )  # fmt: skip
    return cost


@compiled
def _eliminate(a: Array, right: Array, damping: float) -> bool:
    """Solve the damped equations of every frame's state in place; False where one is singular."""
    system = np.empty(a.shape[1:])
    for s in range(a.shape[0]):
        system[:] = a[s]
        for i in range(a.shape[1]):
            system[i, i] *= 1.0 + damping
        if not _factor(system):
            return False
        _substitute(system, right[s])
    return True


class _Equations:
    """Normal equations of all frames and parameters at one point of the descent."""

    def __init__(
        self, model: ModelPrior, y: Array, f: Array, prior: Array, x: Array, p: Array
    ) -> None:
        (frames, n), k = x.shape, len(p)
        self.a, self.b = np.empty((frames, n, n)), np.empty((frames, n, k))
        self.gx, self.c, self.gp = np.empty((frames, n)), np.zeros((k, k)), np.zeros(k)
        self.cost = _frames(
            model.readings, model.answers, y, f, model.noise, model.answer_noise, prior,
            model.state_information, x, p, model.data, self.a, self.b, self.c, self.gx, self.gp,
        )  # fmt: skip
        information, off = model.parameter_information, model.parameters - p
        self.cost += 0.5 * float(information @ off**2)
        self.c += np.diag(information)
        self.gp += information * off
        fixed = information == 0
        self.c[fixed], self.c[:, fixed], self.gp[fixed], self.b[:, :, fixed] = 0, 0, 0, 0
        self.c[fixed, fixed] = 1.0

    def reduced(self, damping: float) -> tuple[Array, Array, Array] | None:
        """A^-1 [B, g] and the Schur complement with its right side; None where a state is open."""
        right = np.concatenate([self.b, self.gx[..., None]], axis=2)
        if not _eliminate(self.a, right, damping):
            return None
        k = len(self.gp)
        cross = self.b.reshape(-1, k).T @ right.reshape(-1, k + 1)
        c = self.c + damping * np.diag(np.diag(self.c)) - cross[:, :k]
        return right, c, self.gp - cross[:, k]

    def step(self, damping: float) -> tuple[Array, Array] | None:
        """Damped step of states and parameters; None where the system is singular."""
        if (reduced := self.reduced(damping)) is None:
            return None
        right, c, gp = reduced
        try:
            change = cho_solve(cho_factor(c), gp)
        except LinAlgError:
            return None
        return right[..., -1] - right[..., :-1] @ change, change


def calibrate(
    model: ModelPrior,
    readings: Array,
    references: Array,
    states: Array,
    prior: Array | None = None,
) -> Calibration:
    """Estimate the parameters and the states of all frames together (bundle adjustment).

    Parameters
    ----------
    model : ModelPrior
        Forward models and priors.
    readings : ndarray, shape (s, m)
        Measured; NaN: not measured.
    references : ndarray, shape (s, l)
        Reference answers; NaN: unknown.
    states : ndarray, shape (s, n)
        Where the descent starts.
    prior : ndarray, shape (s, n), optional
        Prior mean of each frame's state; that of the model by default.

    Returns
    -------
    Calibration
        Parameters with their covariance, and states.

    Raises ValueError if a state is determined neither by readings nor by its prior.
    """
    y, f, x = (np.array(v, np.float64, order='C') for v in (readings, references, states))
    means = np.array(np.broadcast_to(model.state if prior is None else prior, x.shape), order='C')
    p = model.parameters.astype(np.float64)
    now, damping, converged = _Equations(model, y, f, means, x, p), DAMPING, False
    for _ in range(MOST_STEPS):
        step = now.step(damping)
        trial = step and _Equations(model, y, f, means, x + step[0], p + step[1])
        if step and trial and trial.cost < now.cost:
            gained, damping = now.cost - trial.cost, max(0.1 * damping, LEAST_DAMPING)
            x, p, now = x + step[0], p + step[1], trial
            converged = gained <= GAIN * trial.cost
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
    covariance[np.ix_(free, free)] = np.linalg.inv(reduced[1][np.ix_(free, free)])
    return Calibration(p, covariance, x, now.cost, converged)


@compiled
def _descend(
    readings: Model, answers: Model, y: Array, prior: Array, noise: Array, information: Array,
    p: Array, data: Array, x: Array, a: Array, b: Array,
) -> float:  # fmt: skip
    """Descend from x to the best state of one frame by damped Gauss-Newton; return its cost."""
    n, k = b.shape
    none, c, gp = np.empty(0), np.empty((k, k)), np.empty(k)
    gx, right, system = np.empty(n), np.empty((n, 1)), np.empty((n, n))
    there, other, slope = np.empty((n, n)), np.empty((n, k)), np.empty(n)
    cost = _frame(
        readings, answers, y, none, noise, none, prior, information, x, p, data, a, b, c, gx, gp
    )
    damping = DAMPING
    for _ in range(MOST_STEPS):
        system[:], right[:, 0] = a, gx
        for i in range(n):
            system[i, i] *= 1.0 + damping
        new = np.inf
        if _factor(system):
            _substitute(system, right)
            trial = x + right[:, 0]
            new = _frame(
                readings, answers, y, none, noise, none, prior, information, trial, p, data, there,
                other, c, slope, gp,
            )  # fmt: skip
        if new <= cost:
            gained, damping = cost - new, max(0.1 * damping, LEAST_DAMPING)
            x[:], a[:], b[:], gx[:], cost = trial, there, other, slope, new
            if gained <= GAIN * (1e-3 + cost):
                break
        else:
            damping *= 10.0
            if damping > MOST_DAMPING:
                break
    return cost


@compiled_with_models('22111133231233')
def _posterior(
    readings: Model, answers: Model, y: Array, prior: Array, noise: Array, information: Array,
    p: Array, data: Array, starts: Array, a: Array, x: Array, b: Array, costs: Array,
    out: Array, by_state: Array, by_parameter: Array,
) -> float:  # fmt: skip
    """Best state of every frame over its starts, and its answers; return the sum of costs."""
    here, cross = np.empty(a.shape[1:]), np.empty(b.shape[1:])
    for s in range(x.shape[0]):
        costs[s] = np.inf
        for q in range(starts.shape[1]):
            now = starts[s, q].copy()
            cost = _descend(
                readings, answers, y[s], prior[s], noise, information, p, data, now, here, cross
            )
            if cost < costs[s]:
                costs[s], x[s], a[s], b[s] = cost, now, here, cross
        answers(x[s], p, data, out[s], by_state[s], by_parameter[s])
    return float(costs.sum())


def invert(
    model: ModelPrior, fit: Calibration, readings: Array, starts: Array, prior: Array | None = None
) -> Posterior:
    """Estimate the state of every frame by itself (MAP), and the answers that follow.

    Parameters
    ----------
    model : ModelPrior
        Forward models and the state's prior.
    fit : Calibration
        Parameters with their covariance.
    readings : ndarray, shape (s, m)
        Measured; NaN: not measured.
    starts : ndarray, shape (s, q, n)
        Where the descents start; the best one counts.
    prior : ndarray, shape (s, n), optional
        Prior mean of each frame's state; that of the model by default.

    Returns
    -------
    Posterior
        States, answers and their covariance; a frame whose state is undetermined has NaN.
    """
    (frames, _, n), k, count = starts.shape, len(fit.parameters), len(model.answer_noise)
    y, first = np.array(readings, np.float64, order='C'), np.array(starts, np.float64, order='C')
    x, a, b = (
        np.full((frames, n), np.nan),
        np.full((frames, n, n), np.nan),
        np.zeros((frames, n, k)),
    )
    means = np.array(np.broadcast_to(model.state if prior is None else prior, x.shape), order='C')
    costs, out = np.empty(frames), np.full((frames, count), np.nan)
    by_state, by_parameter = np.zeros((frames, count, n)), np.zeros((frames, count, k))
    _posterior(
        model.readings, model.answers, y, means, model.noise, model.state_information,
        fit.parameters, model.data, first, a, x, b, costs, out, by_state, by_parameter,
    )  # fmt: skip
    inverse = _inverses(a)
    shift = -inverse @ b  # of the state with the parameters
    return Posterior(
        x,
        inverse + _carried(shift, fit.covariance),
        out,
        by_state @ inverse @ by_state.transpose(0, 2, 1)
        + _carried(by_parameter + by_state @ shift, fit.covariance),
        2 * costs,
    )


def _carried(slope: Array, covariance: Array) -> Array:
    """Covariance that parameters leave in answers of such slopes, shape (s, l, l)."""
    return np.asarray(slope @ covariance @ slope.transpose(0, 2, 1))


def _inverses(information: Array) -> Array:
    """Inverse of each matrix (s, n, n); NaN where there is none."""
    inverse = np.full(information.shape, np.nan)
    for one, result in zip(information, inverse, strict=True):
        scale = np.sqrt(np.diagonal(one))
        if (scale > 0).all() and np.isfinite(scale).all():
            try:
                result[:] = np.linalg.inv(one / np.outer(scale, scale)) / np.outer(scale, scale)
            except LinAlgError:
                continue
    return inverse
