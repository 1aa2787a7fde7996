"""Sensors behind a microcontroller that speaks the framed protocol: how they are connected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.devices.framed_board import FramedBoard
from tactile_ros.devices.framed_twin import FramedTwin
from tactile_ros.types.config_fields import admit, switch, text_of, whole

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from tactile_ros.devices.clock import VirtualClock
    from tactile_ros.devices.framed_payloads import Payload
    from tactile_ros.types import Array, Layout


@dataclass(frozen=True)
class FramedConnection:
    """A serial port that carries the framed protocol.

    Attributes
    ----------
    port : str
        Device path.
    baud : int
        Baud rate; the rate of frames has to fit through it.
    native_usb : bool
        The port is USB from end to end, where the baud rate means nothing.
    """

    port: str = text_of('/dev/ttyACM0', 'serial port; /dev/serial/by-id/... survives replugging')
    baud: int = whole(921_600, 'baud rate; native USB ignores it', 1200, 12_000_000)
    native_usb: bool = switch(False, 'true: USB from end to end, no baud rate to fit through')

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self)


def open_framed(
    layout: Layout,
    connection: FramedConnection,
    payload: Payload,
    scale: npt.ArrayLike,
    clock_ns: Callable[[], int],
) -> FramedBoard:
    """Driver of a board that speaks the framed protocol; not opened yet.

    Parameters
    ----------
    layout : Layout
        Of the sensor.
    connection : FramedConnection
        Its port.
    payload : Payload
        What the frames carry.
    scale : array_like, broadcast to (t, c)
        Unit of the layout per count.
    clock_ns : callable
        Gives the stamps (ns).

    Returns
    -------
    FramedBoard
        A `Device`.

    Raises
    ------
    ValueError
        If the port cannot carry the rate, or payload and layout differ.
    """
    return FramedBoard(
        connection.port,
        layout,
        payload,
        scale,
        baud=connection.baud,
        native_usb=connection.native_usb,
        clock=clock_ns,
    )


def simulate_framed(
    layout: Layout,
    connection: FramedConnection,
    payload: Payload,
    scale: npt.ArrayLike,
    signal: Callable[[float], Array],
    noise: float | Array,
    seed: int,
    clock: VirtualClock | None = None,
    temperature_c: Callable[[float], Array] | None = None,
) -> FramedTwin:
    """Twin of that board on a pseudo-terminal; not entered yet.

    Parameters
    ----------
    layout, connection, payload, scale
        As in `open_framed`; the connection's port is not used.
    signal : callable
        Time (s) -> values, shape (t, c) (unit of the layout).
    noise : float or ndarray, shape (c,)
        Standard deviation of a reading (unit of the layout).
    seed : int
        Of noise and faults.
    clock : VirtualClock or None
        What the board runs on; None: the machine's.
    temperature_c : callable or None
        Time (s) -> chip temperatures (t,) (degrees Celsius); None: 25.

    Returns
    -------
    FramedTwin
        A `Twin`.
    """
    return FramedTwin(
        layout,
        payload,
        scale,
        signal,
        noise=noise,
        temperature_c=temperature_c,
        seed=seed,
        clock=clock,
        baud=connection.baud,
        native_usb=connection.native_usb,
    )
