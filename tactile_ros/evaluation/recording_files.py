"""Recordings out of bags and files: frames, what was said live about them, and what was true.

`.npz` is ours, read without trust; `.csv` is for spreadsheets and other people's loggers. Columns
of a `.csv`, in any order: `stamp_ns` or `time_s`, `sequence`, `stream`, `tare`; a reading as
`<channel>_<taxel>` (`Bx_0`), chips as `temperature_c_<taxel>` and `status_<taxel>`; truth as its
name (`cell`), with `_x _y _z` for vectors (`force_z`) and `_<n>` for other arrays. An empty cell
is unknown.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections import Counter
from dataclasses import dataclass, fields, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from tactile_ros import calibration
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag import (
    PACKAGE,
    BagContent,
    MessageBuffer,
    all_types,
    read_bag,
    same_fields,
)
from tactile_ros.evaluation.cdr_columns import (
    CONTACTS,
    FRAME,
    Columns,
    read_contacts,
    read_frames,
)
from tactile_ros.evaluation.truth import (
    DEFAULT_TRUTH,
    ELSEWHERE,
    STRING,
    TRUTH_TYPES,
    Association,
    TruthTopics,
    ends_as,
    read_texts,
)
from tactile_ros.files import write_beside
from tactile_ros.messages import read_layout
from tactile_ros.types import (
    STATE_FIELDS,
    TRUTH_KEYS,
    ContactStates,
    Frame,
    Layout,
    Recording,
    TaxelStatus,
    field_shape,
)

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator, Sequence

    from tactile_ros.evaluation.bag import Taker
    from tactile_ros.types import Array, Bytes, Integers

SCHEMA = 1
MOST_MEMBERS = 64
MOST_BYTES = 2 << 30
MOST_ROWS = 5_000_000
NS_PER_S = 1_000_000_000
LAYOUT = 'tactile_ros/msg/TactileLayout'
ROLES = {('frame', FRAME), ('baseline', FRAME), ('layout', LAYOUT), ('contacts', CONTACTS)}
ROLES |= {('calibration', STRING)}
PIECE = 4096  # frames
HORIZON_NS = 2_000_000_000
MOST_WAITING = 8  # pieces of frames that wait for the log time to go on
NEIGHBOURS = 256  # frames before a piece that truth may belong to instead
MOST_EARLY = 1000  # messages of truth that are kept until a frame is heard
FOREVER = 1 << 62
_COLUMNS = ('stamp_ns', 'sequence', 'temperature_c', 'status', 'stream', 'tare')
_DIGEST = re.compile(r'\b[0-9a-f]{64}\b')


@dataclass(frozen=True)
class LiveContacts:
    """What a live run said about frames of a recording.

    Attributes
    ----------
    rows : ndarray, shape (n,)
        Row of the recording that each message is about.
    states : ContactStates
        Of n messages.
    log_ns : ndarray, shape (n,)
        When each message was heard (ns).
    unmatched : int
        Messages about frames that the bag does not hold.
    """

    rows: Integers
    states: ContactStates
    log_ns: Integers
    unmatched: int

    @property
    def failed(self) -> Integers:
        """Rows of which the live run could use no taxel, or whose estimation raised."""
        error = np.uint8(TaxelStatus.ERROR)
        return self.rows[(self.states.taxel_status & error).all(axis=1)]


@dataclass(frozen=True)
class ClassChange:
    """A class that was enrolled or forgotten during a live run.

    Attributes
    ----------
    label, digest : str
        Its name; SHA-256 of the calibration since.
    after_ns : int
        Stamp of the last frame before it (ns).
    presses : tuple of tuple of int
        Stamps of the first and last frame of each press (ns); empty: it was forgotten.
    replace : bool
        What was known under the name was forgotten first.
    """

    label: str
    digest: str
    after_ns: int
    presses: tuple[tuple[int, int], ...] = ()
    replace: bool = False


def read_changes(texts: Iterable[str]) -> tuple[ClassChange, ...]:
    """Changes that announcements of a calibration state; those that make no sense state none."""
    changes = (_read_change(text) for text in texts)
    return tuple(change for change in changes if change is not None)


def _read_change(text: str) -> ClassChange | None:
    try:
        stated = json.loads(text)
        label = stated.get('enrolled', stated.get('forgotten'))
        if not isinstance(label, str):
            return None
        presses = tuple((int(a), int(b)) for a, b in stated.get('presses', ()))
        after_ns = stated.get('after_ns')
        return ClassChange(
            label, str(stated['sha256']), -1 if after_ns is None else int(after_ns),
            presses, bool(stated.get('replace')),
        )  # fmt: skip
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


@dataclass(frozen=True)
class LoadedRecording:
    """One sensor of a bag, a piece of it, or a file.

    Attributes
    ----------
    name : str
        Namespace in the bag, or name of the file.
    recording : Recording
        Frames and truth; in pieces `stream` counts on from piece to piece.
    contacts : LiveContacts or None
        What the live run said.
    baselines : tuple of Frame
        Baselines of the live run; `sequence` is the first frame that each holds for.
    calibrations : tuple of str
        SHA-256 of the calibrations of the live run, in their order.
    changes : tuple of ClassChange
        Classes that came and went in the live run, in their order.
    label_names : tuple of str
        Names of truth labels that came as text.
    problems : tuple of str
        What could not be read or matched, as sentences.
    """

    name: str
    recording: Recording
    contacts: LiveContacts | None = None
    baselines: tuple[Frame, ...] = ()
    calibrations: tuple[str, ...] = ()
    changes: tuple[ClassChange, ...] = ()
    label_names: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def seen(self) -> Integers:
        """Rows that the live node saw; all where it said nothing."""
        if self.contacts is None:
            return np.arange(len(self.recording))
        return np.unique(self.contacts.rows)


@dataclass(frozen=True)
class Loaded:
    """Everything that was read at one path; `problems` concern the whole of it."""

    recordings: tuple[LoadedRecording, ...]
    problems: tuple[str, ...] = ()

    @property
    def sentences(self) -> list[str]:
        """All problems, those of each recording under its name."""
        inner = [f'{r.name}: {text}' for r in self.recordings for text in r.problems]
        return [*self.problems, *inner]


def load(
    path: str | os.PathLike[str],
    layout: Layout | None = None,
    truth_topics: Sequence[str] = DEFAULT_TRUTH,
) -> Loaded:
    """Load a bag (folder, .mcap, .db3), an .npz or a .csv as a whole.

    Parameters
    ----------
    path : path-like
        What to read.
    layout : Layout or None
        For .csv, and for bags without a layout.
    truth_topics : sequence of str
        Topics that tell the truth, relative to the sensor's namespace or absolute:
        TactileContacts, WrenchStamped, PoseStamped, PoseWithCovarianceStamped, String.

    Returns
    -------
    Loaded
        One recording per sensor.

    Raises
    ------
    RecordingError
        If there is nothing of ours at `path`.
    """
    file = Path(path)
    if not file.exists():
        msg = f'{file} does not exist'
        raise RecordingError(msg)
    if file.suffix == '.npz':
        return Loaded((LoadedRecording(file.stem, load_recording(file)),))
    if file.suffix == '.csv':
        if layout is None:
            msg = f'{file} does not tell the layout of its sensor; name the sensor'
            raise RecordingError(msg)
        return Loaded((LoadedRecording(file.stem, read_csv(file, layout)),))
    bag = Bag(file, layout, truth_topics, frames=FOREVER)
    whole = dict(bag)
    recordings = tuple(bag.sensors[space].described(whole[space]) for space in sorted(whole))
    return Loaded(recordings, tuple(bag.problems))


class ClassesChangedError(Exception):
    """A live run learned or forgot a class: to repeat that takes frames of any earlier time."""


class Bag:
    """A bag in pieces: iterate over it once, then ask for its problems.

    Pieces are of equal length and do not depend on how the bag is chunked: one is complete when
    the bag has gone on for `HORIZON_NS` of log time; contacts, truth and baselines that are heard
    later than that after their frame come too late. So memory does not grow with the bag.

    Parameters
    ----------
    path : Path
        A rosbag2 folder, or one .mcap or .db3 file.
    layout : Layout or None
        For a bag that does not tell it.
    truth_topics : sequence of str
        As of `load`.
    association : Association
        Of truth with frames.
    frames : int or None
        Of a piece; None: `PIECE`, and ClassesChangedError where classes came or went.
    """

    def __init__(
        self,
        path: Path,
        layout: Layout | None = None,
        truth_topics: Sequence[str] = DEFAULT_TRUTH,
        association: Association | None = None,
        frames: int | None = None,
    ) -> None:
        self.path = path
        self.sensors: dict[str, SensorBag] = {}
        self.left_out: dict[str, str] = {}
        self._layout, self._truth_topics = layout, truth_topics
        self._association = association or Association()
        self._frames, self._in_pieces = frames or PIECE, frames is None
        self._content = BagContent()
        self._truth: dict[str, MessageBuffer] = {}
        self._now_ns = 0

    def __iter__(self) -> Iterator[tuple[str, LoadedRecording]]:
        """Yield namespace and piece, in the order in which pieces are complete.

        Raises
        ------
        RecordingError
            If there is no bag, or no frame that could be read.
        """
        for _ in read_bag(self.path, self._content, self._taker):
            yield from self._complete(final=False)
        yield from self._complete(final=True)
        if not any(sensor.count for sensor in self.sensors.values()):
            why = '; '.join(self.problems[:3]) or 'it is empty'
            msg = f'{self.path} holds no frames that could be read ({why})'
            raise RecordingError(msg)

    @property
    def problems(self) -> list[str]:
        """Sentences about the bag as a whole, and about sensors that were left out."""
        types = self._content.types.items()
        foreign = sorted(topic for topic, kind in types if not self._role(topic, kind))
        named = [f'topics that are not ours were left out: {", ".join(foreign)}'] * bool(foreign)
        out = [f'{space}/frame was left out: {why}' for space, why in self.left_out.items()]
        return [*self._content.problems, *named, *out]

    def _role(self, topic: str, kind: str) -> str:
        """What a topic is to its sensor: the last part of its name, 'truth', or ''."""
        if kind in TRUTH_TYPES and any(ends_as(topic, name) for name in self._truth_topics):
            return 'truth'
        leaf = topic.rpartition('/')[2]
        return leaf if (leaf, kind) in ROLES else ''

    def _taker(self, topic: str, kind: str) -> Taker | None:
        """Who takes the messages of a topic."""
        role = self._role(topic, kind)
        text = self._content.texts.get(kind)
        if role and text and kind.startswith(f'{PACKAGE}/') and not same_fields(kind, text):
            self._content.problems.append(f'{kind} of the bag is of another version; left out')
            role = ''
        if role == 'truth':
            return self._truth.setdefault(topic, MessageBuffer(kind)).append
        if not role:
            return None
        space = topic.rpartition('/')[0]
        if space not in self.sensors:
            self.sensors[space] = SensorBag(
                space, self._layout, self._association, in_pieces=self._in_pieces
            )
        return self.sensors[space].taker(role)

    def _hand_on(self) -> None:
        """Give truth to the sensors that it is about, as far as the bag has told of sensors."""
        topics = {**self._content.announced, **self._content.types}.items()
        spaces = {t.rpartition('/')[0] for t, k in topics if t.endswith('/frame') and k == FRAME}
        for topic, buffer in self._truth.items():
            hearers = [
                sensor.truth.taker(topic, buffer.type_name)
                for space, sensor in self.sensors.items()
                if space in spaces and (len(spaces) == 1 or topic.startswith(f'{space}/'))
            ]
            if not hearers:  # what comes before any frame waits
                buffer.take(max(len(buffer.logs) - MOST_EARLY, 0))
                continue
            for message in zip(*buffer.take(len(buffer.logs)), strict=True):
                for take in hearers:
                    take(*message)

    def _complete(self, *, final: bool) -> Iterator[tuple[str, LoadedRecording]]:
        """Pieces that are complete by now."""
        self._hand_on()
        heard = [b.logs for s in self.sensors.values() for b in (s.frames, s.contacts) if b.logs]
        self._now_ns = max([self._now_ns, *(logs[-1] for logs in heard)])
        for space, sensor in self.sensors.items():
            while sensor.ready(self._now_ns, self._frames) or (final and sensor.frames.logs):
                if space in self.left_out:
                    sensor.frames.take(len(sensor.frames.logs))
                    continue
                try:
                    piece = sensor.piece(self._frames, final=final)
                except RecordingError as err:
                    self.left_out[space] = str(err)
                    continue
                if piece is not None:
                    yield space, piece


class SensorBag:
    """Messages of one namespace of a bag, given out in pieces.

    Parameters
    ----------
    space : str
        Namespace.
    layout : Layout or None
        For a bag that does not tell it.
    association : Association
        Of truth with frames.
    in_pieces : bool
        Refuse classes that come or go: ClassesChangedError.
    """

    def __init__(
        self, space: str, layout: Layout | None, association: Association, *, in_pieces: bool
    ) -> None:
        self.space, self.name = space, space.strip('/') or 'sensor'
        self.frames, self.contacts, self.tares = MessageBuffer(), MessageBuffer(), MessageBuffer()
        self.truth = TruthTopics(association)
        self.announcements: list[str] = []
        self.lost: Counter[str] = Counter()
        self.notes: list[str] = []
        self.count = 0
        self._in_pieces = in_pieces
        self._live = False
        self._stated, self._fallback = cast('Layout | None', None), layout
        self._stream = 0
        self._last: tuple[int, int] | None = None
        self._before: list[tuple[int, int]] = []

    def taker(self, role: str) -> Taker:
        """Who takes the messages of one of the sensor's own topics."""
        takers: dict[str, Taker] = {
            'frame': self.frames.append,
            'contacts': self.contacts.append,
            'baseline': self.tares.append,
            'layout': lambda _, data: self._take_layout(data),
            'calibration': lambda _, data: self._take_calibration(data),
        }
        return takers[role]

    def _take_calibration(self, data: bytes) -> None:
        _, texts = read_texts([data])
        self.announcements += texts
        if self._in_pieces and read_changes(texts):
            raise ClassesChangedError

    def _take_layout(self, data: bytes) -> None:
        try:
            message = all_types().deserialize_cdr(data, LAYOUT)
            self._stated = read_layout(message)  # type: ignore[arg-type]
        except Exception as err:  # whatever a damaged message is
            self.notes.append(f'a layout makes no sense: {err}')

    @property
    def layout(self) -> Layout:
        """Layout of the bag, else the one that was passed; RecordingError if there is none."""
        if self._stated is None and self._fallback is None:
            msg = 'its layout is not in the bag; name the sensor'
            raise RecordingError(msg)
        if self._stated is None:
            self.notes.append('its layout is not in the bag; that of the named sensor is used')
            self._stated = self._fallback
        assert self._stated is not None
        return self._stated

    def described(self, piece: LoadedRecording) -> LoadedRecording:
        """A piece with what is known about the whole, once all is read."""
        digests = (digest for text in self.announcements for digest in _DIGEST.findall(text))
        counts = self.lost + self.truth.lost
        return replace(
            piece,
            calibrations=tuple(dict.fromkeys(digests)),
            changes=read_changes(self.announcements),
            label_names=self.truth.names,
            problems=(*self.notes, *(f'{n} {what}' for what, n in counts.items())),
        )

    def ready(self, now_ns: int, frames: int) -> bool:
        """Whether a piece is complete, where the bag has been read up to a log time."""
        logs = self.frames.logs
        if len(logs) < frames:
            return False
        return logs[frames - 1] + HORIZON_NS < now_ns or len(logs) >= MOST_WAITING * frames

    def piece(self, frames: int, *, final: bool = False) -> LoadedRecording | None:
        """The next piece; None where none of its frames could be read.

        Raises
        ------
        RecordingError
            If nobody tells the layout.
        """
        layout = self.layout
        logs, messages = self.frames.take(frames)
        rows = read_frames(messages, layout.shape)
        self.lost[f'messages of {self.space}/frame are damaged'] += rows.damaged
        wanted = ' x '.join(map(str, layout.shape))
        self.lost[f'frames were left out: they are not of {wanted}'] += rows.misfits
        if not len(rows.rows):
            return None
        recording = self._recording(rows.arrays)
        until = FOREVER if final and not self.frames.logs else logs[-1] + HORIZON_NS
        index, around = self._index(recording, until)
        live = self._live_contacts(index, until, logs[-1])
        truth = self.truth.beside(recording, index, around, logs[-1], until)
        return self.described(LoadedRecording(
            self.name, replace(recording, truth=truth), live, self._baselines(until)
        ))  # fmt: skip

    def _recording(self, arrays: Columns) -> Recording:
        """Frames as a recording; a new stream begins where the counter or the clock went back."""
        stamp_ns = cast('Integers', arrays['stamp_ns'])
        sequence = cast('Integers', arrays['sequence'])
        before = self._last or (int(stamp_ns[0]) - 1, int(sequence[0]) - 1)
        back = np.diff(stamp_ns, prepend=before[0]) <= 0
        back |= np.diff(sequence, prepend=before[1]) <= 0
        stream = self._stream + np.cumsum(back)
        self.count += len(stamp_ns)
        self._stream = int(stream[-1])
        self._last = (int(stamp_ns[-1]), int(sequence[-1]))
        chips, bits = cast('Array', arrays['temperature_c']), arrays['status']
        return Recording.from_arrays(
            self.layout,
            cast('Array', arrays['values']),
            stamp_ns=stamp_ns,
            sequence=sequence,
            temperature_c=chips if np.isfinite(chips).any() else None,
            status=bits if bits.any() else None,
            stream=stream,
        )

    def _index(
        self, recording: Recording, until: int
    ) -> tuple[dict[tuple[int, int], int], Integers]:
        """Row of each frame by stamp and sequence; frames around the piece, and their stamps."""
        after = read_frames(self.frames.data[: self.frames.heard_by(until)], self.layout.shape)
        around = [*self._before, *(_keys(after.arrays) if after.arrays else ())]
        keys = _keys(vars(recording))
        index = dict.fromkeys(around, ELSEWHERE)
        index.update({key: row for row, key in enumerate(keys)})
        self._before = [*self._before, *keys][-NEIGHBOURS:]
        return index, np.array([stamp for stamp, _ in around], np.int64)

    def _live_contacts(
        self, index: dict[tuple[int, int], int], until: int, last_ns: int
    ) -> LiveContacts | None:
        """Contacts about the frames of the piece; those about none are given up in time."""
        self._live = self._live or bool(self.contacts.logs)
        if not self._live:
            return None
        count = self.contacts.heard_by(until)
        taxels = self.layout.shape[0]
        messages = read_contacts(self.contacts.data[:count], taxels)
        self.lost[f'messages of {self.space}/contacts are damaged'] += messages.damaged
        self.lost[f'contacts do not fit a sensor of {taxels} taxels'] += messages.misfits
        keys = _keys(messages.arrays) if messages.arrays else []
        rows = np.array([index.get(key, -1) for key in keys], np.int64)
        kept = rows >= 0
        logs = np.array(self.contacts.logs[:count], np.int64)[messages.rows]
        waits = ~kept & (logs > last_ns - HORIZON_NS) & (until < FOREVER)
        given_up = int((~kept & ~waits).sum())
        self.lost['contacts are about frames that were not recorded'] += given_up
        self.contacts.keep(messages.rows[waits].tolist(), count)
        columns = {name: messages.arrays[name][kept] for name in STATE_FIELDS if messages.arrays}
        states = ContactStates.assemble(int(kept.sum()), taxels, columns)
        return LiveContacts(rows[kept], states, logs[kept], given_up)

    def _baselines(self, until: int) -> tuple[Frame, ...]:
        """Baselines that were heard since the piece before."""
        _, messages = self.tares.take(self.tares.heard_by(until))
        rows = read_frames(messages, self.layout.shape)
        lost = rows.damaged + rows.misfits
        self.lost[f'messages of {self.space}/baseline are damaged or do not fit'] += lost
        if not rows.arrays:
            return ()
        values, status = rows.arrays['values'], rows.arrays['status']
        counts = rows.arrays['device_time_ns'].tolist()
        return tuple(
            Frame(
                stamp_ns, sequence, cast('Array', values[i]), None, cast('Bytes', status[i]),
                averaged=counts[i],
            )
            for i, (stamp_ns, sequence) in enumerate(_keys(rows.arrays))
        )  # fmt: skip


def _keys(arrays: Columns) -> list[tuple[int, int]]:
    """Stamp (ns) and sequence of each row: together they name a frame in its bag."""
    return list(zip(arrays['stamp_ns'].tolist(), arrays['sequence'].tolist(), strict=True))


def save_recording(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording with its layout and truth into one .npz.

    Parameters
    ----------
    recording : Recording
        Every array is kept as it is.
    path : path-like
        Of the file.
    """
    arrays: Columns = {'recording_schema': np.array(SCHEMA), 'values': recording.values}
    for item in fields(Layout):
        value = getattr(recording.layout, item.name)
        if value is not None:
            arrays[f'layout_{item.name}'] = np.asarray(value)
    for name in _COLUMNS:
        if getattr(recording, name) is not None:
            arrays[name] = np.asarray(getattr(recording, name))
    arrays.update({f'truth_{key}': value for key, value in recording.truth.items()})
    save_arrays(arrays, path)


def save_arrays(arrays: Columns, path: str | os.PathLike[str]) -> Path:
    """Write plain arrays into one .npz, whole or not at all."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return write_beside(path, buffer.getvalue())


def load_recording(path: str | os.PathLike[str]) -> Recording:
    """Read a recording that `save_recording` wrote.

    Parameters
    ----------
    path : path-like
        Of the file; it may be damaged or hostile.

    Returns
    -------
    Recording
        With its layout.

    Raises
    ------
    RecordingError
        If it is no such file, holds objects, or unpacks to more than is sensible.
    """
    file = Path(path)
    try:
        arrays = calibration.plain_arrays(file, MOST_MEMBERS, MOST_BYTES)
    except calibration.DAMAGE as err:
        msg = f'{file} cannot be read as plain arrays: {str(err) or type(err).__name__}'
        raise RecordingError(msg) from err
    if arrays.get('recording_schema', np.array(0)).tolist() != SCHEMA:
        msg = f'{file} is no recording of tactile_ros (schema {SCHEMA})'
        raise RecordingError(msg)
    given = {
        name.removeprefix('layout_'): array
        for name, array in arrays.items()
        if name.startswith('layout_')
    }
    try:
        layout = Layout(
            positions=cast('Array', given['positions']),
            channels=tuple(str(name) for name in given['channels']),
            rotations=cast('Array | None', given.get('rotations')),
            saturation=cast('Array | None', given.get('saturation')),
            rate_hz=float(given['rate_hz'].item()),
            **{name: str(given[name].item()) for name in ('unit', 'frame_id', 'sensor', 'serial')},
        )
        return Recording.from_arrays(
            layout,
            cast('Array', arrays['values']),
            **{name: arrays.get(name) for name in _COLUMNS},  # type: ignore[arg-type]
            truth={
                key.removeprefix('truth_'): cast('Array', value)
                for key, value in arrays.items()
                if key.startswith('truth_')
            },
        )
    except (ValueError, KeyError, TypeError, IndexError) as err:
        msg = f'{file} is no recording: {err}'
        raise RecordingError(msg) from err


def read_csv(path: str | os.PathLike[str], layout: Layout) -> Recording:
    """Read a recording of a sensor of known layout.

    Parameters
    ----------
    path : path-like
        Of a file with a header line.
    layout : Layout
        Its taxels and channels name the columns.

    Returns
    -------
    Recording
        Readings in the unit of the layout.

    Raises
    ------
    RecordingError
        If a column of the readings is missing, unknown or not a number.
    """
    file = Path(path)
    columns = _csv_columns(file)
    taxels, channels = layout.shape
    samples = len(next(iter(columns.values())))
    names = [f'{channel}_{taxel}' for taxel in range(taxels) for channel in layout.channels]
    gone = [name for name in names if name not in columns]
    if gone:
        msg = f'{file} is no recording of {layout.shape}: column {gone[0]!r} is missing'
        raise RecordingError(msg)
    try:
        values = _floats(columns, names).reshape(samples, taxels, channels)
        stamps = _stamps(columns)
        whole = {name: _integers(columns, name) for name in ('sequence', 'stream', 'tare')}
        beside = {
            name: _floats(columns, [f'{name}_{taxel}' for taxel in range(taxels)])
            for name in ('temperature_c', 'status')
            if f'{name}_0' in columns
        }
        truth = _csv_truth(columns, taxels, samples)
        recording = Recording.from_arrays(layout, values, stamps, truth=truth, **whole, **beside)
    except (ValueError, OverflowError, KeyError) as err:
        msg = f'{file} is no recording of {layout.shape}: {err}'
        raise RecordingError(msg) from err
    if columns:
        stray = next(iter(columns))
        msg = f'{file} is no recording of {layout.shape}: column {stray!r} is not known'
        raise RecordingError(msg)
    return recording


def _csv_columns(file: Path) -> dict[str, list[str]]:
    """Cells of every column under its name."""
    try:
        with file.open(newline='', encoding='utf-8') as opened:
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
    if wrong is not None or len(set(names)) != len(names):
        where = f'line {wrong}' if wrong else 'the header'
        msg = f'{file}: {where} does not fit the {len(names)} columns'
        raise RecordingError(msg)
    body = [row for row in rows[1:] if row]
    return {name: [row[i].strip() for row in body] for i, name in enumerate(names)}


def _floats(columns: dict[str, list[str]], names: list[str]) -> Array:
    """Numbers of several columns, shape (s, n); empty cells are NaN."""
    table = [[float(cell) if cell else math.nan for cell in columns.pop(name)] for name in names]
    return np.array(table, np.float64).T


def _integers(columns: dict[str, list[str]], name: str) -> Integers | None:
    """Whole numbers of a column, shape (s,); None where it is absent."""
    if name not in columns:
        return None
    return np.array([int(cell) for cell in columns.pop(name)], np.int64)


def _stamps(columns: dict[str, list[str]]) -> Integers | None:
    """Acquisition times (ns) from whole nanoseconds or from seconds."""
    if 'time_s' not in columns:
        return _integers(columns, 'stamp_ns')
    seconds = [cell.partition('.') for cell in columns.pop('time_s')]
    return np.array([int(s) * NS_PER_S + int(f'{part:0<9.9}') for s, _, part in seconds], np.int64)


def _csv_truth(columns: dict[str, list[str]], taxels: int, samples: int) -> dict[str, Array]:
    """Truth from the columns that bear its names."""
    truth = {}
    for key in TRUTH_KEYS:
        shape = field_shape(key, taxels) if key in STATE_FIELDS else ()
        ends = [f'_{axis}' for axis in 'xyz'] if shape == (3,) else []
        ends = ends or ([f'_{n}' for n in range(math.prod(shape))] if shape else [''])
        names = [f'{key}{end}' for end in ends]
        if any(name in columns for name in names):
            given: dict[str, list[str]] = {n: columns.pop(n, [''] * samples) for n in names}
            truth[key] = _floats(given, names).reshape(samples, *shape)
    return truth
