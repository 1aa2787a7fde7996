"""The driver back to back with its twin, over a real pseudo-terminal and pyserial."""

from __future__ import annotations

import itertools
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.devices.serial_board import ReskinBoard, arrival_stamps, uart_transfer_s
from tactile_ros.devices.simulated_serial import BYTE_FAULTS, SimulatedSerialPort, damage
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Frame, Layout, TaxelStatus

MS = 1_000_000


def take(board: ReskinBoard, count: int) -> list[Frame]:
    return [board.read(5.0) for _ in range(count)]


def end_of_frames(board: ReskinBoard) -> str:
    """Sentence with which the frames end."""
    while True:
        try:
            board.read(0.7)
        except DeviceTimeout as err:
            return str(err)


def why_nothing_comes(board: ReskinBoard) -> str:
    """Sentence once bytes have come through the pseudo-terminal."""
    for _ in range(100):
        with pytest.raises(DeviceError) as caught:
            board.read(0.05)
        if 'no frame came' not in str(caught.value):
            break
    return str(caught.value)


def test_rows_become_frames(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    for row in rows[:10]:
        port.send(encode(row, 31.5))
    frames = take(board, 10)
    assert [f.sequence for f in frames] == list(range(10))
    for frame, row in zip(frames, rows, strict=False):
        np.testing.assert_allclose(frame.values, row, rtol=1e-6, atol=1e-10)
        assert frame.values.shape == board.layout.shape
        assert frame.temperature_c is not None
        assert frame.temperature_c.tolist() == [31.5] * 5
        assert frame.status is None
        assert frame.dropped == 0
    stamps = [f.stamp_ns for f in frames]
    assert all(b > a for a, b in itertools.pairwise(stamps))
    assert board.counters() == {
        'frames': 10, 'dropped': 0, 'lost_bytes': 0, 'framing_errors': 0, 'implausible': 0,
        'reconnects': 0, 'suspected': 0,
    }  # fmt: skip


def test_every_frame_is_there_when_its_last_byte_is(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    for row in rows[:3]:
        port.send(encode(row))
    assert [board.read(1.0).sequence for _ in range(3)] == [0, 1, 2]
    for i in range(3, 20):
        port.send(encode(rows[i])[:50])
        with pytest.raises(DeviceTimeout):
            board.read(0.0)
        port.send(encode(rows[i])[50:])
        assert board.read(1.0).sequence == i


def test_stamps_are_the_arrival_by_the_clock_that_was_handed_in(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    now = [0]
    transfer = uart_transfer_s(5, 460800)
    assert transfer == pytest.approx(82 * 10 / 460800)
    with ReskinBoard(
        port.port, layout, 460800, clock=lambda: now[0], transfer_s=transfer
    ) as board:
        for row in rows[:3]:
            port.send(encode(row))
        now[0] = 1000 * MS
        stamps = [board.read(1.0).stamp_ns for _ in range(3)]
        assert np.diff(stamps).tolist() == [2.5 * MS, 2.5 * MS]
        assert stamps[-1] == 1000 * MS - round(transfer * 1e9)
        port.send(encode(rows[3]))
        now[0] = 1007 * MS
        assert board.read(1.0).stamp_ns == 1007 * MS - round(transfer * 1e9)


def test_stamps_are_the_middle_of_a_conversion_that_is_known(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    with ReskinBoard(port.port, layout, clock=lambda: 1000 * MS, conversion_s=2.1e-3) as board:
        for row in rows[:3]:
            port.send(encode(row))
        assert [board.read(1.0).stamp_ns for _ in range(3)][-1] == 998_950_000


@given(
    st.lists(st.integers(0, 5), min_size=1, max_size=20),
    st.integers(0, 10**12),
    st.one_of(st.none(), st.integers(0, 10**12)),
)
def test_stamps_always_increase(skipped: list[int], now: int, last: int | None) -> None:
    stamps = arrival_stamps(np.array(skipped), now, last, 2_500_000)
    assert len(stamps) == len(skipped)
    restarted = last is not None and now < last - 10**9
    before = [] if last is None or restarted else [last]
    assert all(b > a for a, b in itertools.pairwise([*before, *stamps]))
    assert stamps[-1] <= now or (last is not None and stamps[-1] <= last + sum(skipped) + 20)


def test_stamps_leave_room_for_lost_frames_and_never_reach_back() -> None:
    none, some = np.zeros(3, int), np.array([0, 2, 0])
    assert arrival_stamps(none, 100 * MS, None, 2 * MS) == [96 * MS, 98 * MS, 100 * MS]
    assert arrival_stamps(some, 100 * MS, 0, 2 * MS) == [92 * MS, 98 * MS, 100 * MS]
    assert arrival_stamps(none, 100 * MS, 97 * MS, 2 * MS) == [98 * MS, 99 * MS, 100 * MS]
    assert arrival_stamps(none, 100, 100, 2 * MS) == [101, 102, 103]
    assert arrival_stamps(none, 100 * MS, 5000 * MS, MS) == [98 * MS, 99 * MS, 100 * MS]


def test_half_a_frame_before_unplugging_is_forgotten(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    port.send(encode(rows[:3]) + encode(rows[3])[:40])
    take(board, 3)
    end_of_frames(board)
    port.unplug()
    while 'trying again' not in end_of_frames(board):
        pass
    port.replug()
    assert 'no frame came' in end_of_frames(board)
    port.send(encode(rows[4:7]))
    frames = take(board, 3)
    np.testing.assert_allclose(frames[0].values, rows[4], rtol=1e-6, atol=1e-10)
    assert [(f.sequence, f.dropped) for f in frames] == [(4, 1), (5, 1), (6, 1)]
    counters = board.counters()
    assert (counters['lost_bytes'], counters['framing_errors'], counters['dropped']) == (40, 0, 1)


def test_constant_temperature_is_not_a_measurement(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    with ReskinBoard(port.port, layout, temperature_measured=False) as board:
        for row in rows[:3]:
            port.send(encode(row))
        assert board.read(1.0).temperature_c is None


def test_frames_that_come_at_once_are_no_measure_of_what_is_missing(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    clock = VirtualClock()
    period_s = 1 / layout.rate_hz
    with ReskinBoard(port.port, layout, clock=clock.now_ns) as board:
        for row in rows[:8]:
            port.send(encode(row))
        take(board, 8)
        for row in rows[8:11]:
            port.send(encode(row))
            board.read(1.0)
        for row in rows[11:40]:
            clock.sleep(period_s)
            port.send(encode(row))
            board.read(1.0)
        assert board.counters()['suspected'] == 0
        clock.sleep(20 * period_s)
        port.send(encode(rows[40]))
        board.read(1.0)
        assert 15 <= board.counters()['suspected'] <= 40


def test_clipped_and_repeated_readings_are_marked(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    with ReskinBoard(port.port, layout, mark_repeats=True) as board:
        clipped = rows[1].copy()
        clipped[3, 2] = -6.6e-3 - 1e-6
        for row in (rows[0], rows[0], clipped, rows[2]):
            port.send(encode(row))
        status = [f.status for f in take(board, 4)]
    assert status[0] is None
    assert status[1] is not None
    assert status[1].tolist() == [TaxelStatus.STALE] * 5
    assert status[2] is not None
    assert status[2].tolist() == [0, 0, 0, TaxelStatus.SATURATED, 0]
    assert status[3] is None


def test_a_lost_chip_is_marked_and_nan(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    dead = rows.copy()
    dead[:, 4] = np.nan
    for row in dead[:6]:
        port.send(encode(row))
    frames = take(board, 6)
    for frame in frames:
        assert frame.status is not None
        assert frame.status.tolist() == [0, 0, 0, 0, TaxelStatus.ERROR]
        assert np.isnan(frame.values[4]).all()
        assert np.isfinite(frame.values[:4]).all()


@pytest.mark.parametrize('fault', BYTE_FAULTS)
def test_reskin_board_loses_the_damaged_frame_and_one_good_one_at_most(
    fault: str, port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    sent = [encode(row) for row in rows[:20]]
    for i, frame in enumerate(sent):
        port.send(damage(frame, fault, np.random.default_rng(0)) if i == 8 else frame)
    frames = take(board, 1)
    while not np.allclose(frames[-1].values, rows[19]):
        frames += take(board, 1)
    arrived = [
        encode(f.values, 25.0 if f.temperature_c is None else f.temperature_c) for f in frames
    ]
    good = [frame for i, frame in enumerate(sent) if i != 8]
    assert sum(frame not in arrived for frame in good) <= 1
    if fault not in ('flipped', 'garbage', 'shifted'):  # those may pass undetected
        assert all(frame in sent for frame in arrived)
    assert frames[-1].sequence == 19 or frames[-1].dropped > 1
    assert frames[-1].sequence == len(frames) - 1 + frames[-1].dropped
    assert board.counters()['dropped'] == frames[-1].dropped


def test_a_read_waits_for_a_port_that_comes_later(layout: Layout, rows: np.ndarray) -> None:
    with SimulatedSerialPort() as port:
        port.unplug()
        board = ReskinBoard(port.port, layout)
        with pytest.raises(DeviceError, match='does not exist'):
            board.open()
        port.replug()
        with pytest.raises(DeviceTimeout, match='no frame came'):
            board.read(0.7)
        port.send(encode(rows[:3]))
        assert board.read(2.0).sequence == 0
        assert board.counters()['reconnects'] == 0
        board.close()


def test_two_drivers_do_not_share_a_port(
    port: SimulatedSerialPort, board: ReskinBoard, layout: Layout
) -> None:
    assert board.layout is layout
    with pytest.raises(DeviceError, match='is busy'), ReskinBoard(port.port, layout):
        pass


def test_silence_ends_in_time_and_without_work(board: ReskinBoard) -> None:
    start, work = time.monotonic(), time.process_time()
    with pytest.raises(DeviceTimeout, match=r'no frame came from .* within 0\.2 s'):
        board.read(0.2)
    assert 0.2 <= time.monotonic() - start < 2.0
    assert time.process_time() - work < 0.1


@pytest.mark.parametrize(
    ('stream', 'why'),
    [
        (b'25.10,1.00,2.00,3.0025.20,1.50,2.50,3.50\r\n' * 20, 'numbers fuse'),
        (b'1.00\t2.00\t3.00\t25.10\t1.50\t2.50\t3.50\t25.20\t\r\n' * 20, 'with tabs'),
        (encode(np.random.default_rng(0).normal(0, 1e-3, (8, 10, 3))), 'frames of 10 chips'),
    ],
)
def test_another_stream_is_refused_with_the_reason(
    port: SimulatedSerialPort, board: ReskinBoard, stream: bytes, why: str
) -> None:
    port.send(stream)
    assert why in why_nothing_comes(board)


def test_noise_is_no_frame(port: SimulatedSerialPort, board: ReskinBoard) -> None:
    port.send(np.random.default_rng(0).bytes(3000))
    sentence = why_nothing_comes(board)
    assert sentence.startswith('bytes come from')
    assert 'no frame of 5 chips' in sentence


def test_a_fast_board_is_followed(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    """Many more bytes than the port can hold, in pieces that fit no frame."""
    stream = encode(np.tile(rows, (20, 1, 1)))

    def write() -> None:
        for i in range(0, len(stream), 1000):
            port.send(stream[i : i + 1000])

    writer = threading.Thread(target=write)
    writer.start()
    frames = [board.read(5.0) for _ in range(len(stream) // 82)]
    writer.join()
    assert [f.sequence for f in frames] == list(range(1280))
    assert board.counters()['lost_bytes'] == 0


def test_a_layout_of_other_channels_is_refused() -> None:
    layout = Layout(np.zeros((5, 3)), ('Bx', 'Bz'), 'T')
    with pytest.raises(ValueError, match='must have 3 channels; received 2'):
        ReskinBoard('/dev/null', layout)


def test_a_uart_that_is_too_slow_is_refused_with_both_rates(layout: Layout) -> None:
    why = r'5 chips at 400 Hz .* are 32800 bytes/s and 115200 baud carry 11520 bytes/s'
    with pytest.raises(ValueError, match=why):
        ReskinBoard('/dev/null', layout, transfer_s=uart_transfer_s(5, 115200))
    ReskinBoard('/dev/null', layout)
