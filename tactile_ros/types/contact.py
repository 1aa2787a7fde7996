# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""States of contact: one patch, one frame, many frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, cast, get_args, get_type_hints, overload

import numpy as np
import numpy.typing as npt

from tactile_ros.types.frame import Array, Bools, Bytes, Columns, Integers

Shape = tuple[str | int, ...]
BLANKS = {'f': np.nan, 'i': -1, 'b': False, 'u': 0}


@dataclass(frozen=True)
class Contact:
    """One contact patch; position and force at the patch, in the sensor frame.

    `id` is kept while the patch lives; position (m), unit normal, what the skin exerts on the
    object (N), and covariances (m2, N2).
    """

    id: int
    position: Array
    normal: Array
    force: Array
    position_cov: Array
    force_cov: Array


@dataclass(frozen=True)
class _StateFields:
    """Attributes that one state and many states share, with their shapes but for the s axis.

    t and k stand for taxels and contacts; `status` is 0 where nothing is known.
    """

    force: Annotated[Array, (3,)]
    force_cov: Annotated[Array, (3, 3)]
    torque: Annotated[Array, (3,)]
    torque_cov: Annotated[Array, (3, 3)]
    position: Annotated[Array, (3,)]
    position_cov: Annotated[Array, (3, 3)]
    cell: Annotated[Integers, ()]
    cell_probability: Annotated[Array, ()]
    label: Annotated[Integers, ()]
    label_probability: Annotated[Array, ()]
    yaw: Annotated[Array, ()]
    yaw_std: Annotated[Array, ()]
    object_pose: Annotated[Array, (4, 4)]
    object_pose_cov: Annotated[Array, (6, 6)]
    symmetry: Annotated[Integers, ()]
    in_contact: Annotated[npt.NDArray[np.int8], ()]
    slip: Annotated[npt.NDArray[np.int8], ()]
    slip_probability: Annotated[Array, ()]
    taxel_force: Annotated[Array, ('t',)]
    deformation: Annotated[Array, ('t',)]
    stray_field: Annotated[Array, (3,)]
    valid: Annotated[Bools, ()]
    status: Annotated[Integers, (), 0]
    taxel_status: Annotated[Bytes, ('t',)]
    contacts_id: Annotated[Integers, ('k',)]
    contacts_position: Annotated[Array, ('k', 3)]
    contacts_normal: Annotated[Array, ('k', 3)]
    contacts_force: Annotated[Array, ('k', 3)]
    contacts_position_cov: Annotated[Array, ('k', 3, 3)]
    contacts_force_cov: Annotated[Array, ('k', 3, 3)]

    def as_dict(self) -> dict[str, object]:
        """Every attribute by its name, as plain numbers and lists of them."""
        return {name: np.asarray(column).tolist() for name, column in vars(self).items()}

    def _estimated(self) -> str:
        """Names of what is estimated anywhere."""
        blank = {name: column[2] for name, column in STATE_FIELDS.items()}
        floats = (name for name in blank if np.isnan(blank[name]) and 'contacts' not in name)
        return ', '.join(n for n in floats if np.isfinite(vars(self)[n]).any()) or 'nothing'


def _column_of(array: object, shape: Shape, *blank: float) -> tuple[Shape, type, float]:
    """Trailing shape, type of number, and what stands where nothing is known."""
    kind = get_args(get_args(array)[1])[0]
    return shape, kind, blank[0] if blank else BLANKS[np.dtype(kind).kind]


STATE_FIELDS = {
    name: _column_of(*get_args(hint))
    for name, hint in get_type_hints(_StateFields, include_extras=True).items()
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
        name: np.broadcast_to(np.array(x, kind), (samples, *field_shape(name, taxels, contacts)))
        for name, (_, kind, x) in STATE_FIELDS.items()
    }


@lru_cache(maxsize=64)
def _blank_row(taxels: int, contacts: int) -> dict[str, npt.NDArray[np.generic]]:
    return {name: column[0] for name, column in _blank(1, taxels, contacts).items()}


@dataclass(frozen=True)
class ContactState(_StateFields):
    """Contact in one frame; NaN / -1 where it is not estimated."""

    @classmethod
    def assemble(cls, taxels: int, known: Mapping[str, npt.NDArray[np.generic]]) -> ContactState:
        """Complete what is known about one frame, shape (1, ...) each, as ContactStates does."""
        contacts = known['contacts_id'].shape[1] if 'contacts_id' in known else 1
        state = cls.__new__(cls)
        # the 30 attributes at once: a frozen __init__ sets them one by one, 5 us a frame
        row = {name: column[0] for name, column in known.items()}
        vars(state).update(_blank_row(taxels, contacts), **row)
        return state

    def __repr__(self) -> str:
        touch = {1: 'in contact', 0: 'untouched'}.get(int(self.in_contact), 'contact unknown')
        return f'ContactState({touch}; force {self.force} N; estimated: {self._estimated()})'

    @property
    def contacts(self) -> list[Contact]:
        """Every patch of the frame, strongest first."""
        columns = (
            self.contacts_id.tolist(), self.contacts_position, self.contacts_normal,
            self.contacts_force, self.contacts_position_cov, self.contacts_force_cov,
        )  # fmt: skip
        return [Contact(*row) for row in zip(*columns, strict=True) if row[0] >= 0]


def stack_columns(parts: Sequence[Columns], lengths: Sequence[int]) -> Columns:
    """Columns of all parts of some lengths, one after another; blank where a part has none."""
    patches = max([1, *(part['contacts_id'].shape[1] for part in parts if 'contacts_id' in part)])
    first = {key: part[key] for part in reversed(parts) for key in part}
    return {
        key: np.concatenate([
            widened(key, part[key] if key in part else blank_column(key, column, count), patches)
            for part, count in zip(parts, lengths, strict=True)
        ])
        for key, column in first.items()
    }  # fmt: skip


def blank_column(name: str, like: npt.NDArray[np.generic], count: int) -> npt.NDArray[np.generic]:
    """So many rows of a column in which nothing is measured."""
    fill = STATE_FIELDS[name][2] if name in STATE_FIELDS else BLANKS[like.dtype.kind]
    return np.full((count, *like.shape[1:]), fill, like.dtype)


def widened(name: str, column: npt.NDArray[np.generic], patches: int) -> npt.NDArray[np.generic]:
    """State attribute with room for so many patches; others as they are."""
    shape, _, fill = STATE_FIELDS.get(name, ((), None, None))
    if shape[:1] != ('k',) or column.shape[1] >= patches:
        return column
    wide = np.full((len(column), patches, *column.shape[2:]), fill, column.dtype)
    wide[:, : column.shape[1]] = column
    return wide


@dataclass(frozen=True)
class ContactStates(_StateFields):
    """Contact in s frames: every attribute with a leading axis s."""

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

    def __repr__(self) -> str:
        touched = int((self.in_contact == 1).sum())
        counts = f'{len(self)} frames, {touched} in contact, {int(self.valid.sum())} valid'
        return f'ContactStates({counts}; estimated: {self._estimated()})'

    def __len__(self) -> int:
        return len(self.valid)

    @overload
    def __getitem__(self, index: int) -> ContactState: ...
    @overload
    def __getitem__(self, index: slice | Bools | Integers) -> ContactStates: ...

    def __getitem__(self, index: int | slice | Bools | Integers) -> ContactState | ContactStates:
        kind = ContactStates if np.ndim(self.valid[index]) else ContactState
        part = cast('ContactState | ContactStates', kind.__new__(kind))  # as in assemble
        vars(part).update({name: column[index] for name, column in vars(self).items()})
        return part

    def __iter__(self) -> Iterator[ContactState]:
        return (self[i] for i in range(len(self)))
