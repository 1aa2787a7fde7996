"""Classes learned and forgotten beside a running stream, without ROS.

A thread of its own judges presses and writes the calibration, so that no frame waits for it. It
works on the calibration as the file has it; once that is written, the stream goes on with the same
estimators. Whatever fails before leaves both as they were.
"""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tactile_ros.enrolment import Allowed, PressWatch, learn, recording_of, refuse_name, window_of
from tactile_ros.errors import CalibrationError, TactileError

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.enrolment import Press
    from tactile_ros.nodes.contact_stage import ContactStage
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import ContactState, Frame

MOST_PRESSES = 100
LONGEST_S = 86_400
CLOSED = 'contact_node was deactivated'
TRIED = ' '  # under which a press is tried: no class can be named so


@dataclass(frozen=True)
class Lesson:
    """What is to be learned; see Enrol.action.

    Attributes
    ----------
    label : str
        Name of the class.
    presses : int
        How many are collected.
    timeout_s : float
        Until all of them are there (s).
    replace : bool
        Forget what is known under that name.
    """

    label: str
    presses: int = 1
    timeout_s: float = 60.0
    replace: bool = False


@dataclass(frozen=True)
class Learned:
    """How it ended.

    Attributes
    ----------
    success, message, index : bool, str, int
        As in the result of Enrol.action.
    cancelled : bool
        Whoever asked withdrew.
    """

    success: bool
    message: str
    index: int = -1
    cancelled: bool = False


@dataclass(frozen=True)
class Change:
    """A class that came or went, as it is announced.

    Attributes
    ----------
    label, digest : str
        Its name; SHA-256 of the calibration file since.
    after_ns : int or None
        Stamp of the last frame before (ns); None: there was none.
    presses : tuple of tuple of int
        Stamps of the first and last frame of each press (ns); empty: the class was forgotten.
    replace : bool
        What was known under the name was forgotten first.
    """

    label: str
    digest: str
    after_ns: int | None
    presses: tuple[tuple[int, int], ...] = ()
    replace: bool = False

    def told(self) -> dict[str, object]:
        """As plain values."""
        if not self.presses:
            return {'forgotten': self.label, 'after_ns': self.after_ns}
        return {
            'enrolled': self.label,
            'after_ns': self.after_ns,
            'presses': [list(stamps) for stamps in self.presses],
            'replace': self.replace,
        }


@dataclass
class EnrolStage:
    """One lesson at a time.

    Attributes
    ----------
    stage : ContactStage
        Of the stream.
    path : str
        Calibration file; empty: there is none.
    load : callable
        Pipeline from that file.
    digest : str
        Of the file's pipeline.
    on_change : callable
        Takes a class that came or went, once it holds.
    allowed : Allowed
        What a new class may cost.
    """

    stage: ContactStage
    path: str
    load: Callable[[str], Pipeline]
    digest: str
    on_change: Callable[[Change], None]
    allowed: Allowed = field(default_factory=Allowed)
    _thread: threading.Thread | None = None
    _busy: bool = False
    _watch: PressWatch | None = None
    _arrived: queue.SimpleQueue[Press | None] = field(default_factory=queue.SimpleQueue)
    _withdrawn: str | None = None
    _kept: bool = False  # too late to withdraw
    _closed: bool = False
    _turn: threading.Lock = field(default_factory=threading.Lock)
    _fate: threading.Lock = field(default_factory=threading.Lock)

    @property
    def is_busy(self) -> bool:
        """A lesson is under way."""
        return self._busy

    def refusal(self, lesson: Lesson) -> str:
        """Why a lesson cannot be; empty: it can."""
        try:
            window_of(self.stage.pipeline)
            refuse_name(lesson.label)
        except ValueError as err:
            return str(err)
        presses, timeout_s = lesson.presses, lesson.timeout_s
        reasons = (
            (not self.path, 'enrol needs a calibration file to keep it in: set calibration'),
            (self.is_busy, 'another class is being enrolled: wait for it, or cancel it'),
            (not 1 <= presses <= MOST_PRESSES,
             f'presses of enrol must be 1 to {MOST_PRESSES}; received {presses}'),
            (not 0 < timeout_s <= LONGEST_S,
             f'timeout of enrol must be above 0, at most {LONGEST_S} s; received {timeout_s:g}'),
        )  # fmt: skip
        return next((sentence for holds, sentence in reasons if holds), '')

    def begin(
        self,
        lesson: Lesson,
        on_press: Callable[[int, str], None],
        on_end: Callable[[Learned], None],
    ) -> None:
        """Collect presses from the next rest on.

        Parameters
        ----------
        lesson : Lesson
            That `refusal` has nothing against.
        on_press : callable
            Takes how many presses there are and a sentence, in a thread of its own.
        on_end : callable
            Takes how it ended, in that thread.
        """
        self._busy, self._withdrawn, self._kept = True, None, False
        self._arrived = queue.SimpleQueue()
        self._watch = PressWatch(window_of(self.stage.pipeline))
        self.stage.watch = self._take

        def work() -> None:
            try:
                learned = self._collect(lesson, on_press)
            except Exception as err:  # whoever asked must hear the end
                learned = Learned(False, _sentence(err))
            self.stage.watch = None
            with self._fate:
                self._busy = False
            on_end(learned)

        self._thread = threading.Thread(target=work, name='enrol', daemon=True)
        self._thread.start()

    def _take(self, frame: Frame, state: ContactState) -> None:
        """A frame of the stream; runs in its thread."""
        assert self._watch is not None
        press = self._watch(frame, int(state.in_contact), self.stage.pipeline.baseline)
        if press is not None:
            self._arrived.put(press)

    def cancel(self, reason: str = '') -> bool:
        """End the lesson, and whether it could be: not while its class is written, nor after.

        A reason says that nobody asked for it.
        """
        with self._fate:
            if not self._busy or self._kept:
                return False
            if self._withdrawn is None:
                self._withdrawn = reason
        self._arrived.put(None)
        return True

    def close(self) -> None:
        """End the lesson and its thread, and let a change that is under way come to its end."""
        if self._thread is not None:
            self.cancel(CLOSED)
            self._thread.join()
        with self._turn:
            self._closed = True

    def _collect(self, lesson: Lesson, on_press: Callable[[int, str], None]) -> Learned:
        """Presses, one after the other, and the class once there are enough."""
        end = time.monotonic() + lesson.timeout_s
        trial = self._read()
        presses: list[Press] = []
        refused = ''
        while len(presses) < lesson.presses:
            try:
                press = self._arrived.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                return Learned(False, self._too_late(lesson, presses, refused))
            if press is None:
                return self._given_up()
            refused = self._fault(trial, press)
            if not refused:
                presses.append(press)
            said = refused or f'press {len(presses)} of {lesson.presses} taken'
            on_press(len(presses), said)
        return self._learn(lesson, presses)

    def _given_up(self) -> Learned:
        """Withdrawn by whoever asked, or for a reason."""
        return Learned(False, self._withdrawn or 'cancelled', cancelled=not self._withdrawn)

    @staticmethod
    def _too_late(lesson: Lesson, presses: list[Press], refused: str) -> str:
        """Why there are too few presses."""
        said = (
            f'{len(presses)} of {lesson.presses} presses of {lesson.label!r} came within '
            f'{lesson.timeout_s:g} s'
        )
        return f'{said}; the last one was refused: {refused}' if refused else said

    @staticmethod
    def _fault(trial: Pipeline, press: Press) -> str:
        """Why a press is of no use; empty: it is."""
        try:
            trial.enrol(recording_of(trial.layout, [press]), TRIED)
        except ValueError as err:
            return str(err).replace(f'of {TRIED!r} ', '')
        trial.forget(TRIED)
        return ''

    def _learn(self, lesson: Lesson, presses: list[Press]) -> Learned:
        """The class into the file, then into the stream."""
        with self._turn:
            pipeline = self._read()
            taught = recording_of(pipeline.layout, presses)
            said = learn(pipeline, lesson.label, taught, lesson.replace, self.allowed)
            with self._fate:
                self._kept = self._withdrawn is None
            if not self._kept:
                return self._given_up()
            index = pipeline.label_names.index(lesson.label)
            stamps = tuple(
                (int(p.frames[0].stamp_ns or 0), int(p.frames[-1].stamp_ns or 0)) for p in presses
            )
            self._adopt(pipeline, lesson.label, stamps, lesson.replace)
        return Learned(True, f'{said}; label {index}, kept in {self.path}', index)

    def forget(self, label: str) -> tuple[bool, str]:
        """Undo an enrolment in the file and in the stream.

        Returns
        -------
        done : bool
            Whether it was undone.
        message : str
            What was done, or why not.
        """
        if not self.path:
            return False, 'forget needs a calibration file: set calibration'
        try:
            with self._turn:
                if self._closed:
                    return False, CLOSED
                pipeline = self._read()
                pipeline.forget(label)
                self._adopt(pipeline, label)
        except Exception as err:  # whoever asked must hear the end
            return False, _sentence(err)
        return True, f'{label!r} forgotten; classes are {", ".join(pipeline.label_names)}'

    def _read(self) -> Pipeline:
        """The calibration of the stream, as the file has it.

        Raises
        ------
        CalibrationError
            If the file cannot be read, or is another one by now.
        """
        pipeline = self.load(self.path)
        if pipeline.digest != self.digest:
            msg = f'calibration {self.path} changed since it was read: configure the node again'
            raise CalibrationError(msg)
        return pipeline

    def _adopt(
        self,
        pipeline: Pipeline,
        label: str,
        stamps: tuple[tuple[int, int], ...] = (),
        replace: bool = False,
    ) -> None:
        """Write the file, then let the stream go on with it and tell."""
        pipeline.save(self.path)
        self.digest = pipeline.digest
        after_ns = self.stage.adopt(pipeline.estimation)
        self.on_change(Change(label, self.digest, after_ns, stamps, replace))


def _sentence(err: Exception) -> str:
    """Why something failed; what nobody foresaw also by its kind."""
    foreseen = isinstance(err, (TactileError, ValueError, OSError))
    return str(err) if foreseen else f'{type(err).__name__}: {err}'
