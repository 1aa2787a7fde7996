# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Noise from resting frames and from moving ones, with drift, lost taxels and few rows."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.conditioning.noise import held_noise, motion_noise, rest_noise

RNG = np.random.default_rng(4)
SIGMA = np.array([[0.5, 2.0, 0.0]])


def noisy(samples: int = 4000) -> np.ndarray:
    drift = np.linspace(0, 5, samples)[:, None, None]
    return drift + SIGMA * np.random.default_rng(5).normal(size=(samples, 1, 3))


def test_drift_is_no_noise() -> None:
    rest = noisy()
    np.testing.assert_allclose(
        rest_noise(rest, np.zeros(len(rest), int))[0, :2], SIGMA[0, :2], rtol=0.06
    )
    assert (rest.std(axis=0)[0] > 1.4).all()


def test_a_quantised_channel_has_at_least_its_quantum() -> None:
    rest = np.zeros((100, 1, 1))
    rest[50] = 3.0
    np.testing.assert_allclose(rest_noise(rest, np.zeros(100, int)), 3.0 / np.sqrt(12))


def test_motion_makes_it_no_smaller() -> None:
    values = noisy()
    stamp_ns = np.arange(len(values)) * 10_000_000
    restart = np.zeros(len(values), bool)
    np.testing.assert_allclose(
        motion_noise(values, stamp_ns, restart)[0, :2], SIGMA[0, :2], rtol=0.06
    )
    moving = values + 50 * np.sin(stamp_ns * 1e-9)[:, None, None]
    assert (motion_noise(moving, stamp_ns, restart)[0, :2] > 0.9 * SIGMA[0, :2]).all()


def test_a_lost_channel_is_unknown_and_lost_rows_are_passed_over() -> None:
    values = noisy()
    values[:, 0, 1] = np.nan
    values[::7] = np.nan
    stamp_ns = np.arange(len(values)) * 10_000_000
    for noise in (
        rest_noise(values, np.zeros(len(values), int)),
        motion_noise(values, stamp_ns, np.zeros(len(values), bool)),
    ):
        assert np.isnan(noise[0, 1])
        assert noise[0, 0] == pytest.approx(0.5, rel=0.1)
    nothing = np.full((5, 1, 3), np.nan)
    assert np.isnan(rest_noise(nothing, np.zeros(5, int))).all()


@pytest.mark.parametrize('rows', [2, 3, 5, 40])
def test_noise_inside_held_touches_in_any_order(rows: int) -> None:
    rng = np.random.default_rng(rows)
    group = np.repeat(np.arange(500), rows)
    values = 100.0 * rng.normal(size=(500, 1, 3))[group] + SIGMA * rng.normal(
        size=(len(group), 1, 3)
    )
    found = held_noise(values, group)
    np.testing.assert_allclose(found[0, :2], SIGMA[0, :2], rtol=0.1)
    order = rng.permutation(len(group))
    np.testing.assert_allclose(held_noise(values[order], 7 - group[order]), found, atol=1e-12)
    values[::7] = np.nan
    if rows > 2:
        np.testing.assert_allclose(held_noise(values, group)[0, :2], SIGMA[0, :2], rtol=0.15)
