# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hard cases of fields: what a plain way does, and what is right.

Cases of fields, of the gradiometer and of the magnet pad that are elsewhere in test/:

1 (rank of the chain's features): estimators/test_polynomial_force
3 (clipped pixels): sensors/test_gradiometer
4 (near fields, edges, cancellation): physics/test_magnetics, physics/test_fidelity
4, 8, 19 (for the pad): sensors/test_magnet_pad
7 (ties and distances of neighbours): estimators/test_cell_knn
12 (gaps, of the disc's temperature): physics/test_temperature
15 (temperatures outside of a fit; a disc that lags): physics/test_temperature,
   sensors/test_gradiometer
17 (the order of removing means): sensors/test_gradiometer
"""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.magnetics import exact_disc
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.sensors.gradiometer import disc_model
from tactile_ros.sensors.gradiometer import twin as gradiometer
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.magnet_pad import body_model as pad
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig

DISC, PAD = GradiometerConfig(), MagnetPadConfig()
STATES = gradiometer.states_of(DISC, 200)[32:]
FIELD = exact_disc(DISC.positions, gradiometer.disc_of(DISC)).readings(STATES)[..., [0, 2]]
AXES = np.tile(np.eye(3)[[0, 2]], (4, 1))


def centred(read: np.ndarray) -> np.ndarray:
    return read - read.mean(axis=1, keepdims=True)


def norms(read: np.ndarray) -> np.ndarray:
    return np.hypot(read[..., 0], read[..., 1])


@pytest.mark.parametrize(('strength', 'spoilt'), [(2e-3, 0.05), (0.1, 2.0)])
def test_case_2_norms_after_removal_bear_any_common_field(strength: float, spoilt: float) -> None:
    common = strength * np.array([0.6, 0.8])
    plain = norms(FIELD + common) / norms(FIELD) - 1
    assert np.abs(plain).max() > spoilt  # norms of raw readings
    right = norms(centred(FIELD + common)) - norms(centred(FIELD))
    assert np.abs(right).max() < 1e-14
    # single precision is enough once means are removed, even for 100 mT
    coarse = norms(centred((FIELD + common).astype(np.float32)).astype(np.float64))
    assert np.abs(coarse - norms(centred(FIELD))).max() < 0.1e-6


def test_case_2_the_leak_is_a_mismatch_of_gains() -> None:
    common = np.array([2e-3, 0.0])
    gains = 1 + 0.005 * np.random.default_rng(0).normal(size=(4, 2))
    leak = np.abs(centred(gains * (FIELD + common)) - centred(gains * FIELD)).max()
    assert 1e-6 < leak < 0.03 * 2e-3
    # told of the gains, no combination that is left sees the field
    response = AXES * gains.reshape(-1, 1)
    slope = np.zeros((8, disc_model.STATES))
    slope[:, disc_model.UNIFORM : disc_model.MAGNET] = response
    differences = disc_model.beside_uniform(slope, np.array([True, False, True]))
    moved = (gains * (FIELD + common) - gains * FIELD).reshape(len(FIELD), -1)
    assert np.abs(moved @ differences).max() < 1e-14


def test_case_17_what_warms_all_pixels_alike_goes_with_the_mean() -> None:
    alike = np.array([0.0, 5e-5]) * 20.0  # beta dT of every Bz
    np.testing.assert_allclose(centred(FIELD + alike), centred(FIELD), atol=1e-15)
    # what weakens the magnet does not: it is a gain
    weaker = (1 + 20.0 * REMANENCE_SLOPE) * FIELD
    assert np.abs(centred(weaker) - centred(FIELD)).max() > 1e-4


def test_case_19_a_model_is_compared_with_changes_since_rest() -> None:
    change = pad.change_of_field(PAD, pad.scene_touches(PAD, 20)[8:]).reshape(20, -1)
    rest = pad.rest_field(PAD).reshape(-1)
    # magnets that are 3 % weaker than the config says: at rest that alone is a touch
    wrong = 0.03 * np.abs(rest).max()
    assert wrong > np.median(np.abs(change).max(axis=1)) / 5
    assert 0.03 * np.abs(change).max() < wrong / 2
