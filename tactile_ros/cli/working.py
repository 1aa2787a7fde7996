"""A sign of life from work that takes long: on a terminal the seconds, elsewhere one line."""

from __future__ import annotations

import sys
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import TextIO

PATIENCE_S = 2.0  # without a word
STEP_S = 0.5


@contextmanager
def working(
    what: str, stream: TextIO | None = None, patience_s: float = PATIENCE_S
) -> Iterator[None]:
    """Say what is being done once it takes longer than two seconds.

    Parameters
    ----------
    what : str
        Such as 'fitting'.
    stream : file, optional
        Default: stderr, so that tables and json stay clean.
    patience_s : float
        Silence before the first word (s).
    """
    done = threading.Event()
    told = (what, stream or sys.stderr, patience_s, done)
    teller = threading.Thread(target=_tell, args=told, daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


def _tell(what: str, stream: TextIO, patience_s: float, done: threading.Event) -> None:
    """Wait, then tell; leave the line empty at the end."""
    began = time.monotonic()
    if done.wait(patience_s):
        return
    if not stream.isatty():
        print(f'{what} ...', file=stream, flush=True)
        return
    while not done.wait(STEP_S):
        seconds = time.monotonic() - began
        print(f'\r{what} ... {seconds:.0f} s', end='', file=stream, flush=True)
    print('\r\033[K', end='', file=stream, flush=True)
