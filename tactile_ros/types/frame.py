# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Layouts of taxels, one reading of them, and flat objects that touch them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntFlag
from typing import Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Singles = npt.NDArray[np.float32]  # in large tables alone
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
Columns = dict[str, npt.NDArray[np.generic]]  # attributes or truth by name, shape (s, ...)


def as_shape(name: str, value: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return numbers as C-contiguous float64 of `shape`, where -1 stands for any length.

    A ValueError that begins with `name` refuses another shape and what is no number.
    """
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        msg = f'{name} must be numbers; received {str(value)[:80]}'
        raise ValueError(msg) from error
    fits = array.ndim == len(shape) and all(
        want in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = str(shape).replace('-1', 'any')
        msg = f'{name} must have shape {wanted}; received {np.shape(value)}'
        raise ValueError(msg)
    return array


MOST_CHARACTERS = 100
# letters and digits of any script, and what names of frames, units and objects are written with
NAME = re.compile(r'[\w .,:/()\[\]+*%^=#°~-]*')


def admit_name(what: str, name: str) -> str:
    """Refuse a name that could be markup, a command or an end of line; return it otherwise.

    ValueError if it is longer than 100 characters or has others than letters, digits, spaces and
    `. , : / ( ) [ ] + * % ^ = # _ ~ -`; `what` says whose name it is.

    Examples
    --------
    >>> admit_name('frame_id of Layout', 'thumb/tip')
    'thumb/tip'
    """
    if len(name) > MOST_CHARACTERS or not NAME.fullmatch(name):
        msg = (
            f'{what} must be at most {MOST_CHARACTERS} letters, digits, spaces and '
            f'.,:/()[]+*%^=#_~-; received {name[:40]!r}'
        )
        raise ValueError(msg)
    return name


class TaxelStatus(IntFlag):
    """Bits of one taxel in one frame, as in TactileFrame."""

    STALE = 1
    SATURATED = 2
    STUCK = 4
    ERROR = 8
    WRAPPED = 16
    DEAD = 32


class FrameStatus(IntFlag):
    """Reasons why a frame's contacts are limited or not to be used, as in TactileContacts."""

    NOT_CALIBRATED = 1
    NO_BASELINE = 2
    BAD_TAXELS = 4
    SATURATED = 8
    STRAY_FIELD = 16
    OUT_OF_RANGE = 32
    ABSTAINED = 64
    STALE = 128


class SensorConfig(Protocol):
    """Fields that every sensor's config dataclass has (public_face)."""

    @property
    def positions(self) -> Array:
        """Taxel positions in the sensor frame, shape (t, 3) (m)."""

    @property
    def rotations(self) -> Array | None:
        """Axes of the chips, shape (t, 3, 3); None: aligned."""

    @property
    def saturation(self) -> float | Array | None:
        """Largest reading of a channel (unit of values); None: never clips."""

    @property
    def rate_hz(self) -> float:
        """Nominal frame rate (Hz)."""

    @property
    def noise(self) -> float | Array | None:
        """Noise of a channel at rest (unit of values); None: estimate it from rest."""

    @property
    def track_baseline(self) -> bool:
        """Follow slow drift of the baseline while at rest."""


@dataclass(frozen=True)
class Layout:
    """Places of the taxels of one sensor, and what they measure.

    Attributes
    ----------
    positions : ndarray, shape (t, 3)
        Taxel positions in the sensor frame (m).
    channels, unit : tuple of str, str
        Names of the channels of a taxel; 'T' or '1' (a fraction).
    rotations : ndarray, shape (t, 3, 3), or None
        From chip axes to sensor axes; values are in chip axes. None: aligned.
    saturation : ndarray, shape (c,), or None
        Magnitude at which a channel clips (unit of values); inf or None: never.
    rate_hz : float
        Nominal frame rate (Hz).
    frame_id, sensor, serial : str
        Name of the sensor frame, key of the sensor, which board; see `admit_name`.
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

    @classmethod
    def of(cls, config: SensorConfig, sensor: str, channels: tuple[str, ...], unit: str) -> Layout:
        """Layout of the sensor of a key by the fields that every config has."""
        limit = config.saturation
        return cls(
            config.positions, channels, unit, config.rotations,
            None if limit is None else np.asarray(limit, np.float64), config.rate_hz,
            sensor=sensor,
        )  # fmt: skip

    def __repr__(self) -> str:
        size = f'{len(self.positions)} x {", ".join(self.channels)} ({self.unit})'
        return f'Layout({self.sensor or "sensor"}: {size})'

    @property
    def shape(self) -> tuple[int, int]:
        """Taxels and channels of one frame (t, c)."""
        return len(self.positions), len(self.channels)


@dataclass(frozen=True)
class Frame:
    """One reading of every taxel of one sensor.

    Attributes
    ----------
    stamp_ns, sequence : int or None, int
        Acquisition time (ns), None: an independent frame; counter of its stream.
    values : ndarray, shape (t, c)
        Raw readings (unit of the layout).
    temperature_c, status : ndarray, shape (t,), or None
        What the chips report (degrees Celsius), None: not measured; bits of `TaxelStatus`.
    device_time_ns, dropped : int
        The device's own clock, unwrapped, 0: it has none; frames known lost since activation.
    averaged : int
        Frames that the values are the mean of: 1, a reading; more, the baseline of a tare; 0, a
        baseline without tare noise (of a fit, or of a bag that does not say).
    """

    stamp_ns: int | None
    sequence: int
    values: Array
    temperature_c: Array | None = None
    status: Bytes | None = None
    device_time_ns: int = 0
    dropped: int = 0
    averaged: int = 1

    def __post_init__(self) -> None:
        if np.ndim(self.values) != 2:
            msg = f'values of Frame must have shape (t, c); received {np.shape(self.values)}'
            raise ValueError(msg)

    def __repr__(self) -> str:
        stamp = 'no stamp' if self.stamp_ns is None else f'{self.stamp_ns} ns'
        shape = ' x '.join(map(str, np.shape(self.values)))
        known = self.values[np.isfinite(self.values)]
        span = f'{known.min():.3g} to {known.max():.3g}' if known.size else 'unknown'
        return f'Frame({self.sequence} at {stamp}: {shape} values, {span})'


@dataclass(frozen=True)
class Outline:
    """A flat object described by closed loops in its own frame.

    Attributes
    ----------
    loops : tuple of ndarray, shape (n, 2)
        Corners (m), counter-clockwise; holes clockwise.
    thickness, bend : float or None
        Thickness, or the radius of a tube (m); of an angle tube, whose two axes leave the origin
        along +x and at `bend` (rad).
    """

    name: str
    loops: tuple[Array, ...]
    thickness: float | None = None
    bend: float | None = None

    def __post_init__(self) -> None:
        loops = tuple(as_shape(f'a loop of Outline {self.name}', x, (-1, 2)) for x in self.loops)
        object.__setattr__(self, 'loops', loops)
