"""Where taxels are, one reading of them, and flat objects that touch them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types.arrays import Array, Bytes, as_shape
from tactile_ros.types.names import admit_name


@dataclass(frozen=True)
class Layout:
    """Where the taxels of one sensor sit and what they measure.

    Attributes
    ----------
    positions : ndarray, shape (t, 3)
        Taxel positions in the sensor frame (m).
    channels : tuple of str
        Names of the channels of a taxel.
    unit : str
        Unit of values: 'T' or '1' (a fraction).
    rotations : ndarray, shape (t, 3, 3), or None
        Rotation from chip axes to sensor axes; values are in chip axes. None: aligned.
    saturation : ndarray, shape (c,), or None
        Magnitude at which a channel clips (unit of values); inf or None: never.
    rate_hz : float
        Nominal frame rate (Hz).
    frame_id, sensor, serial : str
        Name of the sensor frame, key of the sensor, which board; see `names.admit_name`.
    """

    positions: Array
    channels: tuple[str, ...]
    unit: str
    rotations: Array | None = None
    saturation: Array | None = None
    rate_hz: float = float('nan')
    frame_id: str = 'tactile_sensor'
    sensor: str = ''
    serial: str = ''

    def __post_init__(self) -> None:
        """Check shapes once, at the door."""
        positions = as_shape('positions of Layout', self.positions, (-1, 3))
        object.__setattr__(self, 'positions', positions)
        if self.rotations is not None:
            rotations = as_shape('rotations of Layout', self.rotations, (len(positions), 3, 3))
            object.__setattr__(self, 'rotations', rotations)
        for name in ('unit', 'frame_id', 'sensor', 'serial'):
            admit_name(f'{name} of Layout', getattr(self, name))
        for channel in self.channels:
            admit_name('channels of Layout', channel)
        limit = np.inf if self.saturation is None else self.saturation
        limits = np.broadcast_to(np.asarray(limit, np.float64), (len(self.channels),))
        object.__setattr__(self, 'saturation', np.array(limits))

    @property
    def shape(self) -> tuple[int, int]:
        """Taxels and channels of one frame (t, c)."""
        return len(self.positions), len(self.channels)


@dataclass(frozen=True)
class Frame:
    """One reading of every taxel of one sensor.

    Attributes
    ----------
    stamp_ns : int or None
        Acquisition time (ns); None: an independent frame.
    sequence : int
        Frame counter of its stream; a gap is lost frames.
    values : ndarray, shape (t, c)
        Raw readings (unit of the layout).
    temperature_c : ndarray, shape (t,), or None
        What the chips report (degrees Celsius); None: not measured.
    status : ndarray, shape (t,), or None
        Bits of `TaxelStatus`; None: all good.
    device_time_ns : int
        The device's own clock, unwrapped; 0: it has none.
    dropped : int
        Frames known lost since activation.
    """

    stamp_ns: int | None
    sequence: int
    values: Array
    temperature_c: Array | None = None
    status: Bytes | None = None
    device_time_ns: int = 0
    dropped: int = 0

    def __post_init__(self) -> None:
        """Refuse values that are no (t, c) table."""
        if np.ndim(self.values) != 2:
            msg = f'values of Frame must have shape (t, c); received {np.shape(self.values)}'
            raise ValueError(msg)


@dataclass(frozen=True)
class Outline:
    """A flat object described by closed loops in its own frame.

    Attributes
    ----------
    name : str
        Name of the object.
    loops : tuple of ndarray, shape (n, 2)
        Corners (m), counter-clockwise; holes clockwise.
    thickness : float or None
        Thickness, or the radius of a tube (m).
    bend : float or None
        Angle tube: its two axes leave the origin along +x and at `bend` (rad).
    """

    name: str
    loops: tuple[Array, ...]
    thickness: float | None = None
    bend: float | None = None

    def __post_init__(self) -> None:
        """Check every loop once."""
        loops = tuple(as_shape(f'a loop of Outline {self.name}', x, (-1, 2)) for x in self.loops)
        object.__setattr__(self, 'loops', loops)
