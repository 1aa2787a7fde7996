# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The twin's parts, placed and turned: learned from some, recognised in others."""

from __future__ import annotations

import dataclasses

import numpy as np

from tactile_ros.enrolment import thinned
from tactile_ros.sensors import load_sensor

SPEC = load_sensor('taxel_array')
CONFIG = SPEC.config(**SPEC.demo)


def test_a_washer_and_a_tube_are_placed_and_turned() -> None:
    recording = SPEC.presses(CONFIG, 3, 12)
    truth = recording.truth
    there = truth['in_contact'] == 1
    assert set(np.unique(truth['label'][there])) == {0, 1}
    assert (truth['label'][~there] == -1).all()
    tube = truth['label'] == 1
    assert np.isfinite(truth['yaw'][tube]).all()
    assert np.isnan(truth['yaw'][~tube]).all()
    assert len(np.unique(truth['yaw'][tube])) == 6
    load = truth['taxel_force'].astype(float).sum(axis=1)
    np.testing.assert_allclose(load[there], truth['force'][there, 2].astype(float), rtol=1e-9)
    assert 1.5 < truth['taxel_force'].astype(float).max() <= 3.0 + 1e-9


def test_what_was_learned_from_some_recognises_others() -> None:
    train = thinned(SPEC.presses(CONFIG, 1, 30), 4.0)
    pipeline = SPEC.pipeline(CONFIG).fit(train)
    test = thinned(SPEC.presses(CONFIG, 2, 12), 4.0)
    states = pipeline.process_batch(test)
    peak = test.truth['taxel_force'].astype(float).max(axis=1)
    firm = (test.truth['in_contact'] == 1) & (peak > 0.5)
    right = states.label[firm] == test.truth['label'][firm]
    assert right.mean() > 0.8  # a tube at the rim may be none of these, but not the washer
    assert right.all() or (states.label[firm][~right] == -1).all()
    miss = np.linalg.norm((states.position - test.truth['position'])[firm][right, :2], axis=1)
    assert np.median(miss) < 0.3e-3


def test_without_objects_the_twin_presses_footprints() -> None:
    plain = dataclasses.replace(CONFIG, objects=(), parts='')  # type: ignore[type-var]
    truth = SPEC.presses(plain, 3, 3).truth
    assert 'label' not in truth
    assert np.isfinite(truth['position'][truth['in_contact'] == 1]).all()
