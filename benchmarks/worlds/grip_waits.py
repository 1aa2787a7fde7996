# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What the threads that read and answer frames wait for: a processor, a lock, or bytes.

The kernel tells in /proc how long a thread ran and how long it was ready without a processor; in
which of its functions a thread sleeps is looked at again and again, from another process.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import isnan, nan
from pathlib import Path
from threading import get_native_id

from tactile_ros.nodes.sensor_node import Reader

LOOK_S = 5e-3
LOCK = 'futex'  # in the name of the kernel function that waits for a lock
AWAKE = ('', '0')
UNTOLD = 'this system does not tell what its threads waited for'


@dataclass(frozen=True)
class Waits:
    """Shares of the time of some threads.

    Attributes
    ----------
    ran, ready : float
        Running, and ready without a processor.
    lock, input : float
        Asleep until another thread lets go of a lock, and for anything else: bytes of the board.
        NaN: this system does not tell.
    """

    ran: float
    ready: float
    lock: float
    input: float

    def tell(self) -> str:
        """As a sentence."""
        parts = {
            'ran': self.ran, 'were ready without a processor': self.ready,
            'slept until a lock was free': self.lock, 'slept until bytes came': self.input,
        }  # fmt: skip
        known = [f'{what} for {100 * share:.0f} %' for what, share in parts.items() if share >= 0]
        if not known:
            return UNTOLD
        return f'the threads that read and answer, of the time: {", ".join(known)}'


def note(path: str) -> None:
    """Let each reader of this process write its thread into a file."""
    run = Reader._run

    def noted(self: Reader) -> None:
        with Path(path).open('a', encoding='ascii') as kept:
            kept.write(f'{get_native_id()}\n')
        run(self)

    Reader._run = noted  # type: ignore[method-assign]


def asleep(pid: int, threads: list[int], seconds: float) -> tuple[float, float]:
    """Shares of a time (s) in which threads of a process slept for locks and for all else.

    NaN where no look found any of them asleep: the kernel does not tell, or they have ended.
    """
    end = time.monotonic() + seconds
    places = [Path(f'/proc/{pid}/task/{thread}/wchan') for thread in threads]
    seen = []
    while time.monotonic() < end:
        seen += [_where(place) for place in places]
        time.sleep(LOOK_S)
    slept = [LOCK in where for where in seen if where not in AWAKE]
    if not slept:
        return nan, nan
    return sum(slept) / len(seen), slept.count(False) / len(seen)


def _where(place: Path) -> str:
    """Kernel function in which a thread sleeps; 0 or empty: in none, or it has ended."""
    try:
        return place.read_text('ascii')
    except OSError:
        return ''


def waits_of(
    threads: list[int],
    before: dict[int, tuple[float, float]],
    after: dict[int, tuple[float, float]],
    slept: tuple[float, float],
    seconds: float,
) -> Waits | None:
    """Waits of threads by `kept_waiting` before and after some time (s); None: nothing is told."""
    found = [thread for thread in threads if thread in before and thread in after]
    moved = any(after[thread] != before[thread] for thread in found)
    if not moved:
        return None if isnan(slept[0]) else Waits(nan, nan, *slept)
    ran, ready = (
        sum(after[thread][i] - before[thread][i] for thread in found) / len(found) / seconds
        for i in (0, 1)
    )
    return Waits(ran, ready, *slept)
