"""What is remembered between two frames of a live stream."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tactile_ros.conditioning.baseline import BaselineTracker
from tactile_ros.conditioning.contact import ContactIds
from tactile_ros.types import Bools, Integers


@dataclass
class Stream:
    """State of one continuous stream of frames.

    Attributes
    ----------
    tracker : BaselineTracker
        Baseline in use.
    memory : object
        What the sensor's features remember.
    ids : ContactIds
        Numbers of touches.
    """

    tracker: BaselineTracker
    memory: object
    ids: ContactIds = field(default_factory=ContactIds)
    _fresh: bool = True
    _newest_ns: int | None = None

    def rebase(self, tracker: BaselineTracker) -> None:
        """Go on from another baseline: what was remembered relative to the old one is void."""
        self.tracker = tracker
        self._fresh = True

    def is_over(self, stamp_ns: Integers | None) -> bool:
        """Whether frames (s,) cannot belong to the stream, since time does not increase."""
        if stamp_ns is None or self._newest_ns is None or not len(stamp_ns):
            return False
        return bool(stamp_ns[0] <= self._newest_ns)

    def admit(self, stamp_ns: Integers | None, count: int) -> Bools:
        """Take in the stamps of the next frames.

        Parameters
        ----------
        stamp_ns : ndarray, shape (s,), or None
            Acquisition times, which increase; None: independent frames, which memory passes over.
        count : int
            Frames s.

        Returns
        -------
        ndarray, shape (s,)
            Rows before which memory is forgotten.
        """
        if stamp_ns is None:
            return np.ones(count, bool)
        restart = np.zeros(count, bool)
        if count:
            restart[0], self._fresh = self._fresh, False
            self._newest_ns = int(stamp_ns[-1])
        return restart
