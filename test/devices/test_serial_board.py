# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Drivers of boards back to back with their twins, over real pseudo-terminals and pyserial."""

import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tactile_ros.devices import framed_protocol
from tactile_ros.devices.framed_protocol import (
    Payload,
    gradiometer,
    taxel_matrix,
    three_axis_chips,
)
from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.devices.serial_board import FramedBoard, ReskinBoard, SerialBoard
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Frame, Layout, TaxelStatus

MS = 1_000_000
SCALE = 1e-6
STALE, STUCK, DEAD = TaxelStatus.STALE, TaxelStatus.STUCK, TaxelStatus.DEAD
CHIPS = three_axis_chips(20)


def layout_of(payload: Payload, rate_hz: float = 1000.0) -> Layout:
    names = tuple(f'c{i}' for i in range(payload.channels))
    return Layout(np.zeros((payload.count, 3)), names, '1', rate_hz=rate_hz)


LAYOUT = layout_of(gradiometer())


def take(board: SerialBoard, count: int) -> list[Frame]:
    return [board.read(60.0) for _ in range(count)]


def complaint(board: SerialBoard, why: str) -> DeviceError:
    """First error that contains `why`."""
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        try:
            board.read(0.02)
        except DeviceError as err:
            if why in str(err):
                return err
    pytest.fail(f'nothing said {why!r} within 120 s')


def statuses(frames: list[Frame]) -> Array:
    """Status bits (s, t), 0 where a frame has none."""
    blank = np.zeros(len(frames[0].values), np.uint8)
    return np.array([blank if f.status is None else f.status for f in frames])


# --- ReSkin ---


@pytest.mark.parametrize(
    ('how', 'age_ns'),
    [
        ({'baud': 460800, 'native_usb': False}, round(82 * 10 / 460800 * 1e9)),
        ({'conversion_s': 2.1e-3}, 1_050_000),
    ],
)
def test_reskin_board_takes_wire_and_conversion_off_its_stamps(
    how: dict[str, float], age_ns: int, port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    now = [0]
    with ReskinBoard(port.port, layout, clock=lambda: now[0], **how) as board:
        port.send(encode(rows[:3]))
        now[0] = 1000 * MS
        stamps = [f.stamp_ns for f in take(board, 3)]
        assert np.diff(stamps).tolist() == [2.5 * MS, 2.5 * MS]
        assert stamps[-1] == 1000 * MS - age_ns


def test_reskin_board_forgets_half_a_frame_of_before_unplugging(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    port.send(encode(rows[:3]) + encode(rows[3])[:40])
    take(board, 3)
    while len(board._decoder.pending) < 40:
        complaint(board, 'no frame came')
    port.unplug()
    complaint(board, 'trying again')
    port.replug()
    complaint(board, 'no frame came')
    port.send(encode(rows[4:7]))
    frames = take(board, 3)
    np.testing.assert_allclose(frames[0].values, rows[4], rtol=1e-6, atol=1e-10)
    assert [(f.sequence, f.dropped) for f in frames] == [(4, 1), (5, 1), (6, 1)]
    counters = board.counters()
    assert (counters['lost_bytes'], counters['framing_errors'], counters['dropped']) == (40, 0, 1)


def test_reskin_board_marks_what_it_sees(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    sent = rows[[0, *range(9)]].copy()
    sent[2, 3, 2] = -6.6e-3 - 1e-6
    sent[4:, 4] = np.nan
    with ReskinBoard(port.port, layout, mark_repeats=True, temperature_measured=False) as board:
        port.send(encode(sent))
        frames = take(board, 10)
    wanted = np.zeros((10, 5), np.uint8)
    wanted[1], wanted[2, 3], wanted[4:, 4] = STALE, TaxelStatus.SATURATED, TaxelStatus.ERROR
    assert statuses(frames).tolist() == wanted.tolist()
    assert np.isnan([f.values for f in frames]).all(axis=2).tolist() == (wanted == 8).tolist()
    assert all(f.temperature_c is None for f in frames)


@pytest.mark.parametrize(
    ('stream', 'why'),
    [
        (b'25.10,1.00,2.00,3.0025.20,1.50,2.50,3.50\r\n' * 20, 'numbers fuse'),
        (b'1.00\t2.00\t3.00\t25.10\t1.50\t2.50\t3.50\t25.20\t\r\n' * 20, 'with tabs'),
        (encode(np.random.default_rng(0).normal(0, 1e-3, (8, 10, 3))), 'give 10 `positions`'),
        (np.random.default_rng(0).bytes(3000), 'but no frame of 5 chips'),
    ],
)
def test_reskin_board_names_another_stream(
    port: SimulatedSerialPort, board: ReskinBoard, stream: bytes, why: str
) -> None:
    port.send(stream)
    complaint(board, why)


def test_reskin_board_refuses_misfits(layout: Layout) -> None:
    with pytest.raises(ValueError, match='must have 3 channels; received 2'):
        ReskinBoard('/dev/null', LAYOUT)
    why = r'5 chips at 400 Hz .* are 32800 bytes/s and 115200 baud carry 11520 bytes/s'
    with pytest.raises(ValueError, match=why):
        ReskinBoard('/dev/null', layout, native_usb=False)
    ReskinBoard('/dev/null', layout)


# --- framed ---


@pytest.mark.parametrize(
    ('payload', 'layout', 'scale', 'baud', 'why'),
    [
        (gradiometer(), LAYOUT, 1.0, 115200,
         'are 38000 bytes/s and 115200 baud carry 11520 bytes/s; .* 380000 or more'),
        (taxel_matrix(2000), layout_of(taxel_matrix(2000), 50.0), 1.0, 1_000_000,
         '126000 bytes/s and 1000000 baud carry 100000 bytes/s'),
        (taxel_matrix(16), LAYOUT, 1.0, 10**6, r'must have shape \(16, 1\); received \(4, 2\)'),
        (gradiometer(), LAYOUT, np.nan, 10**6, 'scale must be finite'),
    ],
)  # fmt: skip
def test_framed_board_refuses_misfits(
    payload: Payload, layout: Layout, scale: float, baud: int, why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        FramedBoard('/dev/null', layout, payload, scale, baud)
    FramedBoard('/dev/null', LAYOUT, gradiometer(), SCALE, native_usb=True)
    FramedBoard('/dev/null', LAYOUT, gradiometer(), SCALE, baud=380_000)


def test_framed_board_refuses_another_stream_once_naming_both(port: SimulatedSerialPort) -> None:
    payload = taxel_matrix(16)
    with FramedBoard(port.port, layout_of(payload, 100.0), payload, 1.0) as board:
        foreign = framed_protocol.encode(taxel_matrix(72), np.zeros((9, 72, 1), int), 0, range(9))
        port.send(foreign)
        first = complaint(board, 'taxels (kind 2) of 72 in 90 bytes')
        assert not isinstance(first, DeviceTimeout)
        assert 'taxels (kind 2) of 16 in 20 bytes' in str(first)
        port.send(foreign)
        assert isinstance(complaint(board, 'of 72 in 90 bytes'), DeviceTimeout)
        port.send(framed_protocol.encode(payload, np.zeros((16, 1), int), 0, 0))
        assert board.read(60.0).dropped == 0


def framed_frames(payload: Payload, data: bytes) -> tuple[list[Frame], dict[str, int]]:
    """Frames and counts of a driver that is fed without a port."""
    board = FramedBoard('unused', layout_of(payload), payload, SCALE, native_usb=True)
    board.feed(data)
    return board.waiting(), board.counters()


def test_framed_board_marks_repeated_samples_and_leaves_repeated_frames_out() -> None:
    counts = np.arange(8).reshape(4, 2)
    sent = [(0, 0), (1, 1000), (2, 1000), (2, 1000), (3, 3000)]
    data = b''.join(framed_protocol.encode(gradiometer(), counts, *moment) for moment in sent)
    frames, counted = framed_frames(gradiometer(), data)
    assert [f.sequence for f in frames] == [0, 1, 2, 3]
    assert statuses(frames).tolist() == [[0] * 4, [0] * 4, [STALE] * 4, [0] * 4]
    assert (counted['repeated'], counted['stale']) == (1, 4)
    assert (np.diff([f.stamp_ns for f in frames]) > 0).all()


def test_framed_page_has_a_program_that_runs(capsys: pytest.CaptureFixture[str]) -> None:
    page = Path(__file__).resolve().parents[2] / 'docs' / 'serial_protocol.md'
    program = page.read_text().split('```python\n')[1].split('```')[0]
    exec(compile(program, str(page), 'exec'), {})
    injected, dropped = capsys.readouterr().out.split()
    assert injected == '3'
    assert int(dropped) >= 3  # more where this machine pauses and the twin's port overruns


# --- ports that come and go ---


def test_serial_board_tries_a_missing_port_with_growing_pauses(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses = VirtualClock()  # the time of pauses between tries, and of nothing else
    virtual = SimpleNamespace(monotonic=lambda: pauses.now_ns() * 1e-9, sleep=pauses.sleep)
    port.unplug()
    board = ReskinBoard(port.port, layout)
    with pytest.raises(DeviceError, match='does not exist'):
        board.open()
    tries: list[float] = []
    real = board.open

    def counted() -> None:
        tries.append(pauses.now_ns() * 1e-9)
        real()

    monkeypatch.setattr(board, 'open', counted)
    with monkeypatch.context() as patched:
        patched.setattr('tactile_ros.devices.serial_board.time', virtual)
        with pytest.raises(DeviceTimeout, match='does not exist'):
            board.read(4.0)
        np.testing.assert_allclose(np.diff(tries)[:6], [0.05, 0.1, 0.2, 0.4, 0.5, 0.5])
        before = pauses.now_ns()
        with pytest.raises(DeviceTimeout):
            board.read(0.02)
        assert pauses.now_ns() - before == pytest.approx(0.02e9, abs=10)
    board._retry_at = 0.0
    port.replug()
    complaint(board, 'no frame came')
    port.send(encode(rows[:3]))
    assert board.read(60.0).sequence == 0
    assert board.counters()['reconnects'] == 0
    board.close()


# --- readings that cannot be trusted ---


def rows_of(payload: Payload, seed: int, noise: float, count: int) -> np.ndarray:
    """Counts (s, t, c) of a sensor at rest."""
    rng = np.random.default_rng(seed)
    level = rng.integers(300, 700, (payload.count, payload.channels))
    return level + np.rint(noise * rng.normal(size=(count, *level.shape))).astype(np.int64)


def marks_of(payload: Payload, counts: np.ndarray) -> np.ndarray:
    """Status bits (s, t) that the driver gives to frames whose sequence and clock go on."""
    data = framed_protocol.encode(payload, counts, 0, 1000 * np.arange(len(counts)))
    return statuses(framed_frames(payload, data)[0])


def test_serial_board_with_quiet_converters_gives_no_false_alarm() -> None:
    """A frame in four repeats the one before to the last bit, as honest 16-bit readings do."""
    counts = rows_of(gradiometer(), 2, 0.24, 3000)
    assert 0.2 < (counts[1:] == counts[:-1]).all(axis=(1, 2)).mean() < 0.95
    assert not marks_of(gradiometer(), counts).all(axis=1).any()


@pytest.mark.parametrize('celsius', [-273.15, 327.67, 0.0])
def test_serial_board_refuses_a_temperature_that_cannot_be(celsius: float) -> None:
    counts = rows_of(CHIPS, 6, 2.0, 20)
    degrees = np.where(np.arange(20)[:, None] < 10, 25.0, celsius)
    data = framed_protocol.encode(CHIPS, counts, 0, 1000 * np.arange(20), degrees)
    frames, counted = framed_frames(CHIPS, data)
    assert all((frame.temperature_c == 25.0).all() for frame in frames[:10])
    assert all(np.isnan(frame.temperature_c).all() for frame in frames[10:])
    assert counted['temperatures_refused'] == 10


def test_chips_that_never_change_are_stuck_though_nothing_tells_their_noise() -> None:
    counts = np.repeat(rows_of(CHIPS, 3, 0.0, 1), 1100, axis=0)
    marks = marks_of(CHIPS, counts)
    assert not marks[:1000].any()
    assert (marks[1001:] & STUCK > 0).all()
    matrix = taxel_matrix(4)  # where nothing touches, that is usual
    assert not marks_of(matrix, np.repeat(rows_of(matrix, 3, 0.0, 1), 1100, axis=0)).any()


def test_reskin_board_says_that_its_temperatures_cannot_be(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    with ReskinBoard(port.port, layout) as board:
        port.send(encode(rows[:8], -273.15))
        assert 'every chip sends a temperature that none can have' in str(complaint(board, ''))


def test_serial_board_of_chips_without_power_is_dead() -> None:
    counts = rows_of(CHIPS, 3, 2.0, 20)
    counts[10:] = 0
    marks = marks_of(CHIPS, counts)
    assert not marks[:10].any()
    assert (marks[10:] & DEAD > 0).all()


def test_reskin_board_suspects_losses_by_the_clock_but_not_after_a_burst(
    port: SimulatedSerialPort, layout: Layout, rows: np.ndarray
) -> None:
    clock = VirtualClock()
    with ReskinBoard(port.port, layout, clock=clock.now_ns) as board:
        port.send(encode(rows[:8]))
        take(board, 8)
        for row, periods, least, most in (
            *((row, 0, 0, 0) for row in rows[8:11]), *((row, 1, 0, 0) for row in rows[11:40]),
            (rows[40], 20, 15, 40),
        ):  # fmt: skip
            clock.sleep(periods / layout.rate_hz)
            port.send(encode(row))
            board.read(1.0)
            assert least <= board.counters()['suspected'] <= most


def test_framed_board_sees_no_frame_in_noise(port: SimulatedSerialPort) -> None:
    with FramedBoard(port.port, LAYOUT, gradiometer(), SCALE, native_usb=True) as board:
        port.send(bytes(1000))
        said = str(complaint(board, 'bytes come from'))
        assert 'gradiometer (kind 1) of 4 in 18 bytes within' in said
