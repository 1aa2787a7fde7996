# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The judges of drivers and decoders: they see wrong readings, marked ones and silence."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

from benchmarks.harness.fault_trials import RATE_HZ, Road, suffer
from benchmarks.harness.fuzz import BoardSubject, FramedSubject, suffer_answers, suffer_bytes
from tactile_ros.devices import fault_flags, framed_protocol
from tactile_ros.devices.framed_protocol import three_axis_chips
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


@pytest.mark.parametrize('resolution', [2, 3])
def test_random_answers_beyond_the_range_are_marked(resolution: int) -> None:
    found = suffer_answers(1000, resolution, False, np.random.default_rng(1))
    assert found.strings >= 1000
    assert found.beyond == 0
    assert found.recovery_s < 5.0


def test_random_status_bytes_let_no_wrong_reading_pass() -> None:
    found = suffer_answers(1000, 3, True, np.random.default_rng(1))
    assert (found.beyond, found.wrong) == (0, 0)
    assert found.recovery_s < 0.5


def test_a_driver_that_marks_nothing_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        fault_flags.ChipFaultDetector,
        'status',
        lambda self, codes, values, good, fresh: np.where(good, 0, TaxelStatus.ERROR),
    )
    assert suffer_answers(1000, 3, False, np.random.default_rng(1)).beyond > 0


def test_a_framed_decoder_delivers_nothing_wrong() -> None:
    found = suffer_bytes(FramedSubject(three_axis_chips(5)), 1000, 1)
    assert (found.strings, found.wrong, found.lost) == (1000, 0, 0)
    assert found.held < 200


def test_a_format_without_checksum_is_seen_to_believe_some() -> None:
    found = suffer_bytes(BoardSubject(5), 1000, 1)
    assert 0 < found.wrong < 500
    assert found.lost <= 1


def test_a_decoder_without_its_crc_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(framed_protocol.zlib, 'crc32', lambda data: framed_protocol.RESIDUE)
    assert suffer_bytes(FramedSubject(three_axis_chips(5)), 1000, 1).wrong > 0
