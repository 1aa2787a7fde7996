# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The taxels' own polynomials: forces, zero at rest, taxels that were never pressed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_ros.enrolment import thinned
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

SPEC = load_sensor('taxel_array')
CONFIG = SPEC.config()


def squares(samples: int, seed: int, pressed: int = 16) -> Recording:
    """Outputs whose forces are a u + b u^2 with an a and b of each taxel."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.05, 0.9, (samples, 16))
    u[::4] = 0
    u[:, pressed:] = 0
    force = np.linspace(1, 3, 16) * u + np.linspace(5, 20, 16) * u**2
    truth = {'taxel_force': force, 'in_contact': (np.arange(samples) % 4 > 0).astype(np.int8)}
    noise = 1e-5 * rng.normal(size=u.shape)
    return Recording.from_arrays(SPEC.layout(CONFIG), (u + noise)[..., None], truth=truth)


def test_each_taxel_has_its_own_law_and_zero_is_zero() -> None:
    pipeline = SPEC.pipeline(CONFIG, 'polynomial').fit(squares(80, 1))
    assert pipeline.estimators == {'taxel_force': 'polynomial'}
    fresh = squares(40, 2)
    states = pipeline.process_batch(fresh)
    np.testing.assert_allclose(states.taxel_force, fresh.truth['taxel_force'], atol=5e-3)
    assert not states.taxel_force[::4].any()
    assert pipeline.report['taxel_force']['fit_rmse'] < 1e-3


def test_a_taxel_that_was_never_pressed_says_nothing() -> None:
    recording = squares(80, 1, pressed=12)
    recording.truth['taxel_force'][:, 14] = np.nan
    pipeline = SPEC.pipeline(CONFIG, 'polynomial').fit(recording)
    states = pipeline.process_batch(squares(40, 2))
    touched = states.in_contact == 1
    assert np.isfinite(states.taxel_force[touched, :12]).all()
    assert np.isnan(states.taxel_force[touched, 14]).all()


def test_all_targets_of_a_simple_programme_are_learned() -> None:
    train = thinned(SPEC.presses(CONFIG, 0, 30), 10.0)
    pipeline = SPEC.pipeline(CONFIG).fit(train)
    assert set(pipeline.estimators) == {'position', 'force', 'taxel_force'}
    test = thinned(SPEC.presses(CONFIG, 1, 12), 10.0)
    states = pipeline.process_batch(test)
    touched = test.truth['in_contact'] == 1
    miss = (states.taxel_force - test.truth['taxel_force'])[touched]
    assert np.sqrt(np.mean(miss**2)) < 0.1
    force = (states.force - test.truth['force'])[touched, 2]
    assert np.sqrt(np.nanmean(force**2)) < 1.2
    assert np.isnan(states.force[:, :2]).all()


@pytest.mark.parametrize('taxels', [1, 72])
def test_any_count_of_taxels(taxels: int) -> None:
    positions = np.zeros((taxels, 3))
    positions[:, 0] = 5e-3 * np.arange(taxels)
    config = dataclasses.replace(CONFIG, positions=positions)  # type: ignore[type-var]
    train = thinned(SPEC.presses(config, 0, 20), 10.0)
    pipeline = SPEC.pipeline(config, 'polynomial').fit(train)
    states = pipeline.process_batch(train)
    assert states.taxel_force.shape == (len(train), taxels)
