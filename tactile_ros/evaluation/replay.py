# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Any pipeline over the frames of a recording, compared with what was said live and with truth.

A replay repeats what the live node did: the frames that its contacts name, baselines, classes that
were learned and forgotten, memory that ends with a stream. A bag may go through it in pieces.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from copy import copy, deepcopy
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from math import nan
from time import perf_counter_ns

import numpy as np

from tactile_ros import enrolment
from tactile_ros.conditioning.faults import DAMAGED, SAYS_NOTHING, UNUSABLE, taxel_faults
from tactile_ros.devices.fault_flags import measured_temperature
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.metrics import Agreement
from tactile_ros.evaluation.recording_files import LoadedRecording
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import (
    STATE_FIELDS,
    Array,
    Bools,
    Columns,
    ContactState,
    ContactStates,
    Frame,
    FrameStatus,
    Integers,
    Recording,
)
from tactile_ros.types.contact import stack_columns, widened
from tactile_ros.types.recording import FIRM

NOT_IN_MESSAGES = ('object_pose', 'object_pose_cov')
TIMED = 200  # frames that are processed one by one for their time
REMEMBERED = 1 << 16  # stamps of frames that a baseline may name
FEWEST = 4  # frames of a tare: fewer tell no noise
BRIDGED = 2  # rows between two frames of a tare: damaged, or not heard
ENOUGH = 30  # frames of tares; fewer tell less than a truth that knows every rest
STILL = 0.1  # of the frames, at which a load cell tells least
CLEAR = 3.0  # standard errors of a mean force


def replay(loaded: LoadedRecording, pipeline: Pipeline) -> Follower:
    """Follower of a whole recording, with the live run's baselines, else with tare rows.

    Raises ValueError if the shape of the pipeline differs.
    """
    follower = Follower(pipeline, loaded)
    follower(loaded)
    return follower


def compare(live: ContactStates, rows: Integers, states: ContactStates, samples: int) -> Agreement:
    """Largest difference of every attribute between n live contacts and replayed states (s rows).

    The contacts are about `rows` (n,); poses are no part of the messages.
    """
    differences, alone = {}, np.zeros(len(rows), bool)
    patches = max(live.contacts_id.shape[1], states.contacts_id.shape[1])
    for name in (name for name in STATE_FIELDS if name not in NOT_IN_MESSAGES):
        mine = np.asarray(widened(name, getattr(states, name)[rows], patches), np.float64)
        theirs = np.asarray(widened(name, getattr(live, name), patches), np.float64)
        single = np.isnan(mine) != np.isnan(theirs)
        alone |= single.any(axis=tuple(range(1, single.ndim)))
        apart = np.where(mine == theirs, 0.0, np.abs(mine - theirs))
        differences[name] = float(np.nanmax(apart, initial=0.0))
    return Agreement(len(rows), samples - len(np.unique(rows)), differences, int(alone.sum()))


def as_live(calibrations: Sequence[str], pipeline: Pipeline) -> Pipeline:
    """Pipeline whose baseline is held where the live run (its SHA-256s) did not track it."""
    if pipeline.digest in calibrations or not pipeline.config.track_baseline:
        return pipeline
    still = copy(pipeline)
    still.config = replace(pipeline.config, track_baseline=False)  # type: ignore[type-var]
    still.reset()
    return still if still.digest in calibrations else pipeline


def as_it_began(
    calibrations: Sequence[str], changes: Sequence[enrolment.ClassChange], pipeline: Pipeline
) -> Pipeline:
    """Pipeline with which the live run began: without the classes that were enrolled in it.

    Where that does not lead back to the one that was announced first, it is taken as it is.
    """
    if not changes:
        return pipeline
    early = deepcopy(pipeline)
    for change in reversed(changes):
        if early.digest in calibrations[:1]:
            break
        if change.presses and change.label in early.label_names:
            with suppress(ValueError):  # a class of the fit: another calibration
                early.forget(change.label)
    early.reset()
    return early if early.digest in calibrations[:1] else pipeline


def calibration_problems(
    calibrations: Sequence[str], pipeline: Pipeline, changes: Sequence[enrolment.ClassChange] = ()
) -> tuple[str, ...]:
    """Sentence where a bag was made with other calibrations (SHA-256) than the pipeline's.

    Those that follow from the first by classes that came and went in the run are no others.
    """
    expected = {pipeline.digest, *(change.digest for change in changes)}
    began = not calibrations or calibrations[0] == pipeline.digest
    if began and expected.issuperset(calibrations):
        return ()
    named = ', '.join(digest[:12] for digest in calibrations)
    if pipeline.digest in calibrations:
        return (f'the bag was made with several calibrations: {named}',)
    which = f'the calibration {pipeline.digest[:12]} is not that of the bag ({named})'
    return (f'{which}: its contacts must differ',)


def failure_problems(pipeline: Pipeline, before: int = 0) -> tuple[str, ...]:
    """Sentence about the frames that could not be estimated, beyond so many."""
    count = pipeline.failures - before
    sentence = f'{count} frames cannot be estimated and count as lost ({pipeline.failure})'
    return (sentence,) if count else ()


class Follower:
    """Copy of a pipeline along a live run, with its memory carried over from piece to piece.

    `first` is its first piece, or all of it, which it must be where classes came or went. `states`
    are of every row of the last piece, unknown where the live node saw no frame; `agreement` is
    None without live contacts; `frames` were processed so far.
    """

    def __init__(self, pipeline: Pipeline, first: LoadedRecording) -> None:
        self.frames = self._spent_ns = 0
        self.agreement: Agreement | None = None
        self._first: Recording | None = None
        calibrations, changes = first.calibrations, first.changes
        self.began = as_it_began(calibrations, changes, as_live(calibrations, pipeline))
        self.pipeline = deepcopy(self.began) if changes else copy(self.began)
        self.pipeline.reset()
        self.pipeline.failures = 0
        self._mismatch = calibration_problems(calibrations, self.began, changes)
        sequence, before = first.recording.sequence, [b.sequence for b in first.baselines[:1]]
        if sequence is not None and before and (sequence[:1] > before).any():
            self._mismatch += ('begun amid a run: contacts differ by what filters remember',)
        self._baselines = BaselineQueue()
        self._changes = ClassChanges(changes, self.pipeline)
        self._stream, self._unused_tares, self._unmeasured = -1, 0, 0

    @property
    def problems(self) -> tuple[str, ...]:
        """Sentences that must be read with the states."""
        left_out = () if self.agreement is None else self.agreement.problems
        failures = failure_problems(self.pipeline)
        if self._unused_tares:
            why = 'this calibration was fitted without rest'
            left_out += (f'{self._unused_tares} tares of the bag are left out: {why}',)
        if self._unmeasured:
            said = 'frames of which every chip says a temperature that none can have'
            left_out += (f'{self._unmeasured} {said}: these are not used',)
        return (*self._mismatch, *self._changes.problems, *failures, *left_out)

    @property
    def us_batch(self) -> float:
        """Wall time of a frame among many (microseconds); NaN: none was processed."""
        return self._spent_ns / self.frames / 1000 if self.frames else nan

    @cached_property
    def us_single(self) -> float:
        """Wall time of a frame alone (microseconds), the median of some; NaN as above."""
        if self._first is None:
            return nan
        pipeline, spent = copy(self.began), []
        pipeline.reset()
        for row in range(len(self._first)):
            frame = self._first.frame(row)
            begin = perf_counter_ns()
            pipeline.process(frame)
            spent.append(perf_counter_ns() - begin)
        return float(np.median(spent)) / 1000

    def __call__(self, piece: LoadedRecording) -> ContactStates:
        """Estimate from the next piece."""
        recording, live, count = piece.recording, piece.contacts, len(piece.seen)
        begin = perf_counter_ns()
        self.states = self._estimate(piece)
        self._spent_ns += perf_counter_ns() - begin
        self.frames += count
        if self._first is None and count:
            self._first = recording.select(slice(0, TIMED))
        if live is not None:
            agreement = compare(live.states, live.rows, self.states, len(recording))
            self.agreement = self.agreement + agreement if self.agreement else agreement
        return self.states

    def _estimate(self, piece: LoadedRecording) -> ContactStates:
        recording, rows = piece.recording, piece.seen
        taxels = recording.layout.shape[0]
        self.pipeline.check_layout(recording)
        if recording.temperature_c is not None:
            self._unmeasured += measured_temperature(recording.temperature_c)[1]
        of_file = recording.stream is None or recording.tare is not None
        if (of_file or recording.stamp_ns is None) and piece.contacts is None:
            return self.pipeline.process_batch(recording)
        tares = piece.baselines if self.pipeline.rest_.tared else ()
        self._unused_tares += len(piece.baselines) - len(tares)
        baselines = self._baselines.by_row(recording, rows, tares)
        if not len(rows):
            return ContactStates.assemble(len(recording), taxels, {})
        number = np.cumsum(recording.restarts)[rows]
        stream = number if recording.stream is None else recording.stream[rows]
        fresh = np.diff(stream, prepend=self._stream) != 0
        self._stream = int(stream[-1])
        failed = np.isin(rows, () if piece.contacts is None else piece.contacts.failed)
        cuts = fresh | np.isin(rows, list(baselines)) | failed
        cuts[1:] |= failed[:-1]
        cuts |= self._changes.cuts(recording, rows)
        edges = np.unique([0, *np.flatnonzero(cuts).tolist(), len(rows)]).tolist()
        parts: list[ContactStates] = []
        for first, last in pairwise(edges):
            row, until = int(rows[first]), int(rows[last - 1]) + 1
            if fresh[first]:
                self.pipeline.reset()
            if row in baselines:
                # also an equal one: a tare restarts memory
                self.pipeline.tare([baselines[row]])
            self._changes.before(recording, row)
            if failed[first]:
                parts.append(batch_of(self.pipeline.process(recording.frame(row), fails=True)))
            else:
                whole = until - row == last - first
                part = recording.select(slice(row, until) if whole else rows[first:last])
                parts.append(self.pipeline.process_next(part))
            self._changes.after(recording, until - 1)
        if len(parts) == 1 and len(rows) == len(recording):
            return parts[0]
        return gathered(parts, rows, len(recording), taxels)


def batch_of(state: ContactState) -> ContactStates:
    """Batch of one."""
    return ContactStates(**{name: np.asarray(getattr(state, name))[None] for name in STATE_FIELDS})


def gathered(
    parts: Sequence[ContactStates], rows: Integers, samples: int, taxels: int
) -> ContactStates:
    """States of some rows (n,), in parts, among all rows s."""
    joined = stack_columns([vars(part) for part in parts], [len(part) for part in parts])
    patches = joined['contacts_id'].shape[1]
    blank = ContactStates.assemble(samples, taxels, {})
    columns: Columns = {}
    for name in STATE_FIELDS:
        columns[name] = widened(name, np.array(getattr(blank, name)), patches)
        columns[name][rows] = joined[name]
    return ContactStates.assemble(samples, taxels, columns)


class BaselineQueue:
    """Baselines of a live run, each until the first frame that it holds for.

    A baseline belongs to the stream with a frame of its stamp; where none has one, to that of the
    baseline before it, or to the next where its sequence went back.
    """

    def __init__(self) -> None:
        self._waiting: list[tuple[int, Frame]] = []
        self._streams: dict[int, int] = {}  # of frames by their stamps
        self._stream: int | None = None
        self._previous = -1

    def by_row(
        self, recording: Recording, rows: Integers, baselines: Sequence[Frame]
    ) -> dict[int, Frame]:
        """Baselines by the processed row before which each comes in; more baselines join them."""
        if recording.sequence is None or not len(recording):
            return {}
        number = np.cumsum(recording.restarts) if recording.stream is None else recording.stream
        sequence, streams = recording.sequence[rows], number[rows]
        if recording.stamp_ns is not None:
            stamps = zip(recording.stamp_ns.tolist(), number.tolist(), strict=True)
            self._streams = dict([*self._streams.items(), *stamps][-REMEMBERED:])
        if self._stream is None:
            self._stream = int(number[0])
        for baseline in baselines:
            home = self._streams.get(baseline.stamp_ns or 0, -1)
            went_back = home < self._stream and baseline.sequence < self._previous
            self._stream = max(home, self._stream + went_back)
            self._previous = baseline.sequence
            self._waiting.append((self._stream, baseline))
        placed: dict[int, Frame] = {}
        waiting = []
        for stream, baseline in self._waiting:
            later = np.flatnonzero((streams == stream) & (sequence >= baseline.sequence))
            if len(later):
                placed[int(rows[later[0]])] = baseline
            elif not len(rows) or stream >= streams[-1]:
                waiting.append((stream, baseline))
        self._waiting = waiting
        return placed


class ClassChanges:
    """Classes that a pipeline learns and forgets again while frames of a live run are replayed."""

    def __init__(self, changes: Sequence[enrolment.ClassChange], pipeline: Pipeline) -> None:
        self.problems: list[str] = []
        self._pipeline = pipeline
        self._waiting = list(changes)
        self._firsts = {first for change in changes for first, _ in change.presses}
        self._baselines: dict[int, Array] = {}

    def cuts(self, recording: Recording, rows: Integers) -> Bools:
        """Rows before which something changes, or a press has just begun."""
        cuts = np.zeros(len(rows), bool)
        if not self._waiting or recording.stamp_ns is None:
            return cuts
        stamps = recording.stamp_ns[rows]
        cuts[1:] |= np.isin(stamps[:-1], list(self._firsts))
        first = 0
        for change in self._waiting:
            later = np.flatnonzero(stamps[first:] > change.last_ns)
            if len(later):
                first += int(later[0])
                cuts[first] = True
        return cuts

    def before(self, recording: Recording, row: int) -> None:
        """Let what changed before a frame hold for it."""
        stamp_ns = 0 if recording.stamp_ns is None else int(recording.stamp_ns[row])
        while self._waiting and self._waiting[0].last_ns < stamp_ns:
            change = self._waiting.pop(0)
            try:
                self._make(change, recording)
            except (ValueError, LookupError) as err:
                self.problems.append(f'{change.label!r} could not be learned or forgotten: {err}')

    def after(self, recording: Recording, row: int) -> None:
        """Keep the baseline with which a press began."""
        if recording.stamp_ns is not None and int(recording.stamp_ns[row]) in self._firsts:
            self._baselines[int(recording.stamp_ns[row])] = self._pipeline.baseline

    def _make(self, change: enrolment.ClassChange, recording: Recording) -> None:
        if not change.presses:
            self._pipeline.forget(change.label)
            return
        presses, stamps = [], recording.stamp_ns
        for first, last in change.presses:
            if stamps is None or first not in self._baselines or last not in stamps:
                msg = 'its presses are not in the recording'
                raise LookupError(msg)
            rows = np.flatnonzero((stamps >= first) & (stamps <= last)).tolist()
            frames = tuple(recording.frame(row) for row in rows)
            presses.append(enrolment.Press(frames, self._baselines[first]))
        support = enrolment.recording_of(self._pipeline.layout, presses)
        # what the live run allowed is not asked again
        everything = enrolment.EVERYTHING
        enrolment.learn(self._pipeline, change.label, support, change.replace, everything)


def presses_in(loaded: LoadedRecording, pipeline: Pipeline) -> list[enrolment.Press]:
    """Presses in the bag of a live run, identified as the live run does.

    The baseline of the pipeline, which tells contact, changes as the recording says. Raises
    RecordingError if there is no press, and frames could not be estimated.
    """
    recording = loaded.recording
    rows = np.arange(len(recording))
    baselines = BaselineQueue().by_row(recording, rows, loaded.baselines)
    ended: list[enrolment.Press | None] = []
    watch, failures = enrolment.PressWatch(enrolment.window_of(pipeline)), pipeline.failures
    for row, restart in zip(rows.tolist(), recording.restarts, strict=True):
        if restart:
            pipeline.reset()
            watch = enrolment.PressWatch(enrolment.window_of(pipeline))
        if row in baselines:
            pipeline.tare([baselines[row]])
        frame = recording.frame(row)
        state = pipeline.process(frame)
        ended.append(watch(frame, int(state.in_contact), pipeline.baseline))
    presses = [press for press in ended if press is not None]
    problems = failure_problems(pipeline, failures)
    if problems and not presses:
        raise RecordingError(' '.join(problems))
    return presses


def with_tare_rows(loaded: LoadedRecording) -> tuple[Recording, str]:
    """Mark the frames that the live run of a bag tared on as tare rows of its recording.

    They are the newest undamaged ones before each baseline. Returns the recording, the same where
    it has tare rows already, and a sentence about tares that do not serve; empty if all do.
    """
    recording = loaded.recording
    if recording.tare is not None or recording.stamp_ns is None or recording.sequence is None:
        return recording, ''
    rows = {stamp: row for row, stamp in enumerate(recording.stamp_ns.tolist())}
    # the first baseline of a stream is no tare: it comes with the frame that it holds for
    named = ((one, rows.get(one.stamp_ns or 0, -1)) for one in loaded.baselines if one.averaged)
    tares = [(one, row) for one, row in named if row < 0 or recording.sequence[row] < one.sequence]
    if not tares:
        return recording, ''
    sound = _undamaged(loaded)
    begins = np.flatnonzero(recording.restarts)
    rests = []
    for baseline, last in tares:
        first = int(begins[max(int(np.searchsorted(begins, last, 'right')) - 1, 0)])
        rest = first + np.flatnonzero(sound[first : last + 1])[-baseline.averaged :]
        far = np.flatnonzero(np.diff(rest) > BRIDGED + 1)  # of what lay before, nothing is known
        rest = rest[far[-1] + 1 :] if len(far) else rest
        rests += [rest] if len(rest) >= FEWEST else []
    kept = [rest for rest in rests if not _is_under_load(recording, rest)]
    tare = _as_rows(len(recording), kept)
    lost = len(tares) - len(rests)
    why = [f'{len(rests) - len(kept)} under load'] * (len(rests) > len(kept))
    why += [f'{lost} of frames that are not in the bag, or fewer than {FEWEST}'] * bool(lost)
    problem = f'{len(kept)} of {len(tares)} tares can be used; {" and ".join(why)}'
    touched = recording.truth.get('in_contact')
    if touched is not None and (touched == 0).any() and 0 < np.count_nonzero(tare) < ENOUGH:
        few = f'tares of fewer than {ENOUGH} frames in all are left out beside in_contact'
        return recording, f'{problem}; {few}' if why else few
    return (replace(recording, tare=tare) if tare.any() else recording), problem if why else ''


def _undamaged(loaded: LoadedRecording) -> Bools:
    recording, live = loaded.recording, loaded.contacts
    if live is None:
        faults = taxel_faults(recording.values, recording.status, recording.layout)
        return np.asarray(~((faults & UNUSABLE) != 0).any(axis=1))
    status, bits = live.states.status, live.states.taxel_status
    silent = ((bits & SAYS_NOTHING) != 0).all(axis=1)
    stale = (status & int(FrameStatus.STALE)) != 0
    sound = np.zeros(len(recording), bool)
    sound[live.rows] = ~(((status & DAMAGED) != 0) | (stale & silent))
    return sound


def _is_under_load(recording: Recording, rows: Integers) -> bool:
    """Rows that truth knows as touched: it says so, or the force is clearly not 0."""
    touched = recording.truth.get('in_contact')
    if touched is not None and (touched[rows] == 1).any():
        return True
    if 'force' not in recording.truth:
        return False
    force = np.nan_to_num(recording.truth['force'].astype(np.float64))
    size = np.linalg.norm(force, axis=1)
    # a load cell has an offset of its own
    force = force - np.median(force[size <= np.quantile(size, STILL)], axis=0)
    away = float(np.linalg.norm(force[rows].mean(axis=0)))
    sigma = float(np.linalg.norm(force[rows].std(axis=0))) / np.sqrt(len(rows))
    return bool(away > FIRM * np.linalg.norm(force, axis=1).max() + CLEAR * sigma)


def _as_rows(count: int, rests: Sequence[Integers]) -> Bools:
    """Rows (s,) of rests, and what lies between their frames; of two that meet the newer one."""
    tare, until = np.zeros(count, bool), count + 1
    for rest in sorted(rests, key=lambda rows: int(rows[-1]), reverse=True):
        if rest[-1] + 1 < until:
            until = int(rest[0])
            tare[until : rest[-1] + 1] = True
    return tare


def with_known_rests(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings of which all have tare rows if one has, where their truth knows the rests."""
    if all(r.tare is None for r in recordings):
        return [*recordings]
    return [
        replace(r, tare=np.asarray(r.truth['in_contact'] == 0))
        if r.tare is None and 'in_contact' in r.truth
        else r
        for r in recordings
    ]


def left_out(pipeline: Pipeline) -> str:
    """Sentence on rows that the fit could not use; empty if it used all."""
    counts = pipeline.report.get('left_out', {})
    said = '; '.join(f'{count:.0f} {what}' for what, count in counts.items())
    return said and f'left out: {said}'


def check_learned(pipeline: Pipeline, recordings: Sequence[Recording]) -> None:
    """Raise RecordingError, with what there was, where a fit learned nothing."""
    if not pipeline.calibrated:
        names = ', '.join(sorted({name for one in recordings for name in one.truth})) or 'nothing'
        msg = f'nothing can be learned from {sum(map(len, recordings))} rows: truth has {names}'
        raise RecordingError('; '.join(filter(None, (msg, left_out(pipeline)))))
