"""The board on its serial port."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tactile_ros.devices.serial_board import ReskinBoard, uart_transfer_s
from tactile_ros.devices.simulated_serial import ReskinTwin
from tactile_ros.sensors.reskin_board.config import layout
from tactile_ros.sensors.reskin_board.signal import NOISE
from tactile_ros.sensors.reskin_board.signal import signal as own_signal

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.timestamps import VirtualClock
    from tactile_ros.sensors.reskin_board.config import ReskinBoardConfig, ReskinBoardConnection
    from tactile_ros.types import Array


def open_board(
    config: ReskinBoardConfig, connection: ReskinBoardConnection, clock_ns: Callable[[], int]
) -> ReskinBoard:
    """Board of `config` at `connection`, with stamps from `clock_ns`; not opened yet."""
    chips = len(config.positions)
    return ReskinBoard(
        connection.port,
        layout(config),
        baud=connection.baud,
        temperature_measured=connection.temperature_measured,
        clock=clock_ns
        if connection.clock_rate == 1.0
        else faster(clock_ns, connection.clock_rate),
        transfer_s=0.0 if connection.native_usb else uart_transfer_s(chips, connection.baud),
        quantum=connection.step,
        mark_repeats=connection.mark_repeats,
        conversion_s=connection.conversion,
    )


def simulate_board(
    config: ReskinBoardConfig,
    connection: ReskinBoardConnection,
    signal: Callable[[float], Array] | None = None,
    seed: int = 0,
    clock: VirtualClock | None = None,
) -> ReskinTwin:
    """Twin of a board that plays `signal`, or a simple one of its own; not entered yet."""
    return ReskinTwin(
        layout(config),
        own_signal(config, seed) if signal is None else signal,
        noise=NOISE if config.noise is None else config.noise,
        seed=seed,
        clock=clock,
        quantum=connection.step,
        # the twin sends what is there at the moment: nothing converts
        driver=lambda port, clock_ns: open_board(
            config, replace(connection, port=port, conversion=0.0), clock_ns
        ),
    )


def faster(clock_ns: Callable[[], int], rate: float) -> Callable[[], int]:
    """Clock (ns) that agrees with `clock_ns` now and runs `rate` times as fast."""
    origin_ns = clock_ns()
    return lambda: origin_ns + int((clock_ns() - origin_ns) * rate)
