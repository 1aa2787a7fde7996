# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The judge of drivers: it sees wrong readings, marked ones, and silence."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

from benchmarks.harness.fault_trials import RATE_HZ, Road, suffer
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame, TaxelStatus


@pytest.fixture
def road() -> Iterator[Road]:
    with Road(load_sensor('gradiometer')) as running:
        yield running


def test_wrong_readings_are_seen_and_marked_ones_forgiven(road: Road) -> None:
    frames = road.run(0.5)
    (t, *_) = road.times(frames)
    assert [road.wrong(frame, t) for frame in frames[:1]] == [0]
    values = frames[0].values.copy()
    values[2] += 20e-6
    bad = dataclasses.replace(frames[0], values=values)
    assert road.wrong(bad, t) == 1
    status = np.array([0, 0, TaxelStatus.STUCK, 0], np.uint8)
    assert road.wrong(dataclasses.replace(bad, status=status), t) == 0
    assert road.wrong(dataclasses.replace(frames[0], values=values * np.nan), t) == 0


def test_a_reading_of_another_time_is_wrong(road: Road) -> None:
    frames = road.run(1.0)
    times = road.times(frames)
    assert np.ptp(times) == pytest.approx((len(frames) - 1) / RATE_HZ)
    assert road.wrong(frames[0], times[-1]) == 4
    stale = np.full(4, TaxelStatus.STALE, np.uint8)
    again = dataclasses.replace(frames[0], status=stale)
    assert road.wrong(again, times[-1], frames[0]) == 0
    assert road.wrong(again, times[-1], frames[-1]) == 4


def test_a_driver_that_lies_is_found_out(road: Road, monkeypatch: pytest.MonkeyPatch) -> None:
    read = road.device.read

    def lie(timeout: float) -> Frame:
        frame = read(timeout)
        values = frame.values.copy()
        values[1] *= 1.1
        return dataclasses.replace(frame, values=values) if frame.sequence == 30 else frame

    monkeypatch.setattr(road.device, 'read', lie)
    assert suffer(road, 'lost', 1, 0.25).wrong == 1


def test_a_driver_that_never_recovers_has_no_recovery(
    road: Road, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = road.device.read
    dead = np.full(4, TaxelStatus.ERROR, np.uint8)
    monkeypatch.setattr(
        road.device, 'read', lambda timeout: dataclasses.replace(read(timeout), status=dead)
    )
    assert suffer(road, 'lost', 1, 0.25).recovery_s == np.inf
