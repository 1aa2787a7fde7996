"""Frames of one sensor with what is known about them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.types.contact import STATE_FIELDS, field_shape
from tactile_ros.types.frame import Array, Bools, Bytes, Columns, Frame, Integers, Layout, as_shape

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

BLOCKS = 10
FIRM = 0.02  # of the largest force: above the drift of a load cell


def refuse_other_shape(sensor: str, layout: Layout, shape: tuple[int, ...]) -> None:
    """Raise ValueError if frames have another shape than `layout` says, naming both."""
    if shape != layout.shape:
        msg = (
            f'frames of {sensor} must have shape {layout.shape} (t, c) as its config says; '
            f'received {shape}'
        )
        raise ValueError(msg)


def refuse_tare(sensor: str, layout: Layout, tared: bool, frames: Sequence[Frame]) -> None:
    """Raise ValueError if frames, or a fit that is not `tared`, cannot give a baseline."""
    if not tared:
        msg = (
            'tare of a pipeline must follow a fit with tare rows or in_contact 0; '
            'this one was fitted on readings without a baseline'
        )
        raise ValueError(msg)
    if not frames:
        msg = 'frames of tare must hold at least one resting frame; received none'
        raise ValueError(msg)
    for frame in frames:
        refuse_other_shape(sensor, layout, np.shape(frame.values))


def refuse_foreign(sensor: str, layout: Layout, *recordings: Recording) -> None:
    """Raise ValueError if there is no recording, or one does not measure what `layout` says."""
    if not recordings:
        msg = 'recordings of fit must hold at least one Recording; received none'
        raise ValueError(msg)
    for recording in recordings:
        found = recording.layout
        refuse_other_shape(sensor, layout, found.shape)
        if (found.unit, found.channels) != (layout.unit, layout.channels):
            msg = (
                f'frames of {sensor} must have channels {", ".join(layout.channels)} in '
                f'{layout.unit}; received {", ".join(found.channels)} in {found.unit}'
            )
            raise ValueError(msg)


def join(recordings: Sequence[Recording]) -> Recording:
    """Several recordings of one sensor as one, with streams that stay apart.

    Parameters
    ----------
    recordings : sequence of Recording
        Of one layout. Stamps are kept only if all have them; truth that one lacks is unknown.

    Returns
    -------
    Recording
        Streams, and sessions where known, are numbered through.
    """
    if len(recordings) == 1:
        return recordings[0]
    first = recordings[0]
    stamped = all(r.stamp_ns is not None for r in recordings)
    return Recording.from_arrays(
        first.layout,
        np.concatenate([r.values for r in recordings]),
        stamp_ns=np.concatenate([r.stamp_ns for r in recordings]) if stamped else None,  # type: ignore[misc]
        temperature_c=_joined(recordings, 'temperature_c', np.nan, np.float64),
        status=_joined(recordings, 'status', 0, np.uint8),
        stream=np.cumsum(np.concatenate([r.restarts for r in recordings])),
        tare=_joined(recordings, 'tare', 0, np.bool_),
        truth=_joined_truth(recordings),
    )


def _joined(
    recordings: Sequence[Recording], name: str, fill: float, dtype: type
) -> npt.NDArray[np.generic] | None:
    """A column that some recordings may lack; None if all do."""
    columns = [getattr(r, name) for r in recordings]
    if all(column is None for column in columns):
        return None
    shape = next(np.shape(column)[1:] for column in columns if column is not None)
    return np.concatenate(
        [
            np.full((len(r), *shape), fill, dtype) if column is None else column
            for r, column in zip(recordings, columns, strict=True)
        ]
    )


def _joined_truth(recordings: Sequence[Recording]) -> Columns:
    """Truth of all, unknown where a recording has none; sessions of recordings stay apart."""
    truth: Columns = {}
    for key in {key for r in recordings for key in r.truth}:
        sample = next(r.truth[key] for r in recordings if key in r.truth)
        fill = np.nan if sample.dtype.kind == 'f' else -1
        parts = [
            r.truth.get(key, np.full((len(r), *sample.shape[1:]), fill, sample.dtype))
            for r in recordings
        ]
        truth[key] = np.concatenate(parts)
    number = np.concatenate([np.full(len(r), i) for i, r in enumerate(recordings)])
    session = truth.get('session', np.zeros(len(number), np.int64)).astype(np.int64)
    truth['session'] = np.unique(np.column_stack([number, session]), axis=0, return_inverse=True)[
        1
    ].reshape(-1)
    return truth


def are_ordered(recordings: Sequence[Recording]) -> bool:
    """Whether neighbouring rows belong together: stamps, streams or tare rows say so."""
    return any(
        column is not None for one in recordings for column in (one.stamp_ns, one.tare, one.stream)
    )


def resting_rows(recording: Recording) -> Bools:
    """Rows (s,) that give the baseline: tare rows, else those that truth calls untouched."""
    if recording.tare is not None and recording.tare.any():
        return recording.tare
    if 'in_contact' in recording.truth:
        return np.asarray(recording.truth['in_contact'] == 0)
    return np.zeros(len(recording), bool)


def touched_rows(recording: Recording) -> Bools:
    """Rows (s,) at which truth places a contact: a position, a cell, a label or `in_contact`."""
    touched = np.zeros(len(recording), bool)
    for key in ('cell', 'label'):
        if key in recording.truth:
            touched |= recording.truth[key].astype(np.int64) >= 0
    if 'position' in recording.truth:
        touched |= np.isfinite(recording.truth['position'].astype(np.float64)).any(axis=1)
    if 'in_contact' in recording.truth:
        known = recording.truth['in_contact'].astype(np.int64)
        touched = (touched & (known != 0)) | (known == 1)
    return touched if recording.tare is None else touched & ~recording.tare


def firm_rows(recording: Recording) -> Bools:
    """Rows (s,) at which truth tells a force well above what a load cell makes of nothing."""
    if 'force' not in recording.truth:
        return np.zeros(len(recording), bool)
    force = np.nan_to_num(recording.truth['force'].astype(np.float64))
    size = np.linalg.norm(force, axis=1)
    firm = np.asarray(size > FIRM * size.max(initial=0.0))
    return firm if recording.tare is None else firm & ~recording.tare


def left_out(
    recordings: Sequence[Recording],
    joined: Recording,
    whole: Bools,
    good: Bools,
    learned: Collection[str],
) -> dict[str, float]:
    """Count what a fit did not learn from, and what it was told and did not learn.

    Parameters
    ----------
    recordings : sequence of Recording
        As they were given.
    joined : Recording
        All of them.
    whole, good : ndarray, shape (s,)
        Rows of which all taxels could be used; those of them that could be learned from.
    learned : collection of str
        Targets that can be estimated now.

    Returns
    -------
    dict of str to float
        Counts by what they are of; empty where all was of use.
    """
    counts = {
        'rows with a faulty taxel': int((~whole).sum()),
        'rows without a baseline': int((whole & ~good).sum()),
    }
    if joined.stamp_ns is None:
        stamped = sum(len(r) for r in recordings if r.stamp_ns is not None)
        counts['stamps, since a recording has none'] = stamped
    found = {what: float(count) for what, count in counts.items() if count}
    for key in sorted((joined.truth.keys() & STATE_FIELDS.keys()) - {'in_contact', *learned}):
        column = joined.truth[key]
        known = np.isfinite(column) if column.dtype.kind == 'f' else column != -1
        told = known.reshape(len(known), -1).any(axis=1) if len(known) else np.zeros(0, bool)
        if told.any():
            found[f'usable rows that tell {key}, which was not learned'] = float(
                (told & good).sum()
            )
    return found


def groups_of(recording: Recording) -> Columns:
    """What an honest split keeps together.

    Parameters
    ----------
    recording : Recording
        Joined over recordings.

    Returns
    -------
    dict of str to ndarray, shape (s,)
        'session': recording and session; 'group': session and repetition (press cycles, say),
        or contiguous blocks of rows where nothing is known.
    """
    zeros = np.zeros(len(recording), np.int64)
    session = recording.truth.get('session', zeros).astype(np.int64)
    repetition = recording.truth.get('repetition', zeros).astype(np.int64)
    pairs = np.column_stack([session, repetition])
    _, group = np.unique(pairs, axis=0, return_inverse=True)
    group = np.asarray(group).reshape(-1)
    if len(np.unique(group)) < 3:
        group = _blocks(recording)
    return {'session': session, 'group': group}


def _blocks(recording: Recording) -> Integers:
    """Ten parts: contiguous where rows follow in time or stream, never cutting many streams."""
    if recording.stamp_ns is None and recording.stream is None:
        return _blocks_by_content(recording)
    stream = np.cumsum(recording.restarts) - 1
    count = int(stream[-1]) + 1 if len(stream) else 1
    if count >= BLOCKS:
        return stream * BLOCKS // count
    return np.arange(len(recording)) * BLOCKS // max(len(recording), 1)


def _blocks_by_content(recording: Recording) -> Integers:
    """Ten parts of independent frames that the order of rows does not change."""
    table = np.nan_to_num(
        recording.values.reshape(len(recording), int(np.prod(recording.values.shape[1:])))
    )
    _, rank = np.unique(table, axis=0, return_inverse=True)
    return np.asarray(rank, np.int64).reshape(-1) % BLOCKS


TRUTH_KEYS = (
    'force', 'torque', 'position', 'cell', 'label', 'yaw', 'object_pose', 'symmetry', 'in_contact',
    'slip', 'taxel_force', 'deformation', 'stray_field', 'session', 'repetition',
)  # fmt: skip
THREE_VALUED = ('in_contact', 'slip')
TURN_ERROR = 1e-3  # poses are written with four digits, too


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
    if array.dtype.kind == 'f' and not np.isfinite(array).all():
        msg = f'{name} of Recording must be whole numbers; received NaN or inf'
        raise ValueError(msg)
    whole: npt.NDArray[np.generic] = array.astype(dtype)
    return whole


def _truth_column(name: str, value: npt.ArrayLike, samples: int, taxels: int) -> Array | Integers:
    """One truth array with its name, shape and dtype checked."""
    if name not in TRUTH_KEYS:
        msg = f'truth of Recording must be one of {", ".join(TRUTH_KEYS)}; received {name!r}'
        raise ValueError(msg)
    wanted = (samples, *field_shape(name, taxels))
    array = np.asarray(value)
    if array.shape != wanted:
        msg = f'truth {name!r} of Recording must have shape {wanted}; received {array.shape}'
        raise ValueError(msg)
    if name in STATE_FIELDS and STATE_FIELDS[name][1] is np.float64:
        numbers = array.astype(np.float64)
        if name == 'object_pose':
            _refuse_no_poses(numbers)
        if np.isinf(numbers).any():
            msg = f'truth {name!r} of Recording must be finite, or NaN where unknown; received inf'
            raise ValueError(msg)
        return numbers
    if array.dtype.kind not in 'biu':
        array = array.astype(np.float64)
        array = np.where(np.isfinite(array), array, -1)
    if name in THREE_VALUED:
        _refuse_other_answers(name, array)
    return array.astype(np.int64)


def _refuse_other_answers(name: str, column: npt.NDArray[np.generic]) -> None:
    """Refuse what is neither yes, no nor unknown."""
    wrong = ~np.isin(column, (1, 0, -1))
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        msg = (
            f'truth {name!r} of Recording must be 1, 0 or -1 (unknown); '
            f'received {column[row]} in row {row}'
        )
        raise ValueError(msg)


def _refuse_no_poses(poses: Array) -> None:
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
    layout : Layout
        Of the sensor.
    values : ndarray, shape (s, t, c)
        Raw readings (unit of the layout).
    stamp_ns : ndarray, shape (s,), or None
        Acquisition times; None: independent frames, no step with memory is run.
    sequence : ndarray, shape (s,), or None
        Frame counter; a gap is lost frames.
    temperature_c : ndarray, shape (s, t), or None
        What the chips report.
    status : ndarray, shape (s, t), or None
        Bits of `TaxelStatus`.
    stream : ndarray, shape (s,), or None
        One continuous stream per value.
    tare : ndarray, shape (s,), or None
        Resting frames: a run of them gives the baseline of what follows in its stream.
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
    truth: dict[str, npt.NDArray[np.generic]] = field(default_factory=dict)

    @classmethod
    def from_arrays(
        cls,
        layout: Layout,
        values: npt.ArrayLike,
        stamp_ns: npt.ArrayLike | None = None,
        sequence: npt.ArrayLike | None = None,
        temperature_c: npt.ArrayLike | None = None,
        status: npt.ArrayLike | None = None,
        stream: npt.ArrayLike | None = None,
        tare: npt.ArrayLike | None = None,
        truth: Mapping[str, npt.ArrayLike | None] | None = None,
    ) -> Recording:
        """Check shapes and types once and hold the arrays; see the class for their meaning.

        Raises
        ------
        ValueError
            If a shape does not fit, a truth key is unknown or its values can not be, or stamps do
            not increase.
        """
        taxels, channels = layout.shape
        table = as_shape('values of Recording', values, (-1, taxels, channels))
        s = len(table)
        chips = None
        if temperature_c is not None:
            chips = as_shape('temperature_c of Recording', temperature_c, (s, taxels))
        bits = None
        if status is not None:
            bits = as_shape('status of Recording', status, (s, taxels)).astype(np.uint8)
        known = {
            key: _truth_column(key, value, s, taxels)
            for key, value in (truth or {}).items()
            if value is not None
        }
        recording = cls(
            layout,
            table,
            _column('stamp_ns', stamp_ns, s, np.int64),  # type: ignore[arg-type]
            _column('sequence', sequence, s, np.int64),  # type: ignore[arg-type]
            chips,
            bits,
            _column('stream', stream, s, np.int64),  # type: ignore[arg-type]
            _column('tare', tare, s, np.bool_),  # type: ignore[arg-type]
            known,  # type: ignore[arg-type]
        )
        recording._refuse_unordered_stamps()
        return recording

    @classmethod
    def from_frames(cls, layout: Layout, frames: Sequence[Frame]) -> Recording:
        """Frames of one stream; stamps and temperatures are in all of them or in none."""
        clean = np.zeros(layout.shape[0], np.uint8)
        stamps = [frame.stamp_ns for frame in frames]
        chips = [frame.temperature_c for frame in frames if frame.temperature_c is not None]
        return cls.from_arrays(
            layout,
            np.stack([frame.values for frame in frames]),
            None if None in stamps else np.array(stamps, np.int64),
            temperature_c=np.stack(chips) if chips else None,
            status=np.stack([clean if f.status is None else f.status for f in frames]),
        )

    def _refuse_unordered_stamps(self) -> None:
        """Stamps increase inside a stream; across streams they need not."""
        if self.stamp_ns is None or len(self) < 2:
            return
        back = (np.diff(self.stamp_ns) <= 0) & ~self.restarts[1:]
        if back.any():
            row = int(np.flatnonzero(back)[0]) + 1
            msg = f'stamp_ns of Recording must increase inside a stream; row {row} does not'
            raise ValueError(msg)

    def __len__(self) -> int:
        """Count of frames s."""
        return len(self.values)

    @property
    def restarts(self) -> Bools:
        """Rows at which a new stream begins, shape (s,); the first alone where none is told."""
        first = np.zeros(len(self), bool)
        first[:1] = True
        if self.stream is not None:
            first[1:] = self.stream[1:] != self.stream[:-1]
        return first

    def select(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.int64] | slice) -> Recording:
        """Recording of some of the rows, in their order.

        Parameters
        ----------
        rows : ndarray or slice
            Mask, indices or slice over s.

        Returns
        -------
        Recording
            With the same layout.
        """
        columns = {
            f.name: getattr(self, f.name)
            for f in fields(self)
            if f.name not in ('layout', 'truth')
        }
        return Recording(
            self.layout,
            truth={key: value[rows] for key, value in self.truth.items()},
            **{name: None if x is None else x[rows] for name, x in columns.items()},  # type: ignore[arg-type]
        )

    def frame(self, row: int) -> Frame:
        """Frame of one row, as a driver would have given it."""
        return Frame(
            stamp_ns=None if self.stamp_ns is None else int(self.stamp_ns[row]),
            sequence=row if self.sequence is None else int(self.sequence[row]),
            values=self.values[row],
            temperature_c=None if self.temperature_c is None else self.temperature_c[row],
            status=None if self.status is None else self.status[row],
        )
