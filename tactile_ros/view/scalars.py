"""A state and a grip as plain numbers by name, for plots. Pure: no viewer is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tactile_ros.types import Array, ContactState

Scalars = dict[str, 'float | int | None']
VECTORS = ('force', 'torque', 'position', 'stray_field')
SCALARS = ('yaw', 'slip_probability', 'cell_probability', 'label_probability')
CHOICES = ('in_contact', 'slip', 'cell', 'label', 'status')
AXES = 'xyz'


class GripMessage(Protocol):
    """What is read of a GripState message."""

    phase: int
    fingers: Sequence[str]
    target_force: Sequence[float]
    force: Sequence[float]
    friction: Sequence[float]
    slip_margin: Sequence[float]
    limited: bool
    refusal: str
    input_age: float


def state_scalars(state: ContactState) -> Scalars:
    """Every number of a state that a plot may show.

    Parameters
    ----------
    state : ContactState
        Of a frame; SI units.

    Returns
    -------
    dict of str to number or None
        force_x, force_x_sigma, ..., in_contact, slip, ...; None: not estimated.
    """
    found: Scalars = {}
    for name in VECTORS:
        for axis, value in zip(AXES, getattr(state, name), strict=True):
            found[f'{name}_{axis}'] = _known(value)
    for name in ('force', 'position'):
        with np.errstate(invalid='ignore'):
            sigma: Array = np.sqrt(np.diagonal(getattr(state, f'{name}_cov')))
        for axis, value in zip(AXES, sigma, strict=True):
            found[f'{name}_{axis}_sigma'] = _known(value)
    found |= {name: _known(getattr(state, name)) for name in SCALARS}
    found |= {name: int(getattr(state, name)) for name in CHOICES}
    found['valid'] = int(state.valid)
    return found


def grip_scalars(grip: GripMessage) -> dict[str, float | int | str | None]:
    """Every number of a GripState by finger, its phase and why nothing was sent."""
    found: dict[str, float | int | str | None] = {
        'phase': int(grip.phase),
        'limited': int(grip.limited),
        'refusal': str(grip.refusal),
        'input_age': _known(grip.input_age),
    }
    for name in ('target_force', 'force', 'friction', 'slip_margin'):
        for finger, value in zip(grip.fingers, getattr(grip, name), strict=False):
            found[f'{finger}_{name}'] = _known(value)
    return found


def json_schema(message: Mapping[str, object]) -> dict[str, object]:
    """What viewers must know of such messages: which entries are numbers, which are text."""
    kinds = {
        name: {'type': 'string' if isinstance(value, str) else 'number'}
        for name, value in message.items()
    }
    return {'type': 'object', 'title': 'tactile_ros', 'properties': kinds}


def _known(value: float | Array) -> float | None:
    """A number, or None for NaN: json has none."""
    number = float(value)
    return number if np.isfinite(number) else None
