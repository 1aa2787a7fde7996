"""Twins of boards on serial ports: pace, faults, and nothing left behind."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.devices.framed_protocol import taxel_matrix
from tactile_ros.devices.serial_board import SerialBoard
from tactile_ros.devices.simulated_serial import BYTE_FAULTS, BoardTwin, FramedTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.errors import DeviceTimeout
from tactile_ros.types import Array, Frame, Layout, TaxelStatus, Twin

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Device

STEP = 1e-7
MATRIX = Layout(np.zeros((16, 3)), ('p',), '1', rate_hz=500.0)


def ramp(t: float) -> Array:
    """A field that tells its period, at 400 Hz, in steps of 4e-7 T."""
    return np.full((5, 3), 1e-3) + round(t * 400) * 4 * STEP


def pressure(t: float) -> Array:
    return np.full((16, 1), 0.5 + 0.4 * np.sin(t))


def board_twin(layout: Layout, clock: VirtualClock | None = None, seed: int = 0) -> BoardTwin:
    return BoardTwin(layout, ramp, clock=clock, quantum=np.full(3, STEP), seed=seed)


def period(frame: Frame) -> int:
    """Period in which a frame was taken, as it tells."""
    return round((frame.values[0, 0] - 1e-3) / 4 / STEP)


def read_to(board: Device, last: int) -> list[Frame]:
    frames = [board.read(5.0)]
    while period(frames[-1]) != last:
        frames.append(board.read(5.0))
    return frames


def make_framed(layout: Layout) -> Twin:
    return FramedTwin(MATRIX, taxel_matrix(16), 1 / 1023, pressure)


def make_board(layout: Layout) -> Twin:
    return board_twin(layout)


@pytest.mark.parametrize('make', [make_framed, make_board])
def test_a_twin_streams_in_real_time_by_itself(
    make: Callable[[Layout], Twin], layout: Layout
) -> None:
    start = time.monotonic()  # before the first frame: those that wait for a busy reader count too
    with make(layout) as twin, twin.device(time.monotonic_ns) as board:
        board.read(5.0)
        frames = [board.read(5.0) for _ in range(100)]
        assert time.monotonic() - start > 0.99 * 99 / board.layout.rate_hz
    assert frames[-1].sequence > 99
    assert frames[0].values.shape == board.layout.shape


@pytest.mark.parametrize('make', [make_framed, make_board])
def test_a_twin_that_is_unplugged_comes_back_within_two_seconds(
    make: Callable[[Layout], Twin], layout: Layout
) -> None:
    with make(layout) as twin, twin.device(time.monotonic_ns) as board:
        before = board.read(5.0)
        twin.inject('unplug')
        gone = False
        while not gone:
            try:
                before = board.read(0.2)
            except DeviceTimeout as err:
                gone = str(err).endswith('trying again')
        start = time.monotonic()
        after = board.read(4.0)
        assert time.monotonic() - start < 2.0 + 1.0
        assert after.sequence > before.sequence + 1
        assert (after.stamp_ns or 0) > (before.stamp_ns or 0)
        assert twin.injected['unplug'] == 1


def test_in_real_time_too_what_is_counted_is_what_was_injected() -> None:
    with FramedTwin(MATRIX, taxel_matrix(16), 1 / 1023, pressure, seed=2) as twin:
        for fault in (*BYTE_FAULTS, 'lost', 'saturation'):
            twin.inject(fault, 3)
        with twin.device(time.monotonic_ns) as board:
            while sum(twin.injected.values()) < 27:
                board.read(5.0)
            last = board.read(5.0).sequence
            while board.read(5.0).sequence < last + 20:
                pass
            counts = board.counters()
    assert twin.overruns or counts['dropped'] == 24
    assert counts['saturated'] == 3


def test_unknown_faults_and_missing_rates_are_refused(layout: Layout) -> None:
    twin = board_twin(layout)
    with pytest.raises(ValueError, match=r"fault must be one of dropped, .*; received 'nack'"):
        twin.inject('nack')
    with pytest.raises(ValueError, match='rate_hz of the layout of a twin must be above 0'):
        BoardTwin(Layout(np.zeros((5, 3)), ('x', 'y', 'z'), 'T'), ramp)
    endless = BoardTwin(Layout(np.zeros((5, 3)), ('x', 'y', 'z'), 'T', rate_hz=400.0), ramp)
    assert 'saturation' not in endless.faults
    assert 'saturation' in twin.faults


@pytest.mark.parametrize('fault', [*BYTE_FAULTS, 'lost', 'nan', 'stall'])
def test_the_board_recovers_from_faults(fault: str, layout: Layout) -> None:
    clock = VirtualClock(10**12)
    with board_twin(layout, clock) as twin, twin.device(clock.now_ns) as board:
        twin.play(10)
        read_to(board, 9)
        twin.inject(fault)
        twin.play(220)
        frames = read_to(board, 229)
    assert twin.injected[fault] == 1
    told = [period(frame) for frame in frames]
    assert len(told) >= (20 if fault == 'stall' else 218)
    seen = fault not in ('flipped', 'garbage', 'shifted')  # those may pass unseen
    assert not seen or set(told) <= set(range(10, 230))


def test_limits_and_stuck_chips_are_as_on_a_board(layout: Layout) -> None:
    clock = VirtualClock()
    with board_twin(layout, clock) as twin, twin.device(clock.now_ns) as board:
        twin.play(3)
        twin.inject('saturation', 2)
        twin.play(3)
        twin.inject('stuck_chip', 2)
        twin.play(3)
        frames = [board.read(5.0) for _ in range(9)]
    marked = [frame.status for frame in frames if frame.status is not None]
    assert [sorted(status.tolist()) for status in marked] == [
        [0, 0, 0, 0, TaxelStatus.SATURATED]
    ] * 2
    values = np.array([frame.values for frame in frames])
    assert (values[6:8, 0] == values[5, 0]).all()
    assert (values[6, 1:] != values[5, 1:]).all()


def test_the_same_seed_gives_the_same_bytes(layout: Layout) -> None:
    def play(seed: int) -> np.ndarray:
        clock = VirtualClock()
        twin = BoardTwin(layout, ramp, noise=1e-5, seed=seed, clock=clock)
        with twin, twin.device(clock.now_ns) as board:
            twin.inject('inserted', 2)
            twin.play(20)
            return np.array([board.read(5.0).values for _ in range(17)])

    np.testing.assert_array_equal(play(1), play(1))
    assert not np.array_equal(play(1), play(2))


def test_a_sensor_may_bring_its_own_driver(layout: Layout) -> None:
    clock = VirtualClock()
    made: list[str] = []

    def driver(port: str, clock_ns: Callable[[], int]) -> Device:
        made.append(port)
        return SerialBoard(port, layout, clock=clock_ns, temperature_measured=False)

    with BoardTwin(layout, ramp, clock=clock, driver=driver) as twin:
        with twin.device(clock.now_ns) as board:
            twin.play(3)
            assert board.read(5.0).temperature_c is None
        assert made == [twin.port]


def test_bytes_that_are_handed_over_give_the_frames_of_a_port() -> None:
    found = []
    for handed in (True, False):
        clock = VirtualClock(1_000_000_000)
        twin = FramedTwin(
            MATRIX, taxel_matrix(16), 1 / 1023, pressure, noise=1e-3, seed=4, clock=clock
        )
        with twin, twin.device(clock.now_ns) as board:
            frames = []
            for _ in range(5):
                if handed:
                    board.feed(twin.period())
                else:
                    twin.play(1)
                frames.append(board.read(1.0))
        found.append(frames)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        assert one.sequence == other.sequence
        assert one.stamp_ns == other.stamp_ns
