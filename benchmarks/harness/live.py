# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Live runs: cost of their processes, and the replay of their bags."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from benchmarks.harness.rows import Row
from tactile_ros.evaluation.metrics import spread
from tactile_ros.evaluation.recording_files import LiveContacts, load
from tactile_ros.evaluation.replay import replay
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Array, Recording

PAGE_KIB = os.sysconf('SC_PAGE_SIZE') / 1024
QUIET = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
SAME = 1e-9


def processor_s(pid: int) -> float:
    """User and system time of a process so far (s)."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def resident_kib(pid: str | int = 'self') -> float:
    """Resident memory of a process (KiB)."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * PAGE_KIB


@dataclass(frozen=True)
class Replayed:
    """A bag of a live run beside its replay: delays (s) of contacts, and how they agree."""

    recording: Recording
    live: LiveContacts
    delay: Array
    lost: int
    difference: float
    us_single: float

    @classmethod
    def of(cls, bag: Path, pipeline: Pipeline) -> Replayed:
        """Replay a bag."""
        loaded = load(bag).recordings[0]
        found, live = replay(loaded, pipeline), loaded.contacts
        delay = (live.log_ns - loaded.recording.stamp_ns[live.rows]) * 1e-9
        agreement = found.agreement
        return cls(
            loaded.recording, live, delay, agreement.without_contacts, agreement.largest,
            found.us_single,
        )  # fmt: skip

    def rows(self, name: str) -> list[Row]:
        """Delays, losses and agreement of a run."""
        delay = spread(self.delay)
        return [
            Row(f'{name}: delay p50', 'ms', 1e3 * delay.p50, us_single=self.us_single),
            Row(f'{name}: delay p99', 'ms', 1e3 * delay.p99),
            Row(f'{name}: frames lost', 'frames', float(self.lost), bound=0.0, aim=0.0),
            Row(f'{name}: largest difference to replay', '1', self.difference, bound=0.0,
                aim=SAME),
        ]  # fmt: skip
