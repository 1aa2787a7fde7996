# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Votes for cells and labels, and turns without a seam."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.regression import Recognition, Vote
from tactile_ros.types import Recording

SPEC = dataclasses.replace(load_sensor('multipole_skin'), estimation=Recognition)
CONFIG = dataclasses.replace(SPEC.config(), positions=np.eye(3)[:2] * 0.01, track_baseline=False)
LAYOUT = SPEC.layout(CONFIG)


def turning(samples: int, seed: int, named: bool = True) -> Recording:
    """Readings that tell a turn and, if `named`, a label."""
    rng = np.random.default_rng(seed)
    yaw, label = rng.uniform(-np.pi, np.pi, samples), rng.integers(3, size=samples)
    values = np.zeros((samples, 2, 3))
    values[:, 0, 0], values[:, 0, 1] = 1e-3 * np.cos(yaw), 1e-3 * np.sin(yaw)
    values[:, 1, 2] = 1e-3 * (1 + label) * named + 1e-3
    values += 1e-6 * rng.normal(size=values.shape)
    truth = {'yaw': yaw, 'label': label, 'in_contact': np.ones(samples, np.int8)}
    rest = Recording.from_arrays(LAYOUT, values, truth=truth)
    rest.values[:20] = 1e-6 * rng.normal(size=(20, 2, 3))
    rest.truth['in_contact'][:20] = 0
    rest.truth['label'][:20], rest.truth['yaw'][:20] = -1, np.nan
    return rest


def test_turns_and_labels_are_found() -> None:
    pipeline = SPEC.pipeline(CONFIG).fit(turning(400, 1))
    fresh = turning(200, 2)
    states = pipeline.process_batch(fresh)
    touched = fresh.truth['in_contact'] == 1
    miss = np.angle(np.exp(1j * (states.yaw - fresh.truth['yaw'])))[touched]
    assert np.abs(miss).max() < 0.1
    inside = np.abs(miss) <= states.yaw_std[touched]
    assert 0.5 < inside.mean() < 0.95
    assert (states.label == fresh.truth['label']).mean() > 0.95
    assert np.median(states.label_probability[touched]) > 0.9
    assert pipeline.label_names == ('0', '1', '2')
    assert pipeline.report['label']['held_out_accuracy'] > 0.9
    assert np.isnan(states.yaw[~touched]).all()
    # without a seam at half a turn
    seam = np.abs(np.abs(fresh.truth['yaw'][touched]) - np.pi) < 0.2
    assert seam.any()
    assert np.abs(miss[seam]).max() < 0.1


def test_a_vote_by_chance_is_not_used() -> None:
    pipeline = SPEC.pipeline(CONFIG, 'grid_knn').fit(turning(400, 1, named=False))
    assert 'label' not in pipeline.estimators
    assert pipeline.report['label']['held_out_accuracy'] < 0.45
    states = pipeline.process_batch(turning(100, 2, named=False))
    assert (states.label == -1).all()
    assert pipeline.label_names == ()


@pytest.mark.parametrize('estimator', ['ridge', 'kernel_ridge'])
def test_another_estimator_does_not_vote(estimator: str) -> None:
    pipeline = SPEC.pipeline(CONFIG, estimator).fit(turning(200, 1))
    assert pipeline.estimators == {'yaw': estimator}


def test_one_class_is_always_named() -> None:
    x = np.random.default_rng(0).normal(size=(12, 3))
    vote = Vote('cell').fit(x, np.full(12, 7), np.arange(12))
    names, shares = vote.predict(x)
    assert names.tolist() == [7] * 12
    np.testing.assert_allclose(shares, 1)
