"""Serial ports by pyserial, opened lazily; every failure is one sentence that says what to do."""

from __future__ import annotations

import errno
import select
from typing import TYPE_CHECKING

from tactile_ros.errors import DeviceError, MissingPackageError

if TYPE_CHECKING:
    from types import ModuleType

    import serial

READ_BYTES = 4096


def _pyserial() -> ModuleType:
    """The package, where it is needed."""
    try:
        import serial
        import serial.tools.list_ports
    except ImportError as err:
        msg = 'serial ports need pyserial: pip install pyserial (or apt install python3-serial)'
        raise MissingPackageError(msg) from err
    return serial


def list_ports() -> list[str]:
    """Names of the serial ports that this machine has."""
    return sorted(port.device for port in _pyserial().tools.list_ports.comports())


def _choice() -> str:
    """The ports that exist, as the end of a sentence."""
    ports = list_ports()
    if not ports:
        return 'this machine has no serial port now: plug the board in'
    return f'ports here: {", ".join(ports)}'


def _refusal(port: str, err: OSError) -> str:
    """Why a port could not be opened and what to do, in one sentence."""
    if err.errno == errno.ENOENT:
        return f'port {port} does not exist; {_choice()}'
    if err.errno in (errno.EAGAIN, errno.EBUSY):
        return f'port {port} is busy: close the program that reads it; {_choice()}'
    if err.errno in (errno.EACCES, errno.EPERM):
        return (
            f'port {port} may not be opened by this user: '
            f'add the user to the group dialout and log in again; {_choice()}'
        )
    return f'port {port} cannot be opened ({err}); {_choice()}'


class SerialPort:
    """A serial port that is read by one program, blocking and without busy waiting.

    Parameters
    ----------
    port : str
        Device path; a path under /dev/serial/by-id survives replugging.
    baud : int
        Baud rate; native USB boards ignore it.
    """

    def __init__(self, port: str, baud: int = 115200) -> None:
        """See the class."""
        self.port = port
        self.baud = baud
        self._serial: serial.Serial | None = None
        self._poll: select.poll | None = None

    @property
    def is_open(self) -> bool:
        """Whether the port is held."""
        return self._serial is not None

    def open(self) -> None:
        """Hold the port for this program alone; what it had received before is discarded.

        Raises
        ------
        DeviceError
            If it is missing, busy or forbidden.
        MissingPackageError
            If pyserial is not installed.
        """
        if self._serial is not None:
            return
        pyserial = _pyserial()
        try:
            device = pyserial.Serial(self.port, self.baud, timeout=0, exclusive=True)
        except (OSError, ValueError) as err:
            failure = err if isinstance(err, OSError) else OSError(str(err))
            raise DeviceError(_refusal(self.port, failure)) from err
        self._serial = device
        self._poll = select.poll()
        self._poll.register(device.fileno(), select.POLLIN)

    def close(self) -> None:
        """Let the port go; closing twice is allowed."""
        device, self._serial, self._poll = self._serial, None, None
        if device is not None:
            device.close()

    def read(self, timeout: float) -> bytes:
        """Wait for bytes and take all that there are.

        Parameters
        ----------
        timeout : float
            Longest wait for the first byte (s).

        Returns
        -------
        bytes
            At most 4096; none when nothing came in time.

        Raises
        ------
        DeviceError
            If the port is not open or is gone; it is closed then.
        """
        if self._serial is None or self._poll is None:
            msg = f'port {self.port} is not open'
            raise DeviceError(msg)
        try:
            if not self._poll.poll(max(0.0, timeout) * 1e3):
                return b''
            return bytes(self._serial.read(READ_BYTES))
        except OSError as err:
            self.close()
            msg = f'port {self.port} was unplugged or taken by another program; {_choice()}'
            raise DeviceError(msg) from err

    def write(self, data: bytes) -> None:
        """Send bytes to the device.

        Raises
        ------
        DeviceError
            If the port is not open or is gone; it is closed then.
        """
        if self._serial is None:
            msg = f'port {self.port} is not open'
            raise DeviceError(msg)
        try:
            self._serial.write(data)
        except OSError as err:
            self.close()
            msg = f'port {self.port} was unplugged; {_choice()}'
            raise DeviceError(msg) from err
