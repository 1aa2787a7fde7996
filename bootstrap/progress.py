# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Say what set-up is doing: one line per step, a counter while it runs, the rest in a log file."""

import ctypes
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from machine import SetupError

START = time.monotonic()
PR_SET_PDEATHSIG = 1  # linux/prctl.h
EVERY = 5.0  # s, between two lines where the terminal cannot overwrite one


def say(text: str) -> None:
    """Print one line with the time since the start."""
    print(f'[{time.monotonic() - START:4.0f} s] {text}', flush=True)


class Counter:
    """A counter on one line of a terminal, or on a line every few seconds elsewhere."""

    def __init__(self, what: str) -> None:
        self.what, self.last = what, time.monotonic()

    def show(self, text: str) -> None:
        """Show the newest state; on a terminal the last one, empty, clears the line."""
        line = f'         {self.what}: {text}' if text else ''
        if sys.stdout.isatty():
            print(f'\r{line:<79}', end='' if line else '\r', flush=True)
        elif line and time.monotonic() - self.last > EVERY:
            self.last = time.monotonic()
            print(line, flush=True)


def run(
    command: list[str],
    *,
    log: Path,
    what: str,
    env: dict[str, str],
    pattern: str = r'$^',
    total: int = 0,
) -> None:
    """Run a command, its output into the log; lines that match `pattern` are counted and shown."""
    counter, seen = Counter(what), 0
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open('a') as file:
        file.write(f'$ {" ".join(command)}\n')
        with subprocess.Popen(
            command,
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            preexec_fn=end_with_parent,  # noqa: PLW1509  (there are no threads)
        ) as process:
            try:
                for line in process.stdout or ():
                    file.write(line)
                    if found := re.match(pattern, line):
                        seen += 1
                        of = f'{seen}/{total} ' if total else ''
                        counter.show(of + found[found.lastindex or 0])
            except BaseException:
                process.terminate()
                raise
            finally:
                counter.show('')
    if process.returncode:
        raise SetupError(failure(what, log))


def end_with_parent() -> None:
    """Let a killed set-up take its child along, or that would go on filling the environment."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def failure(what: str, log: Path) -> str:
    """One sentence about a command that failed: the last error it wrote."""
    text = log.read_text(errors='replace').rpartition('\n$ ')[2]
    lines = [line.strip() for line in text.splitlines()]
    if 'Retrying (' in text and 'connection' in text.lower():
        return f'{what} failed: the package index cannot be reached (all of it is in {log}).'
    error = re.compile(r'(\S+: )?(fatal |CMake )?error\b', re.I)
    last = max((i for i, line in enumerate(lines) if error.match(line)), default=len(lines) - 1)
    reason = ' '.join(lines[last : last + 4 if lines[last].endswith(':') else last + 1])
    return f'{what} failed: {reason} (all of it is in {log}).'
