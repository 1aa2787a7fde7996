"""Geometry, ranges and connection of the ReSkin / AnySkin board: its defaults live here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Layout
from tactile_ros.types.config_fields import (
    admit,
    array,
    each_channel,
    maybe_array,
    number,
    switch,
    text_of,
    whole,
)

PITCH = 7e-3
CHANNELS = 3
# centre, left, right, up, down, as the board counts its chips
CROSS = PITCH * np.array([[0, 0, 0], [-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0]], float)


@dataclass(frozen=True)
class ReskinBoardConfig:
    """Where the chips sit and what they can measure; any number of chips.

    Attributes
    ----------
    positions : ndarray, shape (t, 3)
        Chips in the sensor frame (m).
    rotations : ndarray, shape (t, 3, 3), or None
        Chip axes to sensor axes. The five chips of the board are turned about z by -90, -90,
        180, 90 and 0 degrees; regressors learn that, so that the default leaves it out.
    saturation : float or ndarray, shape (3,), or None
        Magnitude at which a channel wraps (T); inf or None: never. The default suits gain 4x at
        resolution 2; the boards' first firmware (gain 1.33x, resolution 0) wraps at 6.6, 6.6 and
        10.6 mT.
    noise : float, ndarray, shape (3,), or None
        Noise of a channel (T); None: estimated from rest.
    rate_hz : float
        Frames per second that the board sends.
    track_baseline : bool
        Follow slow drift while nothing touches.
    """

    positions: Array = array(CROSS, 'chip positions', 'm', (-1, 3))
    rotations: Array | None = maybe_array('chip to sensor axes; empty: aligned', '1', ('t', 3, 3))
    saturation: float | Array | None = each_channel(
        (78.6e-3, 78.6e-3, 126.8e-3), 'magnitude at which a channel wraps', 'T'
    )
    noise: float | Array | None = each_channel(None, 'noise; empty: estimated from rest', 'T')
    rate_hz: float = number(100.0, 'frames per second', 'Hz', 0.1, 5000)
    track_baseline: bool = switch(True, 'follow slow drift while nothing touches')

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self, CHANNELS)


@dataclass(frozen=True)
class ReskinBoardConnection:
    """How the board is connected: a serial port that streams float32 t, x, y, z of every chip."""

    port: str = text_of('/dev/ttyACM0', 'serial port; /dev/serial/by-id/... survives replugging')
    baud: int = whole(115_200, 'baud rate; native USB ignores it', 1200, 12_000_000)
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

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self)


def layout(config: ReskinBoardConfig) -> Layout:
    """Layout of a board."""
    return Layout(
        positions=config.positions,
        channels=('Bx', 'By', 'Bz'),
        unit='T',
        rotations=config.rotations,
        saturation=None if config.saturation is None else np.asarray(config.saturation, float),
        rate_hz=config.rate_hz,
        sensor='reskin_board',
    )
