"""Enrolment of classes while a stream runs: the work, the action and service, and their client.

A thread of its own judges presses and writes the calibration, so that no frame waits for it. It
works on the calibration as the file has it; once that is written, the stream goes on with the same
estimators. A failure before leaves both as they were.
"""

from __future__ import annotations

import queue
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import rclpy
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from tactile_ros.action import Enrol
from tactile_ros.enrolment import Allowed, PressWatch, learn, recording_of, refuse_name, window_of
from tactile_ros.errors import CalibrationError, TactileError
from tactile_ros.msg import TactileContacts
from tactile_ros.nodes.lifecycle import data
from tactile_ros.srv import ForgetContact

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.action.server import ServerGoalHandle

    from tactile_ros.enrolment import Press
    from tactile_ros.nodes.contact_loop import ContactStage
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


INACTIVE = 'needs an active node: activate it first'


class EnrolServer:
    """Serve enrolments of a node that has a stage for them while it is active.

    A goal that cannot be is accepted and aborted at once: only a result can say why.

    Parameters
    ----------
    node : Node
        Whose action and service they are.
    """

    def __init__(self, node: Node) -> None:
        self.stage: EnrolStage | None = None
        self._node = node
        self._learned: dict[bytes, Learned] = {}
        self._taught = b''
        self._action = ActionServer(
            node, Enrol, '~/enrol',
            execute_callback=self._execute,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )  # fmt: skip
        self._service = node.create_service(ForgetContact, '~/forget', self._on_forget)

    def close(self) -> None:
        """End a lesson that is under way; nothing is served until there is a stage again."""
        stage, self.stage = self.stage, None
        if stage is not None:
            stage.close()

    def destroy(self) -> None:
        """End the action."""
        self._action.destroy()

    def _on_accepted(self, handle: ServerGoalHandle) -> None:
        """Begin; the goal is executed once its result is known, since awaiting one polls."""
        goal = handle.request
        lesson = Lesson(goal.label, goal.presses or 1, goal.timeout, goal.replace)
        reason = f'enrol {INACTIVE}' if self.stage is None else self.stage.refusal(lesson)
        if reason or self.stage is None:
            self._end(handle, Learned(False, reason))
            return
        self._taught = bytes(handle.goal_id.uuid)
        self.stage.begin(lesson, partial(_tell, handle), partial(self._end, handle))

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        """End the lesson, unless its class is being written or is known."""
        mine = self.stage is not None and bytes(handle.goal_id.uuid) == self._taught
        ended = mine and self.stage.cancel()
        return CancelResponse.ACCEPT if ended else CancelResponse.REJECT

    def _end(self, handle: ServerGoalHandle, learned: Learned) -> None:
        """Let the executor answer."""
        self._learned[bytes(handle.goal_id.uuid)] = learned
        handle.execute()

    def _execute(self, handle: ServerGoalHandle) -> Enrol.Result:
        """The result, which is there."""
        learned = self._learned.pop(bytes(handle.goal_id.uuid))
        if learned.success:
            handle.succeed()
        elif learned.cancelled:
            handle.canceled()
        else:
            handle.abort()
        return Enrol.Result(success=learned.success, message=learned.message, index=learned.index)

    async def _on_forget(
        self, request: ForgetContact.Request, response: ForgetContact.Response
    ) -> ForgetContact.Response:
        """Undo an enrolment in a thread of its own, since reading and writing take a while."""
        stage = self.stage
        if stage is None:
            response.message = f'forget {INACTIVE}'
            return response
        done = Future(executor=self._node.executor)
        threading.Thread(
            target=lambda: done.set_result(stage.forget(request.label)), name='forget'
        ).start()
        response.success, response.message = await done
        return response


def _tell(handle: ServerGoalHandle, presses: int, message: str) -> None:
    """Say how it goes."""
    handle.publish_feedback(Enrol.Feedback(presses=presses, message=message))


SERVER = 'contact_node'
PATIENCE_S = 10.0
ANSWER_S = 30.0


class EnrolClient:
    """Calls of one contact_node, each of which waits for its answer.

    Parameters
    ----------
    namespace : str
        Of the sensor.
    """

    def __init__(self, namespace: str = '') -> None:
        self.node = Node('tactile_enrol', namespace=namespace)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._action = ActionClient(self.node, Enrol, f'{SERVER}/enrol')
        self._service = self.node.create_client(ForgetContact, f'{SERVER}/forget')

    def close(self) -> None:
        """End the node."""
        self._action.destroy()
        self.executor.shutdown()
        self.node.destroy_node()

    def enrol(self, lesson: Lesson, hear: Callable[[int, str], None]) -> Learned:
        """Ask for a class and wait for the end; an interrupt cancels it.

        Parameters
        ----------
        lesson : Lesson
            What is to be learned.
        hear : callable
            Takes the count of presses and a sentence after each.

        Raises
        ------
        TactileError
            If nobody answers.
        """
        self.wait_for_enrol()
        goal = Enrol.Goal(
            label=lesson.label,
            presses=lesson.presses,
            timeout=float(lesson.timeout_s),
            replace=lesson.replace,
        )
        handle = self._answer(
            self._action.send_goal_async(
                goal, lambda m: hear(m.feedback.presses, m.feedback.message)
            ),
            ANSWER_S,
        )
        ended = handle.get_result_async()
        try:
            result = self._answer(ended, lesson.timeout_s + ANSWER_S).result
        except KeyboardInterrupt:
            self._answer(handle.cancel_goal_async(), ANSWER_S)
            result = self._answer(ended, ANSWER_S).result
        return Learned(result.success, result.message, result.index)

    def wait_for_enrol(self) -> None:
        """Wait until a node offers to learn; TactileError if none does."""
        self._require(self._action.wait_for_server(PATIENCE_S), 'enrol')

    def forget(self, label: str) -> tuple[bool, str]:
        """Undo an enrolment; whether it was, and a sentence."""
        self._require(self._service.wait_for_service(PATIENCE_S), 'forget')
        found = self._answer(
            self._service.call_async(ForgetContact.Request(label=label)), ANSWER_S
        )
        return found.success, found.message

    def wait_for_truth(self, holds: Callable[[TactileContacts], bool], timeout: float) -> None:
        """Wait until what a twin says to be true is so.

        Raises
        ------
        TactileError
            If it is not within `timeout` (s).
        """
        seen = rclpy.task.Future()

        def look(message: TactileContacts) -> None:
            if holds(message) and not seen.done():
                seen.set_result(True)

        heard = self.node.create_subscription(TactileContacts, 'truth/contacts', look, data())
        try:
            self._answer(seen, timeout)
        finally:
            self.node.destroy_subscription(heard)

    def _require(self, found: bool, what: str) -> None:
        """Refuse to wait for nobody."""
        if not found:
            place = self.node.get_namespace()
            msg = f'no {SERVER} in {place} offers {what}: is it running, of a sensor with classes?'
            raise TactileError(msg)

    def _answer(self, future: Future, timeout: float) -> object:
        """Result of a call."""
        self.executor.spin_until_future_complete(future, timeout)
        if not future.done():
            msg = f'{SERVER} did not answer within {timeout:g} s'
            raise TactileError(msg)
        return future.result()


@contextmanager
def enrolling(namespace: str = '') -> Iterator[EnrolClient]:
    """Client with a ROS of its own, which ends with it."""
    rclpy.init()
    client = EnrolClient(namespace)
    try:
        yield client
    finally:
        client.close()
        rclpy.try_shutdown()
