# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The driver of many chips: its connection, bytes, speed, and what it does about faults."""

import ctypes
import dataclasses
import errno
import time
from collections.abc import Sequence

import numpy as np
import pytest
from smbus2 import i2c_msg

from reference.wires import clusters
from tactile_ros.devices.chip_array import ChipArray, Mode, carried_hz
from tactile_ros.devices.connections import ChipConnection
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings
from tactile_ros.devices.serial_board import FramedBoard
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Frame, Layout, TaxelStatus

EPOCH_NS = 1_700_000_000_000_000_000
ROW = np.array([1e-3, 2e-3, -1e-3])
both_modes = pytest.mark.parametrize('mode', ['single', 'burst'])


def layout_of(taxels: int, rate_hz: float = float('nan')) -> Layout:
    return Layout(np.zeros((taxels, 3)), ('Bx', 'By', 'Bz'), 'T', rate_hz=rate_hz)


class Script:
    """A bus that knows every exchange beforehand; each may come once, in its place."""

    def __init__(self, lines: Sequence[str]) -> None:
        self.lines = list(lines)

    def i2c_rdwr(self, *messages: i2c_msg) -> None:
        assert self.lines, f'not in the script: {[bytes(m).hex() for m in messages]}'
        address, written, answer = self.lines.pop(0).split('|')
        assert {m.addr for m in messages} == {int(address, 16)}
        assert b''.join(bytes(m) for m in messages if not m.flags & 1) == bytes.fromhex(written)
        if answer.strip() == 'NACK':
            raise OSError(errno.EREMOTEIO, 'remote')
        reading = [m for m in messages if m.flags & 1]
        assert sum(m.len for m in reading) == len(bytes.fromhex(answer))
        for message in reading:
            ctypes.memmove(message.buf, bytes.fromhex(answer), message.len)

    def close(self) -> None:
        assert not self.lines, 'something of the script did not come'


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
BURST = '0C | 4F | 83 B4 A4 80 01 7F FF 80 02'
EARLY = '0C | 4F | 13 00 00 00 00 00 00 00 00'
FOREIGN_BITS = [
    '0C | 50 00 | 00 01 FC', '0C | 50 04 | 00 F4 15', '0C | 50 08 | 00 E0 00',
    '0C | 60 01 9C 00 | 00', '0C | 50 00 | 00 01 9C', '0C | 60 F0 00 04 | 00',
    '0C | 50 04 | 00 F0 00', '0C | 60 E5 48 08 | 00', '0C | 50 08 | 00 E5 48',
]  # fmt: skip


def driver(lines: Sequence[str], clock: VirtualClock, mode: Mode = 'single') -> ChipArray:
    return ChipArray(
        [I2cBus('script', smbus=Script(lines))], [ChipPlace(0x0C)], layout_of(1), ChipSettings(),
        mode, clock_ns=lambda: EPOCH_NS + clock.now_ns(), clock=clock,
    )  # fmt: skip


SCRIPTS: dict[str, tuple[list[str], Mode, dict[str, int]]] = {
    'single': ([*OPENING, START, MEASURED, START, MEASURED], 'single', {}),
    'burst': ([*OPENING, '0C | 1F | 80', BURST, BURST, '0C | 80 | 00'], 'burst', {}),
    'polled for': ([*OPENING, START, MEASURED, START, EARLY, EARLY, MEASURED], 'single',
                   {'not_ready': 2}),
    'never ready': ([*OPENING, START, MEASURED, START, *[EARLY] * 9, *OPENING, START, MEASURED],
                    'single', {'not_ready': 9, 'stalls': 1, 'reconfigured': 1, 'dropped': 1}),
    'brown out': ([*OPENING, START, MEASURED, '0C | 3F | 24', *OPENING, START, MEASURED], 'single',
                  {'resets': 1, 'reconfigured': 1, 'dropped': 1}),
    'bits that are not ours': ([*OPENING[:3], *FOREIGN_BITS, OPENING[-1], *[START, MEASURED] * 2],
                               'single', {}),
}  # fmt: skip


@pytest.mark.parametrize('name', SCRIPTS)
def test_chip_array_exchanges_byte_for_byte(name: str) -> None:
    lines, mode, counted = SCRIPTS[name]
    clock = VirtualClock()
    with driver(lines, clock, mode) as array:
        begun_ns = clock.now_ns()
        frame = array.read(1.0)
        assert clock.now_ns() - begun_ns < 50e6
    assert frame.values[0] * 1e6 == pytest.approx((2.4032, -2.4032, 7.744))
    assert (frame.temperature_c[0], frame.status[0]) == pytest.approx((25.0, 0))
    counts = {**array.counters(), 'missing': 0}
    assert {name: count for name, count in counts.items() if count} == counted
    assert frame.sequence == frame.dropped == counted.get('dropped', 0)
    if name == 'single':
        # this bus takes no time: the middle of a conversion of 2.10 ms is 1.16 ms ago
        assert frame.stamp_ns == pytest.approx(EPOCH_NS + clock.now_ns() - 1.155e6, abs=2e4)


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
def test_chip_array_names_why_a_chip_is_not_set_up(lines: list[str], sentence: str) -> None:
    with pytest.raises(DeviceError, match=sentence):
        driver(lines * 2, VirtualClock()).open()


def twin_of(
    places: Sequence[ChipPlace], clock: VirtualClock, mode: Mode = 'single', seed: int = 0,
    **more: object,
) -> ChipArrayTwin:  # fmt: skip
    def steady(t: float) -> np.ndarray:
        return np.tile(ROW, (len(places), 1)) * (1 + 0.1 * np.sin(t))

    given = {'signal': steady, **more}
    return ChipArrayTwin(
        places, layout_of(len(places)), mode=mode, clock=clock, seed=seed, **given
    )


def good(frame: Frame) -> np.ndarray:
    """Chips that no bit marks; a repeat that happens to be the chip's own is STALE, no fault."""
    return (frame.status & ~np.uint8(TaxelStatus.STALE)) == 0


def hidden(frame: Frame) -> bool:
    """True where a reading far from the signal, NaN included, is not marked."""
    return bool((good(frame) & ~(np.abs(frame.values - ROW) < 0.3e-3).all(axis=1)).any())


def recover(array: ChipArray, clock: VirtualClock) -> Frame:
    """First frame of which all chips are good, within two seconds."""
    begun_ns = clock.now_ns()
    while clock.now_ns() - begun_ns < 2e9:
        try:
            frame = array.read(0.1)
        except DeviceTimeout:
            continue
        assert not hidden(frame)
        if good(frame).all():
            return frame
    pytest.fail('not all chips came back within 2 s')


@both_modes
def test_chip_array_measures_the_field_when_it_stamps_it(mode: Mode) -> None:
    """A ramp of 100 mT/s shows the time of acquisition in the values."""
    clock = VirtualClock()
    twin = twin_of(
        clusters(), clock, mode, signal=lambda t: np.full((20, 3), 0.1 * t - 5e-3), noise=0.0,
    )  # fmt: skip
    with twin, twin.device(clock.now_ns) as array:
        frames = [array.read(1.0) for _ in range(50)]
    stamps = np.array([frame.stamp_ns for frame in frames])
    assert (np.diff(stamps) > 0).all()
    assert [frame.sequence for frame in frames] == list(range(50))
    assert all(good(frame).all() for frame in frames)
    assert np.ptp([frame.temperature_c for frame in frames]) < 0.4
    late = [(frame.values.mean() + 5e-3) / 0.1 for frame in frames] - stamps * 1e-9
    assert np.abs(late.mean()) < 0.3e-3
    assert np.abs(late).max() < 1.5e-3


@both_modes
def test_chip_array_names_a_dead_chip_and_does_not_wait_for_it(mode: Mode) -> None:
    clock = VirtualClock()
    twin = twin_of(clusters(), clock, mode)
    twin.inject('nack', 100_000, chip=3)
    with twin.device(clock.now_ns) as array:
        assert array.missing == (clusters()[3],)
        begun_ns = clock.now_ns()
        for _ in range(60):
            frame = array.read(1.0)
            assert frame.status[3] == TaxelStatus.ERROR
            assert good(frame).tolist() == [i != 3 for i in range(20)]
            assert np.isnan(frame.values[3]).all()
        assert clock.now_ns() - begun_ns < 0.6e9
        twin.buses[0].silent.clear()
        recover(array, clock)
        assert array.counters()['missing'] == 0


@pytest.mark.parametrize(
    ('places', 'taxels', 'mode', 'why'),
    [
        ([ChipPlace(0x0C), ChipPlace(0x0D)], 3, 'single', 'must have 2 taxels, one for each chip'),
        ([ChipPlace(0x0C, 1)], 1, 'single', 'must name one of 1 buses'),
        ([ChipPlace(0x0C), ChipPlace(0x0C)], 2, 'single', 'two would answer'),
        ([ChipPlace()], 1, 'wake', 'mode of ChipArray must be one of single, burst'),
    ],
)
def test_chip_array_refuses_misfits(
    places: list[ChipPlace], taxels: int, mode: Mode, why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        ChipArray([I2cBus('none', smbus=Script([]))], places, layout_of(taxels), mode=mode)


@both_modes
@pytest.mark.parametrize('hallconf', [0x0, 0xC])
@pytest.mark.parametrize(
    ('gain', 'resolution', 'filtering', 'oversampling'),
    [(0, (0, 0, 0), 2, 0), (7, (1, 1, 0), 3, 1), (4, (2, 2, 1), 7, 3), (7, (3, 3, 3), 2, 0)],
)
def test_chip_array_reads_the_same_field_with_all_settings(
    gain: int, resolution: tuple[int, int, int], filtering: int, oversampling: int, hallconf: int,
    mode: Mode,
) -> None:  # fmt: skip
    settings = ChipSettings(
        gain, resolution, filtering, oversampling, bool(gain % 2), hallconf=hallconf
    )
    truth = 0.4 * settings.full_scale * [1, -1, 1]
    clock = VirtualClock()
    twin = twin_of(
        [ChipPlace()], clock, mode, signal=lambda t: truth[None], settings=settings, noise=0.0
    )
    with twin.device(clock.now_ns) as array:
        frame = array.read(1.0)
        assert good(frame).all()
        assert np.abs(frame.values[0] - truth).max() <= settings.full_scale.max() / 16384
        assert (frame.temperature_c is None) is not settings.temperature
        assert not any(array.counters().values())


def test_chip_array_without_any_chip_does_not_open() -> None:
    twin = twin_of(clusters(1), VirtualClock())
    for i in range(4):
        twin.inject('nack', 10_000, chip=i)
    with pytest.raises(DeviceError, match='nothing answers at 0x0'), twin.device(lambda: 0):
        pass


@both_modes
@pytest.mark.parametrize('fault', ['nack', 'stuck_bus'])
def test_chip_array_opens_through_one_failing_transfer(fault: str, mode: Mode) -> None:
    clock = VirtualClock()
    twin = twin_of([ChipPlace(0x0C)], clock, mode)
    twin.inject(fault, 1, 0)
    with twin.device(clock.now_ns) as array:
        assert good(array.read(1.0)).all()


DIRECT = [ChipPlace(0x0C + i) for i in range(20)]
TWO_BUSES = [ChipPlace(0x0C + i % 10, i // 10) for i in range(20)]
TWO_SWITCHES = [ChipPlace(0x0C, 0, 0x70 + i % 2, i // 2) for i in range(6)]


@pytest.mark.parametrize('places', [DIRECT, clusters(), TWO_BUSES, TWO_SWITCHES, DIRECT[:2]])
@both_modes
@pytest.mark.parametrize('hertz', [100e3, 400e3])
def test_carried_rate_is_that_of_the_simulated_bus(
    places: list[ChipPlace], mode: Mode, hertz: float
) -> None:
    clock = VirtualClock()
    twin = twin_of(places, clock, mode, hertz=hertz, tolerance=0.0)
    with twin, twin.device(clock.now_ns) as array:
        array.read(1.0)
        begun_ns = clock.now_ns()
        for _ in range(30):
            array.read(1.0)
        rate = 30e9 / (clock.now_ns() - begun_ns)
    carried = carried_hz(places, ChipSettings(), mode == 'burst', hertz)
    # the driver waits a twentieth longer than the conversion
    assert 0.95 * carried <= rate <= 1.0001 * carried


CLUSTERS = ChipConnection(
    addresses=(12, 13, 14, 15) * 5, mux_addresses=(0x70,),
    mux_channels=tuple(i // 4 for i in range(20)),
)  # fmt: skip
REFUSED = {
    'switched': (CLUSTERS, 20, 200.0, (
        '20 chips, 20 of them behind switches at 200 Hz must fit their I2C bus: in mode single a '
        r'bus of 400 kHz and conversions of 2\.1 ms carry 12\d.* Hz; lower the rate, .* mode '
        "'burst', or raise bus_clock")),
    'slow': (ChipConnection(bus_clock=100_000, addresses=(12, 13, 14, 15)), 4, 200.0,
             '4 chips at 200 Hz .* a bus of 100 kHz .* carry 1'),
    'long': (ChipConnection(digital_filter=7, oversampling=3, mode='burst'), 2, 100.0,
             'of 201 ms carry 4.984 Hz; lower the rate, sho'),
}  # fmt: skip


@pytest.mark.parametrize('name', REFUSED)
def test_chip_array_refuses_a_rate_that_its_bus_cannot_carry(name: str) -> None:
    connection, chips, rate_hz, why = REFUSED[name]
    with pytest.raises(ValueError, match=why):
        connection.open(layout_of(chips, rate_hz), time.monotonic_ns)
    dataclasses.replace(connection, bus_clock=0).open(layout_of(chips, rate_hz), time.monotonic_ns)
    connection.open(layout_of(chips), time.monotonic_ns)
    clock = VirtualClock()
    twin = connection.simulate(layout_of(chips, rate_hz), lambda t: None, 0.0, 0, clock)
    with twin, pytest.raises(ValueError, match=why):
        twin.device(clock.now_ns)


def test_chip_array_holds_its_rate() -> None:
    clock = VirtualClock()
    with twin_of(clusters(1), clock, rate_hz=50.0).device(clock.now_ns) as array:
        stamps = [array.read(1.0).stamp_ns for _ in range(50)]
    assert np.diff(stamps) == pytest.approx(np.full(49, 20e6), rel=0.03)


def test_twin_refuses_unknown_faults_and_withdraws_those_that_wait() -> None:
    clock = VirtualClock()
    twin = twin_of(clusters(1), clock)
    with pytest.raises(ValueError, match='fault must be one of stuck_bus, unplug, nack'):
        twin.inject('clock_jump')
    with pytest.raises(ValueError, match='chip must be 0 to 3; received 20'):
        twin.inject('nack', chip=20)
    twin.inject('nack', 10_000, chip=0)
    twin.relieve()
    with twin.device(clock.now_ns) as array:
        assert good(array.read(1.0)).all()
    assert not any(twin.injected.values())


FOUR = Layout(np.zeros((4, 3)), ('Bx', 'By', 'Bz'), 'T', rate_hz=50.0)
ADDRESSES = (0x0C, 0x0D, 0x0E, 0x0F)


def test_chip_connection_places_chips_behind_switches() -> None:
    connection = ChipConnection(
        addresses=ADDRESSES, mux_addresses=(0x70, 0x70, 0, 0x71), mux_channels=(0, 1, 0, 7)
    )
    assert connection.places(4) == [
        ChipPlace(0x0C, 0, 0x70, 0),
        ChipPlace(0x0D, 0, 0x70, 1),
        ChipPlace(0x0E, 0),
        ChipPlace(0x0F, 0, 0x71, 7),
    ]


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        ({'addresses': (12,)}, 'addresses must have one number for each of 4 chips; received 1'),
        ({'bus_of_chip': (0, 0)}, 'bus_of_chip must have one number for each of 4 chips'),
        ({'bus_of_chip': (1,)}, 'bus_of_chip must be 0 to 0, a number in buses /dev/i2c-1'),
        ({'mux_addresses': (0x20,)}, 'mux and channel of ChipPlace must be 0x70 to 0x77'),
        ({'addresses': (12, 12, 13, 14)}, 'must differ; two would answer'),
    ],
)
def test_chip_connection_refuses_places(wrong: dict[str, object], words: str) -> None:
    connection = dataclasses.replace(ChipConnection(addresses=ADDRESSES), **wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=words):
        connection.open(FOUR, time.monotonic_ns)


def test_chip_connection_chooses_the_driver_by_transport() -> None:
    connection = ChipConnection(addresses=ADDRESSES)
    assert isinstance(connection.open(FOUR, time.monotonic_ns), ChipArray)
    serial = dataclasses.replace(connection, transport='serial')
    assert isinstance(serial.open(FOUR, time.monotonic_ns), FramedBoard)
    assert connection.at('/dev/i2c-7').buses == ('/dev/i2c-7',)
    assert isinstance(connection.at('/dev/ttyACM0').open(FOUR, time.monotonic_ns), FramedBoard)
