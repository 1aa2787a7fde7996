"""A first look at the beginning of a bag: by how much truth on topics of its own is late.

Truth that names its frame (TactileContacts with the frame's stamp or sequence) has no delay.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.bag_reader import BagContent, read_parts
from tactile_ros.evaluation.cdr_columns import Columns, read_columns
from tactile_ros.evaluation.message_columns import stamps_of
from tactile_ros.evaluation.topics import FRAME, ends_as, is_frame, split_topic
from tactile_ros.evaluation.truth import READERS, Delay, estimate_delay, read_told
from tactile_ros.evaluation.waiting import Waiting

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tactile_ros.evaluation.bag_reader import Taker
    from tactile_ros.types import Array, Integers

MOST_FRAMES = 12_000
MOST_TOLD = 200_000


@dataclass
class _Seen:
    """What was heard of the topics that matter."""

    frames: dict[str, Waiting] = field(default_factory=dict)
    truth: dict[str, Waiting] = field(default_factory=dict)

    @property
    def enough(self) -> bool:
        """Whether more would cost memory and tell little."""
        frames = max((len(queue) for queue in self.frames.values()), default=0)
        told = max((len(queue) for queue in self.truth.values()), default=0)
        return frames >= MOST_FRAMES or told >= MOST_TOLD


def survey(path: Path, truth_topics: Sequence[str]) -> dict[str, Delay | None]:
    """Delay of every topic of standard messages that tell the truth; None: not told.

    Parameters
    ----------
    path : Path
        Of a bag; at most its first 12 000 frames are read.
    truth_topics : sequence of str
        As of `recording.load`.
    """
    seen, content = _Seen(), BagContent()

    def taker(topic: str, kind: str) -> Taker | None:
        if is_frame(topic, kind):
            return seen.frames.setdefault(topic, Waiting(kind)).append
        if _may_be_late(topic, kind, truth_topics):
            return seen.truth.setdefault(topic, Waiting(kind)).append
        return None

    for _ in read_parts(path, content, taker):
        told = content.announced.items()
        if told and not any(_may_be_late(t, k, truth_topics) for t, k in told):
            return {}
        if seen.enough:
            break
    return {topic: _delay(topic, queue, seen.frames) for topic, queue in seen.truth.items()}


def _may_be_late(topic: str, kind: str, truth_topics: Sequence[str]) -> bool:
    """Whether a topic is truth that may be late."""
    return kind in READERS and any(ends_as(topic, name) for name in truth_topics)


def _delay(topic: str, queue: Waiting, frames: dict[str, Waiting]) -> Delay | None:
    """Delay of one topic behind the frames of its sensor."""
    near = [t for t in frames if topic.startswith(f'{split_topic(t)[0]}/')] or list(frames)
    if not near:
        return None
    own = frames[max(near, key=len)]
    told = read_told(queue.data, queue.type_name)
    times, felt, logs = _felt(own)
    if not (len(times) and len(told.times)):
        return None
    level = _level(told.truth)
    known = np.isfinite(level)
    late, heard = told.times[known], np.array(queue.logs, np.int64)[told.rows][known]
    if not len(late):
        return None
    # clocks that were never set to one another differ by what the recorder heard of them
    apart = int(np.median(late - heard)) - int(np.median(times - logs))
    order = np.argsort(late, kind='stable')
    found = estimate_delay(times, felt, late[order] - apart, level[known][order])
    if found is None:
        return None
    return Delay(found.delay_ns + apart, found.std_ns, found.correlation, found.stretches)


def _felt(queue: Waiting) -> tuple[Integers, Array, Integers]:
    """Stamps, how far each frame is from the usual one, and log times, in the order of time."""
    groups, _ = read_columns(queue.data, FRAME)
    sizes = [group.columns['values'].shape[1] for group in groups]
    groups = [g for g, n in zip(groups, sizes, strict=True) if n == max(sizes)]
    if not groups:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64)
    values = np.concatenate([group.columns['values'] for group in groups])
    stamps = np.concatenate([stamps_of(group.columns) for group in groups])
    logs = np.array(queue.logs, np.int64)[np.concatenate([group.rows for group in groups])]
    away = np.nan_to_num(values - np.nanmedian(values, axis=0))
    order = np.argsort(stamps, kind='stable')
    return stamps[order], np.asarray(np.sqrt((away**2).sum(axis=1)))[order], logs[order]


def _level(truth: Columns) -> Array:
    """One number for each message: the size of a force, or the height of a probe."""
    if 'force' in truth:
        force = np.asarray(truth['force'], np.float64)
        return np.asarray(np.sqrt(np.nansum(force**2, axis=1)))
    return np.asarray(truth['position'], np.float64)[:, 2]
