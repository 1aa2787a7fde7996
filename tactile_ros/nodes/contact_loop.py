# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Contact loop of one stream: frames to contacts, with the rules of a tare, without ROS.

A tare takes the mean of the last `tare_frames` usable frames that were processed, all of them
after the last contact. No clock counts frames, and the new baseline says the first sequence that
it holds for: a replay repeats it exactly.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import nan

import numpy as np

from tactile_ros.conditioning.faults import DAMAGED, SAYS_NOTHING
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import ContactState, Estimation, Frame, FrameStatus, Recording, TaxelStatus

Observer = Callable[[Frame, ContactState], None]
STALE = int(FrameStatus.STALE)
FAR_AHEAD_NS = 86_400 * 10**9  # recordings that are played fast run ahead of the clock, too


@dataclass
class LoopStatistics:
    """Counts of a stream and its last frame, for diagnostics.

    `refused`: frames of another shape; `tare_ns`: stamp of the last frame that a tare took (ns).
    """

    frames: int = 0
    valid: int = 0
    refused: int = 0
    tares: int = 0
    last: Frame | None = None
    state: ContactState | None = None
    tare_ns: int | None = None
    tare_state: str = 'not tared since activation'

    @property
    def sequence(self) -> int:
        """Sequence of the last frame, -1 before the first."""
        return -1 if self.last is None else self.last.sequence

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last frame (ns)."""
        return None if self.last is None else self.last.stamp_ns

    @property
    def in_contact(self) -> int:
        """Contact of the last state: 1, 0, -1 unknown."""
        return -1 if self.state is None else int(self.state.in_contact)

    @property
    def baseline_age_s(self) -> float:
        """Stream time since the last tare (s); NaN: none was taken, or there are no stamps."""
        if self.stamp_ns is None or self.tare_ns is None:
            return nan
        return (self.stamp_ns - self.tare_ns) * 1e-9

    @property
    def faulty_taxels(self) -> list[int]:
        """Taxels that the sensor or the pipeline found faulty in the last frame."""
        return [] if self.state is None else np.flatnonzero(self.state.taxel_status).tolist()


class TimeCheck:
    """Count frames whose time or number cannot be, and give them a time that can."""

    def __init__(self) -> None:
        self.counts = {'stamps replaced': 0, 'stamps backwards': 0, 'sequences repeated': 0}
        self._reported = dict(self.counts)
        self._stamp_ns = self._sequence = -1

    def admit(self, frame: Frame, now_ns: int) -> Frame:
        """Frame as it is, or STALE with the time of arrival where its stamp is 0 or far ahead."""
        stamp_ns = frame.stamp_ns
        if stamp_ns is None:
            return frame
        # a simulated clock is 0 until its first message, which may come after the first frame
        if stamp_ns <= 0 or 0 < now_ns < stamp_ns - FAR_AHEAD_NS:
            self.counts['stamps replaced'] += 1
            stamp_ns = max(now_ns, self._stamp_ns + 1)
            stale = np.full(len(frame.values), np.uint8(TaxelStatus.STALE))
            status = stale if frame.status is None else frame.status | stale
            frame = replace(frame, stamp_ns=stamp_ns, status=status)
        self.counts['stamps backwards'] += stamp_ns < self._stamp_ns
        self.counts['sequences repeated'] += frame.sequence == self._sequence
        self._stamp_ns, self._sequence = stamp_ns, frame.sequence
        return frame

    def report(self) -> str:
        """Sentence of what was counted since the last call; empty: nothing."""
        grown = {name: n - self._reported[name] for name, n in self.counts.items()}
        self._reported = dict(self.counts)
        return ', '.join(f'{count} {name}' for name, count in grown.items() if count)


class ContactLoop:
    """A pipeline behind a lock, with the frames that a tare would take.

    `on_baseline` takes the baseline as a frame whose sequence is the first that it holds for, at
    the first frame of a stream and after every tare; `on_failure` a sentence about failed frames.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        tare_frames: int,
        tare_in_contact: bool,
        on_baseline: Callable[[Frame], None],
        on_failure: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.pipeline, self.tare_in_contact = pipeline, tare_in_contact
        self.statistics = LoopStatistics()
        self._observer: Observer | None = None
        self._on_baseline, self._on_failure = on_baseline, on_failure
        # of each whether something touched
        self._recent: deque[tuple[Frame, bool]] = deque(maxlen=tare_frames)
        self._tared = False  # since activation: a stream that begins anew lifts no guard
        self._lock = threading.Lock()  # the service may come from another thread than the frames

    @property
    def is_touching(self) -> bool:
        """True while the last frame is in contact."""
        return self.statistics.in_contact == 1

    def set_tare_frames(self, count: int) -> None:
        """Average so many frames in the next tare."""
        with self._lock:
            self._recent = deque(self._recent, maxlen=count)

    def observe(self, observer: Observer | None) -> None:
        """Let this take every frame with its state; the one before takes none from now on."""
        with self._lock:
            self._observer = observer

    def reset(self) -> None:
        """Activation: forget the last stream, keep its baseline; the next tare is the first."""
        with self._lock:
            self._begin_stream()
            self._tared = False

    def _begin_stream(self) -> None:
        self.pipeline.reset()
        self._recent.clear()
        self.statistics = LoopStatistics()

    def adopt(self, estimation: Estimation) -> int | None:
        """Go on with other estimators; returns the stamp of the last frame before (ns), if any."""
        with self._lock:
            self.pipeline.estimation = estimation
            return self.statistics.stamp_ns

    def process(self, frames: Sequence[Frame]) -> list[ContactState]:
        """Estimate from the next frames, as one by one; one that fails is an ERROR state."""
        pipeline = self.pipeline
        with self._lock:
            failures = pipeline.failures
            if len(frames) > 1 and self._is_one_stretch(frames):
                recording = Recording.from_frames(pipeline.layout, frames)
                states = list(pipeline.process_next(recording))
                self._remember(frames, states)
            else:
                states = []
                for frame in frames:
                    self._begin(frame)
                    states.append(pipeline.process(frame))
                    self._remember([frame], states[-1:])
                    if self._observer is not None:
                        self._observer(frame, states[-1])
            failed = pipeline.failures - failures
        if failed > 0:
            which = 'a frame' if failed == 1 else f'{failed} frames'
            self._on_failure(f'{which} cannot be estimated ({pipeline.failure})')
        return states

    def _begin(self, frame: Frame) -> None:
        """Begin a stream with a frame that is its first, and announce the baseline in use."""
        if frame.sequence <= self.statistics.sequence:
            self._begin_stream()
        # NaN says that there is no baseline yet, zero that the estimators want none
        if not self.statistics.frames and np.nan_to_num(self.pipeline.baseline).any():
            self._announce(frame.stamp_ns, frame.sequence)

    def _is_one_stretch(self, frames: Sequence[Frame]) -> bool:
        """Nothing begins with any of these frames, and nobody observes them one by one."""
        last, chips = self.statistics.last, frames[0].temperature_c is None
        if self._observer is not None or last is None:
            return False
        return all(
            before.stamp_ns is not None
            and after.stamp_ns is not None
            and after.stamp_ns > before.stamp_ns
            and after.sequence > before.sequence
            and (after.temperature_c is None) == chips
            for before, after in pairwise([last, *frames])
        )

    def _remember(self, frames: Sequence[Frame], states: Sequence[ContactState]) -> None:
        """Count, and keep frames that may be resting for a tare."""
        counts = self.statistics
        counts.frames += len(frames)
        for frame, state in zip(frames, states, strict=True):
            counts.valid += int(state.valid)
            counts.last, counts.state = frame, state
            says_nothing = state.status & STALE and np.all(state.taxel_status & SAYS_NOTHING)
            if not (state.status & DAMAGED or says_nothing):
                self._recent.append((frame, self.is_touching))
            elif self.is_touching and self._recent:
                # nothing before a contact may be a rest after it, whatever its frames look like
                self._recent[-1] = (self._recent[-1][0], True)

    def tare(self) -> tuple[bool, str]:
        """Take the baseline from the last resting frames: True and which, or False and why not."""
        with self._lock:
            done, message = self._take_baseline()
            self.statistics.tare_state = message if done else f'refused: {message}'
            return done, message

    def _take_baseline(self) -> tuple[bool, str]:
        counts = self.statistics
        # frames in contact are no rest: not before the first tare, when nobody can tell
        forbidden = not self.tare_in_contact and self._tared
        frames: list[Frame] = []
        for frame, touched in reversed(self._recent):
            if touched and forbidden:
                break
            frames.insert(0, frame)
        if not counts.frames:
            return False, 'tare needs frames and none came yet: is the sensor active?'
        if not frames and self.is_touching and forbidden:
            return False, (
                'tare is refused while something touches: release it, or set allow_tare_in_contact'
            )
        if not frames:
            return False, (
                'tare needs resting frames and none without damage came since the last contact'
            )
        spread = np.std([frame.values for frame in frames], axis=0) / self.pipeline.rest_.scale
        moving = np.flatnonzero((spread > 1).any(axis=1))
        if moving.size and not self.tare_in_contact:
            return False, (
                f'tare needs resting frames; the last {len(frames)} vary by more than a touch at '
                f'taxels {moving.tolist()[:8]}: something moves, or two sensors send as one'
            )
        try:
            self.pipeline.tare(frames)
        except ValueError as err:
            return False, str(err)
        self._tared = True
        counts.tares += 1
        counts.tare_ns = frames[-1].stamp_ns
        first = counts.sequence + 1
        self._announce(counts.tare_ns, first)
        return True, f'baseline of {len(frames)} frames, from sequence {first} on'

    def _announce(self, stamp_ns: int | None, sequence: int) -> None:
        chips = self.pipeline.baseline_temperature_c
        measured = chips is not None and np.isfinite(chips).any()
        values, averaged = np.array(self.pipeline.baseline), self.pipeline.tare_frames
        taken_c = np.array(chips) if measured else None
        self._on_baseline(Frame(stamp_ns, sequence, values, taken_c, averaged=averaged))
