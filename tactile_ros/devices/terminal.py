"""A terminal whose reads wait for their first byte, whatever other programs set on it."""

from __future__ import annotations

import os
import termios
import time

WAITS_S = 0.1  # the least that terminals wait for
LOOK_S = 1.0


class WaitingReads:
    """Settings by which reads wait, for `WAITS_S` at most: no call but them lets go of the lock.

    A busy thread takes Python's lock at each call more. Another program may open the port all the
    same and let reads wait for ever, as those that look for modems do; that is undone.

    Parameters
    ----------
    terminal : int
        Descriptor.

    Raises
    ------
    termios.error
        If the device is gone.
    """

    def __init__(self, terminal: int) -> None:
        """See the class."""
        wanted = termios.tcgetattr(terminal)
        wanted[6][termios.VMIN], wanted[6][termios.VTIME] = 0, round(10 * WAITS_S)
        termios.tcsetattr(terminal, termios.TCSANOW, wanted)
        os.set_blocking(terminal, True)
        self._terminal = terminal
        self._wanted = termios.tcgetattr(terminal)
        self._due_s = 0.0

    def read(self, count: int) -> bytes:
        """At most so many bytes; none where none came in time, or the device is gone."""
        if time.monotonic() >= self._due_s:
            self._restore()
        data = os.read(self._terminal, count)
        # while bytes come every read returns: now and then is enough
        self._due_s = time.monotonic() + LOOK_S if data else 0.0
        return data

    def _restore(self) -> None:
        """Undo what another program has set."""
        if termios.tcgetattr(self._terminal) != self._wanted:
            termios.tcsetattr(self._terminal, termios.TCSANOW, self._wanted)
