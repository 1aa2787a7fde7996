"""Any pipeline over the frames of a recording, compared with what was said live and with truth.

A replay repeats what the live node did: the frames that its contacts name, the baselines that it
published each from its first frame on, classes learned and forgotten where it did so, memory
forgotten where a stream began.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from time import perf_counter_ns
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.evaluation.class_changes import Repetition, as_it_began
from tactile_ros.evaluation.failing_frames import estimated
from tactile_ros.evaluation.follow import batch_of, gathered
from tactile_ros.evaluation.live_baselines import baselines_by_row
from tactile_ros.frame_guard import FrameGuard
from tactile_ros.types import STATE_FIELDS, ContactState, ContactStates, Frame, Recording

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.evaluation.loaded import ClassChange, LoadedRecording
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Integers

NOT_IN_MESSAGES = ('object_pose', 'object_pose_cov')


@dataclass(frozen=True)
class Agreement:
    """Replay against the contacts of the live run.

    Attributes
    ----------
    frames : int
        Compared.
    without_contacts : int
        Frames that no contacts are about: the live node did not see them, they are left out.
    differences : dict of str to float
        Largest difference of each attribute (its unit); inf where only one of them knows it.
    """

    frames: int
    without_contacts: int
    differences: dict[str, float]

    def __add__(self, other: Agreement) -> Agreement:
        """Of both parts together."""
        names = dict.fromkeys([*self.differences, *other.differences])
        worst = {
            name: max(self.differences.get(name, 0.0), other.differences.get(name, 0.0))
            for name in names
        }
        missing = self.without_contacts + other.without_contacts
        return Agreement(self.frames + other.frames, missing, worst)

    @property
    def largest(self) -> float:
        """Largest difference of all; 0 where nothing was compared."""
        return max(self.differences.values(), default=0.0)

    @property
    def worst(self) -> str:
        """Attribute with the largest difference."""
        return max(self.differences, key=lambda name: self.differences[name], default='')


@dataclass(frozen=True)
class Replayed:
    """One pipeline's answers to one recording.

    Attributes
    ----------
    states : ContactStates
        For every row of the recording; unknown where a frame was left out.
    us_per_frame : float
        Median wall time of one frame, one by one (microseconds); NaN: nothing was processed.
    agreement : Agreement or None
        None: there are no live contacts.
    problems : tuple of str
        What must be known about it, as sentences.
    us_batch : float
        Wall time of one frame of a batch (microseconds); NaN: no batch was run.
    """

    states: ContactStates
    us_per_frame: float
    agreement: Agreement | None
    problems: tuple[str, ...] = ()
    us_batch: float = float('nan')


def replay(
    loaded: LoadedRecording, pipeline: Pipeline, clock_ns: Callable[[], int] = perf_counter_ns
) -> Replayed:
    """Run a pipeline over a recording as a live node would have.

    Parameters
    ----------
    loaded : LoadedRecording
        With frames of the pipeline's shape; the live run's baselines are used, else tare rows.
    pipeline : Pipeline
        Its baseline changes as the recording says.
    clock_ns : callable
        For the time per frame (ns).

    Returns
    -------
    Replayed
        One state per row.

    Raises
    ------
    ValueError
        If the shape differs.
    """
    recording, live = loaded.recording, loaded.contacts
    _refuse_other_shape(recording, pipeline)
    pipeline = as_it_began(loaded, as_live(loaded.calibrations, pipeline))
    problems = calibration_problems(loaded.calibrations, pipeline, loaded.changes)
    changes = Repetition(recording, loaded.changes)
    if live is None and not loaded.baselines:
        begin = clock_ns()
        states, failed = estimated(recording, pipeline)
        batch = (clock_ns() - begin) / 1000 / max(len(recording), 1)
        single = single_cost(recording, pipeline, clock_ns)
        return Replayed(states, single, None, (*problems, *failed), batch)
    rows = np.arange(len(recording)) if live is None else np.unique(live.rows)
    guard = FrameGuard(pipeline)
    singles, micro = _process(recording, rows, loaded.baselines, guard, changes, clock_ns)
    problems += (*changes.problems, *guard.problems)
    found = [batch_of(state) for state in singles]
    states = gathered(found, rows, len(recording), recording.layout.shape[0])
    if live is None:
        return Replayed(states, micro, None, problems)
    agreement = compare(live.states, live.rows, states, len(recording))
    return Replayed(states, micro, agreement, (*problems, *left_out(agreement)))


def left_out(agreement: Agreement | None) -> tuple[str, ...]:
    """A sentence where frames have no contacts."""
    count = 0 if agreement is None else agreement.without_contacts
    reason = 'the live node did not see them'
    return (f'{count} frames without contacts were left out: {reason}',) if count else ()


def as_live(calibrations: Sequence[str], pipeline: Pipeline) -> Pipeline:
    """The pipeline, its baseline held still where the live run had switched tracking off.

    Parameters
    ----------
    calibrations : sequence of str
        SHA-256 of those of the live run.
    pipeline : Pipeline
        Stays as it is.
    """
    if pipeline.digest in calibrations or not pipeline.config.track_baseline:
        return pipeline
    still = copy(pipeline)
    still.config = replace(pipeline.config, track_baseline=False)  # type: ignore[type-var]
    still.reset()
    return still if still.digest in calibrations else pipeline


def single_cost(
    recording: Recording, pipeline: Pipeline, clock_ns: Callable[[], int], frames: int = 500
) -> float:
    """Wall time of one frame processed alone (microseconds): the median of some frames."""
    spent = []
    pipeline.reset()
    guard = FrameGuard(pipeline)
    for row in range(min(len(recording), frames)):
        frame = recording.frame(row)
        begin = clock_ns()
        guard.process(frame)
        spent.append(clock_ns() - begin)
    return float(np.median(spent)) / 1000 if spent else float('nan')


def calibration_problems(
    calibrations: Sequence[str], pipeline: Pipeline, changes: Sequence[ClassChange] = ()
) -> tuple[str, ...]:
    """A sentence where a bag was made with other calibrations (SHA-256) than the pipeline's.

    Those that follow from the first by classes that came and went in the run are no others.
    """
    if not calibrations:
        return ()
    told = {calibrations[0], *(change.digest for change in changes)}
    if told.issuperset(calibrations) and pipeline.digest == calibrations[0]:
        return ()
    named = ', '.join(digest[:12] for digest in calibrations)
    if pipeline.digest in calibrations:
        return (f'the bag was made with several calibrations: {named}',)
    return (
        f'the calibration {pipeline.digest[:12]} is not that of the bag ({named}): '
        'its contacts must differ',
    )


def _refuse_other_shape(recording: Recording, pipeline: Pipeline) -> None:
    """Frames of another board are none of this pipeline."""
    if recording.layout.shape != pipeline.layout.shape:
        msg = (
            f'the recording must have shape {pipeline.layout.shape} (t, c) as the calibration of '
            f'{pipeline.sensor} says; received {recording.layout.shape}'
        )
        raise ValueError(msg)


def _process(
    recording: Recording,
    rows: Integers,
    baselines: Sequence[Frame],
    guard: FrameGuard,
    changes: Repetition,
    clock_ns: Callable[[], int],
) -> tuple[list[ContactState], float]:
    """States of the rows, one by one, and the median time of one (microseconds).

    Baselines come in before their first frame.
    """
    streams = np.cumsum(recording.restarts)
    waiting = baselines_by_row(recording, rows, baselines)
    found, spent, last, pipeline = [], [], -1, guard.pipeline
    for row in rows.tolist():
        frame = recording.frame(row)
        begins = last < 0 or streams[row] != streams[last]
        if begins:
            pipeline.reset()
        for baseline in waiting.get(row, []):
            pipeline.tare([baseline], doubted=False)  # also an equal one: a tare restarts memory
        if changes.before(frame, pipeline) or begins or row in waiting:
            guard.begin()
        begin = clock_ns()
        found.append(guard.process(frame))
        spent.append(clock_ns() - begin)
        changes.after(frame, pipeline)
        last = row
    return found, float(np.median(spent)) / 1000 if spent else float('nan')


def compare(live: ContactStates, rows: Integers, states: ContactStates, samples: int) -> Agreement:
    """Largest difference of every attribute between live contacts and replayed states.

    Parameters
    ----------
    live : ContactStates
        Of n messages.
    rows : ndarray, shape (n,)
        Rows of the states that they are about.
    states : ContactStates
        Replayed, for all s rows.
    samples : int
        Count s.

    Returns
    -------
    Agreement
        By attribute; poses are no part of the messages.
    """
    differences = {}
    for name in STATE_FIELDS:
        if name not in NOT_IN_MESSAGES:
            mine = np.asarray(getattr(states, name)[rows], np.float64)
            theirs = np.asarray(getattr(live, name), np.float64)
            differences[name] = _difference(*_padded(name, mine, theirs))
    missing = samples - len(np.unique(rows))
    return Agreement(len(rows), missing, differences)


def _padded(
    name: str, one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Lists of patches of one length, filled up as states are."""
    shape, _, fill = STATE_FIELDS[name]
    if shape[:1] != ('k',) or one.shape == other.shape:
        return one, other
    patches = max(one.shape[1], other.shape[1])

    def filled(array: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        wide = np.full((len(array), patches, *array.shape[2:]), fill)
        wide[:, : array.shape[1]] = array
        return wide

    return filled(one), filled(other)


def _difference(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> float:
    """Largest difference; inf where only one side knows a value."""
    if not one.size:
        return 0.0
    unknown = np.isnan(one)
    if not np.array_equal(unknown, np.isnan(other)):
        return float('inf')
    same = unknown | (one == other)
    return float(np.where(same, 0.0, np.abs(one - other)).max())
