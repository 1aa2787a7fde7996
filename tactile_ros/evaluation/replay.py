"""Any pipeline over the frames of a recording, compared with what was said live and with truth.

A replay repeats what the live node did: the frames that its contacts name, the baselines that it
published each from its first frame on, classes learned and forgotten where it did so, memory
forgotten where a stream began.
"""

from __future__ import annotations

from contextlib import suppress
from copy import copy, deepcopy
from dataclasses import dataclass, field, replace
from itertools import pairwise
from time import perf_counter_ns
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.enrolment import EVERYTHING, Press, PressWatch, learn, recording_of, window_of
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.recording_files import ClassChange
from tactile_ros.types import STATE_FIELDS, ContactState, ContactStates, Frame, Recording

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.evaluation.recording_files import ClassChange, LoadedRecording
    from tactile_ros.evaluation.sensor_pieces import Piece
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, ContactState, ContactStates, Frame, Integers, Recording


class Follower:
    """Answers of one pipeline, with its memory carried over from piece to piece.

    Parameters
    ----------
    pipeline : Pipeline
        It stays as it is; a copy moves on.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self.pipeline = copy(pipeline)
        self.pipeline.reset()
        self.pipeline.failures = 0
        self._stream = -1

    def __call__(self, piece: Piece) -> ContactStates:
        """States of every row of the next piece; unknown where the live node saw no frame."""
        recording, rows = piece.recording, piece.rows
        taxels = recording.layout.shape[0]
        self.pipeline.check_layout(recording)
        if not len(rows):
            return ContactStates.assemble(len(recording), taxels, {})
        assert recording.stream is not None
        stream = recording.stream[rows]
        fresh = np.diff(stream, prepend=self._stream) != 0
        self._stream = int(stream[-1])
        failed = np.isin(rows, () if piece.live is None else piece.live.failed)
        cuts = fresh | np.isin(rows, list(piece.baselines)) | failed
        cuts[1:] |= failed[:-1]
        edges = np.unique([0, *np.flatnonzero(cuts).tolist(), len(rows)]).tolist()
        parts: list[ContactStates] = []
        for first, last in pairwise(edges):
            if fresh[first]:
                self.pipeline.reset()
            baseline = piece.baselines.get(int(rows[first]))
            if baseline is not None:
                self.pipeline.tare([baseline])
            if failed[first]:
                frame = recording.frame(int(rows[first]))
                parts.append(batch_of(self.pipeline.process_failed(frame)))
                continue
            whole = int(rows[last - 1]) + 1 - int(rows[first]) == last - first
            chosen = (
                slice(int(rows[first]), int(rows[last - 1]) + 1) if whole else rows[first:last]
            )
            parts.append(self.pipeline.process_next(recording.select(chosen)))
        if len(parts) == 1 and len(rows) == len(recording):
            return parts[0]
        return gathered(parts, rows, len(recording), taxels)


def batch_of(state: ContactState) -> ContactStates:
    """A batch of one."""
    return ContactStates(**{name: np.asarray(getattr(state, name))[None] for name in STATE_FIELDS})


def gathered(
    parts: list[ContactStates], rows: Integers, samples: int, taxels: int
) -> ContactStates:
    """States of some rows (n,), in parts, among all rows s."""
    patches = max([1, *(part.contacts_id.shape[1] for part in parts)])
    known = {}
    for name, (shape, dtype, fill) in STATE_FIELDS.items():
        lengths = {'t': taxels, 'k': patches}
        tail = tuple(lengths[n] if isinstance(n, str) else n for n in shape)
        column: npt.NDArray[np.generic] = np.full((samples, *tail), fill, dtype)
        first = 0
        for part in parts:
            values = getattr(part, name)
            place = rows[first : first + len(values)]
            if shape[:1] == ('k',):
                column[place, : values.shape[1]] = values
            else:
                column[place] = values
            first += len(values)
        known[name] = column
    return ContactStates.assemble(samples, taxels, known)


def failure_problems(pipeline: Pipeline, before: int = 0) -> tuple[str, ...]:
    """Sentence about the frames that could not be estimated, beyond so many."""
    count = pipeline.failures - before
    if not count:
        return ()
    return (f'{count} frames cannot be estimated and count as lost ({pipeline.failure})',)


def baselines_by_row(
    recording: Recording, rows: Integers, baselines: Sequence[Frame]
) -> dict[int, list[Frame]]:
    """Baselines by the processed row before which each comes in.

    A counter that starts again makes its sequence ambiguous: a baseline belongs to the stream with
    a frame of its stamp; where none has one, to that of the baseline before it, or to the next
    where its sequence went back.
    """
    if recording.sequence is None or not len(rows):
        return {}
    sequence = recording.sequence[rows]
    number = np.cumsum(recording.restarts)
    streams = number[rows]
    stamps = [] if recording.stamp_ns is None else recording.stamp_ns.tolist()
    homes = dict(zip(stamps, number.tolist(), strict=False))
    found: dict[int, list[Frame]] = {}
    stream, previous = int(streams[0]), -1
    for baseline in baselines:
        home = homes.get(baseline.stamp_ns, -1)
        if home >= stream:
            stream = home
        elif baseline.sequence < previous:
            stream += 1
        previous = baseline.sequence
        later = np.flatnonzero((streams == stream) & (sequence >= baseline.sequence))
        if len(later):
            found.setdefault(int(rows[later[0]]), []).append(baseline)
    return {row: group[-1:] for row, group in found.items()}


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
    watch, failures = PressWatch(window_of(pipeline)), pipeline.failures
    for row, restart in zip(rows.tolist(), recording.restarts, strict=True):
        if restart:
            pipeline.reset()
            watch = PressWatch(window_of(pipeline))
        for baseline in waiting.get(row, []):
            pipeline.tare([baseline])
        frame = recording.frame(row)
        state = pipeline.process(frame)
        found.append(watch(frame, int(state.in_contact), pipeline.baseline))
    presses = [press for press in found if press is not None]
    problems = failure_problems(pipeline, failures)
    if problems and not presses:
        raise RecordingError(' '.join(problems))
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
    failures = pipeline.failures
    changes = Repetition(recording, loaded.changes)
    if live is None and not loaded.baselines:
        begin = clock_ns()
        states = pipeline.process_batch(recording)
        problems += failure_problems(pipeline, failures)
        batch = (clock_ns() - begin) / 1000 / max(len(recording), 1)
        single = single_cost(recording, pipeline, clock_ns)
        return Replayed(states, single, None, problems, batch)
    rows = np.arange(len(recording)) if live is None else np.unique(live.rows)
    failed = () if live is None else live.failed
    singles, micro = _process(
        recording, rows, loaded.baselines, failed, pipeline, changes, clock_ns
    )
    problems += (*changes.problems, *failure_problems(pipeline, failures))
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
    for row in range(min(len(recording), frames)):
        frame = recording.frame(row)
        begin = clock_ns()
        pipeline.process(frame)
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
    failed: Integers | tuple[()],
    pipeline: Pipeline,
    changes: Repetition,
    clock_ns: Callable[[], int],
) -> tuple[list[ContactState], float]:
    """States of the rows, one by one, and the median time of one (microseconds).

    Baselines come in before their first frame.
    """
    streams = np.cumsum(recording.restarts)
    waiting = baselines_by_row(recording, rows, baselines)
    found, spent, last, lost = [], [], -1, set(np.asarray(failed).tolist())
    for row in rows.tolist():
        frame = recording.frame(row)
        begins = last < 0 or streams[row] != streams[last]
        if begins:
            pipeline.reset()
        for baseline in waiting.get(row, []):
            pipeline.tare([baseline])  # also an equal one: a tare restarts memory
        changes.before(frame, pipeline)
        process = pipeline.process_failed if row in lost else pipeline.process
        begin = clock_ns()
        found.append(process(frame))
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
