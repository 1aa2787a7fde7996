"""Drivers of boards back to back with their twins, over real pseudo-terminals and pyserial."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tactile_ros.devices import framed_protocol
from tactile_ros.devices.framed_protocol import (
    Payload,
    five_wires,
    frame_bytes,
    gradiometer,
    taxel_matrix,
    three_axis_chips,
)
from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.devices.serial_board import FramedBoard, ReskinBoard
from tactile_ros.devices.simulated_serial import (
    BYTE_FAULTS,
    FramedTwin,
    SimulatedSerialPort,
    damage,
)
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Frame, Layout, TaxelStatus

MS = 1_000_000
SCALE = 1e-6
RATE_HZ = 1000.0
PAYLOADS = {
    'gradiometer': (gradiometer(), SCALE),
    'chips': (three_axis_chips(20), 1.5e-7),
    'taxels': (taxel_matrix(72), 1 / 1023),
    'jaw': (taxel_matrix(2000), 1 / 1023),
    'wires': (five_wires(4095), 1 / 4095),
}


def layout_of(payload: Payload, rate_hz: float = RATE_HZ) -> Layout:
    names = tuple(f'c{i}' for i in range(payload.channels))
    return Layout(np.zeros((payload.count, 3)), names, '1', rate_hz=rate_hz)


LAYOUT = layout_of(gradiometer())


def signal(t: float) -> Array:
    """Values that tell their time: the millisecond in the first channel."""
    values = np.full((4, 2), 5e-5)
    values[0, 0] = round(t * 1000) * SCALE
    return values


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
        'reconnects': 0, 'temperatures_refused': 0, 'suspected': 0,
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
    transfer = 82 * 10 / 460800
    with ReskinBoard(port.port, layout, 460800, native_usb=False, clock=lambda: now[0]) as board:
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


def test_reskin_board_sees_no_frame_in_noise(
    port: SimulatedSerialPort, board: ReskinBoard
) -> None:
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
        ReskinBoard('/dev/null', layout, native_usb=False)
    ReskinBoard('/dev/null', layout)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock(10**12)


@pytest.fixture
def twin(clock: VirtualClock) -> Iterator[FramedTwin]:
    with FramedTwin(LAYOUT, gradiometer(), SCALE, signal, seed=3, clock=clock) as made:
        yield made


@pytest.fixture
def framed(twin: FramedTwin, clock: VirtualClock) -> Iterator[FramedBoard]:
    with twin.device(clock.now_ns) as driver:
        yield driver


def read_to(framed: FramedBoard, period: int) -> list[Frame]:
    """Frames up to the one that was taken in a period of the twin."""
    frames = [framed.read(5.0)]
    while round(frames[-1].values[0, 0] / SCALE) != period:
        frames.append(framed.read(5.0))
    return frames


def silence(framed: FramedBoard, why: str) -> str:
    """Sentence of the first timeout that says `why`, within two seconds."""
    start = time.monotonic()
    while time.monotonic() - start < 2.0:
        try:
            framed.read(0.0)
        except DeviceTimeout as err:
            if why in str(err):
                return str(err)
    pytest.fail(f'nothing said {why!r} within 2 s')


@pytest.mark.parametrize('name', PAYLOADS)
def test_every_payload_comes_through(name: str, clock: VirtualClock) -> None:
    payload, scale = PAYLOADS[name]
    layout = layout_of(payload, 100.0)
    highest = payload.full_count - 1
    lowest = -highest if payload.signed else 0
    counts = np.random.default_rng(0).integers(lowest, highest, (20, *layout.shape))
    warm = np.linspace(20.0, 30.0, payload.count)
    twin = FramedTwin(
        layout, payload, scale, lambda t: counts[round(t * 100)] * scale, clock=clock,
        temperature_c=lambda t: warm,
    )  # fmt: skip
    with twin, twin.device(clock.now_ns) as board:
        frames = []
        for _ in counts:
            twin.play(1)
            frames.append(board.read(5.0))
    assert [f.sequence for f in frames] == list(range(20))
    assert all(f.status is None and f.dropped == 0 for f in frames)
    np.testing.assert_allclose([f.values for f in frames], counts * scale, rtol=1e-12)
    assert [f.device_time_ns for f in frames[1:]] == [i * 10_000_000 for i in range(1, 20)]
    if name == 'chips':
        np.testing.assert_allclose([f.temperature_c for f in frames], [warm] * 20, atol=0.0051)
    elif name == 'gradiometer':
        np.testing.assert_allclose([f.temperature_c for f in frames], [[20.0] * 4] * 20)
    else:
        assert all(f.temperature_c is None for f in frames)


@pytest.mark.parametrize('fault', [*BYTE_FAULTS, 'lost'])
def test_a_fault_costs_its_frame_alone_and_is_counted(
    fault: str, twin: FramedTwin, framed: FramedBoard
) -> None:
    frames = []
    for i in range(30):
        if i:
            twin.inject(fault)
        twin.play(10)
        frames += read_to(framed, 10 * i + 9)
    assert twin.injected[fault] == 29
    told = [round(f.values[0, 0] / SCALE) for f in frames]
    assert len(told) == 300 - 29
    # damage can make a frame complete with bytes of the next one, which is lost in its place
    assert sum(i not in told for i in range(10, 300, 10)) >= 27
    assert [f.sequence for f in frames] == told
    counts = framed.counters()
    assert counts['dropped'] == frames[-1].dropped == 29
    seen = counts['crc_errors'] + counts['framing_errors']
    assert (seen, counts['missing']) == ((0, 29) if fault == 'lost' else (29, 0))


def test_a_stall_and_a_jump_of_the_clock_are_told_apart(
    twin: FramedTwin, framed: FramedBoard
) -> None:
    frames = []
    period = 0
    for fault in ('stall', 'clock_jump', 'clock_jump', 'stall', 'clock_jump', 'clock_jump'):
        twin.play(20)
        frames += read_to(framed, period + 19)
        twin.inject(fault)
        silent = 500 if fault == 'stall' else 0
        twin.play(20 + silent)
        period += 40 + silent
        frames += read_to(framed, period - 1)
    counts = framed.counters()
    assert counts['stalls'] == twin.injected['stall'] == 2
    assert counts['clock_jumps'] == twin.injected['clock_jump'] == 4
    assert counts['dropped'] == 0
    assert all(b.device_time_ns > a.device_time_ns for a, b in itertools.pairwise(frames))
    stamps = [f.stamp_ns or 0 for f in frames]
    taken = [f.values[0, 0] / SCALE * 1e6 for f in frames]
    # as long as a batch of 20 is: the clock gives the end of the batch to a jump inside of it
    np.testing.assert_allclose(np.diff(stamps), np.diff(taken), rtol=0, atol=20e6)
    assert np.ptp(np.array([f.device_time_ns for f in frames]) - taken) <= 4 * 20e6


def test_unplugging_is_survived_and_counted(twin: FramedTwin, framed: FramedBoard) -> None:
    twin.play(10)
    before = read_to(framed, 9)[-1]
    twin.inject('unplug')
    twin.play(500)
    assert silence(framed, 'does not exist').endswith('trying again')
    twin.play(501)
    silence(framed, 'no frame came')
    twin.play(10)
    after = read_to(framed, 1020)
    assert [f.sequence for f in after] == list(range(11, 21))
    assert [f.dropped for f in after] == [1] * 10
    assert framed.counters()['reconnects'] == twin.injected['unplug'] == 1
    assert framed.counters()['clock_jumps'] == 0
    assert after[0].device_time_ns > before.device_time_ns


def test_the_board_s_clock_may_wrap_and_drift(clock: VirtualClock) -> None:
    twin = FramedTwin(
        LAYOUT, gradiometer(), SCALE, signal, clock=clock, drift=2e-3, start_us=2**32 - 5_000
    )
    with twin, twin.device(clock.now_ns) as board:
        frames = []
        for _ in range(1000):
            twin.play(1)
            frames.append(board.read(5.0))
    device = np.array([f.device_time_ns for f in frames])
    np.testing.assert_allclose(np.diff(device), 1.002e6, rtol=0, atol=1000)
    stamps = np.array([f.stamp_ns or 0 for f in frames])
    errors = stamps - (10**12 + (np.arange(1000) + 1) * 10**6)
    assert np.abs(errors).max() < 0.01e6
    assert board.counters()['clock_jumps'] == 0


def test_a_late_reader_does_not_shift_stamps(twin: FramedTwin, framed: FramedBoard) -> None:
    start = 10**12
    for _ in range(50):
        twin.play(1)
        framed.read(5.0)
    twin.play(80)
    late = read_to(framed, 129)
    due = [start + (i + 1) * 10**6 for i in range(50, 130)]
    # the difference of the clocks creeps up by 1 % of the time that passed
    np.testing.assert_allclose([f.stamp_ns or 0 for f in late], due, rtol=0, atol=1e6)


def test_time_on_the_wire_is_taken_off(clock: VirtualClock) -> None:
    twin = FramedTwin(
        LAYOUT, gradiometer(), SCALE, signal, clock=clock, baud=460800, native_usb=False
    )
    with twin, twin.device(clock.now_ns) as board:
        twin.play(1)
        stamp_ns = board.read(5.0).stamp_ns
    assert stamp_ns == clock.now_ns() - round(38 * 10 / 460800 * 1e9)


def test_a_port_that_is_too_slow_is_refused_with_both_rates() -> None:
    why = r'are 38000 bytes/s and 115200 baud carry 11520 bytes/s; .* 380000 or more'
    with pytest.raises(ValueError, match=why):
        FramedBoard('/dev/null', LAYOUT, gradiometer(), SCALE)
    FramedBoard('/dev/null', LAYOUT, gradiometer(), SCALE, native_usb=True)
    FramedBoard('/dev/null', LAYOUT, gradiometer(), SCALE, baud=380_000)
    jaw = taxel_matrix(2000)
    assert frame_bytes(jaw) == 2520
    with pytest.raises(ValueError, match='126000 bytes/s and 1000000 baud carry 100000 bytes/s'):
        FramedBoard('/dev/null', layout_of(jaw, 50.0), jaw, 1.0, baud=1_000_000)


def test_a_layout_of_another_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r'must have shape \(16, 1\); received \(4, 2\)'):
        FramedBoard('/dev/null', LAYOUT, taxel_matrix(16), SCALE)
    with pytest.raises(ValueError, match='scale must be finite'):
        FramedBoard('/dev/null', LAYOUT, gradiometer(), np.nan)


def test_another_stream_is_refused_once_naming_both() -> None:
    payload = taxel_matrix(16)
    with (
        SimulatedSerialPort() as port,
        FramedBoard(port.port, layout_of(payload, 100.0), payload, 1.0) as board,
    ):
        foreign = framed_protocol.encode(taxel_matrix(72), np.zeros((9, 72, 1), int), 0, range(9))
        port.send(foreign)
        with pytest.raises(DeviceError) as caught:
            board.read(5.0)
        assert not isinstance(caught.value, DeviceTimeout)
        for name in ('taxels (kind 2) of 72 in 90 bytes', 'taxels (kind 2) of 16 in 20 bytes'):
            assert name in str(caught.value)
        port.send(foreign)
        with pytest.raises(DeviceTimeout, match='of 72 in 90 bytes'):
            board.read(0.0)
        port.send(framed_protocol.encode(payload, np.zeros((16, 1), int), 0, 0))
        assert board.read(5.0).dropped == 0


def test_framed_board_sees_no_frame_in_noise() -> None:
    with (
        SimulatedSerialPort() as port,
        FramedBoard(port.port, LAYOUT, gradiometer(), SCALE, native_usb=True) as board,
    ):
        port.send(bytes(1000))
        assert 'gradiometer (kind 1) of 4 in 18 bytes within' in silence(board, 'bytes come from')


def test_repeated_samples_are_stale_and_repeated_frames_left_out() -> None:
    counts = np.arange(8).reshape(4, 2)
    sent = [(0, 0), (1, 1000), (2, 1000), (2, 1000), (3, 3000)]
    with (
        SimulatedSerialPort() as port,
        FramedBoard(port.port, LAYOUT, gradiometer(), SCALE, native_usb=True) as board,
    ):
        for sequence, time_us in sent:
            port.send(framed_protocol.encode(gradiometer(), counts, sequence, time_us))
        frames = [board.read(5.0) for _ in range(4)]
    assert [f.sequence for f in frames] == [0, 1, 2, 3]
    assert [f.status is None for f in frames] == [True, True, False, True]
    assert frames[2].status is not None
    assert frames[2].status.tolist() == [TaxelStatus.STALE] * 4
    assert (board.counters()['repeated'], board.counters()['stale']) == (1, 4)
    stamps = [f.stamp_ns or 0 for f in frames]
    assert all(b > a for a, b in itertools.pairwise(stamps))


def test_the_page_s_program_runs(capsys: pytest.CaptureFixture[str]) -> None:
    page = Path(__file__).resolve().parents[2] / 'docs' / 'serial_protocol.md'
    program = page.read_text().split('```python\n')[1].split('```')[0]
    exec(compile(program, str(page), 'exec'), {})
    injected, dropped = capsys.readouterr().out.split()
    assert injected == '3'
    assert int(dropped) >= 3  # more where this machine pauses and the twin's port overruns


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> VirtualClock:
    """The time of pauses between tries to open, and of nothing else."""
    virtual = VirtualClock()
    stand_in = SimpleNamespace(monotonic=lambda: virtual.now_ns() * 1e-9, sleep=virtual.sleep)
    monkeypatch.setattr('tactile_ros.devices.serial_board.time', stand_in)
    return virtual


def test_serial_board_tries_a_missing_port_with_growing_pauses(
    pauses: VirtualClock, layout: Layout, monkeypatch: pytest.MonkeyPatch
) -> None:
    with SimulatedSerialPort() as port:
        port.unplug()
        board = ReskinBoard(port.port, layout)
        tries: list[float] = []
        real = board.open

        def counted() -> None:
            tries.append(pauses.now_ns() * 1e-9)
            real()

        monkeypatch.setattr(board, 'open', counted)
        with pytest.raises(DeviceTimeout, match='does not exist'):
            board.read(4.0)
        np.testing.assert_allclose(np.diff(tries)[:6], [0.05, 0.1, 0.2, 0.4, 0.5, 0.5])
        before = pauses.now_ns()
        with pytest.raises(DeviceTimeout):
            board.read(0.02)
        assert pauses.now_ns() - before == pytest.approx(0.02e9, abs=10)


def test_serial_board_counts_openings_after_the_first_as_reconnections(layout: Layout) -> None:
    with SimulatedSerialPort() as port:
        board = ReskinBoard(port.port, layout)
        for _ in range(3):
            board.open()
            board.open()
            board.close()
    assert board.counters()['reconnects'] == 2
    with pytest.raises(DeviceError, match='is closed'):
        board.read(0.0)


def rows_of(payload: Payload, rng: np.random.Generator, noise: float, count: int) -> np.ndarray:
    """Counts (s, t, c) of a sensor whose channels stand still but for their noise."""
    shape = (payload.count, payload.channels)
    level = rng.integers(300, 700, shape)
    return level + np.rint(noise * rng.normal(size=(count, *shape))).astype(np.int64)


def marks_of(payload: Payload, counts: np.ndarray) -> np.ndarray:
    """Status bits (s, t) that the driver gives to frames whose sequence and clock go on."""
    board = FramedBoard('unused', layout_of(payload), payload, SCALE, native_usb=True)
    data = framed_protocol.encode(payload, counts, 0, 1000 * np.arange(len(counts)))
    board.feed(data)
    blank = np.zeros(payload.count, np.uint8)
    return np.array([blank if f.status is None else f.status for f in board.waiting()])


@pytest.mark.parametrize('name', ['gradiometer', 'chips', 'taxels', 'wires'])
def test_serial_board_that_freezes_is_stale_then_stuck(name: str) -> None:
    """Sequence and clock of the board go on, its readings do not."""
    payload = PAYLOADS[name][0]
    counts = rows_of(payload, np.random.default_rng(1), 2.0, 400)
    counts[300:] = counts[299]
    marks = marks_of(payload, counts)
    assert not marks[:300].any()
    assert (marks[304:] & TaxelStatus.STALE > 0).all()
    assert (marks[312:] & TaxelStatus.STUCK > 0).all()


def test_serial_board_with_quiet_converters_gives_no_false_alarm() -> None:
    """A frame in four repeats the one before to the last bit, as honest 16-bit readings do."""
    payload = PAYLOADS['gradiometer'][0]
    counts = rows_of(payload, np.random.default_rng(2), 0.24, 30_000)
    share = (counts[1:] == counts[:-1]).all(axis=(1, 2)).mean()
    assert 0.2 < share < 0.95
    marks = marks_of(payload, counts)
    assert not marks.all(axis=1).any()


def test_serial_board_of_chips_without_power_is_dead() -> None:
    payload = PAYLOADS['chips'][0]
    counts = rows_of(payload, np.random.default_rng(3), 2.0, 20)
    counts[10:] = 0
    marks = marks_of(payload, counts)
    assert not marks[:10].any()
    assert (marks[10:] & TaxelStatus.DEAD > 0).all()


def test_serial_board_that_never_moved_is_stuck() -> None:
    payload = PAYLOADS['chips'][0]
    counts = np.repeat(rows_of(payload, np.random.default_rng(4), 2.0, 1), 60, axis=0)
    assert (marks_of(payload, counts)[40:] & TaxelStatus.STUCK > 0).all()


def test_reskin_board_that_freezes_is_stale_then_stuck(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    noisy = rows[0] + 1e-6 * np.random.default_rng(5).normal(size=(100, *rows[0].shape))
    for row in (*noisy, *[noisy[-1]] * 20):
        port.send(encode(row))
    status = [frame.status for frame in take(board, 120)]
    assert all(one is None for one in status[:100])
    assert all((one & TaxelStatus.STALE > 0).all() for one in status[104:])
    assert all((one & TaxelStatus.STUCK > 0).all() for one in status[112:])


@pytest.mark.parametrize('celsius', [-273.15, 327.67, 0.0])
def test_serial_board_refuses_a_temperature_that_cannot_be(celsius: float) -> None:
    payload = PAYLOADS['chips'][0]
    counts = rows_of(payload, np.random.default_rng(6), 2.0, 20)
    board = FramedBoard('unused', layout_of(payload), payload, SCALE, native_usb=True)
    degrees = np.where(np.arange(20)[:, None] < 10, 25.0, celsius)
    board.feed(framed_protocol.encode(payload, counts, 0, 1000 * np.arange(20), degrees))
    frames = board.waiting()
    assert all((frame.temperature_c == 25.0).all() for frame in frames[:10])
    assert all(np.isnan(frame.temperature_c).all() for frame in frames[10:])
    assert board.counters()['temperatures_refused'] == 10
