"""What a report draws of a recording that goes through in pieces: every row that truth judges.

Of a long recording evenly some, so that memory does not grow with its length; what is counted and
summed up is that of all rows (`answer_tally`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.evaluation.metrics import TARGETS, judge, named_rows
from tactile_ros.types import groups_of
from tactile_ros.types.recording import BLOCKS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.types import Array, ContactStates, Integers, Recording

    Columns = Mapping[str, npt.NDArray[np.generic]]

MOST = 1 << 16  # rows of a target
LEAST_GROUPS = 3  # sessions and repetitions below which blocks of rows are groups


class Rows:
    """Columns that grow piece by piece; beyond `MOST` rows every second stays, then every fourth.

    Which rows stay does not depend on the pieces: those whose number is a multiple of `step`.
    """

    def __init__(self) -> None:
        self.step, self.heard = 1, 0
        self._parts: list[Columns] = []
        self._kept = 0

    def add(self, columns: Columns) -> None:
        """The next rows, columns of one length."""
        first = -self.heard % self.step
        part = {name: column[first :: self.step].copy() for name, column in columns.items()}
        self._parts.append(part)
        self._kept += _length(part)
        self.heard += _length(columns)
        while self._kept > MOST:
            self._parts = [{name: column[::2].copy() for name, column in self.columns.items()}]
            self._kept = _length(self._parts[0])
            self.step *= 2

    @property
    def columns(self) -> dict[str, npt.NDArray[np.generic]]:
        """All rows that stayed, by name of the column."""
        names = self._parts[0] if self._parts else {}
        return {name: np.concatenate([part[name] for part in self._parts]) for name in names}


def _length(columns: Columns) -> int:
    return len(next(iter(columns.values())))


class AnswerRows:
    """Rows of one pipeline, by target and by kind of class."""

    def __init__(self) -> None:
        self.targets: dict[str, Rows] = {}
        self.named: dict[str, Rows] = {}

    def add(self, truth: Columns, states: ContactStates, about: Columns) -> None:
        """Answers to the next rows (s), and what is known about each of these rows."""
        for name, (_, key, _) in TARGETS.items():
            if key not in truth:
                continue
            seen = judge(name, truth, states)
            if len(seen.rows):
                columns = {column: values[seen.rows] for column, values in about.items()}
                for column in ('truth', 'estimate', 'variance'):
                    columns[column] = getattr(seen, column)
                self.targets.setdefault(name, Rows()).add(columns)
        for kind, true, said in named_rows(truth, states):
            self.named.setdefault(kind, Rows()).add({'true': true, 'said': said})


class SensorRows:
    """Rows of all pipelines of one sensor, and what they need to be put into groups.

    Parameters
    ----------
    chips : ndarray, shape (t, 3)
        Taxel positions (m).
    """

    def __init__(self, chips: Array) -> None:
        self.chips = chips
        self.answers: dict[str, AnswerRows] = {}
        self.latency = Rows()
        self._pairs: set[tuple[int, int]] = set()
        self._count = self._streams = 0
        self._stream = self._began_ns = -1

    def about(self, recording: Recording, *, whole: bool = False) -> Columns:
        """Number, time (s), stream and group of each row of the next piece, or of the whole."""
        count = len(recording)
        zeros = np.zeros(count, np.int64)
        if whole:
            pairs = np.column_stack([zeros, groups_of(recording)['group'].astype(np.int64)])
        else:
            known = (recording.truth.get(key, zeros) for key in ('session', 'repetition'))
            pairs = np.column_stack([column.astype(np.int64) for column in known])
        if len(self._pairs) < LEAST_GROUPS:
            self._pairs |= set(map(tuple, np.unique(pairs, axis=0).tolist()))
        time_s = np.full(count, np.nan)
        if recording.stamp_ns is not None and count:
            self._began_ns = self._began_ns if self._count else int(recording.stamp_ns[0])
            time_s = (recording.stamp_ns - self._began_ns) * 1e-9
        row = self._count + np.arange(count)
        self._count += count
        return {'row': row, 'time_s': time_s, 'stream': self._numbered(recording), 'pair': pairs}

    def _numbered(self, recording: Recording) -> Integers:
        """Number of each row's stream, going on from piece to piece."""
        stream = recording.stream
        if stream is None:
            self._streams = 1
            return np.zeros(len(recording), np.int64)
        fresh = np.diff(stream, prepend=self._stream) != 0
        number = np.maximum(self._streams - 1 + np.cumsum(fresh), 0)
        if len(stream):
            self._stream, self._streams = int(stream[-1]), int(number[-1]) + 1
        return np.asarray(number, np.int64)

    def groups(self, columns: Columns) -> Integers:
        """What errors of some rows (n,) have in common, as `truth.groups_of` says it of all."""
        if len(self._pairs) >= LEAST_GROUPS:
            _, group = np.unique(columns['pair'], axis=0, return_inverse=True)
            return np.asarray(group, np.int64).reshape(-1)
        if self._streams >= BLOCKS:
            return np.asarray(columns['stream'] * BLOCKS // self._streams, np.int64)
        return np.asarray(columns['row'] * BLOCKS // max(self._count, 1), np.int64)
