"""TactileContacts <-> ContactState, rows of truth, and WrenchStamped from a state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, cast

import numpy as np
import numpy.typing as npt

from tactile_ros.messages.fields import fill_vector, packed, packed_bits, sized, stamp_ns, vector
from tactile_ros.types import STATE_FIELDS, field_shape

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.messages.fields import (
        ContactsMessage,
        PatchMessage,
        VectorMessage,
        WrenchStampedMessage,
    )
    from tactile_ros.types import ContactState

UnknownAs = Literal['zero', 'nan']

# state attribute -> field of TactileContacts, wherever the two names differ
FIELD_NAMES = {
    'force': 'wrench.force',
    'torque': 'wrench.torque',
    'force_cov': 'wrench_covariance',
    'torque_cov': 'wrench_covariance',
    'contacts_id': 'id',
    'contacts_position': 'position',
    'contacts_normal': 'normal',
    'contacts_force': 'force',
    'contacts_position_cov': 'position_covariance',
    'contacts_force_cov': 'force_covariance',
}
_VECTORS = ('force', 'torque', 'stray_field')
_TAXELS = ('taxel_force', 'deformation', 'taxel_status')
_SCALARS = tuple(name for name, (shape, _, _) in STATE_FIELDS.items() if not shape)
_PATCH_VECTORS = ('contacts_position', 'contacts_normal', 'contacts_force')
_PATCH_COVARIANCES = ('contacts_position_cov', 'contacts_force_cov')
_WRENCH_BLOCKS = {'force_cov': slice(0, 3), 'torque_cov': slice(3, 6)}


def fill_contacts(
    message: ContactsMessage, state: ContactState, patch: Callable[[], PatchMessage]
) -> None:
    """Write a state (or a row of truth) into a fresh TactileContacts, header and sequence apart.

    The position of the state is that of the first patch. Where it is not (truth without patches,
    the origin of a recognised object), one more entry of id -1 at the end holds it.
    """
    for name in _SCALARS:
        setattr(message, name, np.asarray(getattr(state, name)).item())
    for name in _TAXELS:
        _fill_taxels(message, name, getattr(state, name))
    for name in _VECTORS:
        fill_vector(_place(message, FIELD_NAMES.get(name, name)), getattr(state, name))
    covariance = np.full((6, 6), np.nan)
    for name, block in _WRENCH_BLOCKS.items():
        covariance[block, block] = getattr(state, name)
    message.wrench_covariance = covariance.ravel()
    message.contacts = _patches(state, patch)
    message.session = message.repetition = -1


def _place(message: object, path: str) -> VectorMessage:
    """Vector inside a message by its dotted path."""
    for name in path.split('.'):
        message = getattr(message, name)
    return cast('VectorMessage', message)


def _fill_taxels(message: ContactsMessage, name: str, values: npt.NDArray[np.generic]) -> None:
    """Write a per-taxel array; nothing known is written as nothing."""
    if values.dtype == np.uint8:
        setattr(message, name, packed_bits(values) if values.any() else packed_bits(()))
    else:
        setattr(message, name, packed(values if np.isfinite(values).any() else ()))


def _patches(state: ContactState, patch: Callable[[], PatchMessage]) -> list[PatchMessage]:
    """Patches of a state, and what it says about position where the first does not say it."""
    found = []
    for k in np.flatnonzero(state.contacts_id >= 0):
        entry = patch()
        entry.id = int(state.contacts_id[k])
        for name in _PATCH_VECTORS:
            fill_vector(_place(entry, FIELD_NAMES[name]), getattr(state, name)[k])
        for name in _PATCH_COVARIANCES:
            setattr(entry, FIELD_NAMES[name], np.array(getattr(state, name)[k]).ravel())
        found.append(entry)
    if not _is_told(state, bool(found)):
        found.append(_lone_position(state, patch()))
    return found


def _is_told(state: ContactState, by_patch: bool) -> bool:
    """The first patch, or the absence of patches, says the position of the state."""
    if not by_patch:
        return not np.isfinite(state.position).any()
    return np.array_equal(
        state.contacts_position[0], state.position, equal_nan=True
    ) and np.array_equal(state.contacts_position_cov[0], state.position_cov, equal_nan=True)


def _lone_position(state: ContactState, entry: PatchMessage) -> PatchMessage:
    """Entry of id -1: a position that is no patch."""
    entry.id = -1
    fill_vector(entry.position, state.position)
    entry.position_covariance = np.array(state.position_cov).ravel()
    for name in ('contacts_normal', 'contacts_force'):
        fill_vector(_place(entry, FIELD_NAMES[name]), np.full(3, np.nan))
    setattr(entry, FIELD_NAMES['contacts_force_cov'], np.full(9, np.nan))
    return entry


def read_contacts(
    messages: Sequence[ContactsMessage], taxels: int
) -> dict[str, npt.NDArray[np.generic]]:
    """Arrays of s TactileContacts under the names of `STATE_FIELDS`, of results and truth alike.

    Parameters
    ----------
    messages : sequence of TactileContacts
        Of rclpy or rosbags, in their order.
    taxels : int
        Count t, for empty per-taxel fields.

    Returns
    -------
    dict of str to ndarray, shape (s, ...)
        Every state attribute (object_pose is not in the message: NaN), and `stamp_ns`,
        `sequence`, `session`, `repetition`, `label_name`, each of shape (s,).

    Raises
    ------
    ValueError
        If a field's length does not fit.
    """
    samples = len(messages)
    patches = max([1, *(sum(p.id >= 0 for p in m.contacts) for m in messages)])
    arrays: dict[str, npt.NDArray[np.generic]] = {
        name: np.full((samples, *field_shape(name, taxels, patches)), fill, dtype)
        for name, (_, dtype, fill) in STATE_FIELDS.items()
    }
    for row, message in enumerate(messages):
        _read_row({name: values[row : row + 1] for name, values in arrays.items()}, message)
    for name in ('sequence', 'session', 'repetition'):
        arrays[name] = np.array([getattr(m, name) for m in messages], np.int64)
    arrays['stamp_ns'] = np.array([stamp_ns(m.header) for m in messages], np.int64)
    arrays['label_name'] = np.array([m.label_name for m in messages], np.str_)
    return arrays


def _read_row(row: dict[str, npt.NDArray[np.generic]], message: ContactsMessage) -> None:
    """Write one message into its row, shape (1, ...), of every array."""
    for name in _SCALARS:
        row[name][0] = getattr(message, name)
    for name in _TAXELS:
        taxels = row[name].shape[1]
        values = sized(f'{name} of TactileContacts', getattr(message, name), (0, taxels))
        if len(values):
            row[name][0] = values
    for name in _VECTORS:
        row[name][0] = vector(_place(message, FIELD_NAMES.get(name, name)))
    covariance = sized('wrench_covariance', message.wrench_covariance, (36,)).reshape(6, 6)
    for name, block in _WRENCH_BLOCKS.items():
        row[name][0] = covariance[block, block]
    _read_patches(row, [p for p in message.contacts if p.id >= 0])
    for entry in (message.contacts[0], message.contacts[-1]) if message.contacts else ():
        if entry is message.contacts[0] or entry.id < 0:
            row['position'][0] = vector(entry.position)
            row['position_cov'][0] = np.reshape(entry.position_covariance, (3, 3))


def _read_patches(
    row: dict[str, npt.NDArray[np.generic]], patches: Sequence[PatchMessage]
) -> None:
    """Write the patches of one message into its row."""
    for k, entry in enumerate(patches):
        row['contacts_id'][0, k] = entry.id
        for name in _PATCH_VECTORS:
            row[name][0, k] = vector(_place(entry, FIELD_NAMES[name]))
        for name in _PATCH_COVARIANCES:
            values = sized(name, getattr(entry, FIELD_NAMES[name]), (9,))
            row[name][0, k] = values.reshape(3, 3)


def fill_wrench(
    message: WrenchStampedMessage, state: ContactState, unknown_as: UnknownAs = 'zero'
) -> None:
    """Write force and torque at the sensor origin, header apart; unknown is zero or NaN."""
    unknown = 0.0 if unknown_as == 'zero' else np.nan
    for part, values in (
        (message.wrench.force, state.force),
        (message.wrench.torque, state.torque),
    ):
        fill_vector(part, np.where(np.isfinite(values), values, unknown))
