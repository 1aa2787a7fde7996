"""Baselines of a live run beside the frames that each holds for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Frame, Integers, Recording


def baselines_by_row(
    recording: Recording, rows: Integers, baselines: Sequence[Frame]
) -> dict[int, list[Frame]]:
    """Baselines by the processed row before which each comes in.

    A counter that starts again makes its sequence ambiguous: a baseline goes to the first stream
    that has it and is not older than the baseline before it.
    """
    if recording.sequence is None or not len(rows):
        return {}
    sequence = recording.sequence[rows]
    streams = np.cumsum(recording.restarts)[rows]
    found: dict[int, list[Frame]] = {}
    stream, previous = int(streams[0]), -1
    for baseline in baselines:
        if baseline.sequence < previous:
            stream += 1
        previous = baseline.sequence
        later = np.flatnonzero((streams == stream) & (sequence >= baseline.sequence))
        if len(later):
            found.setdefault(int(rows[later[0]]), []).append(baseline)
    return {row: group[-1:] for row, group in found.items()}
