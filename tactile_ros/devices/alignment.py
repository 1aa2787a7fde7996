"""Where the board's frames begin in bytes that are out of step.

Evidence that a window of bytes is a frame: CR LF at its end, plausible fields, and a start that is
verified by the CR LF of the frame before it. Candidates are believed in the order in which the
bytes make them known, so that the outcome does not depend on how the bytes were cut.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tactile_ros.devices.packets import TERMINATOR, TEXT, frame_bytes, plausible, words
from tactile_ros.types import Array, Bools, Integers

LOCK_FRAMES = 3
# frames after which a start with odd fields or lost chips is believed, if no better one came
PATIENCE = 4
# frames of bytes that are kept while none is found
KEPT = 8

_IS_TEXT = np.isin(np.arange(256), np.frombuffer(TEXT, np.uint8))


class Start(NamedTuple):
    """Where frames go on, and what has to be tolerated in them.

    Attributes
    ----------
    known_at : int
        Bytes that are needed to know it.
    offset : int
        First byte of the first frame to deliver.
    odd : bool
        Fields that are possible but not natural are part of this stream.
    faulty : ndarray, shape (t,), or None
        Chips that are implausible in frames that are otherwise good.
    """

    known_at: int
    offset: int
    odd: bool
    faulty: Bools | None


@dataclass(frozen=True)
class Evidence:
    """Windows of a frame's length that end in CR LF, with what is known about each.

    Attributes
    ----------
    size : int
        Length of a frame.
    offsets : ndarray, shape (w,)
        First byte of every window, increasing.
    led : ndarray, shape (n,)
        Whether a byte of the stream is verified to follow a frame's end; n leaves room for two
        frames after the last window.
    possible, natural : ndarray, shape (w, t)
        As from `plausible`, per chip; chips known to be faulty pass.
    """

    size: int
    offsets: Integers
    led: Bools
    possible: Bools
    natural: Bools

    def marks(self, passed: Bools) -> Bools:
        """Mask over the stream, shape (n,), of the windows all of whose chips (w, t) pass."""
        marks = np.zeros(len(self.led), bool)
        marks[self.offsets[passed.all(axis=1)]] = True
        return marks


def gather(stream: bytes, verified: list[int], faulty: Bools, quantum: Array | None) -> Evidence:
    """Collect the windows of a stream that end in CR LF.

    Parameters
    ----------
    stream : bytes
        What is at hand.
    verified : list of int
        Offsets known to follow a frame's end although no CR LF shows it.
    faulty : ndarray, shape (t,)
        Chips known to be faulty.
    quantum : ndarray, shape (3,), or None
        As for `plausible`.

    Returns
    -------
    Evidence
        Of windows that are not text.
    """
    size = frame_bytes(len(faulty))
    data = np.frombuffer(stream, np.uint8)
    led = np.zeros(len(data) + 1 + LOCK_FRAMES * size, bool)
    led[2 : len(data) + 1] = (data[:-1] == TERMINATOR[0]) & (data[1:] == TERMINATOR[1])
    offsets = np.flatnonzero(led[size : len(data) + 1])
    windows = data[offsets[:, None] + np.arange(size)]
    binary = ~_IS_TEXT[windows].all(axis=1)
    possible, natural = plausible(words(windows[binary]), quantum)
    led[verified] = True
    return Evidence(
        size, offsets[binary], led, np.logical_or(possible, faulty), np.logical_or(natural, faulty)
    )


def lock_on(seen: Evidence) -> list[Start]:
    """Three natural frames in a row; start at the first, shortly before, that is verified."""
    size, offsets = seen.size, seen.offsets
    fits = seen.marks(seen.natural)
    run = offsets[fits[offsets] & fits[offsets + size] & fits[offsets + 2 * size]]
    verified = offsets[seen.led[offsets] & fits[offsets]]
    for q in run[:1].tolist():
        known_at = q + LOCK_FRAMES * size
        return [Start(known_at, int(verified[verified >= known_at - KEPT * size][0]), False, None)]
    return []


def resume(seen: Evidence, odd_before: bool) -> list[Start]:
    """Start at one natural frame verified at both ends.

    Two in a row do with odd fields, where the stream had such before, or where it only begins to
    have them and is in step.
    """
    size, offsets = seen.size, seen.offsets
    sure = offsets[seen.led[offsets] & seen.natural.all(axis=1)]
    fits = seen.marks(seen.possible)
    odd = offsets[seen.led[offsets] & fits[offsets] & fits[offsets + size]]
    if not odd_before:
        odd = odd[odd == 0]
    return [
        *(Start(q + size, q, False, None) for q in sure[:1].tolist()),
        *(Start(q + 2 * size, q, True, None) for q in odd[:1].tolist()),
    ]


def lock_on_odd(seen: Evidence) -> list[Start]:
    """Start at three frames in which the same few chips are implausible, or fields are odd."""
    size, offsets = seen.size, seen.offsets
    at = np.full(len(seen.led), -1)
    at[offsets] = np.arange(len(offsets))
    run = np.stack([at[offsets], at[offsets + size], at[offsets + 2 * size]])
    run = run[:, (run >= 0).all(axis=0)]
    bad = ~seen.possible[run]
    faulty = bad.all(axis=0)
    steady = (bad.any(axis=0) == faulty).all(axis=1)
    few = 2 * faulty.sum(axis=1) < faulty.shape[1]
    for k in np.flatnonzero(steady & few)[:1].tolist():
        q = int(offsets[run[0, k]])
        odd = bool((~seen.natural[run[:, k]] & ~faulty[k]).any())
        return [Start(q + PATIENCE * size, q if seen.led[q] else q + size, odd, faulty[k])]
    return []


def next_start(seen: Evidence, length: int, synchronised: bool, odd_before: bool) -> Start | None:
    """Earliest start that `length` bytes make known; None when there is none yet.

    Parameters
    ----------
    seen : Evidence
        Of the stream.
    length : int
        Bytes at hand.
    synchronised : bool
        Whether frames were delivered before: one is enough then to go on.
    odd_before : bool
        Whether some of them had odd fields.
    """
    if not len(seen.offsets):
        return None
    starts = resume(seen, odd_before) if synchronised else lock_on(seen)
    earliest = int(seen.offsets[0]) + PATIENCE * seen.size  # that odd fields may be known
    if not any(start.known_at < earliest for start in starts):
        starts += lock_on_odd(seen)
    known = [start for start in starts if start.known_at <= length]
    return min(known, key=lambda start: start[:2]) if known else None
