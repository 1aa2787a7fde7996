"""New classes from one, three or five presses, and what they cost the classes known before."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import betaincinv

from tactile_ros.estimators.few_shot import Supports
from tactile_ros.estimators.press_window import PressVectors, press_vectors
from tactile_ros.sensors.multipole_skin.recogniser import WEAKEST, Recogniser
from tactile_ros.sensors.multipole_skin.windows import WindowMemory, find_windows

if TYPE_CHECKING:
    from tactile_ros.signals import Signals

FOLDS = 5
MOST_JUDGED = 300  # known presses
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
    """Share of the drawn heads that, where the new class was pressed, can pass for it; NaN: none.

    The look-alike of a head is its template that is nearest to the first of the presses.
    """
    presses = PressVectors(new.pattern[:1], new.powers[:1], new.frames[:1])
    matches = recogniser.matches(presses)
    if matches is None:
        return float('nan')
    tried = np.isfinite(matches.cost[0])
    heads = matches.fitted[0, tried]
    powers = np.repeat(new.powers[:1], len(heads), axis=0)
    like = PressVectors(heads, powers, np.repeat(new.frames[:1], len(heads)))
    labels, scores, _ = recogniser.scores(
        like, recogniser.matches(like), recogniser.known_, recogniser.road_
    )
    return float((labels[scores.argmin(axis=1)] == number).sum() / len(tried))


def lost_by(recogniser: Recogniser, number: int) -> dict[str, float]:
    """What a class now takes from presses of the known ones, each without its own neighbours.

    Returns
    -------
    dict of str to float
        `known_presses_judged`, a count; `known_presses_lost`, a share; and
        `known_presses_lost_at_most`, its 95 % bound. Shares are NaN where none is known.
    """
    known = recogniser.known_
    count = len(known.label)
    judged = np.unique(np.linspace(0, count - 1, min(count, MOST_JUDGED)).astype(np.intp))
    part = np.arange(count) * FOLDS // max(count, 1)  # windows of one press lie side by side
    lost = 0
    for fold in range(FOLDS):
        rows = judged[part[judged] == fold]
        if not len(rows):
            continue
        some = known.where(rows)
        presses = PressVectors(some.pattern, some.powers, some.frames)
        labels, scores, _ = recogniser.scores(
            presses,
            recogniser.matches(presses),
            known.where(np.flatnonzero(part != fold)),
            recogniser.road_,
        )
        lost += int((labels[scores.argmin(axis=1)] == number).sum())
    n = len(judged)
    return {
        'known_presses_judged': float(n),
        'known_presses_lost': lost / n if n else float('nan'),
        'known_presses_lost_at_most': _bound(lost, n),
    }


def _bound(count: int, of: int) -> float:
    """What a share is below with 95 % certainty (Clopper and Pearson); NaN of none."""
    if not of:
        return float('nan')
    return 1.0 if count == of else float(betaincinv(count + 1, of - count, 0.95))
