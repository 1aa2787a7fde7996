# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Connections of sensors: boards of the framed protocol or of text lines, I2C buses of chips."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.chip_array import ChipArray, Mode
from tactile_ros.devices.framed_protocol import Payload, three_axis_chips
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings
from tactile_ros.devices.serial_board import FramedBoard, LineBoard
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.simulated_serial import FramedTwin, LineTwin, SerialTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.devices.transport import I2cBus
from tactile_ros.types import Array, Device, Layout, Twin
from tactile_ros.types.config_fields import (
    admit,
    number,
    switch,
    text_of,
    texts,
    whole,
    whole_numbers,
)

DIRECT = 0  # in place of a switch's address
FASTEST_HZ = 400_000


@dataclass(frozen=True)
class SerialConnection:
    """A board that sends frames by itself over a serial port."""

    port: str = text_of('/dev/ttyACM0', 'serial port; /dev/serial/by-id/... survives replugging')
    baud: int = whole(115_200, 'baud rate; native USB ignores it', 1200, 12_000_000)
    native_usb: bool = switch(False, 'true: USB from end to end, no baud rate to fit through')

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self)

    def open(self, layout: Layout, clock_ns: Callable[[], int]) -> Device:
        """Driver with stamps from `clock_ns` (ns); not opened yet.

        A ValueError says that port or buses cannot carry the layout's rate, or do not fit its
        taxels.
        """
        raise NotImplementedError

    def at(self, port: str) -> SerialConnection:
        """The same at another port."""
        return replace(self, port=port)

    def board(self, layout: Layout) -> Callable[..., SerialTwin]:
        """Twin of the board by what all twins need."""
        raise NotImplementedError

    def simulate(
        self, layout: Layout, signal: Callable[[float], Array], noise: float | Array, seed: int,
        clock: VirtualClock | None = None, temperature_c: Callable[[float], Array] | None = None,
    ) -> Twin:  # fmt: skip
        """Twin on a pseudo-terminal or simulated buses, whose paths are not used; not entered yet.

        `signal` gives values (t, c) (unit of the layout) at a time (s), `temperature_c` chip
        temperatures (t,) (degrees Celsius; None: 25). `noise`, a number or (c,), is the standard
        deviation of a reading, `seed` that of noise and faults; `clock` is the board's (None: the
        machine's).
        """

        def driver(port: str, clock_ns: Callable[[], int]) -> Device:
            return self.at(port).open(layout, clock_ns)

        return self.board(layout)(
            layout=layout, driver=driver, signal=signal, noise=noise, seed=seed, clock=clock,
            temperature_c=temperature_c,
        )  # fmt: skip


@dataclass(frozen=True)
class FramedConnection(SerialConnection):
    """A microcontroller that sends the framed protocol over a serial port.

    A sensor's own connection says `payload` and `scale`.
    """

    baud: int = whole(921_600, 'baud rate; native USB ignores it', 1200, 12_000_000)

    def payload(self, layout: Layout) -> Payload:
        """Content of the frames."""
        raise NotImplementedError

    def scale(self) -> npt.ArrayLike:
        """Unit of the layout per count, broadcast to (t, c)."""
        raise NotImplementedError

    def open(self, layout: Layout, clock_ns: Callable[[], int]) -> Device:
        """See `SerialConnection.open`."""
        payload, scale = self.payload(layout), self.scale()
        return FramedBoard(self.port, layout, payload, scale, self.baud, self.native_usb, clock_ns)

    def board(self, layout: Layout) -> Callable[..., SerialTwin]:
        """See `SerialConnection.board`."""
        return partial(FramedTwin, payload=self.payload(layout), scale=self.scale())


@dataclass(frozen=True)
class LineConnection(SerialConnection):
    """A microcontroller, such as an Arduino, that prints a line of numbers for each frame.

    See `text_lines` for what a line may be; lines tell no temperature. A sensor's own connection
    has other defaults.
    """

    scale: float = number(1.0, 'unit of the readings for each printed number', '1', -1e12)
    decimals: int = whole(0, 'digits after the point that the board prints', 0, 9)

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        super().__post_init__()
        if self.scale == 0:
            msg = 'scale of LineConnection must not be 0; received 0'
            raise ValueError(msg)

    def open(self, layout: Layout, clock_ns: Callable[[], int]) -> Device:
        """See `SerialConnection.open`."""
        return LineBoard(self.port, layout, self.scale, self.baud, self.native_usb, clock_ns)

    def board(self, layout: Layout) -> Callable[..., SerialTwin]:
        """See `SerialConnection.board`."""
        return partial(LineTwin, scale=self.scale, decimals=self.decimals)


def open_lines(port: str, taxels: int, scale: float = 1.0) -> Device:
    """Driver of a board that prints so many numbers a line, for whom no sensor is made yet."""
    layout = Layout(np.zeros((taxels, 3)), ('reading',), '1')
    return LineConnection(port, scale=scale).open(layout, time.monotonic_ns)


@dataclass(frozen=True)
class ChipConnection(ChipSettings, SerialConnection):
    """MLX90393 chips on I2C buses, or behind a microcontroller on a serial port.

    Fields of the other transport are not used; one number counts for all chips.
    """

    baud: int = whole(921_600, 'baud rate; native USB ignores it', 1200, 12_000_000)
    transport: str = text_of('i2c', 'how the chips are reached', ('i2c', 'serial'))
    buses: tuple[str, ...] = texts(('/dev/i2c-1',), 'paths of the I2C buses')
    bus_of_chip: tuple[int, ...] = whole_numbers((0,), 'bus of each chip, or of all', 0, 15)
    addresses: tuple[int, ...] = whole_numbers((0x0C, 0x0D), 'address of each chip', 8, 0x77)
    mux_addresses: tuple[int, ...] = whole_numbers((DIRECT,), 'switch of each; 0: none', 0, 0x77)
    mux_channels: tuple[int, ...] = whole_numbers((0,), 'channel of the switch of each chip', 0, 7)
    bus_clock: int = whole(FASTEST_HZ, 'clock of the buses (Hz); 0: unknown', 0, FASTEST_HZ)
    mode: str = text_of('single', 'all at the same time, or fastest', ('single', 'burst'))
    resolution: tuple[int, ...] = whole_numbers((1, 1, 1), 'RES of x, y, z', 0, 3, (3,))

    def places(self, chips: int) -> list[ChipPlace]:
        """Place of each of so many chips; ValueError where the numbers do not fit."""
        bus = _for_each('bus_of_chip', self.bus_of_chip, chips)
        mux = _for_each('mux_addresses', self.mux_addresses, chips)
        channel = _for_each('mux_channels', self.mux_channels, chips)
        addresses = _for_each('addresses', self.addresses, chips, spread=False)
        if max(bus) >= len(self.buses):
            msg = (
                f'bus_of_chip must be 0 to {len(self.buses) - 1}, a number in buses '
                f'{", ".join(self.buses)}; received {max(bus)}'
            )
            raise ValueError(msg)
        switched = [(m, c) if m != DIRECT else () for m, c in zip(mux, channel, strict=True)]
        return [ChipPlace(a, b, *s) for a, b, s in zip(addresses, bus, switched, strict=True)]

    def at(self, port: str) -> ChipConnection:
        """The same at an I2C bus such as /dev/i2c-1, else at a microcontroller's serial port."""
        if Path(port).name.startswith('i2c'):
            return replace(self, transport='i2c', buses=(port,))
        return replace(self, transport='serial', port=port)

    def open(self, layout: Layout, clock_ns: Callable[[], int]) -> Device:
        """See `SerialConnection.open`."""
        if self.transport == 'serial':
            return FramedBoard(
                self.port, layout, three_axis_chips(layout.shape[0]), self.tesla_per_count,
                self.baud, self.native_usb, clock_ns,
            )  # fmt: skip
        return ChipArray(
            [I2cBus(path) for path in self.buses], self.places(layout.shape[0]), layout,
            self, cast('Mode', self.mode), layout.rate_hz, clock_ns, bus_hz=self.bus_clock,
        )  # fmt: skip

    def board(self, layout: Layout) -> Callable[..., SerialTwin]:
        """See `SerialConnection.board`."""
        payload = three_axis_chips(layout.shape[0])
        return partial(FramedTwin, payload=payload, scale=self.tesla_per_count)

    def simulate(
        self, layout: Layout, signal: Callable[[float], Array], noise: float | Array, seed: int,
        clock: VirtualClock | None = None, temperature_c: Callable[[float], Array] | None = None,
    ) -> Twin:  # fmt: skip
        """See `SerialConnection.simulate`; the signal is in chip axes."""
        if self.transport == 'serial':
            return super().simulate(layout, signal, noise, seed, clock, temperature_c)
        return ChipArrayTwin(
            self.places(layout.shape[0]), layout, signal, temperature_c, self,
            cast('Mode', self.mode), layout.rate_hz, noise,
            hertz=self.bus_clock or FASTEST_HZ, clock=clock, seed=seed,
        )  # fmt: skip


def _for_each(
    name: str, numbers: tuple[int, ...], chips: int, spread: bool = True
) -> tuple[int, ...]:
    """The numbers of a field, one for each chip."""
    if spread and len(numbers) == 1:
        return numbers * chips
    if len(numbers) != chips:
        msg = f'{name} must have one number for each of {chips} chips; received {len(numbers)}'
        raise ValueError(msg)
    return numbers
