# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What the bench of delays says of threads: of a lock, of bytes, of a processor."""

from __future__ import annotations

import os
import select
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.worlds import grip_waits

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PATIENCE_S = 20.0


@pytest.fixture
def sleepers() -> Iterator[dict[str, int]]:
    """One thread that waits for a lock, one that waits for bytes: their ids by kind."""
    lock, (end, begin) = threading.Lock(), os.pipe()
    lock.acquire()
    ids: dict[str, int] = {}
    poll = select.poll()
    poll.register(end, select.POLLIN)

    def sleeping(kind: str, wait: Callable[[], object]) -> threading.Thread:
        def work() -> None:
            ids[kind] = threading.get_native_id()
            wait()

        thread = threading.Thread(target=work)
        thread.start()
        return thread

    threads = [sleeping('lock', lock.acquire), sleeping('bytes', poll.poll)]
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline and not (
        len(ids) == 2
        and grip_waits.LOCK in _where(ids['lock'])
        and _where(ids['bytes']) not in grip_waits.AWAKE
        and grip_waits.LOCK not in _where(ids['bytes'])
    ):
        if not Path('/proc/self/wchan').exists():
            break
        time.sleep(1e-3)  # the lock of the interpreter is theirs meanwhile
    yield ids
    lock.release()
    os.write(begin, b'0')
    for thread in threads:
        thread.join()
    os.close(end)
    os.close(begin)


def _where(thread: int) -> str:
    return grip_waits._where(Path(f'/proc/{os.getpid()}/task/{thread}/wchan'))


def test_threads_asleep_are_told_apart(sleepers: dict[str, int]) -> None:
    if _where(sleepers['lock']) in ('', '0'):
        pytest.skip('this system does not tell where threads sleep')
    me = os.getpid()
    assert grip_waits.asleep(me, [sleepers['lock']], 0.05) == (1.0, 0.0)
    assert grip_waits.asleep(me, [sleepers['bytes']], 0.05) == (0.0, 1.0)
    assert grip_waits.asleep(me, list(sleepers.values()), 0.05) == (0.5, 0.5)
    assert np.isnan(grip_waits.asleep(me, [], 0.01)).all()


def test_shares_are_of_the_threads_that_read_alone() -> None:
    before = {1: (1.0, 0.1), 2: (2.0, 0.2), 3: (0.0, 0.0)}
    after = {1: (1.5, 0.2), 2: (3.0, 0.5), 3: (9.0, 9.0)}
    waits = grip_waits.waits_of([1, 2, 4], before, after, (0.25, 0.05), 2.0)
    assert (waits.ran, waits.ready) == (pytest.approx(0.375), pytest.approx(0.1))
    assert waits.tell() == (
        'the threads that read and answer, of the time: ran for 38 %, were ready without a '
        'processor for 10 %, slept until a lock was free for 25 %, slept until bytes came for 5 %'
    )
    assert 'bytes' in grip_waits.waits_of([4], before, after, (0.0, 0.0), 2.0).tell()
    assert grip_waits.waits_of([4], before, after, (np.nan, np.nan), 2.0) is None


def test_what_the_system_does_not_tell_is_not_zero() -> None:
    none = {1: (0.0, 0.0)}
    assert grip_waits.waits_of([1], none, none, grip_waits.asleep(0, [1], 0.01), 1.0) is None
    found = grip_waits.waits_of([1], none, none, (0.25, 0.5), 1.0)
    assert found.tell() == (
        'the threads that read and answer, of the time: slept until a lock was free for 25 %, '
        'slept until bytes came for 50 %'
    )
    assert grip_waits.Waits(*[np.nan] * 4).tell() == grip_waits.UNTOLD
