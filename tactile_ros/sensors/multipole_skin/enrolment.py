"""New classes from one, three or five presses, and what they cost the classes known before."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import betaincinv

from tactile_ros.estimators.few_shot import Supports
from tactile_ros.estimators.press_window import PressVectors, press_vectors
from tactile_ros.sensors.multipole_skin.recogniser import WEAKEST, Recogniser
from tactile_ros.sensors.multipole_skin.windows import (
    WindowMemory,
    find_windows,
    press_numbers,
)

if TYPE_CHECKING:
    from tactile_ros.types import Array, Integers, Signals

FOLDS = 5
DRAWN = 40  # presses of a class that are made up
AROUND = np.array([2e-4, 2e-4, 0.02])  # m, m, rad: how well a head returns to a place
DEEPER = (0.6, 1.6)  # depths of those presses over that of the class's
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
    ends, windows = find_windows(signals, size, WindowMemory(None))
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
    press = press_numbers(signals, size)[np.array(ends)]
    press += recogniser.enrolled_.number.max(initial=-1) + 1
    return recogniser.supports(presses, labels, recogniser.matches(presses), press)


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


def costs(recogniser: Recogniser, new: Supports, number: int) -> dict[str, float]:
    """What a class takes from those known before, and from how many presses it was learned.

    Parameters
    ----------
    recogniser : Recogniser
        That knows it already.
    new : Supports
        Windows of its presses.
    number : int
        Of the class.
    """
    return {
        'presses': float(len(np.unique(new.number))),
        **lost_by(recogniser, number),
        **lost_there(recogniser, new, number),
    }


def lost_by(recogniser: Recogniser, number: int) -> dict[str, float]:
    """What a class now takes from presses of the known ones, each as if it had not been seen.

    Lost is what would be named rightly without the class. A press is lost with the first of its
    windows: they are no evidence of their own.

    Returns
    -------
    dict of str to float
        `known_presses_judged`, a count; `known_presses_lost`, a share; and
        `known_presses_lost_at_most`, its 95 % bound. Shares are NaN where none is known.
    """
    known = recogniser.known_
    press = np.asarray(np.unique(known.number, return_inverse=True)[1], np.int64).reshape(-1)
    count = int(press.max(initial=-1)) + 1
    part = press * FOLDS // max(count, 1)
    lost = np.zeros(count, bool)
    for fold in np.unique(part):
        rows = np.flatnonzero(part == fold)
        presses, seen = _presses(known.where(rows)), known.where(np.flatnonzero(part != fold))
        now, before = _named(recogniser, presses, seen, number)
        lost[press[rows[(now == number) & (before == known.label[rows])]]] = True
    share = float(lost.mean()) if count else float('nan')
    return {
        'known_presses_judged': float(count),
        'known_presses_lost': share,
        'known_presses_lost_at_most': _bound(int(lost.sum()), count),
    }


def lost_there(recogniser: Recogniser, new: Supports, number: int) -> dict[str, float]:
    """What a class takes from others that press where it was pressed, as like it as they can be.

    A class is taken whole or not at all, by chance, since what its template or its presses are
    wrong by is the same from press to press: either it is what pressed, as far as could be told
    without the new class, or noise makes it alike.

    Returns
    -------
    dict of str to float
        `lost_there`, the share over all classes, and `lost_there_at_most`, its 95 % bound; NaN
        where none is open. `lost_there LABEL` for each that is more likely taken than not.
    """
    presses = _presses(new)
    matches = recogniser.matches(presses)
    found = recogniser.scores(presses, matches, recogniser.known_, recogniser.road_)
    others = found[0] != number
    labels = found[0][others]
    if not len(labels):
        return {'lost_there': float('nan'), 'lost_there_at_most': float('nan')}
    same = recogniser.chances(found[1][:, others], found[2][:, others])[0].mean(axis=0)
    noisy = _noise_takes(recogniser, new, number)
    chance = 1 - (1 - same) * (1 - np.array([noisy.get(label, 0.0) for label in labels.tolist()]))
    taken = {
        f'lost_there {label}': float(one)
        for label, one in zip(labels.tolist(), chance, strict=True)
        if one > 0.5
    }
    return {'lost_there': float(chance.mean()), 'lost_there_at_most': _most_of(chance), **taken}


def _noise_takes(recogniser: Recogniser, new: Supports, number: int) -> dict[int, float]:
    """How often noise makes presses of drawn heads and of enrolled classes those of a class.

    Presses of every drawn head are made up there, at depths, places and turns around those at
    which it is nearest to the class, with noise and errors of the model; of enrolled classes,
    their own presses are used with such noise.
    """
    rng = np.random.default_rng(0)
    labels, parts = [], []
    for label, some in (*_heads_there(recogniser, new, rng), *_enrolled_again(recogniser, number)):
        labels.append(label)
        parts.append(some)
    if not parts:
        return {}
    presses = PressVectors(*(np.concatenate([getattr(one, name) for one in parts])
                             for name in ('pattern', 'powers', 'frames')))  # fmt: skip
    variance = presses.variance(recogniser.noise, recogniser.still_)
    if recogniser.search is not None:
        variance = recogniser.search.variance(presses)
    noisy = presses.pattern + np.sqrt(variance) * rng.normal(size=presses.pattern.shape)
    named, _ = _named(recogniser, replace(presses, pattern=noisy), recogniser.known_, number)
    lost = named == number
    each = (lost.reshape(-1, DRAWN).sum(axis=1) + 0.5) / (DRAWN + 1)
    return dict(zip(labels, each.tolist(), strict=True))


def _enrolled_again(recogniser: Recogniser, number: int) -> list[tuple[int, PressVectors]]:
    """Presses of each class that was enrolled beside another one, many times over."""
    enrolled = recogniser.enrolled_
    return [
        (
            label,
            _presses(enrolled.where(np.resize(np.flatnonzero(enrolled.label == label), DRAWN))),
        )
        for label in np.unique(enrolled.label).tolist()
        if label != number
    ]


def _heads_there(
    recogniser: Recogniser, new: Supports, rng: np.random.Generator
) -> list[tuple[int, PressVectors]]:
    """Presses of each drawn head about the pose at which it is nearest to the first press."""
    press = _presses(new.where(np.array([0])))
    matches, found = recogniser.matches(press), []
    if matches is None or recogniser.search is None:
        return []
    for head in np.flatnonzero(np.isfinite(matches.cost[0])).tolist():
        pose = matches.pose[0, head, :3] + AROUND * rng.normal(size=(DRAWN, 3))
        depth = matches.pose[0, head, 3] * rng.uniform(*DEEPER, DRAWN)
        raised = press.powers * depth[:, None] ** [1, 2, 3]
        parts = recogniser.search.bank.at(np.full(DRAWN, head), pose)[:, 0]
        pattern = np.einsum('np,npd->nd', raised, parts)
        same = press.rows(np.zeros(DRAWN, np.intp))
        found.append((head, replace(same, pattern=pattern)))
    return found


def _presses(supports: Supports) -> PressVectors:
    """Supports as presses."""
    return PressVectors(supports.pattern, supports.powers, supports.frames)


def _named(
    recogniser: Recogniser, presses: PressVectors, known: Supports, number: int
) -> tuple[Integers, Integers]:
    """What presses (n,) are called, and what they would be without a class; -1: nothing."""
    matches = recogniser.matches(presses)
    labels, scores, _ = recogniser.scores(presses, matches, known, recogniser.road_)
    without = np.where(labels == number, np.inf, scores)
    now, before = (
        np.where(np.isfinite(some.min(axis=1)), labels[some.argmin(axis=1)], -1)
        for some in (scores, without)
    )
    return now, before


def _bound(count: int, of: int) -> float:
    """What a share is below with 95 % certainty (Clopper and Pearson); NaN of none."""
    if not of:
        return float('nan')
    return 1.0 if count == of else float(betaincinv(count + 1, of - count, 0.95))


def _most_of(chances: Array) -> float:
    """What the share of heads that are lost, each by a chance (n,), is at most with 95 %."""
    count = np.ones(1)
    for chance in chances:
        count = np.convolve(count, [1 - chance, chance])
    return float(np.searchsorted(np.cumsum(count), 0.95)) / len(chances)
