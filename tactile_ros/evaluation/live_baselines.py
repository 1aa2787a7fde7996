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

    A counter that starts again makes its sequence ambiguous: a baseline belongs to the stream with
    a frame of its stamp; where none has one, to that of the baseline before it, or to the next
    where its sequence went back.
    """
    if recording.sequence is None or not len(rows):
        return {}
    sequence = recording.sequence[rows]
    number = np.cumsum(recording.restarts)
    streams = number[rows]
    stamps = [] if recording.stamp_ns is None else recording.stamp_ns.tolist()
    homes = dict(zip(stamps, number.tolist(), strict=False))
    found: dict[int, list[Frame]] = {}
    stream, previous = int(streams[0]), -1
    for baseline in baselines:
        home = homes.get(baseline.stamp_ns, -1)
        if home >= stream:
            stream = home
        elif baseline.sequence < previous:
            stream += 1
        previous = baseline.sequence
        later = np.flatnonzero((streams == stream) & (sequence >= baseline.sequence))
        if len(later):
            found.setdefault(int(rows[later[0]]), []).append(baseline)
    return {row: group[-1:] for row, group in found.items()}
