"""Geometry, ranges and connection of the ReSkin / AnySkin board: its defaults live here."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from tactile_ros.types import Array, Layout, as_shape

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

    positions: Array = field(
        default_factory=CROSS.copy, metadata={'unit': 'm', 'help': 'chip positions'}
    )
    rotations: Array | None = field(
        default=None, metadata={'unit': '1', 'help': 'chip axes to sensor axes; empty: aligned'}
    )
    saturation: float | Array | None = field(
        default_factory=lambda: np.array([78.6e-3, 78.6e-3, 126.8e-3]),
        metadata={'unit': 'T', 'help': 'magnitude at which a channel wraps', 'range': (0, np.inf)},
    )
    noise: float | Array | None = field(
        default=None,
        metadata={'unit': 'T', 'help': 'noise of a channel; empty: estimated', 'range': (0, 1)},
    )
    rate_hz: float = field(
        default=100.0, metadata={'unit': 'Hz', 'help': 'frames per second', 'range': (0.1, 5000)}
    )
    track_baseline: bool = field(
        default=True, metadata={'help': 'follow slow drift while nothing touches'}
    )

    def __post_init__(self) -> None:
        """Check shapes once, at the door."""
        positions = as_shape('positions of ReskinBoardConfig', self.positions, (-1, 3))
        if not (len(positions) and np.isfinite(positions).all()):
            msg = 'positions of ReskinBoardConfig must be finite, one row or more; '
            msg += f'received {positions.tolist()}'
            raise ValueError(msg)
        object.__setattr__(self, 'positions', positions)
        for entry in fields(self):
            value = getattr(self, entry.name)
            if 'range' in entry.metadata and value is not None:
                _refuse_outside(entry.name, value, entry.metadata['range'])


def _refuse_outside(name: str, value: float | Array, bounds: tuple[float, float]) -> None:
    """Refuse a number, or one for each channel, that is not between its bounds."""
    low, high = bounds
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    wanted = ((), (CHANNELS,)) if name in ('saturation', 'noise') else ((),)
    if array.shape not in wanted or not ((array >= low) & (array <= high)).all():
        each = ', or one for each channel' if len(wanted) > 1 else ''
        msg = (
            f'{name} of ReskinBoardConfig must be a number from {low} to {high}{each}; '
            f'received {value}'
        )
        raise ValueError(msg)


@dataclass(frozen=True)
class ReskinBoardConnection:
    """How the board is connected: a serial port that streams float32 t, x, y, z of every chip."""

    port: str = field(
        default='/dev/ttyACM0',
        metadata={'help': 'serial port; /dev/serial/by-id/... survives replugging'},
    )
    baud: int = field(
        default=115200,
        metadata={'help': 'baud rate; native USB ignores it', 'range': (1200, 12_000_000)},
    )
    temperature_measured: bool = field(
        default=True, metadata={'help': 'false: the temperature field holds no measurement'}
    )
    native_usb: bool = field(
        default=True,
        metadata={'help': 'false: a true UART, whose transfer time is taken off the stamps'},
    )
    clock_rate: float = field(
        default=1.0,
        metadata={
            'help': 'seconds of the stamps per second; above 1 for a recording played faster, so '
            'that what remembers time sees the recorded time',
            'range': (1e-3, 1e4),
        },
    )
    mark_repeats: bool = field(
        default=False,
        metadata={'help': 'mark readings equal to the frame before as stale (fast firmware)'},
    )
    step: Array | None = field(
        default=None,
        metadata={
            'unit': 'T',
            'help': 'exact step of Bx, By, Bz at the gain of the firmware, which shows most '
            'damaged readings; empty: unknown',
            'range': (1e-9, 1e-3),
        },
    )

    def __post_init__(self) -> None:
        """Check the shape once, at the door."""
        if self.step is not None:
            step = as_shape('step of ReskinBoardConnection', self.step, (CHANNELS,))
            object.__setattr__(self, 'step', step)


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
