"""The framed driver back to back with its twin, over a real pseudo-terminal and pyserial."""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.devices.framed_protocol import (
    Payload,
    encode,
    five_wires,
    frame_bytes,
    gradiometer,
    taxel_matrix,
    three_axis_chips,
)
from tactile_ros.devices.serial_board import FramedBoard
from tactile_ros.devices.simulated_serial import BYTE_FAULTS, FramedTwin, SimulatedSerialPort
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Frame, Layout, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Iterator

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


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock(10**12)


@pytest.fixture
def twin(clock: VirtualClock) -> Iterator[FramedTwin]:
    with FramedTwin(LAYOUT, gradiometer(), SCALE, signal, seed=3, clock=clock) as made:
        yield made


@pytest.fixture
def board(twin: FramedTwin, clock: VirtualClock) -> Iterator[FramedBoard]:
    with twin.device(clock.now_ns) as driver:
        yield driver


def read_to(board: FramedBoard, period: int) -> list[Frame]:
    """Frames up to the one that was taken in a period of the twin."""
    frames = [board.read(5.0)]
    while round(frames[-1].values[0, 0] / SCALE) != period:
        frames.append(board.read(5.0))
    return frames


def silence(board: FramedBoard, why: str) -> str:
    """Sentence of the first timeout that says `why`, within two seconds."""
    start = time.monotonic()
    while time.monotonic() - start < 2.0:
        try:
            board.read(0.0)
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
    fault: str, twin: FramedTwin, board: FramedBoard
) -> None:
    frames = []
    for i in range(30):
        if i:
            twin.inject(fault)
        twin.play(10)
        frames += read_to(board, 10 * i + 9)
    assert twin.injected[fault] == 29
    told = [round(f.values[0, 0] / SCALE) for f in frames]
    assert len(told) == 300 - 29
    # damage can make a frame complete with bytes of the next one, which is lost in its place
    assert sum(i not in told for i in range(10, 300, 10)) >= 27
    assert [f.sequence for f in frames] == told
    counts = board.counters()
    assert counts['dropped'] == frames[-1].dropped == 29
    seen = counts['crc_errors'] + counts['framing_errors']
    assert (seen, counts['missing']) == ((0, 29) if fault == 'lost' else (29, 0))


def test_all_faults_of_bytes_in_any_order_are_counted(
    twin: FramedTwin, board: FramedBoard
) -> None:
    rng = np.random.default_rng(5)
    twin.play(40)
    told = len(read_to(board, 39))
    for i in range(1, 40):
        for fault in rng.choice([*BYTE_FAULTS, 'lost'], rng.integers(1, 5)):
            twin.inject(str(fault))
        twin.play(40)
        frames = read_to(board, 40 * i + 39)
        assert all(f.sequence == round(f.values[0, 0] / SCALE) for f in frames)
        told += len(frames)
    counts = board.counters()
    assert counts['dropped'] == sum(twin.injected.values()) > 60
    assert counts['frames'] == told == 1600 - counts['dropped']


def test_a_stall_and_a_jump_of_the_clock_are_told_apart(
    twin: FramedTwin, board: FramedBoard
) -> None:
    frames = []
    period = 0
    for fault in ('stall', 'clock_jump', 'clock_jump', 'stall', 'clock_jump', 'clock_jump'):
        twin.play(20)
        frames += read_to(board, period + 19)
        twin.inject(fault)
        silent = 500 if fault == 'stall' else 0
        twin.play(20 + silent)
        period += 40 + silent
        frames += read_to(board, period - 1)
    counts = board.counters()
    assert counts['stalls'] == twin.injected['stall'] == 2
    assert counts['clock_jumps'] == twin.injected['clock_jump'] == 4
    assert counts['dropped'] == 0
    assert all(b.device_time_ns > a.device_time_ns for a, b in itertools.pairwise(frames))
    stamps = [f.stamp_ns or 0 for f in frames]
    taken = [f.values[0, 0] / SCALE * 1e6 for f in frames]
    # as long as a batch of 20 is: the clock gives the end of the batch to a jump inside of it
    np.testing.assert_allclose(np.diff(stamps), np.diff(taken), rtol=0, atol=20e6)
    assert np.ptp(np.array([f.device_time_ns for f in frames]) - taken) <= 4 * 20e6


def test_unplugging_is_survived_and_counted(twin: FramedTwin, board: FramedBoard) -> None:
    twin.play(10)
    before = read_to(board, 9)[-1]
    twin.inject('unplug')
    twin.play(500)
    assert silence(board, 'does not exist').endswith('trying again')
    twin.play(501)
    silence(board, 'no frame came')
    twin.play(10)
    after = read_to(board, 1020)
    assert [f.sequence for f in after] == list(range(11, 21))
    assert [f.dropped for f in after] == [1] * 10
    assert board.counters()['reconnects'] == twin.injected['unplug'] == 1
    assert board.counters()['clock_jumps'] == 0
    assert after[0].device_time_ns > before.device_time_ns


def test_limits_of_the_converter_are_marked(twin: FramedTwin, board: FramedBoard) -> None:
    twin.inject('saturation', 3)
    twin.play(10)
    frames = read_to(board, 9)
    marked = [f.status for f in frames if f.status is not None]
    assert [sorted(status.tolist()) for status in marked] == [[0, 0, 0, 2]] * 3
    assert board.counters()['saturated'] == twin.injected['saturation'] == 3


def test_a_stuck_chip_repeats_itself(clock: VirtualClock) -> None:
    twin = FramedTwin(
        LAYOUT, gradiometer(), SCALE, lambda t: np.zeros((4, 2)), 1e-4, seed=1, clock=clock
    )
    with twin, twin.device(clock.now_ns) as board:
        twin.play(3)
        twin.inject('stuck_chip', 4)
        twin.play(5)
        values = np.array([board.read(5.0).values for _ in range(8)])
    still = (np.diff(values, axis=0) == 0).all(axis=-1)
    assert still[:, 0].tolist() == [False, False, True, True, True, True, False]
    assert not still[:, 1:].any()


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


def test_a_late_reader_does_not_shift_stamps(twin: FramedTwin, board: FramedBoard) -> None:
    start = 10**12
    for _ in range(50):
        twin.play(1)
        board.read(5.0)
    twin.play(80)
    late = read_to(board, 129)
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
        foreign = encode(taxel_matrix(72), np.zeros((9, 72, 1), int), 0, range(9))
        port.send(foreign)
        with pytest.raises(DeviceError) as caught:
            board.read(5.0)
        assert not isinstance(caught.value, DeviceTimeout)
        for name in ('taxels (kind 2) of 72 in 90 bytes', 'taxels (kind 2) of 16 in 20 bytes'):
            assert name in str(caught.value)
        port.send(foreign)
        with pytest.raises(DeviceTimeout, match='of 72 in 90 bytes'):
            board.read(0.0)
        port.send(encode(payload, np.zeros((16, 1), int), 0, 0))
        assert board.read(5.0).dropped == 0


def test_noise_is_no_frame() -> None:
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
            port.send(encode(gradiometer(), counts, sequence, time_us))
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
