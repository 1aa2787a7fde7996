"""Many serialised messages at once as the arrays of recordings, of states and of truth."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_ros.evaluation.cdr_columns import Columns, Group, read_columns
from tactile_ros.types import STATE_FIELDS, field_shape

if TYPE_CHECKING:
    from collections.abc import Container, Sequence

    from tactile_ros.types import Array, Bools, Bytes, Integers

SECOND_NS = 1_000_000_000
PER_TAXEL = ('taxel_force', 'deformation', 'taxel_status')
VECTORS = {'force': 'wrench.force', 'torque': 'wrench.torque', 'stray_field': 'stray_field'}
BLOCKS = {'force_cov': slice(0, 3), 'torque_cov': slice(3, 6)}
PATCH_VECTORS = ('position', 'normal', 'force')


class FrameRows(NamedTuple):
    """Frames as columns.

    `rows` (n,) are their places among the messages; `stamp_ns`, `sequence`, `device_time_ns` (n,),
    `values` (n, t, c), `temperature_c` (n, t), NaN unknown, `status` (n, t); `damaged`
    and `misfits` are counts of messages that are in no row.
    """

    rows: Integers
    stamp_ns: Integers
    sequence: Integers
    device_time_ns: Integers
    values: Array
    temperature_c: Array
    status: Bytes
    damaged: int
    misfits: int

    def select(self, kept: Bools) -> FrameRows:
        """Some of the frames."""
        return self._replace(
            rows=self.rows[kept],
            stamp_ns=self.stamp_ns[kept],
            sequence=self.sequence[kept],
            device_time_ns=self.device_time_ns[kept],
            values=self.values[kept],
            temperature_c=self.temperature_c[kept],
            status=self.status[kept],
        )


def read_frames(messages: Sequence[bytes], shape: tuple[int, int]) -> FrameRows:
    """Frames of serialised TactileFrames.

    Parameters
    ----------
    messages : sequence of bytes
        CDR, s of them.
    shape : tuple of int
        Taxels and channels (t, c); frames of another are counted as misfits.
    """
    taxels, channels = shape
    groups, damaged = read_columns(messages, 'tactile_ros/msg/TactileFrame')
    good = [g for g in groups if _is_frame(g.columns, taxels, channels)]
    misfits = sum(len(g.rows) for g in groups) - sum(len(g.rows) for g in good)
    count = len(messages)
    values = np.empty((count, taxels * channels))
    chips, bits = np.full((count, taxels), np.nan), np.zeros((count, taxels), np.uint8)
    stamps, sequence, device = (np.zeros(count, np.int64) for _ in range(3))
    there = np.zeros(count, bool)
    for rows, columns in good:
        there[rows] = True
        stamps[rows], values[rows] = stamps_of(columns), columns['values']
        sequence[rows] = columns['sequence'].astype(np.int64)
        device[rows] = columns['device_time_ns'].astype(np.int64)
        if columns['temperature_c'].shape[1]:
            chips[rows] = columns['temperature_c']
        if columns['status'].shape[1]:
            bits[rows] = columns['status']
    table = values.reshape(count, taxels, channels)
    every = FrameRows(
        np.arange(count), stamps, sequence, device, table, chips, bits, damaged, misfits
    )
    return every if there.all() else every.select(there)


def _is_frame(columns: Columns, taxels: int, channels: int) -> bool:
    """Whether the lists of frames have the lengths of the sensor."""
    return (
        columns['values'].shape[1] == taxels * channels
        and columns['temperature_c'].shape[1] in (0, taxels)
        and columns['status'].shape[1] in (0, taxels)
    )


def stamps_of(columns: Columns) -> Integers:
    """Times of headers, shape (n,) (ns)."""
    seconds = columns['header.stamp.sec'].astype(np.int64)
    return np.asarray(seconds * SECOND_NS + columns['header.stamp.nanosec'].astype(np.int64))


def vectors_of(columns: Columns, path: str) -> Array:
    """Points or vectors, shape (n, 3)."""
    return np.stack([columns[f'{path}.{axis}'] for axis in 'xyz'], axis=1)


class ContactRows(NamedTuple):
    """Contacts as `messages.read_contacts` gives them; the other fields as of `FrameRows`."""

    rows: Integers
    arrays: Columns
    damaged: int
    misfits: int


def read_contact_rows(
    messages: Sequence[bytes], taxels: int, wanted: Container[str] = STATE_FIELDS
) -> ContactRows:
    """Arrays of serialised TactileContacts.

    Parameters
    ----------
    messages : sequence of bytes
        CDR, s of them.
    taxels : int
        Count t; messages of another are counted as misfits.
    wanted : container of str
        State attributes to read.
    """
    groups, damaged = read_columns(messages, 'tactile_ros/msg/TactileContacts')
    fitting = [g for g in groups if _are_contacts(g.columns, taxels)]
    misfits = sum(len(g.rows) for g in groups) - sum(len(g.rows) for g in fitting)
    rows = np.concatenate([g.rows for g in fitting]) if fitting else np.zeros(0, np.int64)
    order = np.argsort(rows, kind='stable')
    patches = max([1, *(_most_patches(g) for g in fitting)])
    arrays: Columns = {
        name: np.full((len(rows), *field_shape(name, taxels, patches)), fill, dtype)
        for name, (_, dtype, fill) in STATE_FIELDS.items()
        if name in wanted
    }
    for name in ('sequence', 'session', 'repetition', 'stamp_ns'):
        arrays[name] = np.zeros(len(rows), np.int64)
    first = 0
    for group in fitting:
        last = first + len(group.rows)
        _fill({name: column[first:last] for name, column in arrays.items()}, group.columns)
        first = last
    if (np.diff(rows) < 0).any():
        arrays = {name: column[order] for name, column in arrays.items()}
    return ContactRows(rows[order], arrays, damaged, misfits)


def _are_contacts(columns: Columns, taxels: int) -> bool:
    """Whether the lists per taxel have the length of the sensor."""
    return all(columns[name].shape[1] in (0, taxels) for name in PER_TAXEL)


def _ids(columns: Columns) -> npt.NDArray[np.int32]:
    """Ids of the patches, shape (n, k)."""
    found: list[npt.NDArray[np.generic]] = []
    while f'contacts.{len(found)}.id' in columns:
        found.append(columns[f'contacts.{len(found)}.id'])
    count = len(columns['sequence'])
    return np.stack(found, axis=1) if found else np.zeros((count, 0), np.int32)  # type: ignore[return-value]


def _most_patches(group: Group) -> int:
    ids = _ids(group.columns)
    return int((ids >= 0).sum(axis=1).max(initial=0))


def _fill(out: Columns, columns: Columns) -> None:
    """Write one kind of messages into its rows of all arrays."""
    out['stamp_ns'][:] = stamps_of(columns)
    for name, column in out.items():
        if name in VECTORS:
            column[:] = vectors_of(columns, VECTORS[name])
        elif name in BLOCKS:
            block = BLOCKS[name]
            column[:] = columns['wrench_covariance'].reshape(-1, 6, 6)[:, block, block]
        elif name in PER_TAXEL:
            if columns[name].shape[1]:
                column[:] = columns[name]
        elif name in columns:
            column[:] = columns[name]
    _fill_patches(out, columns)


def _fill_patches(out: Columns, columns: Columns) -> None:
    """Patches in their order; the position is that of the first, or of a last one of id -1."""
    ids = _ids(columns)
    slot = np.cumsum(ids >= 0, axis=1) - 1
    last = ids.shape[1] - 1
    for k in range(ids.shape[1]) if 'contacts_id' in out else ():
        there = np.flatnonzero(ids[:, k] >= 0)
        place = slot[there, k]
        out['contacts_id'][there, place] = ids[there, k]
        for name in PATCH_VECTORS:
            told = vectors_of(columns, f'contacts.{k}.{name}')
            out[f'contacts_{name}'][there, place] = told[there]
        for name in ('position', 'force'):
            spread = _covariance(columns, k, name)
            out[f'contacts_{name}_cov'][there, place] = spread[there]
    for k in sorted({0, last}) if last >= 0 else ():
        rows = slice(None) if k == 0 else ids[:, k] < 0
        if 'position' in out:
            out['position'][rows] = vectors_of(columns, f'contacts.{k}.position')[rows]
        if 'position_cov' in out:
            out['position_cov'][rows] = _covariance(columns, k, 'position')[rows]


def _covariance(columns: Columns, k: int, name: str) -> npt.NDArray[np.generic]:
    """Of one patch, shape (n, 3, 3)."""
    return columns[f'contacts.{k}.{name}_covariance'].reshape(-1, 3, 3)
