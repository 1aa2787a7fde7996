"""A delay that is known beforehand, found from the signals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit

from tactile_ros.evaluation.truth import Delay, estimate_delay

SECOND_NS = 1_000_000_000


def presses(times: np.ndarray) -> np.ndarray:
    """Presses of irregular length: smooth ramps, as a probe makes them (time in s)."""
    rng = np.random.default_rng(3)
    total = np.zeros(len(times))
    for at in np.cumsum(rng.uniform(0.6, 1.8, 60)):
        width = rng.uniform(0.1, 0.3)
        rise = expit((times - at) / 0.02)
        total += rng.uniform(0.5, 2) * rise * expit((at + width - times) / 0.02)
    return total


def read(late_s: float, seed: int, noise: float = 0.05) -> Delay | None:
    rng = np.random.default_rng(seed)
    frames = np.arange(4000) * 0.01
    frames = frames + rng.uniform(0, 0.001, 4000)
    cell = np.arange(8000) * 0.005
    skin = presses(frames) + noise * rng.normal(size=4000)
    force = -3 * presses(cell - late_s) + noise * rng.normal(size=8000)
    return estimate_delay(
        (frames * SECOND_NS).astype(np.int64), skin, (cell * SECOND_NS).astype(np.int64), force
    )


@pytest.mark.parametrize('late_s', [-0.2, 0.0, 0.0137, 0.31])
def test_a_delay_is_found_to_within_what_it_claims(late_s: float) -> None:
    found = read(late_s, seed=int(1000 * abs(late_s)))
    assert found is not None
    error = abs(found.delay_ns * 1e-9 - late_s)
    assert error < 0.001
    assert error < 5 * found.std_ns * 1e-9
    assert found.told == (late_s != 0.0)
    assert found.stretches >= 8


def test_signals_that_have_nothing_in_common_tell_nothing() -> None:
    assert read(0.1, seed=1, noise=30.0) is None


def test_a_short_or_silent_recording_tells_nothing() -> None:
    times = np.arange(100, dtype=np.int64) * 10_000_000
    assert estimate_delay(times, np.zeros(100), times, np.zeros(100)) is None
    times = np.arange(5000, dtype=np.int64) * 10_000_000
    assert estimate_delay(times, np.zeros(5000), times, np.zeros(5000)) is None
