"""The driver of many chips: its bytes on the bus, its speed, and what it does about faults."""

from __future__ import annotations

import ctypes
import dataclasses
import errno
import gc
import time
import tracemalloc
from typing import TYPE_CHECKING

import numpy as np
import pytest
from smbus2 import i2c_msg

from tactile_ros.devices.chip_array import (
    ChipArray,
    Mode,
    carried_hz,
    exchange_bits,
    switch_bits,
)
from tactile_ros.devices.connections import ChipConnection
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings, clusters
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Frame, Layout, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.devices.simulated_i2c import SimulatedI2cBus

NACK = 'NACK'
EPOCH_NS = 1_700_000_000_000_000_000


def layout_of(taxels: int) -> Layout:
    return Layout(np.zeros((taxels, 3)), ('Bx', 'By', 'Bz'), 'T')


class Script:
    """A bus that knows every exchange beforehand; each may come once, in its place."""

    def __init__(self, lines: Sequence[str]) -> None:
        self.lines = list(lines)

    def i2c_rdwr(self, *messages: i2c_msg) -> None:
        assert self.lines, f'not in the script: {[bytes(m).hex() for m in messages]}'
        address, written, answer = self.lines.pop(0).split('|')
        sent = b''.join(bytes(m) for m in messages if not m.flags & 1)
        assert {m.addr for m in messages} == {int(address, 16)}
        assert sent == bytes.fromhex(written)
        if answer.strip() == NACK:
            raise OSError(errno.EREMOTEIO, 'remote')
        reading = [m for m in messages if m.flags & 1]
        expected = bytes.fromhex(answer)
        assert sum(m.len for m in reading) == len(expected)
        for message in reading:
            ctypes.memmove(message.buf, expected, message.len)

    def close(self) -> None:
        pass


OPENING = [
    '0C | 80 | 00',  # EX
    '0C | F0 |',  # RT; the status is left for the next command
    '0C | 00 | 04',  # NOP: RS
    '0C | 50 00 | 00 00 7C',  # gain 7, HALLCONF 0xC
    '0C | 50 04 | 00 00 00',
    '0C | 50 08 | 00 00 00',
    '0C | 60 00 1C 00 | 00',  # gain 1, everything else kept
    '0C | 50 00 | 00 00 1C',
    '0C | 60 05 48 08 | 00',  # RES 2 2 2, DIG_FILT 2, OSR 0
    '0C | 50 08 | 00 05 48',
    '0C | 50 90 | 00 B6 68',  # TREF
]
START = '0C | 3F | 20'
MEASURED = '0C | 4F | 03 B4 A4 80 01 7F FF 80 02'  # 25 degrees, 1, -1 and 2 steps


def driver(script: Script, clock: VirtualClock, mode: Mode = 'single') -> ChipArray:
    return ChipArray(
        [I2cBus('script', smbus=script)],
        [ChipPlace(0x0C)],
        layout_of(1),
        ChipSettings(),
        mode,
        clock_ns=lambda: EPOCH_NS + clock.now_ns(),
        clock=clock,
    )


def read_one(frame: Frame) -> tuple[float, ...]:
    assert frame.temperature_c is not None
    assert frame.status is not None
    return (*frame.values[0] * 1e6, frame.temperature_c[0], frame.status[0])


def test_single_measurement_byte_for_byte() -> None:
    script = Script([*OPENING, START, MEASURED, START, MEASURED])
    clock = VirtualClock()
    with driver(script, clock) as array:
        frame = array.read(1.0)
    assert script.lines == []
    assert read_one(frame) == pytest.approx((2.4032, -2.4032, 7.744, 25.0, 0))
    assert frame.sequence == 0
    # this bus takes no time: the middle of a conversion of 2.10 ms is 1.16 ms ago
    assert frame.stamp_ns == pytest.approx(EPOCH_NS + clock.now_ns() - 1.155e6, abs=2e4)
    assert not any(array.counters()[name] for name in ('resets', 'nacks', 'not_ready'))


def test_burst_byte_for_byte() -> None:
    burst = '0C | 4F | 83 B4 A4 80 01 7F FF 80 02'
    script = Script([*OPENING, '0C | 1F | 80', burst, burst, '0C | 80 | 00'])
    with driver(script, VirtualClock(), 'burst') as array:
        assert read_one(array.read(1.0))[:3] == pytest.approx((2.4032, -2.4032, 7.744))
    assert script.lines == []


def test_registers_keep_the_bits_that_are_not_ours() -> None:
    opening = list(OPENING)
    opening[3:6] = ['0C | 50 00 | 00 01 FC', '0C | 50 04 | 00 F4 15', '0C | 50 08 | 00 E0 00']
    opening[6:10] = [
        '0C | 60 01 9C 00 | 00', '0C | 50 00 | 00 01 9C',
        '0C | 60 F0 00 04 | 00', '0C | 50 04 | 00 F0 00',
        '0C | 60 E5 48 08 | 00', '0C | 50 08 | 00 E5 48',
    ]  # fmt: skip
    script = Script([*opening, START, MEASURED])
    driver(script, VirtualClock()).open()
    assert script.lines == []


def test_data_that_are_not_ready_are_polled_for() -> None:
    early = '0C | 4F | 13 00 00 00 00 00 00 00 00'
    script = Script([*OPENING, START, MEASURED, START, early, early, MEASURED])
    with driver(script, VirtualClock()) as array:
        assert read_one(array.read(1.0))[3:] == pytest.approx((25.0, 0))
    assert script.lines == []
    assert array.counters()['not_ready'] == 2


def test_a_chip_that_never_gets_ready_is_reset_after_a_bounded_time() -> None:
    clock = VirtualClock()
    early = '0C | 4F | 13 00 00 00 00 00 00 00 00'
    script = Script([*OPENING, START, MEASURED, START, *[early] * 9, *OPENING, START, MEASURED])
    with driver(script, clock) as array:
        begun_ns = clock.now_ns()
        assert read_one(array.read(1.0))[3:] == pytest.approx((25.0, 0))
        assert clock.now_ns() - begun_ns < 50e6
    assert script.lines == []
    assert (array.counters()['stalls'], array.counters()['reconfigured']) == (1, 1)


def test_a_late_reset_is_a_brown_out() -> None:
    script = Script([*OPENING, START, MEASURED, '0C | 3F | 24', *OPENING, START, MEASURED])
    with driver(script, VirtualClock()) as array:
        frame = array.read(1.0)
    assert script.lines == []
    assert (frame.sequence, frame.dropped) == (1, 1)
    assert (array.counters()['resets'], array.counters()['reconfigured']) == (1, 1)


@pytest.mark.parametrize(
    ('lines', 'sentence'),
    [
        (['0C | 80 | NACK'], 'nothing answers at 0x0c on bus script'),
        ([*OPENING[:2], '0C | 00 | 00'], r'chip 0x0c on bus 0 was not reset \(status 0x00\)'),
        ([*OPENING[:3], '0C | 50 00 | 10 00 00'], 'did not read register 0x00'),
        ([*OPENING[:6], '0C | 60 00 1C 00 | 10'], 'did not write register 0x00'),
        ([*OPENING[:7], '0C | 50 00 | 00 00 7C'], 'keeps 0x007c in register 0x00, not 0x001c'),
    ],
)
def test_a_chip_that_cannot_be_set_up_says_why(lines: list[str], sentence: str) -> None:
    script = Script(lines * 2)
    with pytest.raises(DeviceError, match=sentence):
        driver(script, VirtualClock()).open()
    assert script.lines == []


def test_compensation_programs_the_offsets() -> None:
    settings = ChipSettings(gain=7, resolution=(0, 0, 0), temperature_compensation=True)
    twin = ChipArrayTwin(
        [ChipPlace()], layout_of(1), steady(1), settings=settings, clock=VirtualClock()
    )
    with twin.device(lambda: 0) as array:
        frame = array.read(1.0)
    chip = next(iter(twin.buses[0]._chips.values()))
    assert [chip.registers[i] for i in (1, 4, 5, 6)] == [0x400, 0x8000, 0x8000, 0x8000]
    assert frame.values[0] == pytest.approx([1e-3, 2e-3, -1e-3], abs=30e-6)


# --- back to back with the twin -----------------------------------------------------------------


def steady(taxels: int) -> object:
    row = np.array([1e-3, 2e-3, -1e-3])
    return lambda t: np.tile(row, (taxels, 1)) * (1 + 0.1 * np.sin(t))


def array_of(
    places: Sequence[ChipPlace], clock: VirtualClock, mode: Mode = 'single', seed: int = 0
) -> ChipArrayTwin:
    count = len(places)
    return ChipArrayTwin(
        places, layout_of(count), steady(count), mode=mode, clock=clock, seed=seed
    )


def good(frame: Frame) -> np.ndarray:
    """Chips that no bit marks; a repeat that happens to be the chip's own is STALE, no fault."""
    assert frame.status is not None
    return (frame.status & ~np.uint8(TaxelStatus.STALE)) == 0


def wrong(frame: Frame, t: float = 0.0) -> np.ndarray:
    """Chips whose reading is far from the signal, NaN included."""
    truth = steady(len(frame.values))(t)  # type: ignore[operator]
    return ~(np.abs(frame.values - truth) < 0.3e-3).all(axis=1)


@pytest.mark.parametrize('mode', ['single', 'burst'])
def test_what_is_measured_is_what_was_there(mode: Mode) -> None:
    clock = VirtualClock()
    twin = array_of(clusters(), clock, mode)
    with twin, twin.device(clock.now_ns) as array:
        frames = [array.read(1.0) for _ in range(100)]
    stamps = np.array([frame.stamp_ns for frame in frames])
    assert (np.diff(stamps) > 0).all()
    assert [frame.sequence for frame in frames] == list(range(100))
    for frame, stamp in zip(frames, stamps, strict=True):
        assert good(frame).all()
        truth = twin._signal(stamp * 1e-9)
        assert frame.values == pytest.approx(truth, abs=40e-6)  # five deviations and a step
        assert frame.temperature_c == pytest.approx(np.full(20, 25.0), abs=0.2)


@pytest.mark.parametrize('mode', ['single', 'burst'])
def test_stamps_are_when_it_was_measured(mode: Mode) -> None:
    """A ramp of 100 mT/s tells the time of acquisition from the values."""
    clock = VirtualClock()
    places = clusters()
    slope = 0.1
    twin = ChipArrayTwin(
        places,
        layout_of(20),
        lambda t: np.full((20, 3), slope * t - 5e-3),
        mode=mode,
        noise=0.0,
        signal_step_s=1e-6,
        clock=clock,
    )
    with twin.device(clock.now_ns) as array:
        late = []
        for _ in range(20):
            frame = array.read(1.0)
            assert frame.stamp_ns is not None
            late.append((frame.values.mean() + 5e-3) / slope - frame.stamp_ns * 1e-9)
    assert np.abs(np.mean(late)) < 0.3e-3
    assert np.abs(late).max() < 1.5e-3


def test_the_rate_is_held() -> None:
    clock = VirtualClock()
    places = clusters(1)
    twin = ChipArrayTwin(places, layout_of(4), steady(4), rate_hz=50.0, clock=clock)  # type: ignore[arg-type]
    with twin.device(clock.now_ns) as array:
        stamps = [array.read(1.0).stamp_ns for _ in range(50)]
    assert np.diff(stamps) == pytest.approx(np.full(49, 20e6), rel=0.03)


MARKS = {
    'saturation': TaxelStatus.SATURATED,
    'wrap': TaxelStatus.WRAPPED,
    'nack': TaxelStatus.ERROR,
    'brown_out': TaxelStatus.ERROR,
    'stall': TaxelStatus.ERROR,
}
COUNTS = {'nack': 'nacks', 'brown_out': 'resets', 'stall': 'stalls'}


@pytest.mark.parametrize('mode', ['single', 'burst'])
@pytest.mark.parametrize('count', [1, 3])
@pytest.mark.parametrize('fault', MARKS)
def test_a_chip_that_fails_fails_alone_and_comes_back(fault: str, count: int, mode: Mode) -> None:
    clock = VirtualClock()
    twin = array_of(clusters(), clock, mode)
    with twin, twin.device(clock.now_ns) as array:
        array.read(1.0)
        twin.inject(fault, count, chip=7)
        begun_ns, hit, last_bad_ns = clock.now_ns(), 0, clock.now_ns()
        for _ in range(100):
            frame = array.read(1.0)
            assert not (wrong(frame) & good(frame)).any()
            bad = ~good(frame)
            assert not np.delete(bad, 7).any()
            if bad[7]:
                assert frame.status is not None
                assert frame.status[7] == MARKS[fault]
                hit, last_bad_ns = hit + 1, clock.now_ns()
        assert hit >= (1 if fault == 'nack' else count)
        assert last_bad_ns - begun_ns < 2e9
        assert good(frame).all()
        assert twin.injected[fault] == count
        if fault in COUNTS:
            assert array.counters()[COUNTS[fault]] == count
    assert array.counters()['dropped'] == 0


@pytest.mark.parametrize('mode', ['single', 'burst'])
def test_a_dead_chip_is_named_and_does_not_slow_the_others(mode: Mode) -> None:
    clock = VirtualClock()
    twin = array_of(clusters(), clock, mode)
    twin.inject('nack', 100_000, chip=3)
    with twin.device(clock.now_ns) as array:
        assert array.missing == (clusters()[3],)
        begun_ns = clock.now_ns()
        for _ in range(100):
            frame = array.read(1.0)
            assert frame.status is not None
            assert frame.status[3] == TaxelStatus.ERROR
            assert good(frame).tolist() == [i != 3 for i in range(20)]
            assert np.isnan(frame.values[3]).all()
        assert clock.now_ns() - begun_ns < 1e9
        twin.buses[0].silent.clear()
        begun_ns = clock.now_ns()
        while not good(array.read(1.0)).all():
            assert clock.now_ns() - begun_ns < 2e9
        assert array.counters()['missing'] == 0


@pytest.mark.parametrize('mode', ['single', 'burst'])
def test_a_stuck_chip_is_told_from_a_quiet_one(mode: Mode) -> None:
    clock = VirtualClock()
    twin = array_of(clusters(1), clock, mode)
    with twin.device(clock.now_ns) as array:
        for _ in range(50):
            array.read(1.0)
        twin.inject('stuck_chip', 30, chip=2)
        statuses = np.array([array.read(1.0).status for _ in range(60)])
    assert (statuses[:, [0, 1, 3]] == 0).all()
    stuck = (statuses[:, 2] & TaxelStatus.STUCK) > 0
    stale = (statuses[:, 2] & TaxelStatus.STALE) > 0
    assert np.flatnonzero(stuck).tolist() == list(range(8, 30))  # the tenth alike and on
    assert np.flatnonzero(stale).tolist() == list(range(1, 30))  # once is no wonder


@pytest.mark.parametrize('mode', ['single', 'burst'])
@pytest.mark.parametrize(
    ('fault', 'count', 'sentence'), [('stuck_bus', 3, 'is stuck'), ('unplug', 1, 'was unplugged')]
)
def test_a_bus_that_fails_is_named_and_recovers(
    fault: str, count: int, sentence: str, mode: Mode
) -> None:
    clock = VirtualClock()
    twin = array_of(clusters(), clock, mode)
    with twin.device(clock.now_ns) as array:
        before = array.read(1.0)
        twin.inject(fault, count)
        begun_ns = clock.now_ns()
        with pytest.raises(DeviceTimeout, match=rf'bus simulated-0 {sentence}.*; trying again$'):
            array.read(0.0)
        while True:
            try:
                frame = array.read(0.1)
            except DeviceTimeout:
                continue
            assert not (wrong(frame) & good(frame)).any()
            if good(frame).all():
                break
        assert clock.now_ns() - begun_ns < 2e9
        assert frame.sequence > before.sequence + 1
        assert frame.dropped == array.counters()['dropped'] > 0
        assert array.counters()['bus_errors'] >= count
        assert twin.injected[fault] == count


def test_one_stuck_bus_of_two_costs_its_own_chips_only() -> None:
    clock = VirtualClock()
    places = [ChipPlace(0x0C), ChipPlace(0x0C, 1)]
    twin = array_of(places, clock)
    with twin.device(clock.now_ns) as array:
        array.read(1.0)
        twin.inject('stuck_bus', 1, chip=1)
        frame = array.read(1.0)
        assert good(frame).tolist() == [True, False]
        while not good(array.read(1.0)).all():
            assert clock.now_ns() < 2e9


def test_wrong_calls_are_refused() -> None:
    bus = I2cBus('none', smbus=Script([]))
    with pytest.raises(ValueError, match='must have 2 taxels, one for each chip'):
        ChipArray([bus], [ChipPlace(0x0C), ChipPlace(0x0D)], layout_of(3))
    with pytest.raises(ValueError, match='must name one of 1 buses'):
        ChipArray([bus], [ChipPlace(0x0C, 1)], layout_of(1))
    with pytest.raises(ValueError, match='two would answer'):
        ChipArray([bus], [ChipPlace(0x0C), ChipPlace(0x0C)], layout_of(2))
    with pytest.raises(ValueError, match='mode of ChipArray must be one of single, burst'):
        ChipArray([bus], [ChipPlace()], layout_of(1), mode='wake')  # type: ignore[arg-type]


@pytest.mark.parametrize('mode', ['single', 'burst'])
@pytest.mark.parametrize('hallconf', [0x0, 0xC])
@pytest.mark.parametrize(('gain', 'filtering', 'oversampling'), [(0, 2, 0), (7, 3, 1), (4, 7, 3)])
@pytest.mark.parametrize(
    ('resolution', 'compensated'),
    [((0, 0, 0), False), ((1, 1, 0), False), ((2, 2, 1), False), ((3, 3, 3), False),
     ((1, 0, 1), True)],
)  # fmt: skip
def test_all_settings_give_the_same_field(
    gain: int, filtering: int, oversampling: int, hallconf: int,
    resolution: tuple[int, int, int], compensated: bool, mode: Mode,
) -> None:  # fmt: skip
    settings = ChipSettings(
        gain, resolution, filtering, oversampling, bool(gain % 2), 1, hallconf, compensated
    )
    truth = 0.4 * settings.full_scale * [1, -1, 1]
    clock = VirtualClock()
    twin = ChipArrayTwin(
        [ChipPlace()],
        layout_of(1),
        lambda t: truth[None],
        settings=settings,
        mode=mode,
        noise=0.0,
        clock=clock,
    )
    with twin.device(clock.now_ns) as array:
        frame = array.read(1.0)
        assert good(frame).all()
        assert np.abs(frame.values[0] - truth).max() <= settings.full_scale.max() / 16384
        assert (frame.temperature_c is None) is not settings.temperature
        assert not any(array.counters().values())


@pytest.mark.parametrize('seed', range(4))
def test_faults_on_faults_leave_no_wrong_frame(seed: int) -> None:
    """Seeded storms of faults: stamps and sequences go up, what is wrong says so, all recovers."""
    rng = np.random.default_rng(seed)
    clock = VirtualClock()
    mode: Mode = 'burst' if seed % 2 else 'single'
    places = [*clusters(2), *(ChipPlace(0x0C + i, 1) for i in range(3))]
    twin = array_of(places, clock, mode, seed)
    kinds = [fault for fault in twin.faults if fault not in ('stuck_chip', 'unplug')]
    frames = []
    with twin.device(clock.now_ns) as array:
        for i in range(150):
            if i < 100 and rng.random() < 0.1:
                twin.inject(str(rng.choice(kinds)), int(rng.integers(1, 4)))
            try:
                frames.append(array.read(0.05))
            except DeviceTimeout:
                continue
        begun_ns = clock.now_ns()
        while not good(frames[-1]).all():
            frames.append(array.read(0.05))
            assert clock.now_ns() - begun_ns < 2e9
    assert (np.diff([frame.stamp_ns for frame in frames]) > 0).all()  # type: ignore[arg-type]
    assert (np.diff([frame.sequence for frame in frames]) > 0).all()
    assert not any((wrong(frame) & good(frame)).any() for frame in frames)
    assert sum(not good(frame).all() for frame in frames) > 5


def test_memory_stays_flat() -> None:
    clock = VirtualClock()
    twin = array_of([ChipPlace()], clock)
    with twin.device(clock.now_ns) as array:
        tracemalloc.start()
        try:
            for _ in range(300):
                array.read(1.0)
            gc.collect()
            before = tracemalloc.get_traced_memory()[0]
            for _ in range(1000):
                array.read(1.0)
            gc.collect()
            assert tracemalloc.get_traced_memory()[0] - before < 10_000
        finally:
            tracemalloc.stop()


class Tap:
    """Passes transfers on and notes who was told what."""

    def __init__(self, bus: SimulatedI2cBus) -> None:
        self.bus = bus
        self.seen: list[str] = []

    def i2c_rdwr(self, *messages: i2c_msg) -> None:
        self.seen.append(f'{messages[0].addr:02X}:{bytes(messages[0]).hex()}')
        self.bus.i2c_rdwr(*messages)

    def close(self) -> None:
        self.bus.close()


@pytest.mark.parametrize(
    ('mode', 'expected'),
    [
        ('single', '70:01 0C:3f 0D:3f 70:02 0C:3f 0D:3f 70:01 0C:4f 0D:4f 70:02 0C:4f 0D:4f'),
        ('burst', '70:01 0C:4f 0D:4f 70:02 0C:4f 0D:4f'),
    ],
)
def test_all_are_started_and_then_read_with_one_write_a_switch(mode: Mode, expected: str) -> None:
    clock = VirtualClock()
    places = clusters(2, 2)
    tap = Tap(array_of(places, clock, mode).buses[0])
    array = ChipArray(
        [I2cBus('tap', smbus=tap)],
        places,
        layout_of(4),
        mode=mode,
        clock_ns=clock.now_ns,
        clock=clock,
    )
    with array:
        for _ in range(3):
            tap.seen.clear()
            assert good(array.read(1.0)).all()
            assert ' '.join(tap.seen) == expected


def test_missing_chips_do_not_keep_a_sensor_closed_but_all_of_them_do() -> None:
    clock = VirtualClock()
    twin = array_of(clusters(1), clock)
    for i in range(4):
        twin.inject('nack', 10_000, chip=i)
    with pytest.raises(DeviceError, match='nothing answers at 0x0'), twin.device(lambda: 0):
        pass


@pytest.mark.parametrize('mode', ['single', 'burst'])
@pytest.mark.parametrize('fault', ['nack', 'stuck_bus'])
def test_one_transfer_that_fails_does_not_keep_a_sensor_closed(fault: str, mode: Mode) -> None:
    clock = VirtualClock()
    twin = array_of([ChipPlace(0x0C)], clock, mode)
    twin.inject(fault, 1, 0)
    with twin.device(clock.now_ns) as array:
        assert good(array.read(1.0)).all()


def test_closing_and_opening_again_goes_on() -> None:
    clock = VirtualClock()
    twin = array_of(clusters(1), clock, 'burst')
    array = twin.device(clock.now_ns)
    with array:
        first = array.read(1.0)
    with pytest.raises(DeviceError, match='chips on simulated-0 are not open'):
        array.read(0.0)
    with array:
        again = array.read(1.0)
    assert good(again).all()
    assert again.sequence > first.sequence
    assert array.counters()['resets'] == 0


# --- rates that buses carry ---

DIRECT = [ChipPlace(0x0C + i) for i in range(20)]
TWO_BUSES = [ChipPlace(0x0C + i % 10, i // 10) for i in range(20)]
TWO_SWITCHES = [ChipPlace(0x0C, 0, 0x70 + i % 2, i // 2) for i in range(6)]


def rated(chips: int, rate_hz: float) -> Layout:
    return Layout(np.zeros((chips, 3)), ('Bx', 'By', 'Bz'), 'T', rate_hz=rate_hz)


def test_clocks_of_exchanges() -> None:
    assert exchange_bits(1) == 1 + 1 + 9 + 9
    assert exchange_bits(1, 9) == 20 + 1 + 9 + 81


def test_switches_are_written_where_the_channel_changes() -> None:
    assert switch_bits(clusters(2, 3)) == [20, 0, 0, 20, 0, 0]
    assert switch_bits(clusters(1)) == [0] * 4
    assert switch_bits(DIRECT) == [0] * 20
    # to change the switch is to close the other one first
    assert switch_bits(TWO_SWITCHES) == [40] * 6


@pytest.mark.parametrize('places', [DIRECT, clusters(), TWO_BUSES, TWO_SWITCHES, DIRECT[:2]])
@pytest.mark.parametrize('mode', ['single', 'burst'])
@pytest.mark.parametrize('hertz', [100e3, 400e3])
def test_arithmetic_is_what_the_simulated_bus_does(
    places: list[ChipPlace], mode: Mode, hertz: float
) -> None:
    clock = VirtualClock()
    twin = ChipArrayTwin(
        places, rated(len(places), float('nan')), lambda t: np.zeros((len(places), 3)), mode=mode,
        hertz=hertz, tolerance=0.0, clock=clock,
    )  # fmt: skip
    with twin, twin.device(clock.now_ns) as array:
        array.read(1.0)
        begun_ns = clock.now_ns()
        for _ in range(50):
            array.read(1.0)
        rate = 50e9 / (clock.now_ns() - begun_ns)
    carried = carried_hz(places, ChipSettings(), mode == 'burst', hertz)
    # the driver waits a twentieth longer than the conversion
    assert 0.95 * carried <= rate <= 1.0001 * carried


def test_what_buses_cannot_carry_is_refused_with_both_rates_named() -> None:
    connection = ChipConnection(
        addresses=(12, 13, 14, 15) * 5, mux_addresses=(0x70,),
        mux_channels=tuple(i // 4 for i in range(20)),
    )  # fmt: skip
    carried = carried_hz(connection.places(20), connection.settings, False, 400e3)
    assert carried == pytest.approx(125, abs=1)
    connection.open(rated(20, 0.999 * carried), time.monotonic_ns)
    why = (
        r'20 chips, 20 of them behind switches at 200 Hz must fit their I2C bus: in mode single a '
        rf'bus of 400 kHz and conversions of 2\.1 ms carry {carried:.4g} Hz; lower the rate, .* '
        r"mode 'burst', or raise bus_clock"
    )
    with pytest.raises(ValueError, match=why):
        connection.open(rated(20, 200.0), time.monotonic_ns)
    dataclasses.replace(connection, mode='burst').open(rated(20, 170.0), time.monotonic_ns)
    dataclasses.replace(connection, bus_clock=0).open(rated(20, 200.0), time.monotonic_ns)
    connection.open(rated(20, float('nan')), time.monotonic_ns)


def test_a_slow_bus_and_a_long_conversion_are_refused() -> None:
    slow = ChipConnection(bus_clock=100_000, addresses=(12, 13, 14, 15))
    with pytest.raises(ValueError, match=r'4 chips at 200 Hz .* a bus of 100 kHz .* carry 1'):
        slow.open(rated(4, 200.0), time.monotonic_ns)
    long = ChipConnection(digital_filter=7, oversampling=3, mode='burst')
    with pytest.raises(ValueError, match=r'of 201 ms carry 4.984 Hz; lower the rate, sho'):
        long.open(rated(2, 100.0), time.monotonic_ns)


def test_a_twin_refuses_what_its_driver_refuses() -> None:
    clock = VirtualClock()
    connection = ChipConnection(bus_clock=10_000)
    twin = connection.simulate(rated(2, 100.0), lambda t: np.zeros((2, 3)), 0.0, 0, clock)
    with twin, pytest.raises(ValueError, match='a bus of 10 kHz'):
        twin.device(clock.now_ns)
