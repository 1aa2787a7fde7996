"""Recordings out of bags and files: frames, what was said live about them, and what was true."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import struct
import zipfile
import zlib
from dataclasses import dataclass, fields, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from tactile_ros.calibration import HEADER, write_beside
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag_messages import Heard, decode
from tactile_ros.evaluation.bag_reader import read_bag
from tactile_ros.evaluation.topics import CONTACTS, FRAME, ROLES, digests_in, ends_as, split_topic
from tactile_ros.evaluation.truth import (
    DEFAULT_TRUTH,
    contacts_truth,
    is_truth_type,
    other_truth,
    unknown,
)
from tactile_ros.messages import read_baseline, read_contacts, read_frame, read_layout
from tactile_ros.types import (
    STATE_FIELDS,
    TRUTH_KEYS,
    ContactStates,
    Layout,
    Recording,
    TaxelStatus,
    field_shape,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tactile_ros.types import (
        Array,
        Bools,
        Bytes,
        ContactStates,
        Frame,
        Integers,
        Layout,
        Recording,
    )

MOST_ROWS = 5_000_000
NS_PER_S = 1_000_000_000


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
    columns = _columns(file)
    try:
        return _recording(columns, layout)
    except (ValueError, OverflowError, KeyError) as err:
        msg = f'{file} is no recording of {layout.shape}: {err}'
        raise RecordingError(msg) from err


def _columns(file: Path) -> dict[str, list[str]]:
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


def _recording(columns: dict[str, list[str]], layout: Layout) -> Recording:
    """Take known columns out of the table; what remains is refused by name."""
    taxels, channels = layout.shape
    samples = len(next(iter(columns.values())))
    names = [f'{channel}_{taxel}' for taxel in range(taxels) for channel in layout.channels]
    chips = [f'temperature_c_{taxel}' for taxel in range(taxels)]
    bits = [f'status_{taxel}' for taxel in range(taxels)]
    for name in names:
        if name not in columns:
            msg = f'column {name!r} is missing'
            raise ValueError(msg)
    values = _floats(columns, names).reshape(samples, taxels, channels)
    stamps = _stamps(columns)
    found = {name: _integers(columns, name) for name in ('sequence', 'stream', 'tare')}
    temperature = _floats(columns, chips) if chips[0] in columns else None
    status = _floats(columns, bits) if bits[0] in columns else None
    truth = _truth(columns, taxels)
    if columns:
        msg = f'column {next(iter(columns))!r} is not known'
        raise ValueError(msg)
    return Recording.from_arrays(
        layout, values, stamps, temperature_c=temperature, status=status, truth=truth, **found
    )


def _floats(columns: dict[str, list[str]], names: list[str]) -> Array:
    """Numbers of several columns, shape (s, n); empty cells are NaN."""
    table = [[float(cell) if cell else math.nan for cell in columns.pop(name)] for name in names]
    return np.array(table, np.float64).T


def _integers(columns: dict[str, list[str]], name: str) -> npt.NDArray[np.int64] | None:
    """Whole numbers of a column, shape (s,); None where it is absent."""
    if name not in columns:
        return None
    return np.array([int(cell) for cell in columns.pop(name)], np.int64)


def _stamps(columns: dict[str, list[str]]) -> npt.NDArray[np.int64] | None:
    """Acquisition times (ns) from whole nanoseconds or from seconds."""
    if 'time_s' not in columns:
        return _integers(columns, 'stamp_ns')
    seconds = [cell.partition('.') for cell in columns.pop('time_s')]
    return np.array([int(s) * NS_PER_S + int(f'{part:0<9.9}') for s, _, part in seconds], np.int64)


def _truth(columns: dict[str, list[str]], taxels: int) -> dict[str, Array]:
    """Truth from the columns that bear its names."""
    truth = {}
    for key in TRUTH_KEYS:
        shape = field_shape(key, taxels) if key in STATE_FIELDS else ()
        names = _names(key, shape)
        if any(name in columns for name in names):
            samples = len(next(iter(columns.values())))
            blank = [''] * samples
            filled = {name: columns.pop(name, blank) for name in names}
            truth[key] = _floats(filled, names).reshape(samples, *shape)
    return truth


def _names(key: str, shape: tuple[int, ...]) -> list[str]:
    """Names of the columns that hold one key."""
    if not shape:
        return [key]
    if shape == (3,):
        return [f'{key}_{axis}' for axis in 'xyz']
    return [f'{key}_{n}' for n in range(math.prod(shape))]


SCHEMA = 1
MOST_MEMBERS = 64
MOST_BYTES = 2 << 30
_COLUMNS = ('stamp_ns', 'sequence', 'temperature_c', 'status', 'stream', 'tare')
LONGEST_ENTRY = 300
END = struct.Struct('<4s6xHI6x')

Arrays = dict[str, npt.NDArray[np.generic]]


def save_recording(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording with its layout and truth into one .npz.

    Parameters
    ----------
    recording : Recording
        Every array is kept as it is.
    path : path-like
        Of the file.
    """
    arrays: Arrays = {'recording_schema': np.array(SCHEMA), 'values': recording.values}
    for field in fields(Layout):
        value = getattr(recording.layout, field.name)
        if value is not None:
            arrays[f'layout_{field.name}'] = np.asarray(value)
    for name in _COLUMNS:
        if getattr(recording, name) is not None:
            arrays[name] = np.asarray(getattr(recording, name))
    arrays.update({f'truth_{key}': value for key, value in recording.truth.items()})
    save_arrays(arrays, path)


def save_arrays(arrays: Arrays, path: str | os.PathLike[str]) -> Path:
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
    arrays = read_arrays(file)
    if arrays.get('recording_schema', np.array(0)).tolist() != SCHEMA:
        msg = f'{file} is no recording of tactile_ros (schema {SCHEMA})'
        raise RecordingError(msg)
    try:
        return _archive_recording(arrays)
    except (ValueError, KeyError, TypeError, IndexError) as err:
        msg = f'{file} is no recording: {err}'
        raise RecordingError(msg) from err


def _archive_recording(arrays: Arrays) -> Recording:
    """Put a recording together from its arrays."""

    def number(name: str) -> float:
        return float(cast('float', arrays[name].item()))

    def text(name: str) -> str:
        return str(arrays[name].item())

    layout = Layout(
        positions=cast('Array', arrays['layout_positions']),
        channels=tuple(str(name) for name in arrays['layout_channels']),
        unit=text('layout_unit'),
        rotations=cast('Array | None', arrays.get('layout_rotations')),
        saturation=cast('Array | None', arrays.get('layout_saturation')),
        rate_hz=number('layout_rate_hz'),
        frame_id=text('layout_frame_id'),
        sensor=text('layout_sensor'),
        serial=text('layout_serial'),
    )
    head = len('truth_')
    return Recording.from_arrays(
        layout,
        cast('Array', arrays['values']),
        stamp_ns=cast('Integers | None', arrays.get('stamp_ns')),
        sequence=cast('Integers | None', arrays.get('sequence')),
        temperature_c=cast('Array | None', arrays.get('temperature_c')),
        status=cast('Bytes | None', arrays.get('status')),
        stream=cast('Integers | None', arrays.get('stream')),
        tare=cast('Bools | None', arrays.get('tare')),
        truth={
            key[head:]: cast('Array', value)
            for key, value in arrays.items()
            if key.startswith('truth_')
        },
    )


def read_arrays(path: Path) -> Arrays:
    """Plain arrays of an .npz: counted, measured and typed before anything is unpacked.

    Raises
    ------
    RecordingError
        If there are too many members, too many bytes, objects, or damage.
    """
    try:
        _refuse_long_directory(path)
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            size = sum(member.file_size for member in members)
            if len(members) > MOST_MEMBERS or size > MOST_BYTES:
                msg = (
                    f'{path} unpacks to {len(members)} members of {size} bytes together; '
                    f'at most {MOST_MEMBERS} of {MOST_BYTES} bytes are read'
                )
                raise RecordingError(msg)
            return {
                member.filename[: -len('.npy')]: _read_member(archive, member)
                for member in members
                if member.filename.endswith('.npy')
            }
    except OSError as err:
        msg = f'{path} cannot be read: {err.strerror or err}'
        raise RecordingError(msg) from err
    except (zipfile.BadZipFile, ValueError, EOFError, NotImplementedError, RuntimeError) as err:
        msg = f'{path} is damaged: {err}'
        raise RecordingError(msg) from err
    except (MemoryError, zlib.error, SyntaxError, TypeError) as err:
        msg = f'{path} is damaged: {type(err).__name__}'
        raise RecordingError(msg) from err


def _refuse_long_directory(path: Path) -> None:
    """The last record must announce a short directory, which zipfile reads in one go."""
    with path.open('rb') as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - END.size, 0))
        last = file.read().ljust(END.size, b'\0')
    mark, members, length = END.unpack(last)
    if mark != b'PK\x05\x06':
        msg = 'it does not end as an .npz does'
        raise ValueError(msg)
    if members > MOST_MEMBERS or length > MOST_MEMBERS * LONGEST_ENTRY:
        msg = f'{path} lists {members} members; at most {MOST_MEMBERS} are read'
        raise RecordingError(msg)


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> npt.NDArray[np.generic]:
    """One array; its header must be plain and announce exactly the bytes that follow."""
    with archive.open(member) as file:
        # with a count: without one, all that lies behind the stated size is unpacked
        content = file.read(member.file_size)
    match = HEADER.match(content)
    if match is None:
        msg = f'{member.filename} holds objects or no plain array'
        raise ValueError(msg)
    kind, by_column, lengths = match.groups()
    dtype = np.dtype(kind.decode())
    shape = tuple(int(n) for n in lengths.split(b',') if n)
    count = math.prod(shape)
    if count * dtype.itemsize != len(content) - match.end():
        msg = f'{member.filename} announces {shape}, which does not fit its size'
        raise ValueError(msg)
    flat = np.frombuffer(content, dtype, offset=match.end()) if count else np.zeros(0, dtype)
    return flat.reshape(shape, order='F' if by_column == b'True' else 'C')


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
    """Changes that announcements of a calibration tell; those that make no sense tell none."""
    found = (_read_change(text) for text in texts)
    return tuple(change for change in found if change is not None)


def _read_change(text: str) -> ClassChange | None:
    """Change of one announcement; None: it tells none."""
    try:
        told = json.loads(text)
        label = told.get('enrolled', told.get('forgotten'))
        if not isinstance(label, str):
            return None
        presses = tuple((int(a), int(b)) for a, b in told.get('presses', ()))
        after_ns = told.get('after_ns')
        return ClassChange(
            label, str(told['sha256']), -1 if after_ns is None else int(after_ns),
            presses, bool(told.get('replace')),
        )  # fmt: skip
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


@dataclass(frozen=True)
class LoadedRecording:
    """One sensor of a bag, or a file.

    Attributes
    ----------
    name : str
        Namespace in the bag, or name of the file.
    recording : Recording
        Frames and truth.
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
    """Load a bag (folder, .mcap, .db3), an .npz or a .csv.

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
    return load_bag(file, layout, truth_topics)


def load_bag(path: Path, layout: Layout | None, truth_topics: Sequence[str]) -> Loaded:
    """Recordings of every namespace of a bag that holds frames."""

    def wanted(topic: str, kind: str) -> bool:
        truth = is_truth_type(kind) and any(ends_as(topic, name) for name in truth_topics)
        return truth or (split_topic(topic)[1], kind) in ROLES

    content = read_bag(path, wanted)
    heard = decode(content)
    problems = list(content.problems)
    foreign = sorted(name for name, kind in content.types.items() if not wanted(name, kind))
    if foreign:
        problems.append(f'topics that are not ours were left out: {", ".join(foreign)}')
    frames = [t for t in heard if split_topic(t)[1] == 'frame' and content.types[t] == FRAME]
    if not frames:
        why = '; '.join(problems[:3]) or 'it is empty'
        msg = f'{path} holds no frames that could be read ({why})'
        raise RecordingError(msg)
    found = []
    for topic in sorted(frames):
        try:
            found.append(_sensor(topic, heard, layout, truth_topics, alone=len(frames) == 1))
        except RecordingError as err:
            problems.append(f'{topic} was left out: {err}')
    if not found:
        msg = f'{path}: {"; ".join(problems)}'
        raise RecordingError(msg)
    return Loaded(tuple(found), tuple(problems))


def _sensor(
    topic: str,
    heard: dict[str, list[Heard]],
    layout: Layout | None,
    truth_topics: Sequence[str],
    alone: bool,
) -> LoadedRecording:
    """Recording of one namespace."""
    space, _ = split_topic(topic)
    problems: list[str] = []
    place = _layout(heard.get(f'{space}/layout', []), layout, problems)
    frames = _frames(heard[topic], place, problems)
    recording = _bag_recording_recording(place, frames)
    index = {key: row for row, key in enumerate(_keys(recording))}
    truth, names = _bag_recording_truth(
        [
            (name, messages)
            for name, messages in heard.items()
            if any(ends_as(name, wanted) for wanted in truth_topics)
            and (alone or name.startswith(f'{space}/'))
        ],
        recording,
        index,
        problems,
    )
    live = _live(heard.get(f'{space}/contacts', []), place, index, problems)
    told = heard.get(f'{space}/calibration', [])
    digests = [d for m in told for d in _digests(m)]
    return LoadedRecording(
        space.strip('/') or 'sensor',
        replace(recording, truth=truth),
        live,
        tuple(_frames(heard.get(f'{space}/baseline', []), place, problems, 'baselines')),
        tuple(dict.fromkeys(digests)),
        read_changes(m.message.data for m in told),  # type: ignore[attr-defined]
        names,
        tuple(problems),
    )


def _digests(heard: Heard) -> list[str]:
    """SHA-256 values that a message of text names."""
    return digests_in(str(heard.message.data).encode())  # type: ignore[attr-defined]


def _layout(heard: list[Heard], fallback: Layout | None, problems: list[str]) -> Layout:
    """Layout of the bag, else the one that was passed."""
    found = []
    for item in heard:
        try:
            found.append(read_layout(item.message))  # type: ignore[arg-type]
        except ValueError as err:
            problems.append(f'a layout makes no sense: {err}')
    if found:
        return found[-1]
    if fallback is None:
        msg = 'its layout is not in the bag; name the sensor'
        raise RecordingError(msg)
    problems.append('its layout is not in the bag; that of the named sensor is used')
    return fallback


def _frames(
    heard: list[Heard], layout: Layout, problems: list[str], what: str = 'frames'
) -> list[Frame]:
    """Frames of messages; those of another shape are counted."""
    found, refused, reason = [], 0, ''
    read = read_baseline if what == 'baselines' else read_frame
    for item in heard:
        try:
            found.append(read(item.message, layout.shape))  # type: ignore[arg-type]
        except ValueError as err:
            refused, reason = refused + 1, str(err)
    if refused:
        problems.append(f'{refused} {what} were left out: {reason}')
    return found


def _bag_recording_recording(layout: Layout, frames: list[Frame]) -> Recording:
    """Frames as arrays; a new stream begins where the counter or the clock went back."""
    if not frames:
        msg = 'none of its frames fits its layout'
        raise RecordingError(msg)
    stamps = np.array([frame.stamp_ns or 0 for frame in frames], np.int64)
    sequence = np.array([frame.sequence for frame in frames]).astype(np.int64)
    back = (np.diff(stamps) <= 0) | (np.diff(sequence) <= 0)
    stream = np.concatenate([[0], np.cumsum(back)])
    blank_c = np.full(layout.shape[0], np.nan)
    blank_bits = np.zeros(layout.shape[0], np.uint8)
    chips = [f.temperature_c for f in frames]
    bits = [f.status for f in frames]
    known_c = any(c is not None for c in chips)
    known_bits = any(b is not None for b in bits)
    return Recording.from_arrays(
        layout,
        np.stack([frame.values for frame in frames]),
        stamp_ns=stamps,
        sequence=sequence,
        temperature_c=[blank_c if c is None else c for c in chips] if known_c else None,
        status=[blank_bits if b is None else b for b in bits] if known_bits else None,
        stream=stream,
    )


def _keys(recording: Recording) -> list[tuple[int, int]]:
    """Stamp (ns) and sequence of every frame: together they name it in its bag."""
    if recording.stamp_ns is None or recording.sequence is None:
        return []
    return list(zip(recording.stamp_ns.tolist(), recording.sequence.tolist(), strict=True))


def _live(
    heard: list[Heard], layout: Layout, index: dict[tuple[int, int], int], problems: list[str]
) -> LiveContacts | None:
    """Contacts of the live run beside the frames that they are about."""
    if not heard:
        return None
    arrays, logs = read_contact_arrays(heard, layout.shape[0], problems)
    keys = zip(arrays['stamp_ns'].tolist(), arrays['sequence'].tolist(), strict=True)
    rows = np.array([index.get(key, -1) for key in keys], np.int64)
    kept = rows >= 0
    if not kept.all():
        problems.append(f'{int((~kept).sum())} contacts are about frames that were not recorded')
    known = {name: arrays[name][kept] for name in STATE_FIELDS}
    states = ContactStates.assemble(int(kept.sum()), layout.shape[0], known)
    return LiveContacts(rows[kept], states, logs[kept], int((~kept).sum()))


def read_contact_arrays(
    heard: list[Heard], taxels: int, problems: list[str]
) -> tuple[dict[str, npt.NDArray[np.generic]], Integers]:
    """Arrays and log times of contacts; messages of another shape are left out and counted."""
    good = [h for h in heard if _fits(h, taxels)]
    if len(good) < len(heard):
        lost = len(heard) - len(good)
        problems.append(f'{lost} contacts do not fit a sensor of {taxels} taxels')
    arrays = read_contacts([h.message for h in good], taxels)  # type: ignore[misc]
    return arrays, np.array([h.log_ns for h in good], np.int64)


def _fits(heard: Heard, taxels: int) -> bool:
    """Whether the per-taxel fields of a contacts message have the length of the sensor."""
    fields = ('taxel_force', 'deformation', 'taxel_status')
    return all(len(getattr(heard.message, name)) in (0, taxels) for name in fields)


def _bag_recording_truth(
    topics: list[tuple[str, list[Heard]]],
    recording: Recording,
    index: dict[tuple[int, int], int],
    problems: list[str],
) -> tuple[dict[str, npt.NDArray[np.generic]], tuple[str, ...]]:
    """Truth of all topics beside the frames; a later topic fills what an earlier left unknown."""
    merged: dict[str, npt.NDArray[np.generic]] = {}
    names: tuple[str, ...] = ()
    for topic, messages in topics:
        if messages and messages[0].type_name == CONTACTS:
            arrays, _ = read_contact_arrays(messages, recording.layout.shape[0], problems)
            part, found = contacts_truth(arrays, recording, index)
            lost = int((~found).sum())
        else:
            part, names, lost = other_truth(messages, recording, names)
        if lost:
            problems.append(f'{lost} messages of {topic} belong to no frame')
        for key, value in part.items():
            known = merged.get(key, value)
            merged[key] = np.where(unknown(known), value, known)
    return merged, names
