# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Serialised messages of one type as columns: every field of many messages at once, by numpy.

Messages whose texts and lists have the same lengths hold each field at the same place: one is
walked through by its type's definition, the others are cut at the same places. That takes 5 us for
the three messages of a frame, rosbags 130 us; a replay at 500 x real time has 20 us in all. What
does not fit (XCDR version 1, little-endian, as ROS 2 writes it) goes through rosbags once and is
tried again; what rosbags cannot read either is damaged.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Container, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from tactile_ros.evaluation.bag import BASE, NAME, SEQUENCE, all_types
from tactile_ros.messages import FIELD_NAMES, TAXELS, VECTORS, WRENCH_BLOCKS
from tactile_ros.types import STATE_FIELDS, Array, Bytes, Columns, Integers, field_shape
from tactile_ros.types.contact import stack_columns

FRAME = 'tactile_ros/msg/TactileFrame'
CONTACTS = 'tactile_ros/msg/TactileContacts'
STRING = 'std_msgs/msg/String'

FieldDescription: TypeAlias = Any  # a text or nested tuples, which rosbags gives no types
FRONT_BYTES = 4
MOST_ENTRIES = 4096  # of a list of messages, each of which has columns of its own
NUMBERS = {
    'bool': '?', 'byte': 'u1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1', 'int16': '<i2',
    'uint16': '<u2', 'int32': '<i4', 'uint32': '<u4', 'int64': '<i8', 'uint64': '<u8',
    'float32': '<f4', 'float64': '<f8',
}  # fmt: skip


class NoColumnsError(Exception):
    """Bytes that are no message of the type, or of a form that has no columns."""


class Group(NamedTuple):
    """Messages of one kind: places (n,) among all, fields (n,) or (n, k) by path ('a.0.b')."""

    rows: Integers
    columns: Columns


class MessageLayout:
    """Places of the fields of one message, and of the lengths in it that make its kind.

    Raises NoColumnsError if it is cut, too long, big-endian, or holds what has no columns.
    """

    def __init__(self, data: bytes, type_name: str) -> None:
        self.data, self.at = data, FRONT_BYTES
        self.lengths: list[int] = []
        self.formats: dict[str, tuple[int, str, int | None]] = {}
        if data[:2] != b'\x00\x01':
            raise NoColumnsError
        self._message(type_name, '')
        if len(data) - self.at > 3:  # some middleware fills up to a multiple of 4
            raise NoColumnsError

    def _message(self, type_name: str, path: str) -> None:
        for name, (kind, what) in all_types().fielddefs[type_name][1]:
            self._field(f'{path}{name}', int(kind), what)

    def _field(self, path: str, kind: int, what: FieldDescription) -> None:
        if kind == NAME:
            self._message(str(what), f'{path}.')
        elif kind == BASE:
            text = what[0] == 'string'
            self._number(path, 'uint8' if text else what[0], self._length() if text else None)
        else:
            (entry_kind, entry), count = what
            count = self._length() if kind == SEQUENCE else count
            if entry_kind == BASE and entry[0] != 'string':
                self._number(path, entry[0], count)
                return
            if count > MOST_ENTRIES:
                raise NoColumnsError
            for i in range(count):
                self._field(f'{path}.{i}', int(entry_kind), entry)

    def _number(self, path: str, name: str, count: int | None) -> None:
        if name not in NUMBERS:
            raise NoColumnsError
        form = NUMBERS[name]
        size = np.dtype(form).itemsize
        if count != 0:
            self.at += (FRONT_BYTES - self.at) % size
        self.formats[path] = self.at, form, count
        self.at += size * (1 if count is None else count)
        if self.at > len(self.data):
            raise NoColumnsError

    def _length(self) -> int:
        self.at += (FRONT_BYTES - self.at) % 4
        if self.at + 4 > len(self.data):
            raise NoColumnsError
        self.lengths.append(self.at)
        self.at += 4
        return int(struct.unpack_from('<I', self.data, self.at - 4)[0])

    def columns(self, block: Bytes) -> Columns:
        """Fields of messages (n, bytes) of this kind."""
        places = self.formats.values()
        form = np.dtype({
            'names': list(self.formats),
            'offsets': [at for at, _, _ in places],
            'formats': [kind if count is None else (kind, (count,)) for _, kind, count in places],
            'itemsize': block.shape[1],
        })  # fmt: skip
        table = np.ascontiguousarray(block).view(form)[:, 0]
        return {path: table[path] for path in self.formats}


def read_columns(messages: Sequence[bytes], type_name: str) -> tuple[list[Group], int]:
    """Groups of serialised messages (CDR) of one type, and how many are damaged and in none."""
    sizes = np.array([len(data) for data in messages], np.int64)
    groups: list[Group] = []
    damaged = 0
    for size in np.unique(sizes).tolist():
        rows = np.flatnonzero(sizes == size)
        joined = b''.join([messages[i] for i in rows.tolist()])
        block = np.frombuffer(joined, np.uint8).reshape(len(rows), size)
        while len(rows):
            first = int(rows[0])
            same = np.zeros(len(rows), bool)
            same[0] = True
            try:
                places = MessageLayout(messages[first], type_name)
                marks = [0, 1, *(at + i for at in places.lengths for i in range(4))]
                same = (block[:, marks] == block[0, marks]).all(axis=1)
                alike = block if same.all() else block[same]
                groups.append(Group(rows[same], places.columns(alike)))
            except NoColumnsError:
                columns = _by_rosbags(messages[first], type_name)
                damaged += columns is None
                groups += [] if columns is None else [Group(rows[:1], columns)]
            rows, block = rows[~same], block[~same]
    return groups, damaged


def _by_rosbags(data: bytes, type_name: str) -> Columns | None:
    """Columns of one message that rosbags reads and writes anew; None: it is damaged."""
    store = all_types()
    try:
        fresh = bytes(store.serialize_cdr(store.deserialize_cdr(data, type_name), type_name))
        places = MessageLayout(fresh, type_name)
    except Exception:  # whatever rosbags makes of it
        return None
    return places.columns(np.frombuffer(fresh, np.uint8)[None])


def read_texts(messages: Sequence[bytes]) -> tuple[Integers, list[str]]:
    """Places among all, and texts, of serialised std_msgs/String that can be read."""
    groups, _ = read_columns(messages, STRING)
    texts = {
        row: column.tobytes().rstrip(b'\0').decode('utf-8', 'replace')
        for group in groups
        for row, column in zip(group.rows.tolist(), group.columns['data'], strict=True)
    }
    rows = sorted(texts)
    return np.array(rows, np.int64), [texts[row] for row in rows]


def stamps_of(columns: Columns) -> Integers:
    """Times of headers, shape (n,) (ns)."""
    seconds = columns['header.stamp.sec'].astype(np.int64)
    return np.asarray(seconds * 1_000_000_000 + columns['header.stamp.nanosec'].astype(np.int64))


def vectors_of(columns: Columns, path: str, axes: str = 'xyz') -> Array:
    """Points, vectors or quaternions, shape (n, 3 or 4)."""
    return np.stack([columns[f'{path}.{axis}'] for axis in axes], axis=1)


class Rows(NamedTuple):
    """Messages as arrays of n entries, which are those at `rows` (n,) among all."""

    rows: Integers
    arrays: Columns
    damaged: int  # messages that are in no row
    misfits: int


def read_rows(
    messages: Sequence[bytes],
    type_name: str,
    convert: Callable[[Columns], Columns],
    fits: Callable[[Columns], bool] = lambda _: True,
) -> Rows:
    """Arrays of serialised messages of one type; without any row there is no array."""
    groups, damaged = read_columns(messages, type_name)
    good = [group for group in groups if fits(group.columns)]
    misfits = sum(len(g.rows) for g in groups) - sum(len(g.rows) for g in good)
    parts = [convert(group.columns) for group in good]
    if len(good) == 1:
        return Rows(good[0].rows, parts[0], damaged, misfits)
    rows = np.concatenate([np.zeros(0, np.int64), *(group.rows for group in good)])
    order = np.argsort(rows, kind='stable')
    arrays = stack_columns(parts, [len(group.rows) for group in good])
    return Rows(rows[order], {k: v[order] for k, v in arrays.items()}, damaged, misfits)


def read_frames(messages: Sequence[bytes], shape: tuple[int, int]) -> Rows:
    """Arrays (n, ...) of serialised TactileFrames (t, c) by field; of others they are misfits."""
    taxels, channels = shape

    def fits(columns: Columns) -> bool:
        lengths = {columns[name].shape[1] for name in ('temperature_c', 'status')}
        return columns['values'].shape[1] == taxels * channels and lengths <= {0, taxels}

    def convert(columns: Columns) -> Columns:
        count = len(columns['sequence'])
        chips, bits = columns['temperature_c'], columns['status']
        return {
            'stamp_ns': stamps_of(columns),
            'sequence': columns['sequence'].astype(np.int64),
            'device_time_ns': columns['device_time_ns'].astype(np.int64),
            'values': columns['values'].reshape(count, taxels, channels),
            'temperature_c': chips if chips.shape[1] else np.full((count, taxels), np.nan),
            'status': bits if bits.shape[1] else np.zeros((count, taxels), np.uint8),
        }

    return read_rows(messages, FRAME, convert, fits)


def read_contacts(
    messages: Sequence[bytes], taxels: int, wanted: Container[str] = STATE_FIELDS
) -> Rows:
    """Wanted state attributes of serialised TactileContacts; of other taxels they are misfits."""

    def fits(columns: Columns) -> bool:
        return all(columns[name].shape[1] in (0, taxels) for name in TAXELS)

    def convert(columns: Columns) -> Columns:
        listed = [columns[name] for name in columns if re.fullmatch(r'contacts\.\d+\.id', name)]
        count = len(columns['sequence'])
        ids = np.array(listed, np.int64).reshape(len(listed), count).T
        patches = max(1, int((ids >= 0).sum(axis=1).max(initial=0)))
        arrays: Columns = {'stamp_ns': stamps_of(columns)}
        for name in ('sequence', 'session', 'repetition'):
            arrays[name] = columns[name].astype(np.int64)
        for name, (_, dtype, fill) in STATE_FIELDS.items():
            if name in wanted:
                arrays[name] = np.full((count, *field_shape(name, taxels, patches)), fill, dtype)
                values = _state_values(columns, name)
                if values.size:
                    arrays[name][:] = values
        _fill_patches(arrays, columns, ids)
        return arrays

    return read_rows(messages, CONTACTS, convert, fits)


def _state_values(columns: Columns, name: str) -> npt.NDArray[np.generic]:
    if name in VECTORS:
        return vectors_of(columns, FIELD_NAMES.get(name, name))
    if block := WRENCH_BLOCKS.get(name):
        return columns[FIELD_NAMES[name]].reshape(-1, 6, 6)[:, block, block]
    return columns.get(name, np.zeros(0))


def _fill_patches(arrays: Columns, columns: Columns, ids: Integers) -> None:
    """Fill in patches in their order; the position is that of the first, or of a last of id -1."""
    listed = ids >= 0
    slot = np.cumsum(listed, axis=1) - 1
    last = ids.shape[1] - 1
    for k in range(ids.shape[1]):
        rows = np.flatnonzero(listed[:, k])
        values: Columns = {'id': ids[:, k]}
        for name in ('position', 'normal', 'force'):
            values[name] = vectors_of(columns, f'contacts.{k}.{name}')
        for name in ('position', 'force'):
            values[f'{name}_cov'] = columns[f'contacts.{k}.{name}_covariance'].reshape(-1, 3, 3)
        if 'contacts_id' in arrays:
            for name, column in values.items():
                arrays[f'contacts_{name}'][rows, slot[rows, k]] = column[rows]
        holds = np.ones(len(ids), bool) if k == 0 else ~listed[:, k]
        for name in ('position', 'position_cov') if k in (0, last) else ():
            if name in arrays:
                arrays[name][holds] = values[name][holds]
