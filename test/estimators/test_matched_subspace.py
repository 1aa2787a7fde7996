# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Slip by the patterns of known pulls."""

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.slip_detector import SlipDetector
from tactile_ros.types import Array, Integers

CHANNELS, FRAMES = 12, 60


def pulls(seed: int = 0, count: int = 30) -> tuple[Array, Integers, Integers]:
    """Pulls in three ways of twelve channels, and as many rests with drift in any way."""
    rng = np.random.default_rng(seed)
    ways = np.linalg.qr(np.random.default_rng(7).normal(size=(CHANNELS, 3)))[0]
    time = np.clip(np.linspace(-0.5, 1.0, FRAMES), 0, None)[:, None]
    slip = np.arange(2 * count) < count
    parts = []
    for pulled in slip:
        pattern = ways @ rng.normal(size=3) if pulled else rng.normal(size=CHANNELS)
        size = rng.uniform(200, 600) if pulled else rng.uniform(0, 60)
        parts.append(size * time * pattern / np.linalg.norm(pattern))
    x = np.concatenate(parts) + rng.normal(size=(2 * count * FRAMES, CHANNELS))
    return x, np.repeat(slip, FRAMES).astype(np.int64), np.repeat(np.arange(2 * count), FRAMES)


@pytest.fixture(scope='module')
def fitted() -> SlipDetector:
    return SlipDetector().fit(*pulls())


def test_strong_changes_that_are_no_pull_are_not_flagged(fitted: SlipDetector) -> None:
    """As strong as the strongest pulls, but across the subspace of their patterns."""
    rng = np.random.default_rng(4)
    across = np.linalg.svd(fitted.basis_.T)[2][fitted.basis_.shape[1] :]
    pattern = rng.normal(size=(20, len(across))) @ across
    pattern *= 500 / np.linalg.norm(pattern, axis=1, keepdims=True)
    assert not (fitted.predict(pattern) > 0.5).any()
    inside = 500 * fitted.basis_.T[:3]
    assert (fitted.predict(inside) > 0.5).all()


def test_beyond_all_pulls_and_without_numbers_nothing_is_known(fitted: SlipDetector) -> None:
    assert np.isnan(fitted.predict(1e4 * fitted.basis_.T[:1])).all()
    assert np.isnan(fitted.predict(np.full((1, CHANNELS), np.nan))).all()


def test_scale_and_order_do_not_matter(fitted: SlipDetector) -> None:
    x, slip, sequence = pulls()
    scaled = SlipDetector().fit(1e-6 * x, slip, sequence)
    np.testing.assert_allclose(scaled.predict(1e-6 * x), fitted.predict(x), atol=1e-9)
    back = slice(None, None, -1)
    turned = SlipDetector().fit(x[back], slip[back], sequence[back])
    np.testing.assert_allclose(turned.predict(x), fitted.predict(x), atol=1e-9)


def test_few_sequences_are_refused() -> None:
    x, slip, sequence = pulls(count=4)
    with pytest.raises(ValueError, match='at least 5 sequences that slip and 5 that hold'):
        SlipDetector().fit(x, slip, sequence)
    with pytest.raises(NotCalibratedError):
        SlipDetector().predict(x)
