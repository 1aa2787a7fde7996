"""Frames to contacts with the rules of a tare: what contact_node and stack do, without ROS.

A tare takes the mean of the last `tare_frames` usable frames that were processed, all of them
after the last contact. Frames are counted as they are processed, never by a clock, and the new
baseline says the first sequence that it holds for: a replay repeats it exactly.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Frame, FrameStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Bytes, ContactState

# not those of a taxel that the fit found dead: it is left out
DAMAGED = int(FrameStatus.BAD_TAXELS | FrameStatus.STALE)


@dataclass
class Tally:
    """What the stage has seen, for diagnostics.

    Attributes
    ----------
    frames, valid, refused, tares : int
        Frames processed, those with a valid state, those of another shape; tares done.
    status : int
        Bits of `FrameStatus` of the last state.
    sequence : int
        Of the last frame, -1 before the first.
    taxel_status : ndarray, shape (t,), or None
        Of the last state.
    """

    frames: int = 0
    valid: int = 0
    refused: int = 0
    tares: int = 0
    status: int = 0
    sequence: int = -1
    taxel_status: Bytes | None = None

    @property
    def flagged(self) -> list[int]:
        """Taxels that the sensor or the pipeline found faulty in the last frame."""
        return [] if self.taxel_status is None else np.flatnonzero(self.taxel_status).tolist()


class ContactStage:
    """A pipeline behind a lock, with the frames that a tare would take.

    Parameters
    ----------
    pipeline : Pipeline
        Fitted, or on its nominal model.
    tare_frames : int
        Frames that a tare averages.
    tare_in_contact : bool
        Allow a tare while something touches.
    on_baseline : callable
        Takes the baseline as a frame whose sequence is the first that it holds for: at the first
        frame of a stream and after every tare.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        tare_frames: int,
        tare_in_contact: bool,
        on_baseline: Callable[[Frame], None],
    ) -> None:
        self.pipeline = pipeline
        self.tare_in_contact = tare_in_contact
        self.tally = Tally()
        self._on_baseline = on_baseline
        self._resting: deque[Frame] = deque(maxlen=tare_frames)
        self._touching = False
        # The service comes from another thread than the frames in the one-process road.
        self._lock = threading.Lock()

    @property
    def shape(self) -> tuple[int, int]:
        """Taxels and channels that the pipeline takes."""
        return self.pipeline.layout.shape

    def set_tare_frames(self, count: int) -> None:
        """Average so many frames in the next tare."""
        with self._lock:
            self._resting = deque(self._resting, maxlen=count)

    def reset(self) -> None:
        """A new stream begins: forget the last one, keep its baseline."""
        with self._lock:
            self._forget()

    def _forget(self) -> None:
        self.pipeline.reset()
        self._resting.clear()
        self._touching = False
        self.tally = Tally()

    def process(self, frame: Frame) -> ContactState:
        """Estimate from the next frame.

        Raises
        ------
        ValueError
            If its shape is not the pipeline's.
        """
        with self._lock:
            if frame.sequence <= self.tally.sequence:
                self._forget()
            if not self.tally.frames and self._has_baseline:
                self._on_baseline(self._baseline(frame, frame.sequence))
            state = self.pipeline.process(frame)
            self._remember(frame, state)
            return state

    @property
    def _has_baseline(self) -> bool:
        """A baseline is in use: NaN says none yet, zero that the estimators want none."""
        baseline = self.pipeline.baseline
        return bool(np.isfinite(baseline).any() and np.nan_to_num(baseline).any())

    def _remember(self, frame: Frame, state: ContactState) -> None:
        """Count, and keep the frame for a tare where it may be resting."""
        tally = self.tally
        tally.frames += 1
        tally.valid += int(state.valid)
        tally.status = int(state.status)
        tally.sequence = frame.sequence
        tally.taxel_status = state.taxel_status
        self._touching = bool(state.in_contact == 1)
        if self._touching and self._guarded:
            self._resting.clear()
        elif not tally.status & DAMAGED:
            self._resting.append(frame)

    @property
    def _guarded(self) -> bool:
        """Frames in contact are no rest: not before the first tare, when nobody can tell."""
        return not self.tare_in_contact and self.tally.tares > 0

    def tare(self) -> tuple[bool, str]:
        """Take the baseline from the last resting frames.

        Returns
        -------
        done : bool
            Whether it was taken.
        message : str
            From how many frames and from which sequence on, or why not.
        """
        with self._lock:
            if not self._resting:
                return False, self._refusal()
            frames = list(self._resting)
            try:
                self.pipeline.tare(frames)
            except ValueError as err:
                return False, str(err)
            self.tally.tares += 1
            first = self.tally.sequence + 1
            self._on_baseline(self._baseline(frames[-1], first))
            return True, f'baseline of {len(frames)} frames, from sequence {first} on'

    def _refusal(self) -> str:
        """Why there is no frame to tare from."""
        if self._touching:
            return (
                'tare is refused while something touches: release it, or set allow_tare_in_contact'
            )
        if not self.tally.frames:
            return 'tare needs frames and none came yet: is the sensor active?'
        return 'tare needs resting frames and none without damage came since the last contact'

    def _baseline(self, frame: Frame, sequence: int) -> Frame:
        """Baseline in use as a frame."""
        return Frame(frame.stamp_ns, sequence, np.array(self.pipeline.baseline))
