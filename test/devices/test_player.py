"""Recordings played into a port: every row once, in order and in time."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.devices.player import Player
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.errors import DeviceTimeout

if TYPE_CHECKING:
    from tactile_ros.devices.serial_board import ReskinBoard

MS = 1_000_000


def test_every_row_once_in_order(
    port: SimulatedSerialPort, board: ReskinBoard, rows: np.ndarray
) -> None:
    player = Player(port, period_s=0.0)
    player.play(rows[:30])
    frames = [board.read(1.0) for _ in range(30)]
    np.testing.assert_allclose([f.values for f in frames], rows[:30], rtol=1e-6, atol=1e-10)
    assert player.sent == 30


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
