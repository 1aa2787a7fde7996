# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Which way loads last went, whatever the rate, the noise and the gaps of their frames."""

from itertools import pairwise

import numpy as np
import pytest

from tactile_ros.conditioning.loading_direction import dead_band, loading_signs
from tactile_ros.types import Array

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
