# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Model inversion on toy problems with known posteriors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from reference.inversion_frames import frames_of
from tactile_ros.estimators.model_inversion import (
    Calibration,
    Frames,
    ModelPrior,
    calibrate,
    invert,
)
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array

ROWS = np.array([[1.0, 0.1], [0.5, 0.7], [-0.3, 1.0], [0.8, -0.4], [0.2, -0.6], [-0.9, 0.3]])
GAINS = 1 + 0.05 * np.array([0.3, -1.1, 0.8, 0.1, -0.7, 1.2])
SLOPE = 2.3


@compiled
def states(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """The states themselves."""
    for i in range(out.size):
        out[i], by_state[i, i] = x[i], 1.0


@compiled
def linear(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """Two states and one parameter that is common to all frames."""
    for m in range(out.size):
        out[m] = ROWS[m, 0] * x[0] + ROWS[m, 1] * x[1] + (m % 3) * p[0]
        by_state[m, 0], by_state[m, 1] = ROWS[m, 0], ROWS[m, 1]
        if len(by_parameter) > 0:
            by_parameter[m, 0] = m % 3


@compiled
def gains(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """Six channels with a gain each, a product of the states, and a common offset."""
    for m in range(out.size):
        signal = x[0] * ROWS[m, 0] + x[1] * ROWS[m, 1] + 0.2 * x[0] * x[1]
        out[m] = p[m] * signal + x[2]
        by_state[m, 0] = p[m] * (ROWS[m, 0] + 0.2 * x[1])
        by_state[m, 1] = p[m] * (ROWS[m, 1] + 0.2 * x[0])
        by_state[m, 2] = 1.0
        if len(by_parameter) > 0:
            by_parameter[m, m] = signal


@compiled
def slope(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """Answer that is proportional to the first state."""
    out[0] = p[6] * x[0]
    by_state[0, 0] = p[6]
    if len(by_parameter) > 0:
        by_parameter[0, 6] = x[0]


@compiled
def banana(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """The valley of Rosenbrock."""
    out[0], out[1] = 10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]
    by_state[0, 0], by_state[0, 1], by_state[1, 0] = -20.0 * x[0], 10.0, -1.0


PRIOR = ModelPrior(
    gains, slope, np.full(6, 0.01), np.full(1, 0.02), np.zeros(3), np.array([1e3, 1e3, 0.3]),
    np.r_[np.ones(6), 2.0], np.r_[np.full(6, 0.05), 1.0],
)  # fmt: skip


def frames(count: int, seed: int = 0) -> tuple[np.ndarray, Frames, np.ndarray]:
    """True states, readings and reference answers of PRIOR's models."""
    rng = np.random.default_rng(seed)
    x = np.column_stack(
        [rng.uniform(0.5, 2, count), rng.uniform(-1, 1, count), 0.3 * rng.normal(size=count)]
    )
    signal = x[:, :2] @ ROWS.T + 0.2 * x[:, :1] * x[:, 1:2]
    readings = GAINS * signal + x[:, 2:] + 0.01 * rng.normal(size=(count, 6))
    return x, frames_of(PRIOR, readings), SLOPE * x[:, :1] + 0.02 * rng.normal(size=(count, 1))


def starts(count: int) -> np.ndarray:
    """Where the descents of frames begin."""
    return np.tile([1.0, 0.0, 0.0], (count, 1))


@pytest.fixture(scope='module')
def fitted() -> Calibration:
    return calibrate(PRIOR, *frames(300)[1:], starts(300))


def test_calibrate_linear_problem_gives_the_exact_posterior() -> None:
    rng = np.random.default_rng(1)
    readings = rng.normal(size=(5, 6))
    model = ModelPrior(
        linear, states, np.full(6, 0.1), np.ones(2), np.zeros(2), np.array([2.0, 3.0]),
        np.zeros(1), np.array([0.5]),
    )  # fmt: skip
    fit = calibrate(model, frames_of(model, readings), np.full((5, 2), np.nan), np.zeros((5, 2)))
    shared = (np.arange(6) % 3.0)[:, None]
    design = np.hstack([np.kron(np.eye(5), ROWS), np.tile(shared, (5, 1))]) / 0.1
    prior = np.diag(1 / np.r_[np.tile([2.0, 3.0], 5), 0.5])
    whole = np.vstack([design, prior])
    covariance = np.linalg.inv(whole.T @ whole)
    exact = covariance @ whole.T @ np.r_[readings.ravel() / 0.1, np.zeros(11)]
    np.testing.assert_allclose(fit.parameters, exact[-1:], rtol=1e-8)
    np.testing.assert_allclose(fit.states.ravel(), exact[:-1], rtol=1e-8)
    np.testing.assert_allclose(fit.covariance, covariance[-1:, -1:], rtol=1e-9)
    posterior = invert(model, fit, frames_of(model, readings), np.zeros((5, 2)))
    np.testing.assert_allclose(posterior.answers, posterior.states)
    np.testing.assert_allclose(posterior.answer_covariance[0], covariance[:2, :2], rtol=0.05)


def test_calibrate_agrees_with_least_squares_on_the_same_cost() -> None:
    _, readings, answers = frames(10)
    fit = calibrate(PRIOR, readings, answers, starts(10))

    def residuals(z: np.ndarray) -> np.ndarray:
        p, x = z[:7], z[7:].reshape(-1, 3)
        signal = x[:, :2] @ ROWS.T + 0.2 * x[:, :1] * x[:, 1:2]
        return np.concatenate([
            ((readings.readings - p[:6] * signal - x[:, 2:]) / PRIOR.noise).ravel(),
            ((answers - p[6] * x[:, :1]) / PRIOR.answer_noise).ravel(),
            (x / PRIOR.state_sigma).ravel(), (p - PRIOR.parameters) / PRIOR.parameter_sigma,
        ])  # fmt: skip

    begin = np.r_[PRIOR.parameters, starts(10).ravel()]
    slow = least_squares(residuals, begin, xtol=1e-14, ftol=1e-14, gtol=1e-12)
    assert fit.cost == pytest.approx(slow.cost, rel=1e-9)
    np.testing.assert_allclose(fit.parameters, slow.x[:7], atol=1e-6)
    covariance = np.linalg.inv(slow.jac.T @ slow.jac)[:7, :7]
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-4, atol=1e-9)


def test_calibrate_leaves_an_unobservable_parameter_at_its_prior(fitted: Calibration) -> None:
    count = 300
    _, readings, _ = frames(count)
    silent = calibrate(PRIOR, readings, np.full((count, 1), np.nan), starts(count))
    assert silent.parameters[6] == pytest.approx(2.0)
    assert silent.covariance[6, 6] == pytest.approx(1.0)
    one = invert(PRIOR, silent, readings.of(np.arange(5)), starts(5))
    known = invert(PRIOR, fitted, readings.of(np.arange(5)), starts(5))
    wide, narrow = one.answer_covariance[:, 0, 0], known.answer_covariance[:, 0, 0]
    np.testing.assert_allclose(wide, narrow + one.states[:, 0] ** 2, rtol=0.1)


def test_calibrate_discounts_outliers_of_the_reference(fitted: Calibration) -> None:
    _, readings, answers = frames(300)
    answers[::20] += 5.0
    fit = calibrate(PRIOR, readings, answers, starts(300))
    assert abs(fit.parameters[6] - SLOPE) < 0.03
    assert abs(fitted.parameters[6] - SLOPE) < 0.03


def test_calibrate_refuses_a_state_that_nothing_determines() -> None:
    model = ModelPrior(
        linear, states, np.full(6, np.inf), np.ones(2), np.zeros(2), np.full(2, np.inf),
        np.zeros(1), np.ones(1),
    )  # fmt: skip
    same = frames_of(model, np.zeros((2, 6)))
    with pytest.raises(ValueError, match='determined neither'):
        calibrate(model, same, np.full((2, 2), np.nan), np.zeros((2, 2)))


def test_invert_states_its_errors(fitted: Calibration) -> None:
    x, readings, _ = frames(4000, 5)
    posterior = invert(PRIOR, fitted, readings, starts(4000))
    errors = posterior.answers[:, 0] - SLOPE * x[:, 0]
    inside = np.abs(errors) <= np.sqrt(posterior.answer_covariance[:, 0, 0])
    assert abs(inside.mean() - 0.683) < 0.04
    assert posterior.chi_square.mean() == pytest.approx(6 - 2, rel=0.1)


def test_invert_follows_a_bent_valley_from_every_start() -> None:
    model = ModelPrior(
        banana, states, np.ones(2), np.ones(2), np.zeros(2), np.full(2, np.inf),
        np.zeros(0), np.zeros(0),
    )  # fmt: skip
    fit = Calibration(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 2)), 0.0, converged=True)
    first = np.array([[-1.2, 1.0], [3.0, -2.0], [0.0, 5.0]])
    posterior = invert(model, fit, frames_of(model, np.zeros((3, 2))), first)
    np.testing.assert_allclose(posterior.states, 1.0, atol=1e-4)
    exact = np.linalg.inv(np.array([[401.0, -200.0], [-200.0, 100.0]]))
    np.testing.assert_allclose(posterior.answer_covariance[0], exact, rtol=1e-2)


def test_invert_leaves_out_readings_that_were_not_measured(fitted: Calibration) -> None:
    _, whole, _ = frames(5, 7)
    holes = replace(whole, readings=whole.readings.copy())
    holes.readings[:, 0] = np.nan
    nothing = replace(whole, readings=np.full((5, 6), np.nan))
    found = [
        invert(PRIOR, fitted, one, starts(5)).answer_covariance[:, 0, 0]
        for one in (whole, holes, nothing)
    ]
    assert (found[1] > found[0]).all()
    assert (found[2] > 1e5).all()


def test_invert_one_frame_is_the_batch(fitted: Calibration) -> None:
    _, readings, _ = frames(8, 8)
    batch = invert(PRIOR, fitted, readings, starts(8))
    for s in range(8):
        one = invert(PRIOR, fitted, readings.of(np.array([s])), starts(8)[[s]])
        np.testing.assert_allclose(one.states[0], batch.states[s], rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.answer_covariance[0], batch.answer_covariance[s], rtol=1e-9)


def test_shared_keeps_of_a_parameter_what_holds_for_other_recordings() -> None:
    own = np.r_[0.05, np.zeros(6)]  # as wide as its prior: half of what was found is of others
    wide = replace(PRIOR, parameter_sigma=np.hypot(PRIOR.parameter_sigma, own))
    fit = calibrate(wide, *frames(300)[1:], starts(300))
    found = fit.shared(PRIOR, own)
    np.testing.assert_allclose(found.parameters[1:], fit.parameters[1:])
    assert found.parameters[0] - 1 == pytest.approx(0.5 * (fit.parameters[0] - 1))
    variance = 0.25 * fit.covariance[0, 0] + 0.5 * 0.05**2
    assert found.covariance[0, 0] == pytest.approx(variance)
    np.testing.assert_allclose(found.covariance[0, 1:], 0.5 * fit.covariance[0, 1:])
