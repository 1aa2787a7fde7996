"""A simulated sensor in the place of a real one: its faults by parameter, its truth by stamp."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.nodes.performance import truth_states

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import ContactState, ContactStates, Recording

MOST_FAULTS = 1000
RELIEF = 'none'
PATTERN = re.compile(r'(?P<name>[a-z_]+)(:(?P<count>[0-9]{1,6}))?')


def parse_fault(text: str, known: Sequence[str]) -> tuple[str, int]:
    """Name and count of a fault.

    Parameters
    ----------
    text : str
        `name` or `name:count`.
    known : sequence of str
        Faults that the twin can suffer.

    Returns
    -------
    name : str
        One of `known`.
    count : int
        How many frames or transfers suffer it.

    Raises
    ------
    ValueError
        If it is none; lists those that are.
    """
    found = PATTERN.fullmatch(text.strip())
    name = '' if found is None else found['name']
    count = int(found['count'] or 1) if found is not None else 0
    if name not in known or not 1 <= count <= MOST_FAULTS:
        msg = (
            f'fault must be one of {", ".join(known)}, with :count of 1 to {MOST_FAULTS} where it '
            f'is to happen more than once; received {text!r}'
        )
        raise ValueError(msg)
    return name, count


class SignalTruth:
    """What the signal of a twin says at a time: rows of its recording, again and again.

    Parameters
    ----------
    recording : Recording
        What the twin's signal plays, with truth; evenly spaced.
    start_ns : int
        Node's time at the signal's beginning (ns).

    Notes
    -----
    The clock of a twin's board begins with its signal, so it tells the row that a frame carries
    however late the frame was sent and read.
    """

    def __init__(self, recording: Recording, start_ns: int) -> None:
        self._start_ns = start_ns
        self._rate_hz = recording.layout.rate_hz
        self._truth = recording.truth
        self._states: ContactStates = truth_states(recording)
        self._count = len(recording)

    def row(self, stamp_ns: int, device_time_ns: int = 0) -> int:
        """Row that was played at a time (ns), by the board's clock where it has one."""
        since_ns = device_time_ns or stamp_ns - self._start_ns
        return round(since_ns * 1e-9 * self._rate_hz) % self._count

    def at(self, stamp_ns: int, device_time_ns: int = 0) -> tuple[ContactState, dict[str, int]]:
        """Truth at a time (ns), and the groups that it belongs to."""
        row = self.row(stamp_ns, device_time_ns)
        names = ('session', 'repetition')
        groups = {n: int(np.asarray(self._truth[n][row])) for n in names if n in self._truth}
        return self._states[row], groups
