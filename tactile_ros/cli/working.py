"""A sign of life from work that takes long: on a terminal the seconds, elsewhere one line."""

from __future__ import annotations

import sys
import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import TracebackType
    from typing import TextIO

PATIENCE_S = 2.0  # without a word
STEP_S = 0.5


class Working:
    """Say what is being done once it takes longer than two seconds; a context manager.

    Parameters
    ----------
    what : str
        Such as 'fitting'.
    stream : file, optional
        Default: stderr, so that tables and json stay clean.
    patience_s : float
        Silence before the first word (s).
    """

    def __init__(
        self, what: str, stream: TextIO | None = None, patience_s: float = PATIENCE_S
    ) -> None:
        self.what, self._stream = what, stream or sys.stderr
        self._patience_s = patience_s
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._tell, daemon=True)

    def __enter__(self) -> Working:
        """Begin to wait."""
        self._began = time.monotonic()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Say no more, and leave the line empty."""
        self._done.set()
        self._thread.join()

    def _tell(self) -> None:
        """Wait, then tell."""
        if self._done.wait(self._patience_s):
            return
        if not self._stream.isatty():
            print(f'{self.what} ...', file=self._stream, flush=True)
            return
        while not self._done.wait(STEP_S):
            seconds = time.monotonic() - self._began
            print(f'\r{self.what} ... {seconds:.0f} s', end='', file=self._stream, flush=True)
        print('\r\033[K', end='', file=self._stream, flush=True)
