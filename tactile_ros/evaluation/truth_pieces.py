"""Truth of one sensor, associated with its frames piece by piece."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.evaluation.message_columns import read_contact_rows
from tactile_ros.evaluation.topics import CONTACTS, STRING
from tactile_ros.evaluation.truth_columns import read_texts, read_told
from tactile_ros.evaluation.truth_topics import (
    contacts_truth,
    half_step,
    held_labels,
    nearest_truth,
    unknown,
)
from tactile_ros.evaluation.waiting import Waiting
from tactile_ros.types import TRUTH_KEYS

if TYPE_CHECKING:
    from tactile_ros.evaluation.bag_reader import Taker
    from tactile_ros.evaluation.truth_topics import Association
    from tactile_ros.types import Bools, Integers, Recording

Columns = dict[str, npt.NDArray[np.generic]]
Index = dict[tuple[int, int], int]
TRUTH = frozenset(TRUTH_KEYS)
KEPT_NS = 2_000_000_000  # of log time that truth waits for frames that are heard after it


class TruthPieces:
    """Gathers what is true about one sensor.

    Parameters
    ----------
    association : Association
        Tolerance, and delays by topic.
    """

    def __init__(self, association: Association) -> None:
        self.association = association
        self.names: tuple[str, ...] = ()
        self.lost: Counter[str] = Counter()
        self.tolerances: dict[str, int] = {}
        self._queues: dict[str, Waiting] = {}

    @property
    def sentences(self) -> dict[str, str]:
        """How each topic was brought together with frames."""
        found = {}
        for topic, queue in self._queues.items():
            if queue.type_name == STRING:
                found[topic] = 'holds from when it was heard until the next'
                continue
            asked = self.association.tolerance_ns
            within = self.tolerances.get(topic) if asked is None else asked
            if within is not None:
                delay = self.association.delays.get(topic, 0)
                known = self.association.known.get(topic, '')
                late = f'{delay * 1e-6:.3g} ms late{known}'
                found[topic] = f'within {within * 1e-6:.3g} ms, {late}'
        return found

    def taker(self, topic: str, type_name: str) -> Taker:
        """Who takes the messages of a topic."""
        return self._queues.setdefault(topic, Waiting(type_name)).append

    def of(
        self, recording: Recording, index: Index, around: Integers, last_ns: int, until: int
    ) -> Columns:
        """Truth beside the frames of a piece; a later topic fills what an earlier left unknown.

        Parameters
        ----------
        recording : Recording
            Of s frames, the last of which was heard at `last_ns`.
        index : dict
            Row of a frame by stamp and sequence.
        around : ndarray, shape (m,)
            Stamps of frames shortly before and after the piece (ns).
        last_ns, until : int
            Log times (ns); what is heard after `until` is not looked at.
        """
        merged: Columns = {}
        assert recording.stamp_ns is not None
        for topic, queue in self._queues.items():
            count = queue.heard_by(until)
            if queue.type_name == STRING:
                part = self._labels(topic, queue, count, recording.stamp_ns)
            else:
                part, used = self._nearest(topic, queue, count, recording, index, around)
                queue.use(np.flatnonzero(used).tolist())
                # at the end of the bag nothing waits any longer
                late = until if until > last_ns + KEPT_NS else last_ns - KEPT_NS
                self.lost[f'messages of {topic} belong to no frame'] += queue.forget_before(late)
            for key, value in part.items():
                known = merged.get(key, value)
                merged[key] = np.where(unknown(known), value, known)
        return merged

    def _nearest(
        self,
        topic: str,
        queue: Waiting,
        count: int,
        recording: Recording,
        index: Index,
        around: Integers,
    ) -> tuple[Columns, Bools]:
        """Truth by stamp and sequence, or by the nearest time; which messages were of use."""
        assert recording.stamp_ns is not None
        frames = recording.stamp_ns
        near = np.concatenate([frames, around])
        if queue.type_name == CONTACTS:
            found = read_contact_rows(queue.data[:count], recording.layout.shape[0], TRUTH)
            self._leave_out(topic, queue, found.rows, count)
            tolerance = self._tolerance(topic, near, near)
            return contacts_truth(found.arrays, recording, index, tolerance, around)
        told = read_told(queue.data[:count], queue.type_name)
        self._leave_out(topic, queue, told.rows, count)
        times = told.times - self.association.delays.get(topic, 0)
        return nearest_truth(told.truth, times, frames, self._tolerance(topic, times, near))

    def _leave_out(self, topic: str, queue: Waiting, rows: Integers, count: int) -> None:
        """Forget messages that cannot be read or do not fit."""
        if len(rows) < count:
            self.lost[f'messages of {topic} are damaged or do not fit'] += count - len(rows)
            queue.keep(rows.tolist(), count)

    def _tolerance(self, topic: str, times: Integers, frames: Integers) -> int:
        """Largest distance in time (ns): as asked, else half a step of the first piece."""
        if self.association.tolerance_ns is not None:
            return self.association.tolerance_ns
        if topic not in self.tolerances and len(times) > 1:
            self.tolerances[topic] = max(half_step(times), half_step(frames))
        return self.tolerances.get(topic, half_step(frames))

    def _labels(self, topic: str, queue: Waiting, count: int, frames: Integers) -> Columns:
        """Names that hold until the next one; the last one before the next piece is kept."""
        rows, texts, _ = read_texts(queue.data[:count])
        self._leave_out(topic, queue, rows, count)
        times = np.array(queue.logs[: len(rows)], np.int64)
        if not len(times):
            return {}
        part, self.names = held_labels(texts, times, frames, self.names)
        past = int(np.searchsorted(times, frames[-1], side='right')) - 1
        queue.take(max(past, 0))
        return part
