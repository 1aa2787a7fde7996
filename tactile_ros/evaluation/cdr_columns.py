"""Serialised messages of one type as columns: every field of many messages at once, by numpy.

Messages whose texts and lists have the same lengths hold each field at the same place. So one
message of a kind is walked through by its type's definition, and the others of that kind are cut
at the same places. What does not fit goes through rosbags once and is tried again; what rosbags
cannot read either is damaged.

Notes
-----
XCDR version 1, little-endian, as ROS 2 writes it: 4 bytes in front, primitives aligned to their
size from there on, a length of 4 bytes before a text (which ends with a zero) and a list.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from tactile_ros.evaluation.definitions import all_types

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Bytes, Integers

FRONT = b'\x00\x01'  # of little-endian CDR; two more bytes follow that mean nothing
FRONT_SIZE = 4
MOST_ENTRIES = 4096  # of a list of messages, each of which has columns of its own
BASE, NAME, ARRAY, SEQUENCE = 1, 2, 3, 4  # kinds of a field in rosbags
Columns = dict[str, npt.NDArray[np.generic]]
NUMBERS = {
    'bool': '?', 'byte': 'u1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1', 'int16': '<i2',
    'uint16': '<u2', 'int32': '<i4', 'uint32': '<u4', 'int64': '<i8', 'uint64': '<u8',
    'float32': '<f4', 'float64': '<f8',
}  # fmt: skip


class Unlike(Exception):
    """Bytes that are no message of the type, or of a form that has no columns."""


class Group(NamedTuple):
    """Messages of one kind.

    `rows` (n,) are their places among all; `columns` are fields by dotted path, of shape (n,) or
    (n, k) for a list of k; entries of a list of messages have their number in the path.
    """

    rows: Integers
    columns: Columns


@dataclass
class Places:
    """Where the fields of one kind of message are.

    Attributes
    ----------
    numbers : dict
        Path -> place, type of the number, count; None: no list.
    lengths : list of int
        Places of the lengths that make the kind.
    """

    numbers: dict[str, tuple[int, str, int | None]] = field(default_factory=dict)
    lengths: list[int] = field(default_factory=list)


class _Walk:
    """Goes through one message by the definition of its type."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = FRONT_SIZE
        self.places = Places()
        self.fields = all_types().fielddefs

    def message(self, type_name: str, path: str) -> None:
        """Every field of a message."""
        for name, (kind, what) in self.fields[type_name][1]:
            self._field(f'{path}{name}', int(kind), what)

    def _field(self, path: str, kind: int, what: object) -> None:
        if kind == BASE:
            self._plain(path, what[0], None)  # type: ignore[index]
        elif kind == NAME:
            self.message(str(what), f'{path}.')
        else:
            entry, length = cast('tuple[tuple[int, object], int]', what)
            count = self._length() if kind == SEQUENCE else length
            self._list(path, int(entry[0]), entry[1], count)

    def _list(self, path: str, kind: int, what: object, count: int) -> None:
        """Entries of a list: numbers as one column, messages and texts as columns each."""
        number = kind == BASE and what[0] in NUMBERS  # type: ignore[index]
        if number:
            self._plain(path, what[0], count)  # type: ignore[index]
            return
        if count > MOST_ENTRIES:
            raise Unlike
        for i in range(count):
            self._field(f'{path}.{i}', kind, what)

    def _plain(self, path: str, name: str, count: int | None) -> None:
        """A number, a list of numbers, or a text."""
        if name == 'string':
            count = self._length()
            self._take(path, 'u1', 1, count)
        elif name in NUMBERS:
            self._take(path, NUMBERS[name], np.dtype(NUMBERS[name]).itemsize, count)
        else:
            raise Unlike

    def _length(self) -> int:
        self._align(4)
        if self.at + 4 > len(self.data):
            raise Unlike
        self.places.lengths.append(self.at)
        (length,) = struct.unpack_from('<I', self.data, self.at)
        self.at += 4
        return int(length)

    def _take(self, path: str, form: str, size: int, count: int | None) -> None:
        if count != 0:
            self._align(size)
        self.places.numbers[path] = (self.at, form, count)
        self.at += size * (1 if count is None else count)
        if self.at > len(self.data):
            raise Unlike

    def _align(self, size: int) -> None:
        self.at += (FRONT_SIZE - self.at) % size


def places_of(data: bytes, type_name: str) -> Places:
    """Places of the fields of one message.

    Raises
    ------
    Unlike
        If it has none: it is cut, too long, not little-endian, or holds what has no columns.
    """
    walk = _Walk(data)
    if data[:2] != FRONT:
        raise Unlike
    walk.message(type_name, '')
    if len(data) - walk.at > 3:  # some middleware fills up to a multiple of 4
        raise Unlike
    return walk.places


def read_columns(messages: Sequence[bytes], type_name: str) -> tuple[list[Group], int]:
    """Columns of serialised messages.

    Parameters
    ----------
    messages : sequence of bytes
        CDR of one type, n of them.
    type_name : str
        Such as 'tactile_ros/msg/TactileFrame'.

    Returns
    -------
    groups : list of Group
        One for each kind of message.
    damaged : int
        Messages that nobody can read; they are in no group.
    """
    sizes = np.array([len(data) for data in messages], np.int64)
    groups: list[Group] = []
    refused: list[int] = []
    for size in np.unique(sizes).tolist():
        rows = np.flatnonzero(sizes == size)
        block = np.frombuffer(b''.join([messages[i] for i in rows.tolist()]), np.uint8)
        _cut(messages, rows, block.reshape(len(rows), size), type_name, groups, refused)
    damaged = 0
    for row in refused:
        again = _by_rosbags(messages[row], type_name)
        damaged += again is None
        groups += [] if again is None else [Group(np.array([row]), again)]
    return groups, damaged


def _cut(
    messages: Sequence[bytes],
    rows: Integers,
    block: Bytes,
    type_name: str,
    groups: list[Group],
    refused: list[int],
) -> None:
    """Sort messages of one size, `block` (n, size), by kind and cut each kind."""
    while len(rows):
        try:
            places = places_of(messages[int(rows[0])], type_name)
        except Unlike:
            refused.append(int(rows[0]))
            rows, block = rows[1:], block[1:]
            continue
        marks = [0, 1, *(at + i for at in places.lengths for i in range(4))]
        same = (block[:, marks] == block[0, marks]).all(axis=1)
        alike = block if same.all() else block[same]
        groups.append(Group(rows[same], _columns(alike, places)))
        rows, block = rows[~same], block[~same]


def _columns(block: Bytes, places: Places) -> Columns:
    """Fields of messages of one kind."""
    found: Columns = {}
    for path, (at, form, count) in places.numbers.items():
        width = np.dtype(form).itemsize * (1 if count is None else count)
        column = np.ascontiguousarray(block[:, at : at + width])
        values = column.view(form) if width else column.astype(form)
        found[path] = values[:, 0] if count is None else values
    return found


def _by_rosbags(data: bytes, type_name: str) -> Columns | None:
    """Columns of one message that rosbags reads and writes anew; None: it is damaged."""
    store = all_types()
    try:
        fresh = bytes(store.serialize_cdr(store.deserialize_cdr(data, type_name), type_name))
        return _columns(np.frombuffer(fresh, np.uint8)[None], places_of(fresh, type_name))
    except Exception:
        return None


def text_at(column: npt.NDArray[np.generic], row: int) -> str:
    """Text of one message, from its column of bytes (n, k)."""
    return bytes(column[row].tobytes()).rstrip(b'\0').decode('utf-8', 'replace')
