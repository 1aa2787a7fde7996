"""Recordings played into a port: every row once, in order, with a word before each touch."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.devices.player import Player, Touch
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.errors import DeviceTimeout

if TYPE_CHECKING:
    from tactile_ros.devices.serial_board import ReskinBoard

MS = 1_000_000


def test_rest_then_tare_then_touch(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    player = Player(port, period_s=0.0)
    touches = [Touch(rows[:4], rest=rows[20]), Touch(rows[4:6], rest=rows[21])]
    seen = []

    def before(index: int, touch: Touch) -> None:
        assert len(seen) == index
        assert touch.rest is not None
        player.rest(touch.rest, 3)
        # a tare reads until the last frame that was sent
        frames = [board.read(1.0)]
        while frames[-1].sequence < player.sent - 1:
            frames.append(board.read(1.0))
        seen.append([frame.values for frame in frames])

    assert player.touches(touches, before) == 12
    assert player.sent == 12
    wanted = [rows[20]] * 3, [*rows[:4], *[rows[21]] * 3]
    for ours, theirs in zip(seen, wanted, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-10)


def test_every_row_once_in_order(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    player = Player(port, period_s=0.0, temperature_c=30.0)
    player.play(rows[:30])
    frames = [board.read(1.0) for _ in range(30)]
    np.testing.assert_allclose([f.values for f in frames], rows[:30], rtol=1e-6, atol=1e-10)
    assert frames[0].temperature_c is not None
    assert frames[0].temperature_c.tolist() == [30.0] * 5


@pytest.mark.usefixtures('board')
def test_the_schedule_is_the_recordings_divided_by_the_speed_up(
    port: SimulatedSerialPort, rows: np.ndarray
) -> None:
    def seconds(player: Player, stamps: list[int]) -> float:
        start = time.monotonic()
        player.play(rows[: len(stamps)], np.array(stamps) * MS)
        return time.monotonic() - start

    assert seconds(Player(port, speed_up=0.5), [0, 20, 40]) >= 0.08
    assert 0.02 <= seconds(Player(port, speed_up=1000.0), [0, 10_000, 20_000]) < 10.0
    assert 0.04 <= seconds(Player(port, longest_gap_s=0.02), [0, 50_000, 100_000]) < 10.0


def test_nobody_reading_is_said(rows: np.ndarray) -> None:
    with SimulatedSerialPort(patience_s=0.05) as port:
        player = Player(port, period_s=0.0)
        with pytest.raises(DeviceTimeout, match='nobody reads'):
            player.play(np.tile(rows, (16, 1, 1)))
    assert 0 < player.sent < 1024


@pytest.mark.parametrize('speed', [0.0, -1.0, float('nan')])
def test_a_speed_up_must_be_positive(port: SimulatedSerialPort, speed: float) -> None:
    with pytest.raises(ValueError, match='speed_up must be above 0'):
        Player(port, speed_up=speed)
