"""Connections of sensors: port and baud rate of the framed protocol, I2C buses of chips."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar, cast

from tactile_ros.devices.chip_array import ChipArray, Mode
from tactile_ros.devices.framed_protocol import three_axis_chips
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings, tesla_per_lsb
from tactile_ros.devices.serial_board import FramedBoard
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.simulated_serial import FramedTwin
from tactile_ros.devices.transport import I2cBus
from tactile_ros.types.config_fields import admit, switch, text_of, texts, whole, whole_numbers

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from tactile_ros.devices.framed_protocol import Payload
    from tactile_ros.devices.timestamps import VirtualClock
    from tactile_ros.types import Array, Device, Layout, Twin


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


DIRECT = 0  # in place of a switch's address
FASTEST_HZ = 400_000


class Noisy(Protocol):
    """A config that says how noisy its sensor is."""

    @property
    def noise(self) -> float | Array | None:
        """Standard deviation of a channel (T); None: unknown."""
        ...


Config = TypeVar('Config', bound=Noisy)


@dataclass(frozen=True)
class ChipConnection(FramedConnection):
    """MLX90393 chips on I2C buses, or behind a microcontroller on a serial port.

    Attributes
    ----------
    transport : str
        'i2c' or 'serial'; the fields of the other one are not used, those of the chips always.
    buses : tuple of str
        Paths of the I2C buses.
    bus_of_chip : tuple of int
        For each chip which of the buses, counted from 0; one number: for all chips.
    addresses : tuple of int
        For each chip its address on the bus.
    mux_addresses : tuple of int
        For each chip the address of the switch (TCA9548A) it is behind, 0: none; one number: for
        all chips.
    mux_channels : tuple of int
        For each chip the channel of that switch; one number: for all chips.
    mode : str
        'single': all chips start together; 'burst': each measures without end.
    bus_clock : int
        Clock of the I2C buses (Hz), which the rate of frames has to fit; 0: unknown, not checked.
    gain, resolution, digital_filter, oversampling, temperature, hallconf
        Of the chips; see `ChipSettings`.
    """

    transport: str = text_of('i2c', 'how the chips are reached', ('i2c', 'serial'))
    buses: tuple[str, ...] = texts(('/dev/i2c-1',), 'paths of the I2C buses')
    bus_of_chip: tuple[int, ...] = whole_numbers((0,), 'bus of each chip, or of all', 0, 15)
    addresses: tuple[int, ...] = whole_numbers((0x0C, 0x0D), 'address of each chip', 8, 0x77)
    mux_addresses: tuple[int, ...] = whole_numbers(
        (DIRECT,), 'switch of each chip, or of all; 0: none', 0, 0x77
    )
    mux_channels: tuple[int, ...] = whole_numbers(
        (0,), 'channel of the switch for each chip, or for all', 0, 7
    )
    bus_clock: int = whole(FASTEST_HZ, 'clock of the buses (Hz); 0: unknown', 0, FASTEST_HZ)
    mode: str = text_of('single', 'all at the same time, or fastest', ('single', 'burst'))
    gain: int = whole(1, 'GAIN_SEL; 0 has the largest range, 7 the finest step', 0, 7)
    resolution: tuple[int, ...] = whole_numbers((1, 1, 1), 'RES of x, y, z', 0, 3, (3,))
    digital_filter: int = whole(2, 'DIG_FILT; more is slower and has less noise', 0, 7)
    oversampling: int = whole(0, 'OSR; more is slower and has less noise', 0, 3)
    temperature: bool = switch(True, 'read the temperature of the chips, too')
    hallconf: int = whole(0xC, 'HALLCONF, 12 (factory) or 0', 0, 0xC)

    @property
    def settings(self) -> ChipSettings:
        """How the chips measure."""
        return ChipSettings(
            gain=self.gain,
            resolution=cast('tuple[int, int, int]', self.resolution),
            digital_filter=self.digital_filter,
            oversampling=self.oversampling,
            temperature=self.temperature,
            hallconf=self.hallconf,
        )

    def places(self, chips: int) -> list[ChipPlace]:
        """Where each of so many chips is reached.

        Raises
        ------
        ValueError
            If there are more or fewer addresses, switches or channels than chips.
        """
        bus = self._for_each('bus_of_chip', chips)
        mux, channel = (
            self._for_each('mux_addresses', chips),
            self._for_each('mux_channels', chips),
        )
        addresses = self._for_each('addresses', chips, spread=False)
        if max(bus) >= len(self.buses):
            msg = (
                f'bus_of_chip must be 0 to {len(self.buses) - 1}, a number in buses '
                f'{", ".join(self.buses)}; received {max(bus)}'
            )
            raise ValueError(msg)
        return [
            ChipPlace(addresses[i], bus[i])
            if mux[i] == DIRECT
            else ChipPlace(addresses[i], bus[i], mux[i], channel[i])
            for i in range(chips)
        ]

    def _for_each(self, name: str, chips: int, spread: bool = True) -> tuple[int, ...]:
        """The numbers of a field, one for each chip."""
        numbers: tuple[int, ...] = getattr(self, name)
        if spread and len(numbers) == 1:
            return numbers * chips
        if len(numbers) != chips:
            msg = f'{name} must have one number for each of {chips} chips; received {len(numbers)}'
            raise ValueError(msg)
        return numbers

    @property
    def measuring(self) -> Mode:
        """How the chips are read, for the driver."""
        return 'burst' if self.mode == 'burst' else 'single'

    @property
    def tesla_per_count(self) -> npt.ArrayLike:
        """Step of x, y, z (T) at these settings, shape (3,)."""
        settings = self.settings
        return tesla_per_lsb(settings.gain, settings.resolution, settings.hallconf)


def open_chips(
    layout: Layout, connection: ChipConnection, clock_ns: Callable[[], int]
) -> ChipArray | FramedBoard:
    """Driver of chips over I2C or behind a serial port; not opened yet.

    Parameters
    ----------
    layout : Layout
        Of the sensor: t chips.
    connection : ChipConnection
        Where they are reached.
    clock_ns : callable
        Gives the stamps (ns).

    Returns
    -------
    ChipArray or FramedBoard
        A `Device`.

    Raises
    ------
    ValueError
        If the places do not fit the chips, or port or buses cannot carry the rate.
    """
    chips = layout.shape[0]
    if connection.transport == 'serial':
        payload = three_axis_chips(chips)
        return open_framed(layout, connection, payload, connection.tesla_per_count, clock_ns)
    return ChipArray(
        [I2cBus(path) for path in connection.buses],
        connection.places(chips),
        layout,
        connection.settings,
        mode=connection.measuring,
        rate_hz=layout.rate_hz,
        clock_ns=clock_ns,
        bus_hz=connection.bus_clock,
    )


def simulate_chips(
    layout: Layout,
    connection: ChipConnection,
    signal: Callable[[float], Array],
    noise: float | Array,
    seed: int,
    clock: VirtualClock | None = None,
) -> ChipArrayTwin | FramedTwin:
    """Twin of those chips, on simulated buses or on a pseudo-terminal; not entered yet.

    Parameters
    ----------
    layout, connection
        As in `open_chips`; ports and paths of buses are not used.
    signal : callable
        Time (s) -> flux density in chip axes, shape (t, 3) (T).
    noise : float or ndarray, shape (3,)
        Standard deviation of a reading (T).
    seed : int
        Of noise, oscillators and faults.
    clock : VirtualClock or None
        What buses or board run on; None: the machine's.

    Returns
    -------
    ChipArrayTwin or FramedTwin
        A `Twin`.
    """
    chips = layout.shape[0]
    if connection.transport == 'serial':
        payload, scale = three_axis_chips(chips), connection.tesla_per_count
        return simulate_framed(layout, connection, payload, scale, signal, noise, seed, clock)
    return ChipArrayTwin(
        connection.places(chips),
        layout,
        signal,
        settings=connection.settings,
        mode=connection.measuring,
        rate_hz=layout.rate_hz,
        noise=noise,
        hertz=connection.bus_clock or FASTEST_HZ,
        clock=clock,
        seed=seed,
    )


@dataclass(frozen=True)
class ChipSensor(Generic[Config]):
    """How one kind of sensor of chips is opened and simulated.

    Attributes
    ----------
    layout : callable
        Layout of a config.
    signal : callable
        Of a config and a seed: time (s) -> flux density, shape (t, 3) (T), that a twin plays.
    noise : float
        Standard deviation of a reading (T) where the config says none.
    """

    layout: Callable[[Config], Layout]
    signal: Callable[[Config, int], Callable[[float], Array]]
    noise: float

    def open(
        self, config: Config, connection: ChipConnection, clock_ns: Callable[[], int]
    ) -> Device:
        """Driver of `config` at `connection`, with stamps from `clock_ns`; not opened yet."""
        return open_chips(self.layout(config), connection, clock_ns)

    def simulate(
        self,
        config: Config,
        connection: ChipConnection,
        signal: Callable[[float], Array] | None = None,
        seed: int = 0,
        clock: VirtualClock | None = None,
    ) -> Twin:
        """Twin that plays `signal`, or the sensor's own; not entered yet."""
        return simulate_chips(
            self.layout(config),
            connection,
            self.signal(config, seed) if signal is None else signal,
            self.noise if config.noise is None else config.noise,
            seed,
            clock,
        )
