"""The vocabulary of the house: frames, layouts, outlines, contacts, recordings and contracts.

Letters of shapes: s sample, t taxel, c channel, k contact, 3 for space. SI units; NaN and -1 mean
not measured or not estimated, never zero.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntFlag
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from types import TracebackType

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]


class TaxelStatus(IntFlag):
    """Bits of one taxel in one frame, as in TactileFrame."""

    STALE = 1
    SATURATED = 2
    STUCK = 4
    ERROR = 8
    WRAPPED = 16
    DEAD = 32


class FrameStatus(IntFlag):
    """Why a frame's contacts are limited or must not be used, as in TactileContacts."""

    NOT_CALIBRATED = 1
    NO_BASELINE = 2
    BAD_TAXELS = 4
    SATURATED = 8
    STRAY_FIELD = 16
    OUT_OF_RANGE = 32
    ABSTAINED = 64
    STALE = 128


def as_shape(name: str, value: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return `value` as float64 of `shape`, where -1 stands for any length.

    Parameters
    ----------
    name : str
        What the value is, for the sentence of the error.
    value : array_like
        Numbers.
    shape : tuple of int
        Wanted shape; -1 accepts any length.

    Returns
    -------
    ndarray, shape `shape`
        C-contiguous float64, a copy only where needed.

    Raises
    ------
    ValueError
        If the shape differs.
    """
    array = np.ascontiguousarray(value, dtype=np.float64)
    fits = array.ndim == len(shape) and all(
        want in (-1, got) for want, got in zip(shape, array.shape)
    )
    if not fits:
        wanted = str(shape).replace('-1', 'any')
        msg = f'{name} must have shape {wanted}; received {np.shape(value)}'
        raise ValueError(msg)
    return array


@dataclass(frozen=True)
class Layout:
    """Where the taxels of one sensor sit and what they measure.

    Attributes
    ----------
    positions : ndarray, shape (t, 3)
        Taxel positions in the sensor frame (m).
    channels : tuple of str
        Names of the channels of a taxel.
    unit : str
        Unit of values: 'T' or '1' (a fraction).
    rotations : ndarray, shape (t, 3, 3), or None
        Rotation from chip axes to sensor axes; values are in chip axes. None: aligned.
    saturation : ndarray, shape (c,), or None
        Magnitude at which a channel clips (unit of values); inf or None: never.
    rate_hz : float
        Nominal frame rate (Hz).
    frame_id, sensor, serial : str
        Name of the sensor frame, key of the sensor, which board.
    """

    positions: Array
    channels: tuple[str, ...]
    unit: str
    rotations: Array | None = None
    saturation: Array | None = None
    rate_hz: float = float('nan')
    frame_id: str = 'tactile_sensor'
    sensor: str = ''
    serial: str = ''

    def __post_init__(self) -> None:
        """Check shapes once, at the door."""
        positions = as_shape('positions of Layout', self.positions, (-1, 3))
        object.__setattr__(self, 'positions', positions)
        if self.rotations is not None:
            rotations = as_shape('rotations of Layout', self.rotations, (len(positions), 3, 3))
            object.__setattr__(self, 'rotations', rotations)
        limit = np.inf if self.saturation is None else self.saturation
        limits = np.broadcast_to(np.asarray(limit, np.float64), (len(self.channels),))
        object.__setattr__(self, 'saturation', np.array(limits))

    @property
    def shape(self) -> tuple[int, int]:
        """Taxels and channels of one frame (t, c)."""
        return len(self.positions), len(self.channels)


@dataclass(frozen=True)
class Frame:
    """One reading of every taxel of one sensor.

    Attributes
    ----------
    stamp_ns : int or None
        Acquisition time (ns); None: an independent frame.
    sequence : int
        Frame counter of its stream; a gap is lost frames.
    values : ndarray, shape (t, c)
        Raw readings (unit of the layout).
    temperature_c : ndarray, shape (t,), or None
        What the chips report (degrees Celsius); None: not measured.
    status : ndarray, shape (t,), or None
        Bits of `TaxelStatus`; None: all good.
    device_time_ns : int
        The device's own clock, unwrapped; 0: it has none.
    dropped : int
        Frames known lost since activation.
    """

    stamp_ns: int | None
    sequence: int
    values: Array
    temperature_c: Array | None = None
    status: Bytes | None = None
    device_time_ns: int = 0
    dropped: int = 0

    def __post_init__(self) -> None:
        """Refuse values that are no (t, c) table."""
        if np.ndim(self.values) != 2:
            msg = f'values of Frame must have shape (t, c); received {np.shape(self.values)}'
            raise ValueError(msg)


@dataclass(frozen=True)
class Outline:
    """A flat object described by closed loops in its own frame.

    Attributes
    ----------
    name : str
        Name of the object.
    loops : tuple of ndarray, shape (n, 2)
        Corners (m), counter-clockwise; holes clockwise.
    thickness : float or None
        Thickness, or the radius of a tube (m).
    bend : float or None
        Angle tube: its two axes leave the origin along +x and at `bend` (rad).
    """

    name: str
    loops: tuple[Array, ...]
    thickness: float | None = None
    bend: float | None = None

    def __post_init__(self) -> None:
        """Check every loop once."""
        loops = tuple(as_shape(f'a loop of Outline {self.name}', x, (-1, 2)) for x in self.loops)
        object.__setattr__(self, 'loops', loops)


@dataclass(frozen=True)
class Contact:
    """One contact patch; position and force at the patch, in the sensor frame.

    Attributes
    ----------
    id : int
        Kept while the patch lives.
    position, normal, force : ndarray, shape (3,)
        Position (m), unit normal, and what the skin exerts on the object (N).
    position_cov, force_cov : ndarray, shape (3, 3)
        Covariances (m2, N2).
    """

    id: int
    position: Array
    normal: Array
    force: Array
    position_cov: Array
    force_cov: Array


# name: (trailing shape, dtype, fill); t and k stand for taxels and contacts
STATE_FIELDS: dict[str, tuple[tuple[str | int, ...], type, float]] = {
    'force': ((3,), np.float64, np.nan),
    'force_cov': ((3, 3), np.float64, np.nan),
    'torque': ((3,), np.float64, np.nan),
    'torque_cov': ((3, 3), np.float64, np.nan),
    'position': ((3,), np.float64, np.nan),
    'position_cov': ((3, 3), np.float64, np.nan),
    'cell': ((), np.int64, -1),
    'cell_probability': ((), np.float64, np.nan),
    'label': ((), np.int64, -1),
    'label_probability': ((), np.float64, np.nan),
    'yaw': ((), np.float64, np.nan),
    'yaw_std': ((), np.float64, np.nan),
    'object_pose': ((4, 4), np.float64, np.nan),
    'object_pose_cov': ((6, 6), np.float64, np.nan),
    'symmetry': ((), np.int64, -1),
    'in_contact': ((), np.int8, -1),
    'slip': ((), np.int8, -1),
    'slip_probability': ((), np.float64, np.nan),
    'taxel_force': (('t',), np.float64, np.nan),
    'deformation': (('t',), np.float64, np.nan),
    'stray_field': ((3,), np.float64, np.nan),
    'valid': ((), np.bool_, False),
    'status': ((), np.int64, 0),
    'taxel_status': (('t',), np.uint8, 0),
    'contacts_id': (('k',), np.int64, -1),
    'contacts_position': (('k', 3), np.float64, np.nan),
    'contacts_normal': (('k', 3), np.float64, np.nan),
    'contacts_force': (('k', 3), np.float64, np.nan),
    'contacts_position_cov': (('k', 3, 3), np.float64, np.nan),
    'contacts_force_cov': (('k', 3, 3), np.float64, np.nan),
}
TRUTH_KEYS = (
    'force', 'torque', 'position', 'cell', 'label', 'yaw', 'object_pose', 'symmetry', 'in_contact',
    'slip', 'taxel_force', 'deformation', 'stray_field', 'session', 'repetition',
)  # fmt: skip


def field_shape(name: str, taxels: int, contacts: int = 1) -> tuple[int, ...]:
    """Trailing shape of a state attribute or truth key for a sensor of `taxels`."""
    tail = STATE_FIELDS[name][0] if name in STATE_FIELDS else ()
    lengths = {'t': taxels, 'k': contacts}
    return tuple(lengths[n] if isinstance(n, str) else n for n in tail)


@lru_cache(maxsize=64)
def _blank(samples: int, taxels: int, contacts: int) -> dict[str, npt.NDArray[np.generic]]:
    """Read-only arrays of `nothing known` that take no memory."""
    return {
        name: np.broadcast_to(
            np.array(fill, dtype), (samples, *field_shape(name, taxels, contacts))
        )
        for name, (_, dtype, fill) in STATE_FIELDS.items()
    }


@dataclass(frozen=True)
class _StateFields:
    """The attributes that one state and many states share (public_face, without the s axis)."""

    force: Array
    force_cov: Array
    torque: Array
    torque_cov: Array
    position: Array
    position_cov: Array
    cell: Integers
    cell_probability: Array
    label: Integers
    label_probability: Array
    yaw: Array
    yaw_std: Array
    object_pose: Array
    object_pose_cov: Array
    symmetry: Integers
    in_contact: npt.NDArray[np.int8]
    slip: npt.NDArray[np.int8]
    slip_probability: Array
    taxel_force: Array
    deformation: Array
    stray_field: Array
    valid: Bools
    status: Integers
    taxel_status: Bytes
    contacts_id: Integers
    contacts_position: Array
    contacts_normal: Array
    contacts_force: Array
    contacts_position_cov: Array
    contacts_force_cov: Array


@dataclass(frozen=True)
class ContactState(_StateFields):
    """What is known about the contact in one frame; NaN / -1 where it is not estimated."""

    @property
    def contacts(self) -> list[Contact]:
        """Every patch of the frame, strongest first."""
        return [
            Contact(
                int(self.contacts_id[k]),
                self.contacts_position[k],
                self.contacts_normal[k],
                self.contacts_force[k],
                self.contacts_position_cov[k],
                self.contacts_force_cov[k],
            )
            for k in range(len(self.contacts_id))
            if self.contacts_id[k] >= 0
        ]


@dataclass(frozen=True)
class ContactStates(_StateFields):
    """What is known about the contact in s frames: every attribute with a leading axis s."""

    @classmethod
    def assemble(
        cls, samples: int, taxels: int, known: Mapping[str, npt.NDArray[np.generic]]
    ) -> ContactStates:
        """Complete what is known with NaN / -1 (read-only views) where it is not.

        Parameters
        ----------
        samples, taxels : int
            Lengths s and t.
        known : mapping of str to ndarray, shape (s, ...)
            Any subset of the attributes.

        Returns
        -------
        ContactStates
            All attributes.
        """
        contacts = known['contacts_id'].shape[1] if 'contacts_id' in known else 1
        return cls(**{**_blank(samples, taxels, contacts), **known})  # type: ignore[arg-type]

    def __len__(self) -> int:
        """Count of frames s."""
        return len(self.valid)

    def __getitem__(self, index: int) -> ContactState:
        """State of one frame."""
        return ContactState(**{name: getattr(self, name)[index] for name in STATE_FIELDS})

    def __iter__(self) -> Iterator[ContactState]:
        """States of the frames, one after the other."""
        return (self[i] for i in range(len(self)))


def _column(
    name: str, value: npt.ArrayLike | None, samples: int, dtype: type
) -> npt.NDArray[np.generic] | None:
    """A per-sample column of a Recording with its length checked."""
    if value is None:
        return None
    array = np.asarray(value).astype(dtype)
    if array.shape != (samples,):
        msg = f'{name} of Recording must have shape ({samples},); received {array.shape}'
        raise ValueError(msg)
    return array


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
        return array.astype(np.float64)
    whole = np.where(np.isfinite(array.astype(np.float64)), array, -1)
    return whole.astype(np.int64)


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
    def from_arrays(  # noqa: PLR0913
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
            If a shape does not fit, a truth key is unknown, or stamps do not increase.
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
        """Rows at which a new stream begins, shape (s,); every row where frames have no stream."""
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
            **{name: None if x is None else x[rows] for name, x in columns.items()},
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


class Device(Protocol):
    """A sensor that can be read, real or simulated; a context manager."""

    @property
    def layout(self) -> Layout:
        """Where the taxels are."""
        ...

    def read(self, timeout: float) -> Frame:
        """Wait at most `timeout` (s) for the next frame; DeviceTimeout when none came."""
        ...

    def __enter__(self) -> Device:
        """Open."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        ...


class Estimator(Protocol):
    """A published method: fitted arrays in attributes that end in `_`."""

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> Estimator:
        """Learn from features (s, d) and targets (s, k)."""
        ...

    def predict(self, x: Array) -> Array:
        """Targets (s, k) for features (s, d)."""
        ...
