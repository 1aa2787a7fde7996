# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The memory of a viscoelastic skin against a plain loop, live against batch, and bad streams."""

import math

import numpy as np
import pytest

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.types import Array, Bools, Integers

TAUS = np.array([0.05, 0.3, 3.0, 30.0])


def plain_means(change: Array, stamp_ns: Integers, restart: Bools, taus: Array) -> Array:
    """Means by the definition, a number at a time: exact for a change linear between frames."""
    means = np.zeros((len(change), len(taus), change.shape[1]))
    for m, tau in enumerate(taus):
        for d in range(change.shape[1]):
            mean, last, when = 0.0, 0.0, -1
            for i in range(len(change)):
                x = float(change[i, d])
                if i == 0 or restart[i]:
                    mean, last, when = 0.0, 0.0 if math.isnan(x) else x, int(stamp_ns[i])
                elif stamp_ns[i] > when:
                    x = last if math.isnan(x) else x
                    dt = (int(stamp_ns[i]) - when) * 1e-9
                    slope = (x - last) / dt
                    # the particular solution of tau mean' + mean = last + slope t, plus its decay
                    mean = (mean - last + slope * tau) * math.exp(-dt / tau)
                    mean += last + slope * (dt - tau)
                    last, when = x, int(stamp_ns[i])
                means[i, m, d] = mean
    return means


def stream(count: int, width: int, seed: int) -> tuple[Array, Integers, Bools]:
    """A smooth change with noise, jittering stamps, gaps and two restarts."""
    rng = np.random.default_rng(seed)
    step_ns = rng.integers(2_000_000, 150_000_000, count)
    step_ns[rng.random(count) < 0.01] = 20_000_000_000
    stamp_ns = np.cumsum(step_ns)
    phase = 1e-9 * stamp_ns[:, None] + rng.random(width)
    change = np.sin(0.5 * phase) + 0.01 * rng.normal(size=(count, width))
    restart = np.zeros(count, bool)
    restart[[count // 3, count // 2]] = True
    return change, stamp_ns, restart


def live(history: FadingMemory, change: Array, stamp_ns: Integers, restart: Bools) -> Array:
    """Means frame by frame, as a stream comes in."""
    rows = (slice(i, i + 1) for i in range(len(change)))
    return np.concatenate([history(change[i], stamp_ns[i], restart[i]) for i in rows])


@pytest.mark.parametrize('count', [1, 2, 3, 17, 500])
def test_batch_is_the_plain_loop(count: int) -> None:
    rows = stream(count, 3, seed=count)
    np.testing.assert_allclose(
        FadingMemory(TAUS)(*rows), plain_means(*rows, TAUS), rtol=0, atol=1e-9
    )


def test_frames_that_are_not_newer_and_values_that_are_missing() -> None:
    change, stamp_ns, restart = stream(300, 4, seed=3)
    rng = np.random.default_rng(3)
    change[rng.random(change.shape) < 0.1] = np.nan
    change[0, 1] = np.nan
    change[restart, 2] = np.nan
    stamp_ns[50:60] = stamp_ns[40]
    stamp_ns[120] = stamp_ns[119]
    stamp_ns[200] = stamp_ns[20]
    expected = plain_means(change, stamp_ns, restart, TAUS)
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(
        FadingMemory(TAUS)(change, stamp_ns, restart), expected, rtol=0, atol=1e-9
    )
    history = FadingMemory(TAUS)
    parts = [
        history(change[a:b], stamp_ns[a:b], restart[a:b])
        for a, b in ((0, 55), (55, 58), (58, 120), (120, 121), (121, 300))
    ]
    np.testing.assert_allclose(np.concatenate(parts), expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        live(FadingMemory(TAUS), change, stamp_ns, restart), expected, rtol=0, atol=1e-9
    )


@pytest.mark.parametrize('taus', [[0.0], [-1.0, 1.0], [np.nan]])
def test_time_constants_are_positive(taus: list[float]) -> None:
    with pytest.raises(ValueError, match='must be positive'):
        FadingMemory(np.array(taus))
