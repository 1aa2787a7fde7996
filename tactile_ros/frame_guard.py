"""A frame that cannot be estimated costs itself alone: it counts as lost, the stream goes on.

What the failing frame left in the stream's memory is undone: the stream is copied now and then,
and the frames since are taken again.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import ContactState, FrameStatus, Recording, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Frame, Layout

# a copy takes half as long as a frame: so few of them leave the 99 % of delays as they are
FRAMES_BETWEEN_COPIES = 256
ERROR = np.uint8(TaxelStatus.ERROR)


class FrameGuard:
    """Takes the next frames of a pipeline's stream, whatever an estimator makes of them.

    Parameters
    ----------
    pipeline : Pipeline
        Whose stream it is; after a tare, a reset or other estimators it needs `begin`.
    on_failure : callable
        Takes a sentence about each frame that fails.

    Attributes
    ----------
    failures : int
        Frames that could not be estimated.
    reason : str
        Why the first of them could not; empty: there is none.
    """

    def __init__(
        self, pipeline: Pipeline, on_failure: Callable[[str], None] = lambda _: None
    ) -> None:
        self.pipeline = pipeline
        self.failures = 0
        self.reason = ''
        self._on_failure = on_failure
        self.begin()

    def begin(self) -> None:
        """Go back no further than to now."""
        self._kept = deepcopy(self.pipeline.stream)
        self._since: list[Frame] = []

    @property
    def problems(self) -> tuple[str, ...]:
        """A sentence where frames failed."""
        return (sentence_of(self.failures, self.reason),) if self.failures else ()

    def process(self, frame: Frame) -> ContactState:
        """Estimate from the next frame; one that fails has the status ERROR at every taxel.

        Raises
        ------
        ValueError
            If its shape is not the pipeline's.
        """
        if len(self._since) >= FRAMES_BETWEEN_COPIES:
            self.begin()
        try:
            state = self.pipeline.process(frame)
        except Exception as err:
            if np.shape(frame.values) != self.pipeline.layout.shape:
                raise
            return self._lost(frame, err)
        self._since.append(frame)
        return state

    def process_all(self, frames: Sequence[Frame]) -> list[ContactState]:
        """Estimate from the next frames of one stretch: the same numbers, and cheaper."""
        if len(self._since) + len(frames) > FRAMES_BETWEEN_COPIES:
            self.begin()
        try:
            states = list(self.pipeline.process_next(joined(frames, self.pipeline.layout)))
        except Exception:
            self._go_back()
            return [self.process(frame) for frame in frames]
        self._since += frames
        return states

    def _go_back(self) -> None:
        """Undo what was taken in part."""
        self.pipeline.stream = deepcopy(self._kept)
        for frame in self._since:
            self.pipeline.process(frame)

    def _lost(self, frame: Frame, err: Exception) -> ContactState:
        """State of a frame that failed; its replay sees the same."""
        reason = f'{type(err).__name__}: {err}'
        self.failures, self.reason = self.failures + 1, self.reason or reason
        self._on_failure(f'a frame cannot be estimated and counts as lost ({reason})')
        self._go_back()
        taxels = self.pipeline.layout.shape[0]
        try:
            state = self.pipeline.process(marked(frame, taxels))
        except Exception:  # not even as a lost one: the stream goes on without it
            self._go_back()
            state = unknown(taxels)
        self.begin()
        return state


def sentence_of(failures: int, reason: str) -> str:
    """How many frames failed, and why the first of them did."""
    return f'{failures} frames cannot be estimated and count as lost ({reason})'


def marked(frame: Frame, taxels: int) -> Frame:
    """A frame of which no taxel is to be used."""
    status = np.zeros(taxels, np.uint8) if frame.status is None else frame.status
    return replace(frame, status=status | ERROR)


def unknown(taxels: int) -> ContactState:
    """Nothing is known of a frame."""
    told = {
        'valid': np.zeros(1, bool),
        'status': np.array([int(FrameStatus.BAD_TAXELS)]),
        'taxel_status': np.full((1, taxels), ERROR),
    }
    return ContactState.assemble(taxels, told)


def joined(frames: Sequence[Frame], layout: Layout) -> Recording:
    """Frames of one stretch, with stamps, as a recording; temperatures are in all or in none."""
    clean = np.zeros(layout.shape[0], np.uint8)
    told = any(frame.status is not None for frame in frames)
    stamps = [frame.stamp_ns for frame in frames if frame.stamp_ns is not None]
    chips = [frame.temperature_c for frame in frames if frame.temperature_c is not None]
    return Recording.from_arrays(
        layout,
        np.stack([frame.values for frame in frames]),
        stamps,
        temperature_c=np.stack(chips) if chips else None,
        status=np.stack([clean if f.status is None else f.status for f in frames])
        if told
        else None,
    )
