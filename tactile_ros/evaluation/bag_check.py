# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Health of a bag: its topics, frames lost, repeated or out of time, dead taxels; its repair.

The bag is read as a replay reads it, in pieces, so that a check names what a replay leaves out.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_ros.conditioning.faults import UNUSABLE, taxel_faults
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag import (
    PACKAGE,
    BagContent,
    BagWriter,
    Taker,
    all_types,
    read_bag,
    same_fields,
)
from tactile_ros.evaluation.recording_files import PIECE, Bag
from tactile_ros.evaluation.truth import FrameTimes
from tactile_ros.files import temporary_folder
from tactile_ros.types import Array, Integers, Recording

NS = 1e-9
JUMP, DRIFT = 2.5, 0.1  # periods that a stamp may be off; and per lost frame
MOSTLY = 0.5  # of the frames


@dataclass
class TopicCheck:
    """Messages of one topic, and when they were received (ns)."""

    type_name: str
    schema: str  # comparison of the definition in the bag with ours
    messages: int = 0
    first_ns: int = 0
    last_ns: int = 0
    pause_ns: int = 0  # the longest

    def count(self, log_ns: int) -> None:
        """Count a message."""
        if not self.messages:
            self.first_ns = self.last_ns = log_ns
        self.messages += 1
        self.pause_ns = max(self.pause_ns, log_ns - self.last_ns)
        self.last_ns = max(self.last_ns, log_ns)

    @property
    def rate_hz(self) -> float:
        """Mean rate (Hz); NaN: it has too few messages."""
        span = (self.last_ns - self.first_ns) * NS
        return (self.messages - 1) / span if span > 0 else float('nan')


@dataclass(frozen=True)
class FrameCheck:
    """Frames of one sensor."""

    frames: int
    repeats: int  # that stand there twice
    restarts: int  # frames at which the counter began again
    period_s: float  # usual distance of stamps
    lost: Integers  # (n,) frames missing in every gap of the counter
    jumps: Array  # (n,) time by which a stamp is off what the counter lets expect (s)
    dead: dict[int, float]  # taxels unusable in most frames, or never changing: share of frames
    problems: tuple[str, ...]  # sentences about what a replay leaves out

    @classmethod
    def of(cls, times: FrameTimes, taxels: TaxelCheck, problems: tuple[str, ...]) -> FrameCheck:
        """Compare the stamps and the counter of frames."""
        keys = np.column_stack([times.stamp_ns, times.sequence])
        _, first = np.unique(keys, axis=0, return_index=True)
        stamps, counter = keys[np.sort(first)].T
        steps, counts = np.diff(stamps) * NS, np.diff(counter)
        single = steps[(counts == 1) & (steps > 0)]
        period = float(np.median(single)) if len(single) else float('nan')
        off = steps - counts * period
        bad = (np.abs(off) > period * (JUMP + DRIFT * counts)) | (steps <= 0)
        return cls(
            frames=len(times), repeats=len(times) - len(first),
            restarts=int((counts <= 0).sum()), period_s=period, lost=counts[counts > 1] - 1,
            jumps=off[bad & (counts > 0)], dead=taxels.dead, problems=problems,
        )  # fmt: skip


class TaxelCheck:
    """Frames in which every taxel says something new, and in which it cannot be used."""

    def __init__(self) -> None:
        self.frames = 0
        self._last: Array | None = None
        self._moved = self._unusable = np.zeros(0, np.int64)

    def add(self, recording: Recording) -> None:
        """Take the next piece in."""
        values = recording.values
        if self._last is None:
            self._moved = self._unusable = np.zeros(values.shape[1], np.int64)
            self._last = values[:1]
        steps = np.abs(np.diff(values, axis=0, prepend=self._last))
        bits = taxel_faults(values, recording.status, recording.layout)
        self._moved = self._moved + (steps > 0).any(axis=2).sum(axis=0)
        self._unusable = self._unusable + ((bits & UNUSABLE) > 0).sum(axis=0)
        self._last = values[-1:]
        self.frames += len(values)

    @property
    def dead(self) -> dict[int, float]:
        """Taxels that cannot be used in most frames, or stand still where most others do not."""
        share = self._unusable / max(self.frames, 1)
        usual = self._moved[share <= MOSTLY]
        if len(usual) and np.median(usual) > MOSTLY * self.frames:
            share[self._moved == 0] = 1.0
        return {int(i): float(share[i]) for i in np.flatnonzero(share > MOSTLY)}


@dataclass(frozen=True)
class BagCheck:
    """Topics by name, sensors by namespace, and sentences about damage and what is left out."""

    topics: dict[str, TopicCheck]
    sensors: dict[str, FrameCheck]
    damage: tuple[str, ...]
    left_out: tuple[str, ...]
    unused: tuple[str, ...]


class _TimedBag(Bag):
    """Bag that notes when the messages of every topic were received."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, frames=PIECE)
        self.topics: dict[str, TopicCheck] = {}

    def handler(self, topic: str, kind: str) -> Taker | None:
        """Note the time of a message, then take it as a replay would."""
        inner = super().handler(topic, kind)
        schema = schema_of(kind, self.content.texts.get(kind, ''))
        check = self.topics.setdefault(topic, TopicCheck(kind, schema))

        def take(log_ns: int, data: bytes) -> None:
            check.count(log_ns)
            if inner is not None:
                inner(log_ns, data)

        return take


def schema_of(kind: str, text: str) -> str:
    """Compare the definition of a type in a bag with ours, in words."""
    if not text:
        return 'not in the bag'
    if not kind.startswith(f'{PACKAGE}/'):
        return 'in the bag'
    same = kind in all_types().fielddefs and same_fields(kind, text)
    return 'as here' if same else 'another version'


def check_bag(path: Path) -> BagCheck:
    """Read a bag through as a replay would.

    Raises RecordingError if there is no bag at `path`.
    """
    bag, taxels = _TimedBag(path), dict[str, TaxelCheck]()
    try:
        for space, piece in bag:
            taxels.setdefault(space, TaxelCheck()).add(piece.recording)
    except RecordingError:  # no frame at all
        if not (bag.content.counts or bag.content.problems or bag.topics):
            raise
    damage = tuple(bag.content.problems)
    for topic, kind in bag.content.types.items():  # of messages that are no CDR
        text = bag.content.texts.get(kind, '')
        check = bag.topics.setdefault(topic, TopicCheck(kind, schema_of(kind, text)))
        check.messages = bag.content.counts[topic]
    sensors = {
        space: FrameCheck.of(
            FrameTimes.join(bag.sensors[space].times), one, bag.sensors[space].whole().problems
        )
        for space, one in taxels.items()
    }
    out = tuple(f'{space}/frame: {why}' for space, why in bag.left_out.items())
    return BagCheck(bag.topics, sensors, damage, out, tuple(bag.unused))


class Repair(NamedTuple):
    """Messages by topic that were saved, and sentences about what was not."""

    counts: Counter[str]
    problems: list[str]


def repair_bag(path: Path, target: Path) -> Repair:
    """Write every message that can still be read into a new, closed bag (MCAP).

    Raises TactileError if `target` is there already, cannot be written, or nothing can be saved.
    """
    content, left_out = BagContent(), dict[str, str]()
    with temporary_folder(target) as fresh:
        with BagWriter(fresh) as writer:
            kinds: dict[str, str] = {}

            def handler(topic: str, kind: str) -> Taker | None:
                if kinds.setdefault(topic, kind) != kind:
                    left_out[f'{topic} as {kind}'] = f'it is {kinds[topic]} before'
                    return None
                try:
                    latched = topic in content.latched
                    writer.add_topic(topic, kind, latched, content.texts.get(kind, ''))
                except RecordingError as err:
                    left_out[topic] = str(err)
                    return None
                return partial(writer.write, topic, kind)

            for _ in read_bag(path, content, handler):
                pass
        saved = Counter(writer.counts)
        problems = content.problems + [f'{t} was left out: {y}' for t, y in left_out.items()]
        if not saved.total():
            why = '; '.join(problems[:3]) or 'it is empty'
            msg = f'{path} holds no message that could be saved ({why})'
            raise RecordingError(msg)
    return Repair(saved, problems)
