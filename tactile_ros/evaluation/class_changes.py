"""Classes that came and went in a live run: read from its bag, and repeated in a replay."""

from __future__ import annotations

import json
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.enrolment import EVERYTHING, Press, PressWatch, learn, recording_of, window_of
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.live_baselines import baselines_by_row
from tactile_ros.evaluation.loaded import ClassChange
from tactile_ros.frame_guard import FrameGuard

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tactile_ros.evaluation.loaded import LoadedRecording
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Frame, Recording


def read_changes(texts: Iterable[str]) -> tuple[ClassChange, ...]:
    """Changes that announcements of a calibration tell; those that make no sense tell none."""
    found = (_read(text) for text in texts)
    return tuple(change for change in found if change is not None)


def _read(text: str) -> ClassChange | None:
    """Change of one announcement; None: it tells none."""
    try:
        told = json.loads(text)
        label = told.get('enrolled', told.get('forgotten'))
        if not isinstance(label, str):
            return None
        presses = tuple((int(a), int(b)) for a, b in told.get('presses', ()))
        after_ns = told.get('after_ns')
        return ClassChange(
            label, str(told['sha256']), -1 if after_ns is None else int(after_ns),
            presses, bool(told.get('replace')),
        )  # fmt: skip
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


def as_it_began(loaded: LoadedRecording, pipeline: Pipeline) -> Pipeline:
    """The pipeline as the live run began with it, to be changed as the run changed it.

    A calibration that holds the classes that were enrolled in the run forgets them, where that
    leads back to the one that was announced first; else it is taken as it is.
    """
    if not loaded.changes:
        return pipeline
    early = deepcopy(pipeline)
    for change in reversed(loaded.changes):
        if early.digest in loaded.calibrations[:1]:
            break
        if change.presses and change.label in early.label_names:
            with suppress(ValueError):  # known from the fit: another calibration
                early.forget(change.label)
    early.reset()
    return early if early.digest in loaded.calibrations[:1] else deepcopy(pipeline)


def presses_in(loaded: LoadedRecording, pipeline: Pipeline) -> list[Press]:
    """Presses in the bag of a live run, found as a live run finds them.

    Parameters
    ----------
    loaded : LoadedRecording
        With the baselines of its run.
    pipeline : Pipeline
        Tells contact; its baseline changes as the recording says.

    Raises
    ------
    RecordingError
        If no press was found, and frames could not be estimated.
    """
    recording = loaded.recording
    rows = np.arange(len(recording))
    waiting = baselines_by_row(recording, rows, loaded.baselines)
    found: list[Press | None] = []
    watch, guard = PressWatch(window_of(pipeline)), FrameGuard(pipeline)
    for row, restart in zip(rows.tolist(), recording.restarts, strict=True):
        if restart:
            pipeline.reset()
            watch = PressWatch(window_of(pipeline))
        for baseline in waiting.get(row, []):
            pipeline.tare([baseline], doubted=False)
        if restart or row in waiting:
            guard.begin()
        frame = recording.frame(row)
        state = guard.process(frame)
        found.append(watch(frame, int(state.in_contact), pipeline.baseline))
    presses = [press for press in found if press is not None]
    if guard.failures and not presses:
        raise RecordingError(' '.join(guard.problems))
    return presses


@dataclass
class Repetition:
    """Changes of a live run, made again while its frames are replayed.

    Attributes
    ----------
    recording : Recording
        Frames of the run.
    changes : tuple of ClassChange
        In their order.
    problems : list of str
        What could not be repeated, as sentences.
    """

    recording: Recording
    changes: Sequence[ClassChange]
    problems: list[str] = field(default_factory=list)
    _baselines: dict[int, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Note at which frames presses begin."""
        self._waiting = list(self.changes)
        self._firsts = {first for change in self.changes for first, _ in change.presses}

    def before(self, frame: Frame, pipeline: Pipeline) -> bool:
        """Let what changed before a frame hold for it; whether anything did."""
        waiting = len(self._waiting)
        while self._waiting and self._waiting[0].after_ns < (frame.stamp_ns or 0):
            change = self._waiting.pop(0)
            try:
                self._make(change, pipeline)
            except (ValueError, LookupError) as err:
                self.problems.append(f'{change.label!r} could not be learned or forgotten: {err}')
        return len(self._waiting) < waiting

    def after(self, frame: Frame, pipeline: Pipeline) -> None:
        """Keep the baseline with which a press began."""
        if frame.stamp_ns in self._firsts:
            self._baselines[frame.stamp_ns] = pipeline.baseline

    def _make(self, change: ClassChange, pipeline: Pipeline) -> None:
        """Learn or forget one class."""
        if not change.presses:
            pipeline.forget(change.label)
            return
        presses = [self._press(first, last) for first, last in change.presses]
        taught = recording_of(pipeline.layout, presses)
        # what the live run allowed is not asked again
        learn(pipeline, change.label, taught, change.replace, EVERYTHING)

    def _press(self, first: int, last: int) -> Press:
        """A press from its frames; LookupError where they are not in the recording."""
        stamps = self.recording.stamp_ns
        if stamps is None or first not in self._baselines or last not in stamps:
            msg = 'its presses are not in the recording'
            raise LookupError(msg)
        rows = np.flatnonzero((stamps >= first) & (stamps <= last))
        frames = tuple(self.recording.frame(int(row)) for row in rows)
        return Press(frames, self._baselines[first])
