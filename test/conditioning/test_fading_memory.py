# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Memories of a viscoelastic skin: fading means, creep and the way of a load."""

import math
from itertools import pairwise

import numpy as np
import pytest

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.conditioning.loading_direction import dead_band, loading_signs
from tactile_ros.conditioning.viscoelastic import Creep
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


TOP, SECONDS = 3.0, 24.0
# slow ramps, quick ones, and one that takes ten seconds
CORNERS = np.array([0.0, 0.5, 2.5, 4.0, 5.5, 6.0, 6.3, 6.7, 6.85, 7.5, 17.5, 18.0, 22.0])
LOADS = TOP * np.array([0, 0, 1.0, 1.0, 0, 0, 0.6, 0.6, 0, 0, 0.8, 0.3, 0.9])
RATES = (20.0, 100.0, 500.0)


def read(rate: float, noise: float = 0.0, seed: int = 1) -> tuple[Array, Array]:
    """Times (s,) and a load (s,) at them."""
    time = np.arange(round(SECONDS * rate)) / rate
    load = np.interp(time, CORNERS, LOADS)
    return time, load + noise * np.random.default_rng(seed).normal(size=len(time))


def begins(count: int) -> np.ndarray:
    return np.arange(count) == 0


def truth(time: Array, band: float) -> Array:
    """Signs (s,) by the corners alone; NaN within a band of where they change."""
    load, sign = np.interp(time, CORNERS, LOADS), np.zeros(len(time))
    last = 0.0
    for (a, b), (low, high) in zip(pairwise(CORNERS), pairwise(LOADS), strict=True):
        inside = (time > a) & (time <= b)
        way = np.sign(high - low)
        if way not in (0.0, last):
            sign[inside] = np.where(np.abs(load[inside] - low) > band, way, np.nan)
            last = way
        else:
            sign[inside] = last
    sign[time > CORNERS[-1]] = last
    return sign


@pytest.mark.parametrize('noise', [0.0, 2e-3 * TOP])
@pytest.mark.parametrize('rate', RATES)
def test_signs_are_those_of_the_corners_at_any_rate(rate: float, noise: float) -> None:
    time, load = read(rate, noise)
    band = dead_band(load)
    signs, wanted = loading_signs(load, begins(len(time)), band), truth(time, band + 8 * noise)
    known = np.isfinite(wanted)
    assert known.mean() > 0.85
    assert (signs == wanted)[known].all()


def test_lost_rows_keep_the_sign_and_a_stream_forgets_the_one_before_it() -> None:
    time, load = read(100.0)
    lost = np.random.default_rng(2).uniform(size=len(time)) < 0.3
    lost[[0, 900]], band = False, dead_band(load)
    gappy = np.where(lost, np.nan, load)
    restart = np.isin(np.arange(len(load)), (0, 900))
    signs = loading_signs(gappy, restart, band)
    assert (signs[1:][lost[1:]] == signs[:-1][lost[1:]])[restart[1:][lost[1:]] == 0].all()
    assert (loading_signs(load[~lost], restart[~lost], band) == signs[~lost]).all()
    assert (loading_signs(gappy[900:], restart[900:], band) == signs[900:]).all()
    assert signs[900] == 0
    assert set(np.unique(signs)) == {-1.0, 0.0, 1.0}
    assert not loading_signs(np.full(9, np.nan), begins(9), band).any()
