"""Windows in a stream of frames: a press from its onset on, in pieces of equal length.

A window begins with contact and has `window` frames; the next one follows while contact lasts. A
stream's first `window` frames are one too, wherever in them contact began, so that a stream of
exactly one window is answered as a whole. Live frames and recordings take the same road.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, Integers, Signals


@dataclass
class WindowMemory:
    """What is remembered of a stream.

    Attributes
    ----------
    past : object
        Of what else estimates from the stream.
    frames : list of ndarray, shape (d,)
        The newest changes of field, no more than a window.
    age, held : int
        Frames since the stream began, and in contact since the last window.
    """

    past: object
    frames: list[Array] = field(default_factory=list)
    age: int = 0
    held: int = 0


def find_windows(
    signals: Signals, size: int, memory: WindowMemory
) -> tuple[list[int], list[Array]]:
    """Windows that end in some frames; the memory moves on.

    Parameters
    ----------
    signals : Signals
        Conditioned frames (s).
    size : int
        Frames of a window.
    memory : WindowMemory
        Of the stream.

    Returns
    -------
    ends : list of int
        Rows on which the answers stand.
    frames : list of ndarray, shape (w, d)
        Changes of field in each window; NaN in rows that could not be used.
    """
    delta = signals.delta.reshape(len(signals.good), int(np.prod(signals.delta.shape[1:])))
    if signals.stamp_ns is None:  # frames without times are presses of their own
        rows = np.flatnonzero(signals.good & (signals.in_contact != 0))
        return rows.tolist(), [delta[i : i + 1] for i in rows]
    ends, found = [], []
    for i, contact in enumerate(signals.in_contact):
        if signals.restart[i]:
            memory.frames.clear()
            memory.age, memory.held = 0, 0
        good = bool(signals.good[i])
        memory.frames.append(delta[i] if good else np.full(delta.shape[1], np.nan))
        del memory.frames[:-size]
        memory.age += 1
        if contact == 0:
            memory.held = 0
        else:  # an unusable frame ends no press, nor does one that nobody can judge
            memory.held += memory.held > 0 or good
        whole = memory.held >= size or (memory.age == size and contact != 0)
        if whole and good:
            ends.append(i)
            found.append(np.array(memory.frames))
            memory.held = 0
    return ends, found


def press_numbers(signals: Signals, size: int) -> Integers:
    """Which press each frame is of, shape (s,).

    A press ends where a stream does, and with a window of rest: contact that flickers where a head
    comes down or leaves makes no second one. Frames without times are presses of their own.
    """
    count = len(signals.good)
    if signals.stamp_ns is None:
        return np.arange(count)
    touched = np.flatnonzero(signals.in_contact != 0)
    before = np.concatenate([[-1], touched[:-1]])
    rested = touched - before > size
    stream = np.cumsum(signals.restart)
    anew = stream[touched] != stream[before]
    number = np.zeros(count, np.int64)
    number[touched] = 1
    number[touched[~(rested | anew)]] = 0
    return np.cumsum(number)
