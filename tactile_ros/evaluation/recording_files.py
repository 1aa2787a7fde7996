# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Recordings out of bags and files: frames, their live contacts and their truth.

`.npz` is ours, read without trust; `.csv` is for spreadsheets and other people's loggers. Columns
of a `.csv`, in any order: `stamp_ns` or `time_s`, `sequence`, `stream`, `tare`; a reading as
`<channel>_<taxel>` (`Bx_0`), chips as `temperature_c_<taxel>` and `status_<taxel>`; truth as its
name (`cell`), with `_x _y _z` for vectors (`force_z`) and `_<n>` for other arrays. An empty cell
is unknown.
"""

from __future__ import annotations

import csv
import math
import os
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, cast

import numpy as np

from tactile_ros import calibration
from tactile_ros.enrolment import ClassChange
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import cdr_columns
from tactile_ros.evaluation.bag import PACKAGE, BagContent, Taker, all_types, read_bag, same_fields
from tactile_ros.evaluation.truth import (
    DEFAULT_TRUTH,
    TRUTH_TYPES,
    Association,
    FrameTimes,
    TruthTopic,
    ends_as,
    merged,
    nearest_of_key,
)
from tactile_ros.files import refuse_misfit
from tactile_ros.messages import read_layout
from tactile_ros.sensors import SensorSpec
from tactile_ros.types import (
    STATE_FIELDS,
    TRUTH_KEYS,
    Array,
    Columns,
    ContactStates,
    Frame,
    Integers,
    Layout,
    Recording,
    TaxelStatus,
    field_shape,
)

SCHEMA, MARK = 1, b'recording_schema.npy'  # the second in every .npz
MOST_BYTES = 2 << 30
MOST_ROWS = 5_000_000
NS_PER_S = 1_000_000_000
LAYOUT = 'tactile_ros/msg/TactileLayout'
ROLES = {
    ('frame', cdr_columns.FRAME), ('baseline', cdr_columns.FRAME), ('layout', LAYOUT),
    ('contacts', cdr_columns.CONTACTS), ('calibration', cdr_columns.STRING),
}  # fmt: skip
PIECE = 4096  # frames
HORIZON_NS = 2_000_000_000
MOST_WAITING = 8  # pieces of frames that wait for the log time to go on
MOST_EARLY = 1000  # messages of truth that are kept until a frame is heard
FOREVER = 1 << 62
_COLUMNS = ('values', 'stamp_ns', 'sequence', 'temperature_c', 'status', 'stream', 'tare')
_DIGEST = re.compile(r'\b[0-9a-f]{64}\b')


@dataclass(frozen=True)
class LiveContacts:
    """States of n messages of a live run about rows (n,) of a recording.

    `log_ns` (n,) is when each was heard (ns).
    """

    rows: Integers
    states: ContactStates
    log_ns: Integers

    @property
    def failed(self) -> Integers:
        """Rows of which the live run could use no taxel, or whose estimation raised."""
        return self.rows[(self.states.taxel_status & np.uint8(TaxelStatus.ERROR)).all(axis=1)]


def read_changes(texts: Iterable[str]) -> tuple[ClassChange, ...]:
    """Changes that announcements of a calibration state; those that make no sense state none."""
    return tuple(change for text in texts if (change := ClassChange.read(text)) is not None)


@dataclass(frozen=True)
class LoadedRecording:
    """One sensor of a bag, a piece of it, or a file.

    Contacts, baselines, calibrations (SHA-256) and changes are those of the live run. Pieces of a
    bag have no truth, and their `stream` counts on.
    """

    name: str  # namespace in the bag, or name of the file
    recording: Recording
    contacts: LiveContacts | None = None
    baselines: tuple[Frame, ...] = ()  # `sequence` is the first frame that each holds for
    calibrations: tuple[str, ...] = ()
    changes: tuple[ClassChange, ...] = ()
    label_names: tuple[str, ...] = ()  # of truth labels that came as text
    problems: tuple[str, ...] = ()  # sentences about all that could not be read or matched

    @property
    def seen(self) -> Integers:
        """Rows that the live node saw; all where it left no record."""
        if self.contacts is None:
            return np.arange(len(self.recording))
        return np.unique(self.contacts.rows)


def places_outside(recording: Recording) -> list[str]:
    """Sentence on true places farther from the taxels than these from one another."""
    places, taxels = recording.truth.get('position', np.empty((0, 3))), recording.layout.positions
    low, high = taxels.min(axis=0), taxels.max(axis=0)
    reach = (high - low).max() or 0.1  # m, of a lone taxel
    far = int(((places < low - reach) | (places > high + reach)).any(axis=1).sum())
    return [f'{far} true places are far outside of the taxels; are they in metres?'] if far else []


@dataclass(frozen=True)
class Loaded:
    """Everything that was read at one path; `problems` concern the whole of it."""

    recordings: tuple[LoadedRecording, ...]
    problems: tuple[str, ...] = ()

    @property
    def sentences(self) -> list[str]:
        """All problems, those of each recording under its name."""
        parts = [(r.name, (*r.problems, *places_outside(r.recording))) for r in self.recordings]
        inner = [f'{name}: {text}' for name, texts in parts for text in texts]
        return [*self.problems, *inner]


def load(
    path: str | os.PathLike[str],
    layout: Layout | None = None,
    truth_topics: Sequence[str] = DEFAULT_TRUTH,
    association: Association | None = None,
) -> Loaded:
    """Load a bag (folder, .mcap, .db3), an .npz or a .csv as a whole, one recording per sensor.

    The layout is for .csv, and for bags without one; topics with the truth are relative to
    the sensor's namespace or absolute; without an association truth meets frames within half a
    step. Raises RecordingError if there is nothing of ours at `path`.
    """
    file = Path(path)
    if not file.exists():
        msg = f'{file} does not exist'
        raise RecordingError(msg)
    if file.suffix == '.npz':
        return Loaded((LoadedRecording(file.stem, load_recording(file)),))
    if file.suffix == '.csv':
        if layout is None:
            msg = f'{file} has no layout of its sensor; name the sensor or a calibration'
            raise RecordingError(msg)
        return Loaded((LoadedRecording(file.stem, read_csv(file, layout)),))
    bag = Bag(file, layout, truth_topics, association, frames=FOREVER)
    recordings = []
    for space, piece in sorted(bag, key=lambda pair: pair[0]):
        whole = bag.sensors[space].whole()
        recording = replace(piece.recording, truth=whole.recording.truth)
        recordings.append(replace(
            whole, recording=recording, contacts=piece.contacts, baselines=piece.baselines
        ))  # fmt: skip
    return Loaded(tuple(recordings), tuple(bag.problems))


def find(
    name: str, spec: SensorSpec, layout: Layout | None, truth_topics: Sequence[str] = (),
    association: Association | None = None,
) -> Loaded:  # fmt: skip
    """Load what is at a path, as `load` does, else the recording that a sensor ships by that name.

    Raises RecordingError if there is neither.
    """
    if Path(name).exists():
        return load(name, layout, truth_topics or DEFAULT_TRUTH, association)
    shipped = spec.recordings()
    if name not in shipped:
        msg = f'{name} does not exist, and {spec.key} ships only {", ".join(shipped) or "none"}'
        raise RecordingError(msg)
    return Loaded((LoadedRecording(name, shipped[name]),))


class ClassesChangedError(Exception):
    """A live run learned or forgot a class: to repeat that takes frames of any earlier time."""


class MessageBuffer:
    """Messages of one topic in their order: log times (ns) and CDR."""

    def __init__(self) -> None:
        self.logs: list[int] = []
        self.data: list[bytes] = []

    def append(self, log_ns: int, data: bytes) -> None:
        """Take one more message in."""
        self.logs.append(log_ns)
        self.data.append(data)

    def take(self, count: int | None = None) -> tuple[list[int], list[bytes]]:
        """Take the oldest messages out, or all: their log times and data."""
        taken = self.logs[:count], self.data[:count]
        del self.logs[:count], self.data[:count]
        return taken

    def take_until(self, log_ns: int) -> tuple[list[int], list[bytes]]:
        """Take out what was heard until then."""
        return self.take(bisect_right(self.logs, log_ns))


class Bag:
    """A bag in pieces: iterate over it once, then ask for its problems and the truth of sensors.

    A piece is complete when the bag has gone on for `HORIZON_NS` of log time; contacts and
    baselines that are heard later than that come too late. Parameters are as of `load`; with None
    frames a piece has `PIECE`, and ClassesChangedError is raised where classes came or went;
    `wanted` are the keys of the truth to read.
    """

    def __init__(
        self,
        path: Path,
        layout: Layout | None = None,
        truth_topics: Sequence[str] = DEFAULT_TRUTH,
        association: Association | None = None,
        frames: int | None = None,
        wanted: Container[str] = TRUTH_KEYS,
    ) -> None:
        self.path = path
        self.sensors: dict[str, SensorBag] = {}
        self.left_out: dict[str, str] = {}
        self._frames, self._truth_topics = frames or PIECE, truth_topics
        self._new_sensor = partial(
            SensorBag, layout, association or Association(), wanted, in_pieces=frames is None
        )
        self.content = BagContent()
        self._truth: dict[tuple[str, str], MessageBuffer] = {}
        self._now_ns = 0

    def __iter__(self) -> Iterator[tuple[str, LoadedRecording]]:
        """Yield namespace and piece, in the order in which pieces are complete.

        Raises RecordingError if there is no bag, or no frame that could be read.
        """
        for _ in read_bag(self.path, self.content, self.handler):
            yield from self._complete(final=False)
        yield from self._complete(final=True)
        if not any(sensor.times for sensor in self.sensors.values()):
            why = '; '.join(self.problems[:3]) or 'it is empty'
            msg = f'{self.path} holds no frames that could be read ({why})'
            raise RecordingError(msg)

    @property
    def problems(self) -> list[str]:
        """Sentences about the bag as a whole, and about sensors that were left out."""
        unused = self.unused
        named = [f'topics that are not ours were left out: {", ".join(unused)}'] * bool(unused)
        out = [f'{space}/frame was left out: {why}' for space, why in self.left_out.items()]
        return [*self.content.problems, *named, *out]

    @property
    def unused(self) -> list[str]:
        """Topics that are not ours."""
        types = self.content.types.items()
        return sorted(topic for topic, kind in types if not self._role(topic, kind))

    def _role(self, topic: str, kind: str) -> str:
        """Role of a topic for its sensor: the last part of its name, 'truth', or ''."""
        if kind in TRUTH_TYPES and any(ends_as(topic, name) for name in self._truth_topics):
            return 'truth'
        leaf = topic.rpartition('/')[2]
        return leaf if (leaf, kind) in ROLES else ''

    def handler(self, topic: str, kind: str) -> Taker | None:
        """Find the function that takes the messages of a topic."""
        role = self._role(topic, kind)
        text = self.content.texts.get(kind)
        if role and text and kind.startswith(f'{PACKAGE}/') and not same_fields(kind, text):
            self.content.problems.append(f'{kind} of the bag is of another version; left out')
            return None
        if role == 'truth':
            return self._truth.setdefault((topic, kind), MessageBuffer()).append
        if not role:
            return None
        space = topic.rpartition('/')[0]
        sensor = self.sensors.setdefault(space, self._new_sensor(space=space))
        return sensor.takers[role]

    def _hand_on(self) -> None:
        """Give truth to the sensors that it is about, of those that the bag has named so far."""
        topics = {**self.content.announced, **self.content.types}.items()
        of_frames = (t for t, k in topics if t.endswith('/frame') and k == cdr_columns.FRAME)
        spaces = {topic.rpartition('/')[0] for topic in of_frames}
        for (topic, kind), buffer in self._truth.items():
            hearers = [
                sensor
                for space, sensor in self.sensors.items()
                if space in spaces and (len(spaces) == 1 or topic.startswith(f'{space}/'))
            ]
            if not hearers:  # truth before any frame waits
                buffer.take(max(len(buffer.logs) - MOST_EARLY, 0))
                continue
            logs, messages = buffer.take()
            for sensor in hearers if logs else ():
                sensor.truth.setdefault(topic, TruthTopic(topic, kind)).extend(logs, messages)

    def _complete(self, *, final: bool) -> Iterator[tuple[str, LoadedRecording]]:
        heard = [b.logs for s in self.sensors.values() for b in (s.frames, s.contacts) if b.logs]
        self._now_ns = max([self._now_ns, *(logs[-1] for logs in heard)])
        for space, sensor in self.sensors.items():
            while sensor.ready(self._now_ns, self._frames) or (final and sensor.frames.logs):
                self._hand_on()
                if space in self.left_out:
                    sensor.frames.take()
                    continue
                try:
                    piece = sensor.piece(self._frames, final=final)
                except RecordingError as err:
                    self.left_out[space] = str(err)
                    continue
                if piece is not None:
                    yield space, piece
        if final:
            self._hand_on()


class SensorBag:
    """Messages of one namespace of a bag, given out in pieces.

    Parameters as of `Bag`; `in_pieces` refuses classes that come or go: ClassesChangedError.
    """

    def __init__(
        self,
        layout: Layout | None,
        association: Association,
        wanted: Container[str],
        space: str,
        *,
        in_pieces: bool,
    ) -> None:
        self.space, self.name = space, space.strip('/') or 'sensor'
        self.frames, self.contacts, self.tares = MessageBuffer(), MessageBuffer(), MessageBuffer()
        self.takers: dict[str, Taker] = {
            'frame': self.frames.append,
            'contacts': self.contacts.append,
            'baseline': self.tares.append,
            'layout': lambda _, data: self._take_layout(data),
            'calibration': lambda _, data: self._take_calibration(data),
        }
        self.truth: dict[str, TruthTopic] = {}
        self.times: list[FrameTimes] = []
        self.association, self._wanted = association, wanted
        self._announcements: list[str] = []
        self._lost: Counter[str] = Counter()
        self._notes: list[str] = []
        self._in_pieces = in_pieces
        self._live = False
        self._stated, self._fallback = cast('Layout | None', None), layout
        self._usual: Array | None = None

    def _take_calibration(self, data: bytes) -> None:
        _, texts = cdr_columns.read_texts([data])
        self._announcements += texts
        if self._in_pieces and read_changes(texts):
            raise ClassesChangedError

    def _take_layout(self, data: bytes) -> None:
        try:
            message = all_types().deserialize_cdr(data, LAYOUT)
            self._stated = read_layout(message)  # type: ignore[arg-type]
        except Exception as err:  # whatever a damaged message is
            self._notes.append(f'a layout makes no sense: {err}')

    @property
    def layout(self) -> Layout:
        """Layout of the bag, else the one that was passed; RecordingError if there is none."""
        if self._stated is None and self._fallback is None:
            msg = 'its layout is not in the bag; name the sensor'
            raise RecordingError(msg)
        if self._stated is None:
            self._notes.append('its layout is not in the bag; that of the named sensor is used')
            self._stated = self._fallback
        assert self._stated is not None
        return self._stated

    def whole(self) -> LoadedRecording:
        """Times and truth of all frames without readings, once every piece was given out."""
        times = FrameTimes.join(self.times)
        truth, names, lost = merged(self.truth.values(), times, self.association)
        recording = Recording(
            self.layout, np.zeros((len(times), 0, 0)), times.stamp_ns, times.sequence,
            stream=times.stream, truth=truth,
        )  # fmt: skip
        problems = [f'{count} {sentence}' for sentence, count in (self._lost + lost).items()]
        one = self._described(LoadedRecording(self.name, recording, label_names=names))
        return replace(one, problems=(*self._notes, *problems))

    def _described(self, one: LoadedRecording) -> LoadedRecording:
        digests = (digest for text in self._announcements for digest in _DIGEST.findall(text))
        calibrations, changes = tuple(dict.fromkeys(digests)), read_changes(self._announcements)
        return replace(one, calibrations=calibrations, changes=changes)

    def ready(self, now_ns: int, frames: int) -> bool:
        """Tell whether a piece is complete, where the bag has been read up to a log time."""
        logs = self.frames.logs
        if len(logs) < frames:
            return False
        return logs[frames - 1] + HORIZON_NS < now_ns or len(logs) >= MOST_WAITING * frames

    def piece(self, frames: int, *, final: bool = False) -> LoadedRecording | None:
        """Next piece; None where none of its frames could be read.

        Raises RecordingError if the layout is unknown.
        """
        layout = self.layout
        logs, messages = self.frames.take(frames)
        rows = cdr_columns.read_frames(messages, layout.shape)
        self._lost[f'messages of {self.space}/frame are damaged'] += rows.damaged
        wanted = ' x '.join(map(str, layout.shape))
        self._lost[f'frames were left out: they are not of {wanted}'] += rows.misfits
        for topic in self.truth.values():
            topic.decode(layout.shape[0], self._wanted)
        if not len(rows.rows):
            return None
        recording = self._recording(rows.arrays, np.array(logs, np.int64)[rows.rows])
        until = FOREVER if final and not self.frames.logs else logs[-1] + HORIZON_NS
        live = self._live_contacts(recording, until, logs[-1])
        piece = LoadedRecording(self.name, recording, live, self._baselines(until))
        return self._described(piece)

    def _recording(self, arrays: Columns, log_ns: Integers) -> Recording:
        stamp_ns, sequence = (cast('Integers', arrays[n]) for n in ('stamp_ns', 'sequence'))
        values = cast('Array', arrays['values'])
        before = (int(stamp_ns[0]) - 1, int(sequence[0]) - 1, 0)
        if self.times:
            last = self.times[-1]
            before = (int(last.stamp_ns[-1]), int(last.sequence[-1]), int(last.stream[-1]))
        back = np.diff(stamp_ns, prepend=before[0]) <= 0
        back |= np.diff(sequence, prepend=before[1]) <= 0
        stream = before[2] + np.cumsum(back)
        away = self._deviation(values)
        self.times.append(FrameTimes(stamp_ns, sequence, stream, log_ns, away))
        chips, bits = cast('Array', arrays['temperature_c']), arrays['status']
        return Recording.from_arrays(
            self.layout, values, stamp_ns=stamp_ns, sequence=sequence, stream=stream,
            temperature_c=chips if np.isfinite(chips).any() else None,
            status=bits if bits.any() else None,
        )  # fmt: skip

    def _deviation(self, values: Array) -> Array:
        """Norm (s,) of readings less the usual one, where a delay must be estimated."""
        estimated = self.association.delay_ns is None
        if not (estimated and any(topic.has_delay for topic in self.truth.values())):
            return np.zeros(len(values))
        if self._usual is None:
            self._usual = np.nan_to_num(np.median(values, axis=0))
        return np.asarray(np.sqrt((np.nan_to_num(values - self._usual) ** 2).sum(axis=(1, 2))))

    def _live_contacts(
        self, recording: Recording, until: int, last_ns: int
    ) -> LiveContacts | None:
        """Contacts about the frames of the piece; those about none are given up in time."""
        self._live = self._live or bool(self.contacts.logs)
        if not self._live:
            return None
        heard, data = self.contacts.take_until(until)
        taxels = self.layout.shape[0]
        messages = cdr_columns.read_contacts(data, taxels)
        self._lost[f'messages of {self.space}/contacts are damaged'] += messages.damaged
        self._lost[f'contacts do not fit a sensor of {taxels} taxels'] += messages.misfits
        logs = np.array(heard, np.int64)[messages.rows]
        rows = np.full(len(logs), -1, np.int64)
        if messages.arrays:
            assert recording.sequence is not None
            assert recording.stamp_ns is not None
            stamps = messages.arrays['stamp_ns'].astype(np.int64)
            sequence = messages.arrays['sequence'].astype(np.int64)
            rows = nearest_of_key(recording.sequence, recording.stamp_ns, sequence, stamps)
            rows[recording.stamp_ns[rows] != stamps] = -1
        kept = rows >= 0
        waits = ~kept & (logs > last_ns - HORIZON_NS) & (until < FOREVER)
        given_up = 'contacts are about frames that were not recorded'
        self._lost[given_up] += int((~kept & ~waits).sum())
        again = messages.rows[waits].tolist()
        self.contacts.logs[:0] = [heard[i] for i in again]
        self.contacts.data[:0] = [data[i] for i in again]
        columns = {name: messages.arrays[name][kept] for name in STATE_FIELDS if messages.arrays}
        states = ContactStates.assemble(int(kept.sum()), taxels, columns)
        return LiveContacts(rows[kept], states, logs[kept])

    def _baselines(self, until: int) -> tuple[Frame, ...]:
        rows = cdr_columns.read_frames(self.tares.take_until(until)[1], self.layout.shape)
        lost = rows.damaged + rows.misfits
        self._lost[f'messages of {self.space}/baseline are damaged or do not fit'] += lost
        names = ('stamp_ns', 'sequence', 'values', 'temperature_c', 'status', 'device_time_ns')
        columns = [rows.arrays[name] for name in names] if rows.arrays else []
        return tuple(
            Frame(int(stamp_ns), int(sequence), values, chips, status, averaged=int(count))
            for stamp_ns, sequence, values, chips, status, count in zip(*columns, strict=True)
        )


def save_recording(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording with its layout and truth into one .npz; every array is kept as it is."""
    refuse_misfit(Path(path), MARK)
    columns = {
        'recording_schema': SCHEMA,
        **{name: column for name, column in vars(recording).items() if name in _COLUMNS},
        **{f'layout_{name}': value for name, value in vars(recording.layout).items()},
        **{f'truth_{key}': value for key, value in recording.truth.items()},
    }
    known = {name: np.asarray(x) for name, x in columns.items() if x is not None}
    calibration.save_arrays(path, known)


def load_recording(path: str | os.PathLike[str]) -> Recording:
    """Read a recording that `save_recording` wrote, from a file that may be damaged or hostile.

    Raises RecordingError if it is no such file, holds objects, or unpacks to more than is
    sensible.
    """
    file = Path(path)
    try:
        arrays = calibration.plain_arrays(file, calibration.MOST_MEMBERS, MOST_BYTES)
    except calibration.DAMAGE as err:
        msg = f'{file} cannot be read as plain arrays: {str(err) or type(err).__name__}'
        raise RecordingError(msg) from err
    if arrays.get('recording_schema', np.array(0)).tolist() != SCHEMA:
        kind = 'a calibration, ' if 'sensor.scalar' in arrays else ''
        msg = f'{file} is {kind}no recording of tactile_ros (schema {SCHEMA})'
        raise RecordingError(msg)

    def named(prefix: str) -> Columns:
        return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}

    given: dict[str, Any] = {k: x if x.ndim else x.item() for k, x in named('layout_').items()}
    columns = {name: arrays.get(name) for name in _COLUMNS}
    try:
        channels = tuple(str(name) for name in given.pop('channels'))
        layout = Layout(channels=channels, **given)
        return Recording.from_arrays(layout, truth=named('truth_'), **columns)  # type: ignore[arg-type]
    except (ValueError, KeyError, TypeError, IndexError) as err:
        msg = f'{file} is no recording: {err}'
        raise RecordingError(msg) from err


def read_csv(path: str | os.PathLike[str], layout: Layout) -> Recording:
    """Read a recording whose columns are named by the taxels and channels of a layout.

    Raises RecordingError if a column of the readings is missing, unknown or not a number.
    """
    file = Path(path)
    columns = _csv_columns(file)
    taxels, channels = layout.shape
    samples = len(next(iter(columns.values())))

    def column(name: str, what: str, read: Callable[[str], float]) -> list[float]:
        """Take numbers of a column out; those of one that is not there are empty cells."""
        numbers: list[float] = []
        try:
            for cell in columns.pop(name, [''] * samples):
                numbers.append(read(cell))
        except ValueError as err:
            msg = f'row {len(numbers) + 1} of column {name} must be {what}; received {cell!r}'
            raise ValueError(msg) from err
        return numbers

    def table(names: Sequence[str]) -> Array:
        return np.array([column(n, 'a number', lambda c: float(c or 'nan')) for n in names]).T

    def integers(name: str, what: str = 'a whole number') -> Integers | None:
        return np.array(column(name, what, int)) if name in columns else None

    names = [f'{channel}_{taxel}' for taxel in range(taxels) for channel in layout.channels]
    wrong = next((f'{name!r} is missing' for name in names if name not in columns), '')
    try:
        if not wrong:
            recording = Recording.from_arrays(
                layout, table(names).reshape(samples, taxels, channels),
                stamp_ns=np.array(column('time_s', 'seconds', _nanoseconds))
                if 'time_s' in columns
                else integers('stamp_ns', 'whole nanoseconds (seconds are time_s)'),
                truth={
                    key: table(ends).reshape(samples, *field_shape(key, taxels))
                    for key in TRUTH_KEYS
                    if columns.keys() & {*(ends := _truth_names(key, taxels))}
                },
                **{name: integers(name) for name in ('sequence', 'stream', 'tare')},
                **{
                    name: table([f'{name}_{taxel}' for taxel in range(taxels)])
                    for name in ('temperature_c', 'status')
                    if f'{name}_0' in columns
                },
            )  # fmt: skip
            known = 'time_s, stamp_ns, sequence, stream, tare, temperature_c_0, status_0, force_z'
            known = ', '.join([known, 'torque_z', 'position_z', *TRUTH_KEYS[3:]])
            wrong = next((f'must be one of {known}; received {name!r}' for name in columns), '')
    except (ValueError, OverflowError) as err:
        msg = f'{file} is no recording of {layout.shape}: {err}'
        raise RecordingError(msg) from err
    if wrong:
        msg = f'{file} is no recording of {layout.shape}: column {wrong}'
        raise RecordingError(msg)
    return recording


def _csv_columns(file: Path) -> dict[str, list[str]]:
    if file.exists() and not file.is_file():  # a pipe or a device may never end
        msg = f'{file} cannot be read: it is no file'
        raise RecordingError(msg)
    try:
        with file.open(newline='', encoding='utf-8-sig') as opened:
            rows = list(islice(csv.reader(opened), MOST_ROWS + 1))
    except OSError as err:
        msg = f'{file} cannot be read: {err.strerror}'
        raise RecordingError(msg) from err
    except (csv.Error, UnicodeDecodeError) as err:
        msg = f'{file} is no csv file: {err}'
        raise RecordingError(msg) from err
    if len(rows) < 2:
        msg = f'{file} has no rows under its header line'
        raise RecordingError(msg)
    names = [name.strip() for name in rows[0]]
    wrong = next((n for n, row in enumerate(rows, 1) if row and len(row) != len(names)), None)
    if wrong is not None or len(set(names)) != len(names) or ';' in names[0]:
        msg = f'{file}: line {wrong or 1} does not fit {len(names)} columns, which commas separate'
        raise RecordingError(msg)
    body = [row for row in rows[1:] if row]
    return {name: [row[i].strip() for row in body] for i, name in enumerate(names)}


def _nanoseconds(text: str) -> int:
    seconds, _, part = text.partition('.')
    return int(seconds) * NS_PER_S + int(f'{part:0<9.9}')


def _truth_names(key: str, taxels: int) -> list[str]:
    shape = field_shape(key, taxels)
    ends = 'xyz' if shape == (3,) else range(math.prod(shape))
    return [f'{key}_{end}' for end in ends] if shape else [key]
