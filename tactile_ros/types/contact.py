"""What is known about contacts: one patch, one frame, many frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.types.frame import Array, Bools, Bytes, Integers

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


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


_FLOAT, _INT = (np.float64, np.nan), (np.int64, -1)
# name: (trailing shape, dtype, fill); t and k stand for taxels and contacts
STATE_FIELDS: dict[str, tuple[tuple[str | int, ...], type, float]] = {
    'force': ((3,), *_FLOAT),
    'force_cov': ((3, 3), *_FLOAT),
    'torque': ((3,), *_FLOAT),
    'torque_cov': ((3, 3), *_FLOAT),
    'position': ((3,), *_FLOAT),
    'position_cov': ((3, 3), *_FLOAT),
    'cell': ((), *_INT),
    'cell_probability': ((), *_FLOAT),
    'label': ((), *_INT),
    'label_probability': ((), *_FLOAT),
    'yaw': ((), *_FLOAT),
    'yaw_std': ((), *_FLOAT),
    'object_pose': ((4, 4), *_FLOAT),
    'object_pose_cov': ((6, 6), *_FLOAT),
    'symmetry': ((), *_INT),
    'in_contact': ((), np.int8, -1),
    'slip': ((), np.int8, -1),
    'slip_probability': ((), *_FLOAT),
    'taxel_force': (('t',), *_FLOAT),
    'deformation': (('t',), *_FLOAT),
    'stray_field': ((3,), *_FLOAT),
    'valid': ((), np.bool_, False),
    'status': ((), np.int64, 0),
    'taxel_status': (('t',), np.uint8, 0),
    'contacts_id': (('k',), *_INT),
    'contacts_position': (('k', 3), *_FLOAT),
    'contacts_normal': (('k', 3), *_FLOAT),
    'contacts_force': (('k', 3), *_FLOAT),
    'contacts_position_cov': (('k', 3, 3), *_FLOAT),
    'contacts_force_cov': (('k', 3, 3), *_FLOAT),
}


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


@lru_cache(maxsize=64)
def _blank_row(taxels: int, contacts: int) -> dict[str, npt.NDArray[np.generic]]:
    """Nothing known of one frame."""
    return {name: column[0] for name, column in _blank(1, taxels, contacts).items()}


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

    @classmethod
    def assemble(cls, taxels: int, known: Mapping[str, npt.NDArray[np.generic]]) -> ContactState:
        """Complete what is known about one frame, shape (1, ...) each, as ContactStates does."""
        contacts = known['contacts_id'].shape[1] if 'contacts_id' in known else 1
        state = cls.__new__(cls)
        # the 30 attributes at once: a frozen __init__ sets them one by one, 5 us a frame
        vars(state).update(_blank_row(taxels, contacts))
        vars(state).update({name: column[0] for name, column in known.items()})
        return state

    @property
    def contacts(self) -> list[Contact]:
        """Every patch of the frame, strongest first."""
        columns = (
            self.contacts_id.tolist(), self.contacts_position, self.contacts_normal,
            self.contacts_force, self.contacts_position_cov, self.contacts_force_cov,
        )  # fmt: skip
        return [Contact(*row) for row in zip(*columns, strict=True) if row[0] >= 0]


@dataclass(frozen=True)
class ContactStates(_StateFields):
    """What is known about the contact in s frames: every attribute with a leading axis s."""

    @classmethod
    def assemble(
        cls, samples: int, taxels: int, known: Mapping[str, npt.NDArray[np.generic]]
    ) -> ContactStates:
        """Complete some attributes, shape (s, ...), by read-only views of NaN / -1."""
        contacts = known['contacts_id'].shape[1] if 'contacts_id' in known else 1
        return cls(**{**_blank(samples, taxels, contacts), **known})  # type: ignore[arg-type]

    def refuse_misfit(self, taxels: int) -> None:
        """Raise ValueError where an attribute has another shape or kind than its name says."""
        for name, (_, dtype, _) in STATE_FIELDS.items():
            found = getattr(self, name)
            wanted = (len(self), *field_shape(name, taxels, self.contacts_id.shape[1]))
            if found.shape != wanted or found.dtype.kind != np.dtype(dtype).kind:
                msg = (
                    f'{name} of ContactStates must have shape {wanted} and type '
                    f'{np.dtype(dtype)}; received {found.shape}, {found.dtype}'
                )
                raise ValueError(msg)

    def __len__(self) -> int:
        """Count of frames s."""
        return len(self.valid)

    def __getitem__(self, index: int) -> ContactState:
        """State of one frame."""
        return ContactState(**{name: getattr(self, name)[index] for name in STATE_FIELDS})

    def __iter__(self) -> Iterator[ContactState]:
        """States of the frames, one after the other."""
        return (self[i] for i in range(len(self)))
