# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Work that takes long says so, and what is quick says nothing."""

from __future__ import annotations

import io
import threading
import time

import pytest

from tactile_ros.cli.console import SHARE, TimeEstimate, working


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


def spend(seconds: float = 0.02) -> None:
    """Work of a processor."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def fail() -> None:
    raise ValueError


def wait_for(estimate: TimeEstimate) -> None:
    estimate._beside.join(20.0)
    assert estimate._beside.exitcode == 0


def test_an_estimate_tells_how_long_the_whole_takes() -> None:
    with TimeEstimate(spend) as estimate:
        wait_for(estimate)
        assert 0.02 * SHARE <= estimate.expected_s < 0.2 * SHARE


def test_an_estimate_that_fails_tells_nothing() -> None:
    with TimeEstimate(fail) as estimate:
        wait_for(estimate)
        assert estimate.expected_s == 0.0


def test_long_work_is_told_with_its_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('tactile_ros.cli.console.STEP_S', 0.01)
    monkeypatch.setattr('os.sched_getaffinity', lambda _: {0, 1})
    stream = Heard(tty=False)
    with working('fitting', stream, patience_s=0.0, part=spend):
        assert stream.told.wait(10.0)
        stream.told.clear()
        while ' s of about ' not in stream.getvalue():
            assert stream.told.wait(10.0)
            stream.told.clear()
    assert stream.getvalue().startswith('fitting ...\nfitting ... 0 s of about 0 s\n')
