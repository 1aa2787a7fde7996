# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Creep undone: holds, gaps, noise, and readings that were not there."""

import numpy as np
import pytest

from tactile_ros.conditioning.viscoelastic import Creep

TAU, SHARE = np.array([1.5, 30.0]), np.array([[0.08], [0.066]])
CREEP = Creep(TAU, SHARE)


def test_a_hold_of_two_minutes_does_not_drift() -> None:
    time = np.arange(0, 120, 0.05)
    stamps = (1e9 * time).astype(np.int64)
    v = np.ones((len(time), 1))  # of a step at the first frame, in closed form
    for tau, share in zip(TAU, SHARE[:, 0], strict=True):
        v[:, 0] += share * -np.expm1(-time / tau)  # a Voigt element under a held stress
    assert np.ptp(v) > 0.1
    found = CREEP.undo(v, stamps, np.zeros(len(v), bool), CREEP.start())
    assert np.ptp(found) < 0.003


@pytest.mark.parametrize('rate', [1.0, 50.0, 5000.0])
def test_noise_is_not_amplified(rate: float) -> None:
    noise = np.random.default_rng(0).normal(size=(2000, 1))
    stamps = (1e9 * np.arange(2000) / rate).astype(np.int64)
    found = CREEP.undo(noise, stamps, np.zeros(2000, bool), CREEP.start())
    assert found.std() <= 1.001 * noise.std()


def test_hard_case_12_a_gap_is_an_exact_exponential() -> None:
    state = CREEP.start()
    v, stamps = np.full((2, 1), 1.0 + SHARE.sum()), np.array([0, 10_000_000_000])
    force = CREEP.undo(v, stamps, np.zeros(2, bool), state)
    # the branch of 1.5 s has all but settled in ten, as its closed form says
    fade = np.exp(-10 / TAU)
    mean = (1 - fade) * TAU / 10
    strain = (mean - fade) * force[0, 0] + (1 - mean) * force[1, 0]
    np.testing.assert_allclose(state.strain[:, 0], strain)
    assert force[1, 0] < force[0, 0]


def test_undo_is_the_equation_taxel_by_taxel() -> None:
    rng = np.random.default_rng(6)
    v = rng.uniform(0, 3, (200, 1))
    v[rng.integers(200, size=20)] = np.nan
    stamps = np.cumsum(rng.integers(-3_000_000, 90_000_000, 200))
    restart = rng.random(200) < 0.02
    strain, last, newest, wanted = np.zeros(2), 0.0, None, []
    for reading, stamp, again in zip(v[:, 0], stamps, restart, strict=True):
        if again:
            strain, last, newest = np.zeros(2), 0.0, None
        if newest is None or stamp <= newest:
            force = reading - SHARE[:, 0] @ strain
            last = np.nan_to_num(force) if newest is None else last
            newest = stamp if newest is None else newest
        else:
            part = 1e-9 * (stamp - newest) / TAU
            decay, mean = np.exp(-part), -np.expm1(-part) / part
            strain = decay * strain + (mean - decay) * last
            force = (reading - SHARE[:, 0] @ strain) / (1 + SHARE[:, 0] @ (1 - mean))
            last = last if np.isnan(force) else force
            strain, newest = strain + (1 - mean) * last, stamp
        wanted.append(force)
    found = CREEP.undo(v, stamps, restart, CREEP.start())
    np.testing.assert_allclose(found[:, 0], wanted, rtol=1e-12, atol=1e-13)
