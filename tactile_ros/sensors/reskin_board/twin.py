# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The board on its serial port, real or simulated: dipoles over the chips that presses move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tactile_ros.devices.connections import SerialConnection
from tactile_ros.devices.serial_board import ReskinBoard
from tactile_ros.devices.simulated_serial import ReskinTwin
from tactile_ros.enrolment import Programme, Touches, Truth, growing_loads, recorded
from tactile_ros.physics.magnetics import dipole_field, in_chip_axes
from tactile_ros.sensors.reskin_board.config import CHANNELS, PITCH, ReskinBoardConfig, layout
from tactile_ros.types import Array, Layout, Recording
from tactile_ros.types.config_fields import maybe_array, number, switch

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

    One stream that begins with a tare. `seed` is of places, loads and noise, `noise` of a channel
    (T); None: that of the chips.
    """
    return recorded(
        layout(config), programme(config, seed, count), lambda touches: reading(config, touches),
        truth, NOISE if noise is None else noise, seed,
    )  # fmt: skip


@dataclass(frozen=True)
class ReskinBoardConnection(SerialConnection):
    """A serial port on which the board streams float32 t, x, y, z of every chip."""

    temperature_measured: bool = switch(True, 'false: the temperature field holds no measurement')
    native_usb: bool = switch(
        True, 'false: a true UART, whose transfer time is taken off the stamps'
    )
    clock_rate: float = number(
        1.0,
        'seconds of the stamps per second; above 1 for a recording played faster, so that what '
        'remembers time sees the recorded time',
        's/s', 1e-3, 1e4,
    )  # fmt: skip
    mark_repeats: bool = switch(
        False, 'mark readings equal to the frame before as stale (fast firmware)'
    )
    conversion: float = number(
        2.10e-3,
        'time of a conversion, half of which is taken off the stamps; 2.1 ms: firmware with OSR 0 '
        'and DIG_FILT 2; 0: unknown',
        's', 0.0, 0.3,
    )  # fmt: skip
    step: Array | None = maybe_array(
        'exact step of Bx, By, Bz at the gain of the firmware, which shows most damaged readings; '
        'empty: unknown',
        'T', (CHANNELS,), 1e-9, 1e-3,
    )  # fmt: skip

    def open(self, layout: Layout, clock_ns: Callable[[], int]) -> ReskinBoard:
        """Driver with stamps from `clock_ns` (ns); not opened yet."""
        return ReskinBoard(
            self.port, layout, self.baud, self.native_usb, self.temperature_measured,
            clock=clock_ns if self.clock_rate == 1.0 else faster(clock_ns, self.clock_rate),
            quantum=self.step, mark_repeats=self.mark_repeats, conversion_s=self.conversion,
        )  # fmt: skip

    def board(self, layout: Layout) -> Callable[..., ReskinTwin]:
        """See `SerialConnection.board`."""
        return partial(ReskinTwin, quantum=self.step)

    def at(self, port: str) -> SerialConnection:
        """See `SerialConnection.at`; nothing in a twin converts."""
        return replace(self, port=port, conversion=0.0)


def faster(clock_ns: Callable[[], int], rate: float) -> Callable[[], int]:
    """Clock (ns) that agrees with `clock_ns` now and runs `rate` times as fast."""
    origin_ns = clock_ns()
    return lambda: origin_ns + int((clock_ns() - origin_ns) * rate)
