"""Frames of one sensor with what is known about them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.types.arrays import Array, Bools, Bytes, Integers, as_shape
from tactile_ros.types.contact import STATE_FIELDS, field_shape
from tactile_ros.types.frames import Frame, Layout

if TYPE_CHECKING:
    from collections.abc import Mapping

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
