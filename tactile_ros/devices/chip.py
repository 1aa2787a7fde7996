"""One MLX90393 on its bus: reset, registers, start and read, each one exchange of bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_ros.devices.mlx90393 import (
    TREF_REGISTER,
    ChipSettings,
    Command,
    Status,
    register_read,
    register_write,
)
from tactile_ros.errors import DeviceError

if TYPE_CHECKING:
    from tactile_ros.devices.mux import ChipPlace, Switches
    from tactile_ros.devices.transport import I2cBus


class CommandRefused(DeviceError):
    """A chip answers, but does not do what its datasheet says."""


class Chip:
    """A chip, the road to it, and what the driver remembers of it.

    Parameters
    ----------
    place : ChipPlace
        Where it is reached.
    bus : I2cBus
        Its bus.
    switches : Switches
        Those of its bus.
    settings : ChipSettings
        How it shall measure.

    Attributes
    ----------
    tref : int
        Its thermometer's reference word.
    lost : bool
        Whether it has to be reset before it is read again.
    configured : bool
        Whether it ever was.
    losses : int
        Times that it was lost since it was last read.
    retry_ns, pause_s : int, float
        When to try again, and how long the pause before that was.
    started_ns, ready_ns, read_ns : int
        When its measurement began, when the next is ready, when the last was asked for.
    fresh : bool
        Whether it had time for a new measurement between the last two readings.
    """

    def __init__(
        self, place: ChipPlace, bus: I2cBus, switches: Switches, settings: ChipSettings
    ) -> None:
        """See the class."""
        self.place = place
        self.bus = bus
        self.switches = switches
        self.tref = 0
        self.lost = True
        self.configured = False
        self.losses = 0
        self.retry_ns = 0
        self.pause_s = 0.0
        self.started_ns = 0
        self.ready_ns = 0
        self.read_ns = 0
        self.fresh = True
        self._settings = settings
        self._read = bytes((Command.READ | settings.axes,))
        self._single = bytes((Command.START_SINGLE | settings.axes,))
        self._burst = bytes((Command.START_BURST | settings.axes,))

    def ask(self, command: bytes, count: int) -> bytes:
        """Exchange bytes with the chip, through its switch."""
        self.switches.select(self.place.mux, self.place.channel)
        return self.bus.transfer(self.place.address, command, count)

    def start_single(self) -> int:
        """Start one measurement; the status that answers."""
        return self.ask(self._single, 1)[0]

    def start_burst(self) -> int:
        """Start measuring without end; the status that answers."""
        return self.ask(self._burst, 1)[0]

    def read(self) -> bytes:
        """Status and data of the last measurement."""
        return self.ask(self._read, self._settings.answer_bytes)

    def exit(self) -> int:
        """End whatever it does, 1 ms has to pass then; the status that answers."""
        return self.ask(bytes((Command.EXIT,)), 1)[0]

    def reset(self) -> bytes:
        """Reset it; 2 ms have to pass then. The status is left for `configure` to see."""
        return self.ask(bytes((Command.RESET,)), 0)

    def configure(self) -> None:
        """Write the settings into a chip that was just reset, verify them and read TREF.

        Raises
        ------
        CommandRefused
            If it was not reset, refuses a command or does not keep what was written.
        """
        status = self.ask(bytes((Command.NOP,)), 1)[0]
        if not status & Status.RESET:
            msg = f'chip {self.place} was not reset (status {status:#04x}): is it an MLX90393?'
            raise CommandRefused(msg)
        words: dict[int, int] = {}
        wanted: dict[int, int] = {}
        for field, value in self._settings.fields:
            if field.register not in words:
                words[field.register] = self._register(field.register)
                wanted[field.register] = words[field.register]
            wanted[field.register] = field.put(wanted[field.register], value)
        for register, word in wanted.items():
            if word != words[register]:
                self._write(register, word)
        self.tref = self._register(TREF_REGISTER)
        self.configured = True

    def _register(self, register: int) -> int:
        """Word of a register."""
        status, high, low = self.ask(register_read(register), 3)
        self._refuse(status, f'read register {register:#04x}')
        return high << 8 | low

    def _write(self, register: int, word: int) -> None:
        """Write a register and read it back."""
        (status,) = self.ask(register_write(register, word), 1)
        self._refuse(status, f'write register {register:#04x}')
        kept = self._register(register)
        if kept != word:
            msg = (
                f'chip {self.place} keeps {kept:#06x} in register {register:#04x}, not {word:#06x}'
            )
            raise CommandRefused(msg)

    def _refuse(self, status: int, what: str) -> None:
        """Raise where a command was rejected or the chip has reset in between."""
        if status & (Status.ERROR | Status.RESET):
            msg = f'chip {self.place} did not {what} (status {status:#04x})'
            raise CommandRefused(msg)
