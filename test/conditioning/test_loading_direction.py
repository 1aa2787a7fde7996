# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Which way loads last went, whatever the rate, the noise and the gaps of their frames."""

from __future__ import annotations

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
    """Times (s,) and a load (s, 1) at them."""
    time = np.arange(round(SECONDS * rate)) / rate
    load = np.interp(time, CORNERS, LOADS)
    return time, (load + noise * np.random.default_rng(seed).normal(size=len(time)))[:, None]


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
    band = dead_band(load)[0]
    assert 0.5 * 10 * noise <= band <= max(2 * 10 * noise, 2e-3 * TOP)
    signs, wanted = loading_signs(load, begins(len(time)))[:, 0], truth(time, band + 8 * noise)
    known = np.isfinite(wanted)
    assert known.mean() > 0.9
    assert (signs == wanted)[known].all()


@pytest.mark.parametrize('rate', RATES)
def test_lost_rows_keep_the_sign_and_change_no_other(rate: float) -> None:
    time, load = read(rate)
    whole = loading_signs(load, begins(len(time)))
    lost = np.random.default_rng(2).uniform(size=len(time)) < 0.3
    lost[0] = False
    gappy = load.copy()
    gappy[lost] = np.nan
    signs = loading_signs(gappy, begins(len(time)), dead_band(load))
    late = np.abs(signs - whole)[:, 0] > 0  # a row whose turn was lost is told by the next
    assert late.sum() <= 12
    assert (signs[1:][lost[1:]] == signs[:-1][lost[1:]]).all()
    without = loading_signs(load[~lost], begins(int((~lost).sum())), dead_band(load))
    assert (without == signs[~lost]).all()


def test_a_stream_forgets_the_one_before_it() -> None:
    _, load = read(100.0, 2e-3 * TOP)
    load = np.column_stack([load[:, 0], load[::-1, 0], np.full(len(load), np.nan)])
    load[500:520, 0] = np.nan
    restart = np.isin(np.arange(len(load)), (0, 900))
    signs = loading_signs(load, restart, np.full(3, 0.06))
    again = loading_signs(load[900:], restart[900:], np.full(3, 0.06))
    assert (signs[900:] == again).all()
    assert set(np.unique(signs[:, :2])) == {-1.0, 0.0, 1.0}
    assert (signs[:, 2] == 0).all()
    assert (signs[900] == 0).all()
