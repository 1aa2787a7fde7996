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

    def is_over(self, stamp_ns: int | None) -> bool:
        """Whether a frame cannot belong to the stream, since time does not increase."""
        return None not in (stamp_ns, self._newest_ns) and stamp_ns <= self._newest_ns  # type: ignore[operator]

    def admit(self, stamp_ns: int | None) -> tuple[Integers | None, Bools]:
        """Take in the stamp of the next frame.

        Parameters
        ----------
        stamp_ns : int or None
            Acquisition time; None: an independent frame, which memory passes over.

        Returns
        -------
        stamp_ns : ndarray, shape (1,), or None
            The same, as a batch of one.
        restart : ndarray, shape (1,)
            Whether memory is forgotten before the frame.
        """
        if stamp_ns is None:
            return None, np.ones(1, bool)
        restart = np.array([self._fresh])
        self._newest_ns, self._fresh = stamp_ns, False
        return np.array([stamp_ns], np.int64), restart
