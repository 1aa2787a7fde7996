# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Frames of one sensor with their truth; joining, and what an honest split keeps together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from tactile_ros.types.contact import STATE_FIELDS, field_shape, stack_columns
from tactile_ros.types.frame import Array, Bools, Bytes, Columns, Frame, Integers, Layout, as_shape

TRUTH_KEYS = (
    'force', 'torque', 'position', 'cell', 'label', 'yaw', 'object_pose', 'symmetry', 'in_contact',
    'slip', 'taxel_force', 'deformation', 'stray_field', 'session', 'repetition',
)  # fmt: skip
TURN_ERROR = 1e-3  # poses are written with four digits, too
BLOCKS = 10
FIRM = 0.02  # of the largest force: above the drift of a load cell
CALM = 1.5e-3  # of the largest force: less is nothing


def _column(
    name: str, value: npt.ArrayLike | None, samples: int, dtype: type
) -> npt.NDArray[np.generic] | None:
    """A per-sample column of a Recording with its length checked."""
    if value is None:
        return None
    array = np.asarray(value)
    if array.shape != (samples,):
        msg = f'{name} of Recording must have shape ({samples},); received {array.shape}'
        raise ValueError(msg)
    if array.dtype.kind == 'f' and len(odd := array[(array != array.round()) | np.isinf(array)]):
        msg = f'{name} of Recording must be whole numbers; received {odd[0]:g}'
        raise ValueError(msg)
    return np.asarray(array.astype(dtype))


def _truth_column(name: str, value: npt.ArrayLike, samples: int, taxels: int) -> Array | Integers:
    """One truth array with its name, shape and values checked."""
    if name not in TRUTH_KEYS:
        msg = f'truth of Recording must be one of {", ".join(TRUTH_KEYS)}; received {name!r}'
        raise ValueError(msg)
    wanted, array = (samples, *field_shape(name, taxels)), np.asarray(value)
    if array.shape != wanted:
        msg = f'truth {name!r} of Recording must have shape {wanted}; received {array.shape}'
        raise ValueError(msg)
    if name in STATE_FIELDS and STATE_FIELDS[name][1] is np.float64:
        numbers = array.astype(np.float64)
        if name == 'object_pose':
            _check_poses(numbers)
        if np.isinf(numbers).any():
            msg = f'truth {name!r} of Recording must be finite, or NaN where unknown; received inf'
            raise ValueError(msg)
        return numbers
    if array.dtype.kind not in 'biu':
        array = array.astype(np.float64)
        array = np.where(np.isfinite(array), array, -1)
    wrong = ~np.isin(array, (1, 0, -1))
    if name in ('in_contact', 'slip') and wrong.any():
        msg = (
            f'truth {name!r} of Recording must be 1, 0 or -1 (unknown); '
            f'received {array[wrong][0]} in row {np.flatnonzero(wrong)[0]}'
        )
        raise ValueError(msg)
    return array.astype(np.int64)


def _check_poses(poses: Array) -> None:
    """Refuse matrices (s, 4, 4) that move no rigid object; rows with NaN are unknown."""
    known = ~np.isnan(poses).any(axis=(1, 2))
    turn, last = poses[known, :3, :3], poses[known, 3]
    with np.errstate(over='ignore', invalid='ignore'):
        off = np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        off += np.abs(last - [0.0, 0.0, 0.0, 1.0]).max(axis=1)
        rigid = (off <= TURN_ERROR) & (np.linalg.det(turn) > 0)
    rigid &= np.isfinite(poses[known, :3, 3]).all(axis=1)
    if not rigid.all():
        row = int(np.flatnonzero(known)[~rigid][0])
        msg = (
            "truth 'object_pose' of Recording must hold rotations (orthonormal, right-handed) "
            f'above a last row 0, 0, 0, 1; row {row} does not'
        )
        raise ValueError(msg)


@dataclass(frozen=True)
class Recording:
    """Frames of one sensor with what is known about them.

    Attributes
    ----------
    values : ndarray, shape (s, t, c)
        Raw readings (unit of the layout).
    stamp_ns, sequence : ndarray, shape (s,), or None
        Acquisition times, None: independent frames, no step with memory is run; frame counter.
    temperature_c, status : ndarray, shape (s, t), or None
        What the chips report; bits of `TaxelStatus`.
    stream, tare : ndarray, shape (s,), or None
        One continuous stream per value; resting frames: a run of them gives the baseline of what
        follows in its stream.
    truth : dict
        Any subset of `TRUTH_KEYS`; NaN or -1 where unknown.
    """

    layout: Layout
    values: Array
    stamp_ns: Integers | None = None
    sequence: Integers | None = None
    temperature_c: Array | None = None
    status: Bytes | None = None
    stream: Integers | None = None
    tare: Bools | None = None
    truth: Columns = field(default_factory=dict)

    def __repr__(self) -> str:
        inner = ('layout', 'values', 'truth')
        known = [name for name, x in vars(self).items() if x is not None and name not in inner]
        truth = ', '.join(self.truth) or 'none'
        frames = f'{len(self)} frames of {self.layout}; {", ".join(known)}'
        return f'Recording({frames}; truth: {truth})'

    @classmethod
    def from_arrays(
        cls, layout: Layout, values: npt.ArrayLike, stamp_ns: npt.ArrayLike | None = None,
        sequence: npt.ArrayLike | None = None, temperature_c: npt.ArrayLike | None = None,
        status: npt.ArrayLike | None = None, stream: npt.ArrayLike | None = None,
        tare: npt.ArrayLike | None = None,
        truth: Mapping[str, npt.ArrayLike | None] | None = None,
    ) -> Recording:  # fmt: skip
        """Check shapes and types once and hold the arrays; see the class for their meaning.

        ValueError if a shape does not fit, a truth key or value can not be, or stamps do not
        increase inside a stream.
        """
        taxels, channels = layout.shape
        table = as_shape('values of Recording', values, (-1, taxels, channels))
        s = len(table)
        if temperature_c is not None:
            temperature_c = as_shape('temperature_c of Recording', temperature_c, (s, taxels))
        if status is not None:
            status = as_shape('status of Recording', status, (s, taxels)).astype(np.uint8)
        given = {key: value for key, value in (truth or {}).items() if value is not None}
        columns = {
            'stamp_ns': _column('stamp_ns', stamp_ns, s, np.int64),
            'sequence': _column('sequence', sequence, s, np.int64),
            'temperature_c': temperature_c,
            'status': status,
            'stream': _column('stream', stream, s, np.int64),
            'tare': _column('tare', tare, s, np.bool_),
            'truth': {key: _truth_column(key, value, s, taxels) for key, value in given.items()},
        }
        recording = cls(layout, table, **columns)  # type: ignore[arg-type]
        if recording.stamp_ns is not None and s > 1:
            back = (np.diff(recording.stamp_ns) <= 0) & ~recording.restarts[1:]
            if back.any():
                row = int(np.flatnonzero(back)[0]) + 1
                msg = f'stamp_ns of Recording must increase inside a stream; row {row} does not'
                raise ValueError(msg)
        return recording

    @classmethod
    def from_frames(
        cls, layout: Layout, frames: Sequence[Frame], stream: npt.ArrayLike | None = None,
        tare: npt.ArrayLike | None = None,
    ) -> Recording:  # fmt: skip
        """Frames of one layout; stamps and temperatures are kept where all frames have them."""
        clean = np.zeros(layout.shape[0], np.uint8)
        stamps = [frame.stamp_ns for frame in frames]
        chips = [frame.temperature_c for frame in frames if frame.temperature_c is not None]
        return cls.from_arrays(
            layout,
            np.array([frame.values for frame in frames]),
            None if None in stamps else np.array(stamps, np.int64),
            temperature_c=np.array(chips) if len(chips) == len(frames) else None,
            status=np.array([clean if f.status is None else f.status for f in frames]),
            stream=stream,
            tare=tare,
        )

    def __len__(self) -> int:
        return len(self.values)

    @property
    def restarts(self) -> Bools:
        """Rows at which a new stream begins, shape (s,); the first alone where none is stated."""
        first: Bools = np.arange(len(self)) == 0
        if self.stream is not None:
            first[1:] = self.stream[1:] != self.stream[:-1]
        return first

    def select(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.int64] | slice) -> Recording:
        """Recording of some of the rows (mask, indices or slice over s), in their order."""
        columns = {
            name: None if x is None else x[rows]
            for name, x in vars(self).items()
            if name not in ('layout', 'truth')
        }
        truth = {key: value[rows] for key, value in self.truth.items()}
        return replace(self, truth=truth, **columns)  # type: ignore[arg-type]

    def frame(self, row: int) -> Frame:
        """Frame of one row, as a driver would have given it."""
        return Frame(
            stamp_ns=None if self.stamp_ns is None else int(self.stamp_ns[row]),
            sequence=row if self.sequence is None else int(self.sequence[row]),
            values=self.values[row],
            temperature_c=None if self.temperature_c is None else self.temperature_c[row],
            status=None if self.status is None else self.status[row],
        )


def join(recordings: Sequence[Recording]) -> Recording:
    """Several recordings of one layout as one, with streams and sessions that stay apart.

    Stamps are kept only if all have them; truth that one does not have is unknown there.
    """
    if len(recordings) == 1:
        return recordings[0]
    stamped = all(r.stamp_ns is not None for r in recordings)
    lengths = [len(r) for r in recordings]
    truth = stack_columns([r.truth for r in recordings], lengths)
    number = np.repeat(np.arange(len(recordings)), lengths)
    pairs = np.column_stack([number, truth.get('session', np.zeros_like(number))])
    truth['session'] = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)
    names = ['values', 'temperature_c', 'status', 'tare', *['stamp_ns'] * stamped]
    known = [{n: x for n in names if (x := vars(r)[n]) is not None} for r in recordings]
    stream = np.cumsum(np.concatenate([r.restarts for r in recordings]))
    columns = stack_columns(known, lengths)
    return Recording.from_arrays(recordings[0].layout, stream=stream, truth=truth, **columns)


def are_ordered(recordings: Sequence[Recording]) -> bool:
    """True where stamps, streams or tare rows say that neighbouring rows belong together."""
    columns = [column for one in recordings for column in (one.stamp_ns, one.tare, one.stream)]
    return any(column is not None for column in columns)


def resting_rows(recording: Recording) -> Bools:
    """Rows (s,) that give the baseline: tare rows, else those that truth calls untouched."""
    if recording.tare is not None and recording.tare.any():
        return recording.tare
    if 'in_contact' in recording.truth:
        return np.asarray(recording.truth['in_contact'] == 0)
    return np.zeros(len(recording), bool)


def touched_rows(recording: Recording) -> Bools:
    """Rows (s,) at which truth places a contact: a position, a cell, a label or `in_contact`."""
    truth, touched = recording.truth, np.zeros(len(recording), bool)
    for key in truth.keys() & {'cell', 'label'}:
        touched |= truth[key].astype(np.int64) >= 0
    if 'position' in truth:
        touched |= np.isfinite(truth['position'].astype(np.float64)).any(axis=1)
    if 'in_contact' in truth:
        known = truth['in_contact'].astype(np.int64)
        touched = (touched & (known != 0)) | (known == 1)
    return _untared(recording, touched)


def firm_rows(recording: Recording) -> Bools:
    """Rows (s,) whose true force is well above what a load cell makes of nothing."""
    size = _force_sizes(recording)
    return _untared(recording, size > FIRM * size.max(initial=0.0))


def calm_rows(recording: Recording) -> Bools:
    """Rows (s,) of a time course whose true force is what a load cell makes of nothing."""
    if 'force' not in recording.truth or recording.stamp_ns is None:
        return np.zeros(len(recording), bool)
    size, force = _force_sizes(recording), recording.truth['force'].astype(np.float64)
    calm = np.isfinite(force).any(axis=1) & (size <= CALM * size.max(initial=0.0))
    return _untared(recording, calm)


def _force_sizes(recording: Recording) -> Array:
    """True forces (s,) (N), 0 where unknown."""
    force = recording.truth.get('force', np.zeros((len(recording), 3)))
    return np.asarray(np.linalg.norm(np.nan_to_num(force.astype(np.float64)), axis=1))


def _untared(recording: Recording, rows: Bools) -> Bools:
    """Those of some rows (s,) that are no tare."""
    return rows if recording.tare is None else rows & ~recording.tare


def groups_of(recording: Recording) -> Columns:
    """Groups (s,) of a joined recording that an honest split keeps together.

    'session': recording and session; 'group': session and repetition (press cycles, say), or ten
    blocks of rows where fewer than three of them are known.
    """
    zeros = np.zeros(len(recording), np.int64)
    session = recording.truth.get('session', zeros).astype(np.int64)
    repetition = recording.truth.get('repetition', zeros).astype(np.int64)
    pairs = np.column_stack([session, repetition])
    group = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)
    if len(np.unique(group)) < 3:
        group = _blocks(recording)
    return {'session': session, 'group': group}


def _blocks(recording: Recording) -> Integers:
    """Ten parts: contiguous in time or stream; of independent frames by content, not by order."""
    count = len(recording)
    if recording.stamp_ns is None and recording.stream is None:
        width = int(np.prod(recording.layout.shape))
        table = np.nan_to_num(recording.values.reshape(count, width))
        _, rank = np.unique(table, axis=0, return_inverse=True)
        return np.asarray(rank, np.int64).reshape(-1) % BLOCKS
    stream = np.cumsum(recording.restarts) - 1
    streams = int(stream[-1]) + 1 if count else 1
    if streams >= BLOCKS:
        return stream * BLOCKS // streams
    return np.arange(count) * BLOCKS // max(count, 1)
