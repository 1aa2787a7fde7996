# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The command `tactile`: one file per command; Ctrl-C ends any of them in one line."""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tactile_ros import use_one_thread

INTERRUPTED = 130
_started: list[int] = []  # process id of the command, not of those that it forks

use_one_thread()


def start() -> int:
    """Run the command of `sys.argv`, so that an interrupt ends it at any moment.

    Nothing else is imported before: the packages that follow take most of the first second.
    """
    _started.append(os.getpid())
    signal.signal(signal.SIGINT, _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # as bin/tactile blocks it
    from tactile_ros.cli.main import main

    return main()


def _end(*_: object) -> None:
    """End this process at once; those that it started end with it."""
    try:
        if os.getpid() in _started:
            os.write(2, b'tactile: interrupted\n')
            forks = sys.modules.get('multiprocessing')
            for child in forks.active_children() if forks else ():
                child.kill()
                child.join()
            files = sys.modules.get('tactile_ros.files')
            for part in map(Path, tuple(files.UNFINISHED if files else ())):
                shutil.rmtree(part, ignore_errors=True)
                part.unlink(missing_ok=True)
    finally:
        os._exit(INTERRUPTED)


@contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt inside, for commands that end in order."""
    before = signal.getsignal(signal.SIGINT)
    if before is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        if before is _end:
            signal.signal(signal.SIGINT, before)
