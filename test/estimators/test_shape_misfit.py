# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What the best head leaves of a press: errors, or the way to another shape."""

import numpy as np

from tactile_ros.estimators.press_search import shape_misfits

HEADS, READINGS = 4, 40
RNG = np.random.default_rng(3)
FITTED = 15 * RNG.normal(size=(HEADS, READINGS))
SLOPES = RNG.normal(size=(4, READINGS)) * np.array([[100.0], [100.0], [0.0], [9.0]])


def misfits(miss: np.ndarray) -> np.ndarray:
    """Of presses (n, d) whose best head is the first one; it is round: no slope with its turn."""
    n = len(miss)
    slopes, away = np.tile(SLOPES, (n, 1, 1)), np.tile(FITTED - FITTED[0], (n, 1, 1))
    return shape_misfits(miss, slopes, away)


def test_noise_is_about_one_and_a_shape_between_two_heads_is_far_more() -> None:
    noise = RNG.normal(size=(400, READINGS))
    alone = misfits(noise)
    assert 0.9 < alone.mean() < 1.1
    aside = np.array([[0.5, -0.3, 0.0, 0.4]]) @ SLOPES  # aside or deeper is no other shape
    assert misfits(aside)[0] < 0.05
    other = np.zeros((1, 1, READINGS))  # nor is there one where there is no other head
    assert shape_misfits(noise[:1], SLOPES[None], other).tolist() == [1.0]
    between = noise + 0.2 * (FITTED[2] - FITTED[0])
    assert np.median(misfits(between)) > np.quantile(alone, 0.95)
