"""Work that takes long says so, and what is quick says nothing."""

from __future__ import annotations

import io
import threading

from tactile_ros.cli.console import working


class Heard(io.StringIO):
    """A stream that tells when something was written."""

    def __init__(self, tty: bool) -> None:
        super().__init__()
        self.tty, self.told = tty, threading.Event()

    def isatty(self) -> bool:
        return self.tty

    def write(self, text: str) -> int:
        count = super().write(text)
        self.told.set()
        return count


def test_quick_work_is_silent() -> None:
    stream = Heard(tty=False)
    with working('fitting', stream, patience_s=60.0):
        pass
    assert stream.getvalue() == ''


def test_long_work_is_one_line_in_a_file() -> None:
    stream = Heard(tty=False)
    with working('fitting', stream, patience_s=0.0):
        assert stream.told.wait(10.0)
    assert stream.getvalue() == 'fitting ...\n'


def test_a_terminal_sees_the_seconds_and_then_an_empty_line() -> None:
    stream = Heard(tty=True)
    with working('fitting', stream, patience_s=0.0):
        assert stream.told.wait(10.0)
    assert stream.getvalue().startswith('\rfitting ... ')
    assert stream.getvalue().endswith('\r\033[K')
