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

from tactile_ros.conditioning.faults import DAMAGED, SAYS_NOTHING
from tactile_ros.types import Frame, FrameStatus, Recording

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Bytes, ContactState, Estimation

STALE = int(FrameStatus.STALE)


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
    in_contact : int
        Of the last state: 1, 0, -1 unknown.
    stamp_ns, tare_ns : int or None
        Of the last frame, and of the last that a tare took (ns).
    tare_state : str
        How the last tare went, in words.
    """

    frames: int = 0
    valid: int = 0
    refused: int = 0
    tares: int = 0
    status: int = 0
    sequence: int = -1
    taxel_status: Bytes | None = None
    in_contact: int = -1
    stamp_ns: int | None = None
    tare_ns: int | None = None
    tare_state: str = 'not tared since activation'

    @property
    def baseline_age_s(self) -> float:
        """Stream time since the last tare (s); NaN: none was taken, or there are no stamps."""
        if self.stamp_ns is None or self.tare_ns is None:
            return float('nan')
        return (self.stamp_ns - self.tare_ns) * 1e-9

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
    on_failure : callable
        Takes a sentence about each frame that cannot be estimated.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        tare_frames: int,
        tare_in_contact: bool,
        on_baseline: Callable[[Frame], None],
        on_failure: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.pipeline = pipeline
        self.tare_in_contact = tare_in_contact
        self.tally = Tally()
        self._watch: Callable[[Frame, ContactState], None] | None = None
        self._on_baseline = on_baseline
        # of each whether something touched
        self._seen: deque[tuple[Frame, bool]] = deque(maxlen=tare_frames)
        # since activation: a stream that begins anew, or a doubled message, lifts no guard
        self._tared = False
        # The service comes from another thread than the frames in the one-process road.
        self._lock = threading.Lock()
        self._on_failure = on_failure

    @property
    def shape(self) -> tuple[int, int]:
        """Taxels and channels that the pipeline takes."""
        return self.pipeline.layout.shape

    @property
    def failures(self) -> int:
        """Frames that could not be estimated."""
        return self.pipeline.failures

    def set_tare_frames(self, count: int) -> None:
        """Average so many frames in the next tare."""
        with self._lock:
            self._seen = deque(self._seen, maxlen=count)

    def reset(self) -> None:
        """Activation: forget the last stream, keep its baseline; the next tare is the first."""
        with self._lock:
            self._forget()
            self._tared = False

    def _forget(self) -> None:
        self.pipeline.reset()
        self._seen.clear()
        self.tally = Tally()

    def process(self, frame: Frame) -> ContactState:
        """Estimate from the next frame; one that fails counts as lost.

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
            failures = self.pipeline.failures
            state = self.pipeline.process(frame)
            self._report_failures(failures)
            self._remember(frame, state)
            if self._watch is not None:
                self._watch(frame, state)
            return state

    def process_all(self, frames: Sequence[Frame]) -> list[ContactState]:
        """Estimate from the next frames: the same numbers as one by one, and cheaper."""
        with self._lock:
            if len(frames) > 1 and self._is_one_stretch(frames):
                failures = self.pipeline.failures
                recording = Recording.from_frames(self.pipeline.layout, frames)
                states = list(self.pipeline.process_next(recording))
                self._report_failures(failures)
                for frame, state in zip(frames, states, strict=True):
                    self._remember(frame, state)
                return states
        return [self.process(frame) for frame in frames]

    def _report_failures(self, before: int) -> None:
        """Say that frames could not be estimated."""
        count = self.pipeline.failures - before
        if count:
            frames = 'a frame' if count == 1 else f'{count} frames'
            self._on_failure(f'{frames} cannot be estimated ({self.pipeline.failure})')

    def _is_one_stretch(self, frames: Sequence[Frame]) -> bool:
        """Nothing begins with any of these frames, and nobody watches them one by one."""
        if self._watch is not None or not self.tally.frames or self.tally.stamp_ns is None:
            return False
        before, stamp_ns = self.tally.sequence, self.tally.stamp_ns
        warm = frames[0].temperature_c is None
        for frame in frames:
            later = frame.stamp_ns is not None and frame.stamp_ns > stamp_ns
            if frame.sequence <= before or not later or (frame.temperature_c is None) != warm:
                return False
            before, stamp_ns = frame.sequence, frame.stamp_ns
        return True

    @property
    def watch(self) -> Callable[[Frame, ContactState], None] | None:
        """What takes every frame with its state before the next one is processed; or nothing."""
        return self._watch

    @watch.setter
    def watch(self, watch: Callable[[Frame, ContactState], None] | None) -> None:
        """Once this returns, the one before takes no frame."""
        with self._lock:
            self._watch = watch

    def adopt(self, estimation: Estimation) -> int | None:
        """Estimate by other estimators of the same sensor from the next frame on.

        Returns
        -------
        int or None
            Stamp of the last frame that was processed before (ns); None: there was none.
        """
        with self._lock:
            self.pipeline.estimation = estimation
            return self.tally.stamp_ns

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
        tally.in_contact = int(state.in_contact)
        tally.stamp_ns = frame.stamp_ns
        if not _is_damaged(state):
            self._seen.append((frame, self.is_touching))
        elif self.is_touching and self._seen:
            # nothing before a contact may be a rest after it, whatever its frames look like
            self._seen[-1] = (self._seen[-1][0], True)

    @property
    def is_touching(self) -> bool:
        """Something touches, as far as can be told."""
        return self.tally.in_contact == 1

    @property
    def _guarded(self) -> bool:
        """Frames in contact are no rest: not before the first tare, when nobody can tell."""
        return not self.tare_in_contact and self._tared

    def _resting(self) -> list[Frame]:
        """Frames that a tare may take: where contact matters, those since the last one."""
        frames: list[Frame] = []
        for frame, touched in reversed(self._seen):
            if touched and self._guarded:
                break
            frames.append(frame)
        return frames[::-1]

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
            done, message = self._take()
            self.tally.tare_state = message if done else f'refused: {message}'
            return done, message

    def _take(self) -> tuple[bool, str]:
        """Take the baseline, or say why not."""
        frames = self._resting()
        if not frames:
            return False, self._refusal()
        try:
            self.pipeline.tare(frames)
        except ValueError as err:
            return False, str(err)
        self._tared = True
        self.tally.tares += 1
        self.tally.tare_ns = frames[-1].stamp_ns
        first = self.tally.sequence + 1
        self._on_baseline(self._baseline(frames[-1], first))
        return True, f'baseline of {len(frames)} frames, from sequence {first} on'

    def _refusal(self) -> str:
        """Why there is no frame to tare from."""
        if self.is_touching and self._guarded:
            return (
                'tare is refused while something touches: release it, or set allow_tare_in_contact'
            )
        if not self.tally.frames:
            return 'tare needs frames and none came yet: is the sensor active?'
        return 'tare needs resting frames and none without damage came since the last contact'

    def _baseline(self, frame: Frame, sequence: int) -> Frame:
        """Baseline in use as a frame, with the temperatures that it was taken at."""
        chips = self.pipeline.baseline_temperature_c
        known = chips is not None and bool(np.isfinite(chips).any())
        warm = np.array(chips) if known else None
        level, count = np.array(self.pipeline.baseline), self.pipeline.tare_frames
        return Frame(frame.stamp_ns, sequence, level, temperature_c=warm, averaged=count)


def _is_damaged(state: ContactState) -> bool:
    """No tare may take this frame: a taxel of it is bad, or none says anything new."""
    if state.status & DAMAGED:
        return True
    return bool(state.status & STALE and np.all(state.taxel_status & SAYS_NOTHING))
