# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Influence of references and their noise by evidence: a linear problem against refits."""

from dataclasses import replace

import numpy as np
import pytest

from reference.inversion_frames import frames_of
from tactile_ros.estimators.evidence import Influence, learn_noise
from tactile_ros.estimators.model_inversion import Calibration, ModelPrior, calibrate
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array

NOISE, ROWS, TERMS, SPREAD = 0.05, 150, 8, 0.3


@compiled
def itself(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """States that are read without error."""
    for m in range(out.size):
        out[m], by_state[m, m] = x[m], 1.0


@compiled
def weighted(
    x: Array, p: Array, data: Array, out: Array, by_state: Array, by_parameter: Array
) -> None:
    """Two weighted sums of the states."""
    for f in range(2):
        out[f] = 0.0
        for i in range(x.size):
            k = f * x.size + i
            out[f] += p[k] * x[i]
            by_state[f, i] = p[k]
            if len(by_parameter) > 0:
                by_parameter[f, k] = x[i]


def problem(stated: float) -> tuple[ModelPrior, np.ndarray, np.ndarray]:
    """Model with a stated noise of references, readings and references."""
    rng = np.random.default_rng(3)
    x, weights = rng.normal(size=(ROWS, TERMS)), SPREAD * rng.normal(size=(2, TERMS))
    f = x @ weights.T + NOISE * rng.normal(size=(ROWS, 2))
    model = ModelPrior(
        itself, weighted, np.full(TERMS, 1e-7), np.full(2, stated), np.zeros(TERMS),
        np.full(TERMS, 10.0), np.zeros(2 * TERMS), np.full(2 * TERMS, 2.0),
    )  # fmt: skip
    return model, x, f


def fitted(model: ModelPrior, x: np.ndarray, f: np.ndarray) -> tuple[Calibration, Influence]:
    fit = calibrate(model, frames_of(model, x), f, x)
    return fit, Influence(model, fit, frames_of(model, x), f)


@pytest.mark.parametrize('size', [1, 5, 30])  # of a group: fewer and more than the parameters
def test_held_out_errors_are_those_of_refits_without_the_group(size: int) -> None:
    model, x, f = problem(0.2)
    f[3, 0] = np.nan
    groups = np.arange(ROWS) // size
    errors, covariance = fitted(model, x, f)[1].held_out(groups)
    assert np.isnan(errors[3, 0])
    assert np.isfinite(errors).sum() == errors.size - 1
    for name in (0, 2):
        held = groups == name
        without = np.where(held[:, None], np.nan, f)
        refit = calibrate(model, frames_of(model, x), without, x)
        weights = refit.parameters.reshape(2, TERMS)
        known = np.isfinite(f[held])
        expected = x[held] @ weights.T - f[held]
        np.testing.assert_allclose(errors[held][known], expected[known], rtol=1e-5, atol=1e-7)
        blocks = np.stack([refit.covariance[:TERMS, :TERMS], refit.covariance[TERMS:, TERMS:]])
        variance = np.einsum('si,kij,sj->sk', x[held], blocks, x[held]) + 0.2**2
        found = np.diagonal(covariance[held], axis1=1, axis2=2)
        np.testing.assert_allclose(found[known], variance[known], rtol=1e-4)


@pytest.mark.parametrize('stated', [0.01, 0.5])
def test_noise_and_widths_are_those_of_the_world(stated: float) -> None:
    model, x, f = problem(stated)
    kinds = np.where(np.arange(2 * TERMS) < TERMS, 0, -1)
    for _ in range(8):
        fit, influence = fitted(model, x, f)
        model = learn_noise(model, fit, influence, np.zeros(0, np.int64), kinds)
    np.testing.assert_allclose(model.answer_noise, NOISE, rtol=3 / np.sqrt(2 * ROWS))
    assert model.parameter_sigma[0] == pytest.approx(SPREAD, rel=0.6)
    np.testing.assert_array_equal(model.parameter_sigma[TERMS:], 2.0)


def test_a_reference_that_alone_determines_an_answer_draws_it_to_itself() -> None:
    model, x, f = problem(0.01)
    few = replace(model, parameter_sigma=np.full(2 * TERMS, 1e3))
    influence = fitted(few, x[:TERMS], f[:TERMS])[1]
    np.testing.assert_allclose(influence.drawn, 1.0, atol=1e-3)
