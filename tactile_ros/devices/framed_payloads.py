"""What the frames of `framed` carry: four kinds of readings as integer counts.

gradiometer: 8 signed counts and the chip's temperature; taxels: a matrix of unsigned 10 bit
counts, packed; wires: two positions and a divider; chips: temperature and three signed counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

TAXEL_BITS = 10
MOST_BYTES = 4096
GRADIOMETER_CHANNELS = 8


class Kind(IntEnum):
    """Numbers of the payloads on the wire."""

    GRADIOMETER = 1
    TAXELS = 2
    WIRES = 3
    CHIPS = 4


@dataclass(frozen=True)
class Payload:
    """One kind of readings: how many, and which bytes they are.

    Attributes
    ----------
    kind : Kind
        Its number on the wire.
    count : int
        Pixels, taxels or chips (t).
    channels : int
        Counts of each (c).
    full_count : int
        Magnitude at which the converter clips.
    """

    kind: Kind
    count: int
    channels: int
    full_count: int

    def __post_init__(self) -> None:
        """Refuse what no frame can hold."""
        if self.count < 1 or self.size > MOST_BYTES:
            msg = (
                f'count of a payload must be at least 1 and fill at most {MOST_BYTES} bytes; '
                f'received {self.count}'
            )
            raise ValueError(msg)
        most = {Kind.TAXELS: 2**TAXEL_BITS - 1, Kind.WIRES: 0xFFFF}.get(self.kind, 0x7FFF)
        if not 1 <= self.full_count <= most:
            msg = f'full_count must be 1 to {most}; received {self.full_count}'
            raise ValueError(msg)

    @property
    def signed(self) -> bool:
        """Whether counts may be negative."""
        return self.kind in (Kind.GRADIOMETER, Kind.CHIPS)

    @property
    def size(self) -> int:
        """Length (bytes)."""
        return self.dtype.itemsize

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """The fields as they lie on the wire, without gaps."""
        if self.kind == Kind.TAXELS:
            return np.dtype([('packed', 'u1', (-(-self.count // 4) * 5,))])
        if self.kind == Kind.WIRES:
            return np.dtype([('counts', '<u2', (self.count, self.channels))])
        if self.kind == Kind.CHIPS:
            states = -(-self.count // 4)
            return np.dtype([('chips', '<i2', (self.count, 4)), ('states', 'u1', (states,))])
        shape = (self.count, self.channels)
        return np.dtype([('counts', '<i2', shape), ('temperature', '<i2')])

    def __str__(self) -> str:
        """As sentences name it."""
        return describe(self.kind, self.count, self.size)


def describe(kind: int, count: int, size: int) -> str:
    """Name of a payload in a sentence, known or not."""
    name = Kind(kind).name.lower() if kind in Kind.__members__.values() else 'unknown'
    return f'{name} (kind {kind}) of {count} in {size} bytes'


def gradiometer(full_count: int = 0x7FFF) -> Payload:
    """Payload of four pixels (Bx, Bz) and one chip temperature; int16 counts."""
    return Payload(Kind.GRADIOMETER, GRADIOMETER_CHANNELS // 2, 2, full_count)


def taxel_matrix(count: int, full_count: int = 2**TAXEL_BITS - 1) -> Payload:
    """Payload of `count` taxels, 10 bit counts packed."""
    return Payload(Kind.TAXELS, count, 1, full_count)


def five_wires(full_count: int = 0xFFFF, channels: int = 3) -> Payload:
    """Payload of u_AC, u_BD and the divider, uint16 counts of a converter that ends at that.

    A fourth channel is the foil's potential under a third excitation.
    """
    return Payload(Kind.WIRES, 1, channels, full_count)


def three_axis_chips(count: int, full_count: int = 0x7FFF) -> Payload:
    """Payload of `count` chips: temperature, x, y, z, and whether the reading is new."""
    return Payload(Kind.CHIPS, count, 3, full_count)
