# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What every driver must do over its twin, faults included: a new sensor needs no new test."""

from functools import lru_cache

import numpy as np
import pytest

from benchmarks.harness.fault_trials import (
    RATE_HZ,
    STORM,
    STORMS,
    Road,
    noise_beside,
    suffer,
    usable,
    ways,
)
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.simulated_serial import BYTE_FAULTS, STALL_S, FramedTwin, SerialTwin
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.sensors import list_sensors, load_sensor
from tactile_ros.types import TaxelStatus

VOCABULARY = {
    'nack', 'stuck_bus', 'brown_out', 'stuck_chip', 'saturation', 'wrap', 'dropped', 'doubled',
    'flipped', 'garbage', 'truncated', 'inserted', 'shifted', 'lost', 'nan', 'stall', 'unplug',
    'clock_jump',
}  # fmt: skip
EXACT = {'nack', 'brown_out', 'stuck_bus', 'saturation', 'wrap'}

ROADS = [(key, how) for key in list_sensors() for how in ways(load_sensor(key))]
NAMES = ['-'.join([key, *map(str, how.values())]) for key, how in ROADS]


def road_of(key: str, how: dict[str, object], seed: int = 0, noise: float = 0.0) -> Road:
    return Road(load_sensor(key), how, seed, noise)


@lru_cache
def faults_of(index: int) -> tuple[str, ...]:
    twin = road_of(*ROADS[index]).twin
    return tuple(twin.faults)


SUFFERED = [
    pytest.param(*ROADS[i], fault, id=f'{NAMES[i]}-{fault}')
    for i in range(len(ROADS))
    for fault in faults_of(i)
]
roads = pytest.mark.parametrize(('key', 'how'), ROADS, ids=NAMES)


@roads
def test_driver_frames_follow_the_signal_in_order(key: str, how: dict[str, object]) -> None:
    noise = {'T': 10e-6, '1': 2e-3}[load_sensor(key).layout(load_sensor(key).config()).unit]
    with road_of(key, how, noise=noise) as road:
        frames = road.run(1.0)
        times = road.times(frames)
        assert road.device.layout.shape == road.layout.shape
    assert len(frames) > 0.7 * RATE_HZ
    sequence = [frame.sequence for frame in frames]
    assert sequence == list(range(sequence[0], sequence[0] + len(frames)))
    assert (np.diff([frame.stamp_ns or 0 for frame in frames]) > 0).all()
    assert sum(road.wrong(frame, t) for frame, t in zip(frames, times, strict=True)) == 0
    assert all(usable(frame).all() for frame in frames)
    spread = np.array([f.values - road.signal(t) for f, t in zip(frames, times, strict=True)])
    assert 0.7 * noise < spread.std() < 1.4 * noise
    assert frames[-1].dropped == 0


@roads
def test_driver_can_be_closed_and_opened_again(key: str, how: dict[str, object]) -> None:
    road = road_of(key, how)
    with road.twin as twin:
        device = twin.device(road.clock.now_ns)
        for _ in range(2):
            with device:
                if isinstance(twin, SerialTwin):
                    twin.play(5)
                assert device.read(60.0).values.shape == road.layout.shape
            with pytest.raises(DeviceError):
                device.read(0.0)
            if isinstance(twin, SerialTwin):
                twin._line.unplug()
                twin._line.replug()


@roads
def test_driver_ends_silence_in_time_with_a_sentence(key: str, how: dict[str, object]) -> None:
    with road_of(key, how) as road:
        if isinstance(road.twin, ChipArrayTwin):
            road.twin.inject('unplug')
        begun_ns = road.clock.now_ns()
        with pytest.raises(DeviceTimeout) as silent:
            road.device.read(0.05)
        assert road.clock.now_ns() - begun_ns < 0.2e9
    said = str(silent.value)
    assert '\n' not in said
    if isinstance(road.twin, ChipArrayTwin):
        assert 'was unplugged' in said
        assert said.endswith('; trying again')


def test_twins_have_one_vocabulary_of_faults() -> None:
    known = {fault for i in range(len(ROADS)) for fault in faults_of(i)}
    assert known == VOCABULARY


@pytest.mark.parametrize(('key', 'how', 'fault'), SUFFERED)
def test_driver_survives_and_counts_a_fault(key: str, how: dict[str, object], fault: str) -> None:
    count = STORMS.get(fault, STORM)
    noise = noise_beside(fault, load_sensor(key).layout(load_sensor(key).config()))
    with road_of(key, how, noise=noise) as road:
        trial = suffer(road, fault, count, 0.25)
        assert trial.injected == count
        assert trial.recovery_s < 2.0
        assert trial.frames > 20
        assert fault in road.twin.unseen or trial.wrong == 0
        framed = isinstance(road.twin, FramedTwin) and fault != 'stuck_chip'
        if framed or fault in EXACT:
            assert trial.counted == trial.injected
        elif fault == 'stall' and 'suspected' in road.counters():
            # frames that are missing by the clock: half a second of 80 Hz each
            assert trial.counted == pytest.approx(40 * count, abs=2 * count)
        elif fault not in {*road.twin.unseen, 'lost', 'nan', 'stuck_chip'}:
            assert trial.counted >= 1


@roads
def test_driver_survives_a_storm_of_everything(key: str, how: dict[str, object]) -> None:
    with road_of(key, how, seed=4) as road:
        rng = np.random.default_rng(4)
        frames = road.run(0.25)
        left_out = {*road.twin.unseen, 'stuck_chip', 'unplug'}
        kinds = [f for f in road.twin.faults if f not in left_out]
        storm = rng.choice(kinds, 20).tolist()
        for fault in storm:
            road.twin.inject(fault)
        frames += road.run(2.0 + STALL_S * storm.count('stall'))
        times = road.times(frames)
        wrong = sum(road.wrong(frame, t) for frame, t in zip(frames, times, strict=True))
        injected = sum(road.twin.injected.values())
        counts = road.counters()
    assert injected == 20
    assert wrong == 0
    assert usable(frames[-1]).all()
    if isinstance(road.twin, FramedTwin):
        lost = sum(n for k, n in road.twin.injected.items() if k in (*BYTE_FAULTS, 'lost'))
        assert counts['dropped'] == lost


@roads
def test_driver_marks_a_chip_that_repeats_itself(key: str, how: dict[str, object]) -> None:
    layout = load_sensor(key).layout(load_sensor(key).config())
    with road_of(key, how, noise={'T': 10e-6, '1': 4e-3}[layout.unit]) as road:
        frames = road.run(0.5)
        road.twin.inject('stuck_chip', 30)
        frames += road.run(1.0)
    status = np.array([np.zeros(len(layout.positions)) if f.status is None else f.status
                       for f in frames]).astype(np.uint8)  # fmt: skip
    stuck = (status & TaxelStatus.STUCK) > 0
    doubted = (status & (TaxelStatus.STUCK | TaxelStatus.STALE)) > 0
    assert 15 <= stuck.any(axis=1).sum() <= 30
    assert 24 <= doubted[:, stuck.any(axis=0)].all(axis=1).sum() <= 32
    assert not stuck[-1].any()
    # one converter reads all taxels of some boards: it stops as a whole
    together = isinstance(road.twin, SerialTwin) and road.twin.one_converter
    assert stuck.any(axis=0).sum() == (len(layout.positions) if together else 1)


def test_driver_lets_a_board_of_one_converter_rest() -> None:
    with road_of('taxel_array', {}) as road:
        road.twin.signal = lambda t: np.zeros(road.layout.shape)  # type: ignore[union-attr]
        frames = road.run(0.5)
        road.twin.signal = road.signal  # type: ignore[union-attr]
        frames += road.run(0.5)
        road.twin.signal = lambda t: np.zeros(road.layout.shape)  # type: ignore[union-attr]
        frames += road.run(2.0)
    assert len(frames) > 200
    assert all(frame.status is None for frame in frames)
