"""The board on its serial port."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.serial_board import ReskinBoard
from tactile_ros.devices.simulated_serial import ReskinTwin
from tactile_ros.enrolment import Programme, Touches, growing_loads, playing, recorded
from tactile_ros.physics.magnetics import dipole_field, in_chip_axes
from tactile_ros.sensors.reskin_board.config import PITCH, layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.timestamps import VirtualClock
    from tactile_ros.enrolment import Truth
    from tactile_ros.sensors.reskin_board.config import ReskinBoardConfig, ReskinBoardConnection
    from tactile_ros.types import Array, Recording

NOISE = 1e-6  # T
ABOVE, MOMENT = 4e-3, 1e-3  # m, A m2
STIFFNESS = 10e3  # N / m
PRESSES = 40


def reading(config: ReskinBoardConfig, touches: Touches) -> Array:
    """Readings (s, t, 3) (T) of the dipoles where the press has moved them."""
    up = np.array([0.0, 0.0, 1.0])
    rest = config.positions + ABOVE * up
    away = (rest - np.nan_to_num(touches.position)[:, None])[..., :2]
    share = np.exp(-0.5 * np.square(away / PITCH).sum(axis=2))
    moved = rest - share[..., None] * touches.force[:, None] / STIFFNESS
    moments = np.broadcast_to(MOMENT * up, rest.shape)
    return in_chip_axes(dipole_field(config.positions, moved, moments), config.rotations)


def truth(touches: Touches) -> Truth:
    """Place and force."""
    return {'position': touches.position, 'force': touches.force}


def programme(config: ReskinBoardConfig, seed: int, count: int) -> Programme:
    """Presses of 1..8 N with some shear near random chips."""
    rng = np.random.default_rng(seed)
    chip = rng.integers(len(config.positions), size=count)
    play = np.column_stack([PITCH * rng.uniform(-0.6, 0.6, (count, 2)), np.full(count, ABOVE)])
    load = growing_loads(count, 1.0, 8.0, rng)
    shear = load[:, None] * rng.uniform(-0.2, 0.2, (count, 2))
    return Programme(config.positions[chip] + play, np.column_stack([shear, load]))


def presses(
    config: ReskinBoardConfig, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of `count` presses with their truth: position and force.

    Parameters
    ----------
    config : ReskinBoardConfig
        Of the sensor.
    seed : int
        Of places, loads and noise.
    count : int
        Presses (n).
    noise : float or None
        Of a channel (T); None: that of the chips.

    Returns
    -------
    Recording
        One stream that begins with a tare.
    """
    return recorded(
        layout(config),
        programme(config, seed, count),
        lambda touches: reading(config, touches),
        truth,
        NOISE if noise is None else noise,
        seed,
    )


def demo_signal(config: ReskinBoardConfig, seed: int = 0) -> Callable[[float], Array]:
    """The readings of `presses` without noise, over time (s), again and again."""
    return playing(presses(config, seed, noise=0.0))


def open_board(
    config: ReskinBoardConfig, connection: ReskinBoardConnection, clock_ns: Callable[[], int]
) -> ReskinBoard:
    """Board of `config` at `connection`, with stamps from `clock_ns`; not opened yet."""
    return ReskinBoard(
        connection.port,
        layout(config),
        baud=connection.baud,
        temperature_measured=connection.temperature_measured,
        clock=clock_ns
        if connection.clock_rate == 1.0
        else faster(clock_ns, connection.clock_rate),
        native_usb=connection.native_usb,
        quantum=connection.step,
        mark_repeats=connection.mark_repeats,
        conversion_s=connection.conversion,
    )


def simulate_board(
    config: ReskinBoardConfig, connection: ReskinBoardConnection,
    signal: Callable[[float], Array] | None = None, seed: int = 0,
    clock: VirtualClock | None = None,
) -> ReskinTwin:  # fmt: skip
    """Twin of a board that plays `signal`, or a simple one of its own; not entered yet."""
    return ReskinTwin(
        layout(config),
        demo_signal(config, seed) if signal is None else signal,
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
