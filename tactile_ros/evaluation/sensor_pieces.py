"""One sensor's messages out of a bag, in pieces of equal length with all that is said about them.

A piece is complete when the bag has gone on for `HORIZON_NS` of log time: contacts, truth and
baselines that are heard later than that after their frame come too late. So memory does not grow
with the bag, and pieces do not depend on how the bag is chunked.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.definitions import all_types
from tactile_ros.evaluation.message_columns import FrameRows, read_contact_rows, read_frames
from tactile_ros.evaluation.recording_files import LiveContacts, read_changes
from tactile_ros.evaluation.topics import LAYOUT, digests_in
from tactile_ros.evaluation.truth import ELSEWHERE, Association, TruthPieces, read_texts
from tactile_ros.evaluation.waiting import Waiting
from tactile_ros.messages import read_layout
from tactile_ros.types import STATE_FIELDS, ContactStates, Frame, Recording

if TYPE_CHECKING:
    from tactile_ros.evaluation.bag_reader import Taker
    from tactile_ros.types import Array, Bytes, Integers, Layout

PIECE = 4096  # frames
HORIZON_NS = 2_000_000_000
MOST_WAITING = 8 * PIECE  # frames that wait for the log time to go on
NEIGHBOURS = 256  # frames before a piece that truth may belong to instead
FOREVER = 1 << 62


class ClassesChangedError(Exception):
    """A live run learned or forgot a class: to repeat that takes frames of any earlier time."""


@dataclass(frozen=True)
class Piece:
    """Frames that follow one another in a bag.

    Attributes
    ----------
    recording : Recording
        With truth; `stream` counts on from piece to piece.
    rows : ndarray, shape (n,)
        Rows that the live node saw; all where no contacts are heard.
    baselines : dict of int to Frame
        Baselines of the live run by the row before which each comes in.
    live : LiveContacts or None
        What the live run said.
    """

    recording: Recording
    rows: Integers
    baselines: dict[int, Frame]
    live: LiveContacts | None


class SensorPieces:
    """Gathers the messages of one namespace and gives them out in pieces.

    Parameters
    ----------
    space : str
        Namespace.
    layout : Layout or None
        For a bag that does not tell it.
    association : Association
        Of truth with frames.
    """

    def __init__(self, space: str, layout: Layout | None, association: Association) -> None:
        self.name = space.strip('/') or 'sensor'
        self.frames, self.contacts, self.tares = Waiting(), Waiting(), Waiting()
        self.truth = TruthPieces(association)
        self.digests: list[str] = []
        self.lost: Counter[str] = Counter()
        self.notes: list[str] = []
        self.count = self.dropped = 0
        self.begin_ns = self.end_ns = 0
        self._spoken = False
        self._told: Layout | None = None
        self._fallback = layout
        self._baselines: list[tuple[int, Frame]] = []
        self._stream = 0
        self._tare_stream: int | None = None
        self._tare_sequence = -1
        self._last: tuple[int, int] | None = None
        self._before: list[tuple[int, int]] = []

    def taker(self, leaf: str) -> Taker:
        """Who takes the messages of one of the sensor's own topics."""
        own: dict[str, Taker] = {
            'frame': self.frames.append,
            'contacts': self.contacts.append,
            'baseline': self.tares.append,
            'layout': lambda _, data: self._take_layout(data),
            'calibration': lambda _, data: self._take_calibration(data),
        }
        return own[leaf]

    @property
    def now_ns(self) -> int:
        """Log time up to which the bag has been heard."""
        return max(self.frames.last_ns, self.contacts.last_ns)

    def _take_calibration(self, data: bytes) -> None:
        self.digests += digests_in(data)
        _, texts, _ = read_texts([data])
        if read_changes(texts):
            raise ClassesChangedError

    def _take_layout(self, data: bytes) -> None:
        try:
            message = all_types().deserialize_cdr(data, LAYOUT)
            self._told = read_layout(message)  # type: ignore[arg-type]
        except Exception as err:
            self.notes.append(f'a layout makes no sense: {err}')

    @property
    def layout(self) -> Layout:
        """Layout of the bag, else the one that was passed; RecordingError if there is none."""
        if self._told is None and self._fallback is None:
            msg = 'its layout is not in the bag; name the sensor'
            raise RecordingError(msg)
        if self._told is None:
            note = 'its layout is not in the bag; that of the named sensor is used'
            self.notes += [] if note in self.notes else [note]
            assert self._fallback is not None
            self._told = self._fallback
        return self._told

    def ready(self, now_ns: int) -> bool:
        """Whether a piece is complete, where the bag has been read up to a log time."""
        waiting = len(self.frames)
        if waiting < PIECE:
            return False
        return self.frames.logs[PIECE - 1] + HORIZON_NS < now_ns or waiting >= MOST_WAITING

    def piece(self, *, final: bool = False) -> Piece | None:
        """The next piece; None where none of its frames could be read.

        Raises
        ------
        RecordingError
            If nobody tells the layout.
        """
        shape = self.layout.shape
        logs, messages = self.frames.take(PIECE)
        rows = read_frames(messages, shape)
        self.lost['messages of frame are damaged'] += rows.damaged
        self.lost[f'frames were left out: they are not of {shape[0]} x {shape[1]}'] += rows.misfits
        if not len(rows.rows):
            return None
        recording = self._recording(rows)
        until = FOREVER if final and not self.frames.logs else logs[-1] + HORIZON_NS
        index, around = self._index(rows, until)
        live = self._live(index, until, logs[-1])
        truth = self.truth.of(recording, index, around, logs[-1], until)
        seen = np.arange(len(recording)) if live is None else np.unique(live.rows)
        baselines = self._tares(recording, seen, until)
        return Piece(replace(recording, truth=truth), seen, baselines, live)

    def _index(self, rows: FrameRows, until: int) -> tuple[dict[tuple[int, int], int], Integers]:
        """Row of each frame by stamp and sequence; frames around the piece, and their stamps."""
        waiting = self.frames.data[: self.frames.heard_by(until)]
        after = read_frames(waiting, self.layout.shape)
        around = [*self._before, *zip(after.stamp_ns.tolist(), after.sequence.tolist(),
                  strict=True)]  # fmt: skip
        keys = list(zip(rows.stamp_ns.tolist(), rows.sequence.tolist(), strict=True))
        index = dict.fromkeys(around, ELSEWHERE)
        index.update({key: row for row, key in enumerate(keys)})
        self._before = [*self._before, *keys][-NEIGHBOURS:]
        return index, np.array([stamp for stamp, _ in around], np.int64)

    def _recording(self, rows: FrameRows) -> Recording:
        """Frames as a recording; a new stream begins where the counter or the clock went back."""
        stamp_ns, sequence = rows.stamp_ns, rows.sequence
        before = self._last or (int(stamp_ns[0]) - 1, int(sequence[0]) - 1)
        step = np.diff(sequence, prepend=before[1])
        back = (np.diff(stamp_ns, prepend=before[0]) <= 0) | (step <= 0)
        stream = self._stream + np.cumsum(back)
        self.begin_ns = self.begin_ns if self.count else int(stamp_ns[0])
        self.dropped += int((step[~back] - 1).sum())
        self.count += len(stamp_ns)
        self._stream, self.end_ns = int(stream[-1]), int(stamp_ns[-1])
        self._last = (int(stamp_ns[-1]), int(sequence[-1]))
        return Recording.from_arrays(
            self.layout,
            rows.values,
            stamp_ns=stamp_ns,
            sequence=sequence,
            temperature_c=_known_chips(rows.temperature_c),
            status=_known_bits(rows.status),
            stream=stream,
        )

    def _live(
        self, index: dict[tuple[int, int], int], until: int, last_ns: int
    ) -> LiveContacts | None:
        """Contacts about the frames of the piece; those about none are given up in time."""
        self._spoken = self._spoken or len(self.contacts) > 0
        if not self._spoken:
            return None
        count = self.contacts.heard_by(until)
        taxels = self.layout.shape[0]
        found = read_contact_rows(self.contacts.data[:count], taxels)
        self.lost['messages of contacts are damaged'] += found.damaged
        self.lost[f'contacts do not fit a sensor of {taxels} taxels'] += found.misfits
        stamps, sequence = found.arrays['stamp_ns'].tolist(), found.arrays['sequence'].tolist()
        rows = np.array([index.get(k, -1) for k in zip(stamps, sequence, strict=True)], np.int64)
        kept = rows >= 0
        logs = np.array(self.contacts.logs[:count], np.int64)[found.rows]
        waits = ~kept & (logs > last_ns - HORIZON_NS) & (until < FOREVER)
        given_up = int((~kept & ~waits).sum())
        self.lost['contacts are about frames that were not recorded'] += given_up
        self.contacts.keep(found.rows[waits].tolist(), count)
        known = {name: found.arrays[name][kept] for name in STATE_FIELDS}
        states = ContactStates.assemble(int(kept.sum()), taxels, known)
        return LiveContacts(rows[kept], states, logs[kept], given_up)

    def _tares(self, recording: Recording, seen: Integers, until: int) -> dict[int, Frame]:
        """Baselines by the row before which each comes in.

        A counter that starts again makes a sequence ambiguous: a baseline goes to the first stream
        that has it and is not older than the baseline before it.
        """
        assert recording.stream is not None
        assert recording.sequence is not None
        if not len(seen):
            return {}
        streams, sequence = recording.stream[seen], recording.sequence[seen]
        if self._tare_stream is None:
            self._tare_stream = int(streams[0])
        self._take_tares(until)
        found: dict[int, Frame] = {}
        waiting = []
        for stream, baseline in self._baselines:
            later = np.flatnonzero((streams == stream) & (sequence >= baseline.sequence))
            if len(later):
                found[int(seen[later[0]])] = baseline
            elif stream >= streams[-1]:
                waiting.append((stream, baseline))
        self._baselines = waiting
        return found

    def _take_tares(self, until: int) -> None:
        """Baselines that were heard, each with the stream that it is of."""
        assert self._tare_stream is not None
        _, messages = self.tares.take(self.tares.heard_by(until))
        rows = read_frames(messages, self.layout.shape)
        self.lost['messages of baseline are damaged or do not fit'] += rows.damaged + rows.misfits
        for i, sequence in enumerate(rows.sequence.tolist()):
            self._tare_stream += sequence < self._tare_sequence
            self._tare_sequence = sequence
            stamp_ns, count = int(rows.stamp_ns[i]), int(rows.device_time_ns[i])
            frame = Frame(
                stamp_ns, sequence, rows.values[i], None, rows.status[i], averaged=count
            )
            self._baselines.append((self._tare_stream, frame))

    @property
    def problems(self) -> list[str]:
        """Sentences about what was lost, once all is read."""
        counts = self.lost + self.truth.lost
        return [*self.notes, *(f'{n} {what}' for what, n in counts.items())]


def _known_chips(chips: Array) -> Array | None:
    """Temperatures, None where none was measured."""
    return chips if np.isfinite(chips).any() else None


def _known_bits(bits: Bytes) -> Bytes | None:
    """Status bits, None where there is none."""
    return bits if bits.any() else None
