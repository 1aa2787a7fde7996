"""A pipeline that follows a sensor through the pieces of a bag, as a live node would have."""

from __future__ import annotations

from copy import copy, deepcopy
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.frame_guard import FrameGuard
from tactile_ros.types import STATE_FIELDS, ContactStates
from tactile_ros.types.recording import refuse_foreign

if TYPE_CHECKING:
    from tactile_ros.evaluation.sensor_pieces import Piece
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import ContactState, Integers, Recording


class Follower:
    """Answers of one pipeline, with its memory carried over from piece to piece.

    Parameters
    ----------
    pipeline : Pipeline
        It stays as it is; a copy moves on.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self.pipeline = copy(pipeline)
        self.pipeline.reset()
        self.guard = FrameGuard(self.pipeline)
        self._stream = -1

    def __call__(self, piece: Piece) -> ContactStates:
        """States of every row of the next piece; unknown where the live node saw no frame."""
        recording, rows = piece.recording, piece.rows
        taxels = recording.layout.shape[0]
        refuse_foreign(self.pipeline.sensor, self.pipeline.layout, recording)
        if not len(rows):
            return ContactStates.assemble(len(recording), taxels, {})
        assert recording.stream is not None
        stream = recording.stream[rows]
        fresh = np.diff(stream, prepend=self._stream) != 0
        self._stream = int(stream[-1])
        cuts = fresh | np.isin(rows, list(piece.baselines))
        edges = np.unique([0, *np.flatnonzero(cuts).tolist(), len(rows)]).tolist()
        parts: list[ContactStates] = []
        for first, last in pairwise(edges):
            if fresh[first]:
                self.pipeline.reset()
            baseline = piece.baselines.get(int(rows[first]))
            if baseline is not None:
                self.pipeline.tare([baseline], doubted=False)
            whole = int(rows[last - 1]) + 1 - int(rows[first]) == last - first
            chosen = (
                slice(int(rows[first]), int(rows[last - 1]) + 1) if whole else rows[first:last]
            )
            parts += self._answers(recording.select(chosen))
        if len(parts) == 1 and len(rows) == len(recording):
            return parts[0]
        return gathered(parts, rows, len(recording), taxels)

    def _answers(self, recording: Recording) -> list[ContactStates]:
        """States of the next frames of one stretch, in parts; a failing one costs itself alone.

        What fails is halved, what succeeds is doubled: one failing frame costs about three times
        the stretch, and where every frame fails each is tried twice.
        """
        parts: list[ContactStates] = []
        first, size = 0, len(recording)
        while first < len(recording):
            part = recording.select(slice(first, first + size))
            states = self._tried(part)
            if states is None and len(part) > 1:
                size = len(part) // 2
                continue
            if states is None:
                self.guard.begin()
                states, size = batch_of(self.guard.process(part.frame(0))), 1
            else:
                size *= 2
            parts.append(states)
            first += len(part)
        return parts

    def _tried(self, recording: Recording) -> ContactStates | None:
        """States of the next frames; None, and nothing has happened: one of them fails."""
        before = deepcopy(self.pipeline.stream)
        try:
            return self.pipeline.process_next(recording)
        except MemoryError:
            raise
        except Exception:  # whatever an estimator makes of a frame
            self.pipeline.stream = before
            return None


def batch_of(state: ContactState) -> ContactStates:
    """A batch of one."""
    return ContactStates(**{name: np.asarray(getattr(state, name))[None] for name in STATE_FIELDS})


def gathered(
    parts: list[ContactStates], rows: Integers, samples: int, taxels: int
) -> ContactStates:
    """States of some rows (n,), in parts, among all rows s."""
    patches = max([1, *(part.contacts_id.shape[1] for part in parts)])
    known = {}
    for name, (shape, dtype, fill) in STATE_FIELDS.items():
        lengths = {'t': taxels, 'k': patches}
        tail = tuple(lengths[n] if isinstance(n, str) else n for n in shape)
        column: npt.NDArray[np.generic] = np.full((samples, *tail), fill, dtype)
        first = 0
        for part in parts:
            values = getattr(part, name)
            place = rows[first : first + len(values)]
            if shape[:1] == ('k',):
                column[place, : values.shape[1]] = values
            else:
                column[place] = values
            first += len(values)
        known[name] = column
    return ContactStates.assemble(samples, taxels, known)
