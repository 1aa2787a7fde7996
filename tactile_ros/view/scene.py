"""A frame and its state as balls and arrows in space. Pure: no viewer is needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array

if TYPE_CHECKING:
    from tactile_ros.types import ContactState, Frame, Layout

Rgba = tuple[float, float, float, float]
GREY: Rgba = (0.6, 0.6, 0.6, 0.5)
COLD, WARM = np.array([0.23, 0.42, 0.75]), np.array([0.97, 0.45, 0.13])
CONTACT: Rgba = (0.97, 0.45, 0.13, 0.55)
FORCE: Rgba = (0.13, 0.45, 0.95, 0.95)
SLIPPING: Rgba = (0.9, 0.1, 0.25, 0.95)
METRES_PER_NEWTON = 5e-3
LEAST_SIGMA, MOST_SIGMA = 3e-4, 5e-3  # m, of a contact's ball
ARROW = 0.35  # length of the largest change of field, as a part of the skin


@dataclass(frozen=True)
class Ball:
    """An ellipsoid: middle (3,) and half axes (3,) in metres."""

    middle: Array
    half_axes: Array
    colour: Rgba


@dataclass(frozen=True)
class Arrow:
    """From a place (3,) along a vector (3,), in metres."""

    start: Array
    along: Array
    colour: Rgba


@dataclass(frozen=True)
class Scene:
    """Everything that is shown of one frame."""

    balls: list[Ball]
    arrows: list[Arrow]
    words: str


def scene_of(layout: Layout, frame: Frame, rest: Array, state: ContactState, most: float) -> Scene:
    """Taxels with what they feel, contacts with two sigmas, and forces.

    Parameters
    ----------
    layout : Layout
        Of t taxels.
    frame : Frame
        The readings.
    rest : ndarray, shape (t, c)
        Readings of the untouched skin (unit of the layout).
    state : ContactState
        Of the frame; what is not estimated is not shown.
    most : float
        Change that has the full colour (unit of the layout).

    Returns
    -------
    Scene
        In the sensor frame.
    """
    change = frame.values - rest
    balls = [*_taxels(layout, change, most), *_contacts(state)]
    return Scene(balls, [*_fields(layout, change, most), *_forces(state)], _words(state))


def size_of(layout: Layout) -> float:
    """Half the usual distance between taxels (m)."""
    apart = np.linalg.norm(layout.positions[:, None] - layout.positions[None], axis=-1)
    apart = apart[apart > 0]
    return 0.5 * float(apart.min()) if apart.size else 2e-3


def _taxels(layout: Layout, change: Array, most: float) -> list[Ball]:
    """A ball for each taxel, warmer the more it feels; grey where nothing is known."""
    half = np.full(3, 0.35 * size_of(layout))
    return [
        Ball(place, half, (red, green, blue, 0.9))
        for place, (red, green, blue) in zip(
            layout.positions, warmth(change, most).tolist(), strict=True
        )
    ]


def warmth(change: Array, most: float) -> Array:
    """Colours (t, 3), 0 to 1, of a change (t, c): from cold to warm at `most`, grey unknown."""
    share = np.clip(np.linalg.norm(change, axis=1) / most, 0.0, 1.0)[:, None]
    return np.where(np.isnan(share), GREY[:3], COLD + share * (WARM - COLD))


def _fields(layout: Layout, change: Array, most: float) -> list[Arrow]:
    """The change of field at chips with three axes, turned into the sensor's."""
    if layout.unit != 'T' or len(layout.channels) != 3:
        return []
    turned = change
    if layout.rotations is not None:
        turned = np.einsum('tij,tj->ti', layout.rotations, change)
    reach = ARROW * max(float(np.ptp(layout.positions, axis=0).max()), 4 * size_of(layout))
    return [
        Arrow(place, along * reach / most, GREY)
        for place, along in zip(layout.positions, turned, strict=True)
        if np.isfinite(along).all()
    ]


def _contacts(state: ContactState) -> list[Ball]:
    """Contacts of two sigmas."""
    if state.in_contact == 0:
        return []
    told = [(c.position, c.position_cov) for c in state.contacts]
    told = told or [(state.position, state.position_cov)]
    return [
        Ball(np.nan_to_num(place), _half_axes(cov), CONTACT)
        for place, cov in told
        if np.isfinite(place[:2]).all()
    ]


def _half_axes(cov: Array) -> Array:
    """Two sigmas along x, y, z (m), such that they can be seen."""
    with np.errstate(invalid='ignore'):
        sigma = np.sqrt(np.diagonal(cov))
    half: Array = 2 * np.clip(np.nan_to_num(sigma, nan=LEAST_SIGMA), LEAST_SIGMA, MOST_SIGMA)
    return half


def _forces(state: ContactState) -> list[Arrow]:
    """Forces of the contacts, or the whole one at the contact."""
    colour = SLIPPING if state.slip == 1 else FORCE
    told = [(c.position, c.force) for c in state.contacts if np.isfinite(c.force).any()]
    told = told or [(state.position, state.force)]
    return [
        Arrow(np.nan_to_num(place), METRES_PER_NEWTON * np.nan_to_num(force), colour)
        for place, force in told
        if np.nan_to_num(force).any()
    ]


def _words(state: ContactState) -> str:
    """What is recognised, in a word or two."""
    said = [f'label {int(state.label)}'] if state.label >= 0 else []
    said += [f'cell {int(state.cell)}'] if state.cell >= 0 else []
    said += ['slips'] if state.slip == 1 else []
    return ', '.join(said)
