"""New classes from one, three or five presses, and what they cost the classes known before."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import Supports
from tactile_ros.estimators.press_window import PressVectors, press_vectors
from tactile_ros.sensors.multipole_skin.recogniser import WEAKEST, Recogniser
from tactile_ros.sensors.multipole_skin.windows import WindowMemory, find_windows

if TYPE_CHECKING:
    from tactile_ros.signals import Signals

FIRM = 2 * WEAKEST  # sigma: a press to learn from must be clearer than one to recognise


def enrolled(
    recogniser: Recogniser, signals: Signals, size: int, number: int, name: str
) -> Supports:
    """Supports of a new class.

    Parameters
    ----------
    recogniser : Recogniser
        That will know it.
    signals : Signals
        Conditioned frames of its presses.
    size : int
        Frames of a window.
    number, name : int, str
        Of the class.

    Raises
    ------
    ValueError
        If no press is found, one is clipped or faulty, or one is too weak.
    """
    _, windows = find_windows(signals, size, WindowMemory(None))
    spoilt = int((~signals.good).sum())
    if spoilt:
        msg = (
            f'presses of {name!r} must be whole; {spoilt} of {len(signals.good)} frames '
            'are clipped or faulty: press less, or choose a larger range'
        )
        raise ValueError(msg)
    if not windows:
        msg = f'recording of {name!r} must hold a press of {size} frames; found none'
        raise ValueError(msg)
    presses = press_vectors(windows, recogniser.basis)
    strength = recogniser.strength(presses)
    presses = _firm_part(presses, strength, name)
    labels = np.full(len(presses.pattern), number)
    return recogniser.supports(presses, labels, recogniser.matches(presses))


def _firm_part(presses: PressVectors, strength: np.ndarray, name: str) -> PressVectors:
    """Presses, all of which are strong enough."""
    weak = strength < FIRM
    if weak.any():
        msg = (
            f'presses of {name!r} must reach {FIRM:.0f} sigma of the noise; '
            f'{int(weak.sum())} of {len(weak)} reach {strength.min():.1f}: press harder'
        )
        raise ValueError(msg)
    return presses


def alike_by(recogniser: Recogniser, new: Supports, number: int) -> float:
    """Share of the drawn heads that, where the new class was pressed, can pass for it.

    The look-alike of a head is its template that is nearest to the first of the presses.
    """
    presses = PressVectors(new.pattern[:1], new.powers[:1], new.frames[:1])
    matches = recogniser.matches(presses)
    if matches is None:
        return 0.0
    tried = np.isfinite(matches.cost[0])
    heads = matches.fitted[0, tried]
    powers = np.repeat(new.powers[:1], len(heads), axis=0)
    like = PressVectors(heads, powers, np.repeat(new.frames[:1], len(heads)))
    labels, scores, _ = recogniser.scores(
        like, recogniser.matches(like), recogniser.known_, recogniser.road_
    )
    return float((labels[scores.argmin(axis=1)] == number).sum() / len(tried))


def lost_by(recogniser: Recogniser, number: int) -> float:
    """Share of the known presses that a class now takes from their own, 0 where none is known."""
    known = recogniser.known_
    if not len(known.label):
        return 0.0
    presses = PressVectors(known.pattern, known.powers, known.frames)
    matches = recogniser.matches(presses)
    labels, scores, _ = recogniser.scores(presses, matches, known, recogniser.road_)
    return float((labels[scores.argmin(axis=1)] == number).mean())
