# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Enrolment of classes while a stream runs: the work, its action and service, and their client.

A thread of its own judges presses and writes the calibration, as the file has it. Once that is
written, the stream goes on with the same estimators; a failure before leaves both as they were.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import rclpy
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from tactile_ros.action import Enrol
from tactile_ros.enrolment import (
    Allowed,
    ClassChange,
    Press,
    PressWatch,
    learn,
    recording_of,
    refuse_name,
    window_of,
)
from tactile_ros.errors import CalibrationError, TactileError
from tactile_ros.msg import TactileContacts
from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.pipeline import Pipeline
from tactile_ros.srv import ForgetContact
from tactile_ros.types import Closing, ContactState, Frame
from tactile_ros.types.config_fields import admit, number, switch, text_of, whole

CLOSED = 'contact_node was deactivated'
CANCELLED = 'cancelled'
CANDIDATE = ' '  # under which a press is tried: no class can be named so
INACTIVE = 'needs an active node: activate it first'
SERVER = 'contact_node'
PATIENCE_S = 10.0
ANSWER_S = 30.0


@dataclass(frozen=True)
class EnrolRequest:
    """Class to enrol; ValueError for what cannot be whatever the stream."""

    label: str = text_of('', 'name of the class')
    presses: int = whole(1, 'presses that teach it', 1, 100)
    timeout_s: float = number(60.0, 'time until all presses are there', 's', 1e-3, 86_400)
    replace: bool = switch(False, 'forget an earlier class of that name first')

    def __post_init__(self) -> None:
        admit(self)
        refuse_name(self.label)


def refusal(message: str) -> Enrol.Result:
    """Result without a class, and why there is none."""
    return Enrol.Result(message=message, index=-1)


class Enrolment:
    """Enrolments beside the loop of a stream, one at a time.

    `load` reads the pipeline of the calibration file `path` (empty: there is none) of SHA-256
    `digest`; `on_change` takes a class that came or went; one may cost no more than `allowed`.
    """

    def __init__(
        self,
        loop: ContactLoop,
        path: str,
        load: Callable[[str], Pipeline],
        digest: str,
        on_change: Callable[[ClassChange], None],
        allowed: Allowed | None = None,
    ) -> None:
        self._loop, self._path, self._load = loop, path, load
        self._digest, self._on_change, self._allowed = digest, on_change, allowed or Allowed()
        self._thread: threading.Thread | None = None
        self._arrived: queue.SimpleQueue[Press | None] = queue.SimpleQueue()
        self._busy = self._kept = self._closed = False  # kept: too late to withdraw
        self._withdrawn = ''  # why
        self._file_lock, self._state_lock = threading.Lock(), threading.Lock()

    def check(self) -> None:
        """Refuse by a ValueError where nothing can be enrolled now."""
        window_of(self._loop.pipeline)
        if not self._path:
            msg = 'enrol needs a calibration file to keep it in: set calibration'
            raise ValueError(msg)
        if self._busy:
            msg = 'another class is being enrolled: wait for it, or cancel it'
            raise ValueError(msg)

    def begin(
        self,
        request: EnrolRequest,
        on_press: Callable[[int, str], None],
        on_end: Callable[[Enrol.Result], None],
    ) -> None:
        """Collect presses from the next rest on, for a request that `check` lets pass.

        `on_press` takes how many presses there are and a sentence, `on_end` how it ended, both in
        a thread of its own.
        """
        self._busy, self._withdrawn, self._kept = True, '', False
        arrived = self._arrived = queue.SimpleQueue()
        detect = PressWatch(window_of(self._loop.pipeline))

        def observe(frame: Frame, state: ContactState) -> None:
            press = detect(frame, int(state.in_contact), self._loop.pipeline.baseline)
            if press is not None:
                arrived.put(press)

        def work() -> None:
            try:
                result = self._learn(request, self._collect(request, on_press))
            except Exception as err:  # whoever asked must hear the end
                result = refusal(_sentence(err))
            self._loop.observe(None)
            with self._state_lock:
                self._busy = False
            on_end(result)

        self._loop.observe(observe)
        self._thread = threading.Thread(target=work, name='enrol', daemon=True)
        self._thread.start()

    def cancel(self, reason: str = CANCELLED) -> bool:
        """End the enrolment; False where its class is being written, or is."""
        with self._state_lock:
            if not self._busy or self._kept:
                return False
            self._withdrawn = self._withdrawn or reason
        self._arrived.put(None)
        return True

    def close(self) -> None:
        """End an enrolment and its thread, and let a change under way come to its end."""
        if self._thread is not None:
            self.cancel(CLOSED)
            self._thread.join()
        with self._file_lock:
            self._closed = True

    def _collect(self, request: EnrolRequest, on_press: Callable[[int, str], None]) -> list[Press]:
        """Presses that are of use, one after the other, until there are enough."""
        end = time.monotonic() + request.timeout_s
        trial = self._read()
        presses: list[Press] = []
        refused = ''
        while len(presses) < request.presses:
            try:
                press = self._arrived.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                msg = (
                    f'{len(presses)} of {request.presses} presses of {request.label!r} came '
                    f'within {request.timeout_s:g} s'
                    + (f'; the last one was refused: {refused}' if refused else '')
                )
                raise TactileError(msg) from None
            if press is None:
                raise TactileError(self._withdrawn)
            refused = _fault(trial, press)
            if not refused:
                presses.append(press)
            on_press(len(presses), refused or f'press {len(presses)} of {request.presses} taken')
        return presses

    def _learn(self, request: EnrolRequest, presses: list[Press]) -> Enrol.Result:
        """Enrol the class into the file, then into the stream."""
        with self._file_lock:
            pipeline = self._read()
            support = recording_of(pipeline.layout, presses)
            said = learn(pipeline, request.label, support, request.replace, self._allowed)
            with self._state_lock:
                self._kept = not self._withdrawn
            if not self._kept:
                raise TactileError(self._withdrawn)
            index = pipeline.label_names.index(request.label)
            stamps = [
                (press.frames[0].stamp_ns or 0, press.frames[-1].stamp_ns or 0)
                for press in presses
            ]
            self._adopt(pipeline, request.label, stamps, request.replace)
        said = f'{said}; label {index}, kept in {self._path}'
        return Enrol.Result(success=True, message=said, index=index)

    def forget(self, label: str) -> tuple[bool, str]:
        """Undo an enrolment in the file and in the stream: True and a sentence, or why not."""
        if not self._path:
            return False, 'forget needs a calibration file: set calibration'
        try:
            with self._file_lock:
                if self._closed:
                    return False, CLOSED
                pipeline = self._read()
                pipeline.forget(label)
                self._adopt(pipeline, label)
        except Exception as err:  # whoever asked must hear the end
            return False, _sentence(err)
        return True, f'{label!r} forgotten; classes are {", ".join(pipeline.label_names)}'

    def _read(self) -> Pipeline:
        """Read the stream's calibration; CalibrationError if the file is another one by now."""
        pipeline = self._load(self._path)
        if pipeline.digest != self._digest:
            msg = f'calibration {self._path} changed since it was read: configure the node again'
            raise CalibrationError(msg)
        return pipeline

    def _adopt(
        self,
        pipeline: Pipeline,
        label: str,
        stamps: Sequence[tuple[int, int]] = (),
        replace: bool = False,
    ) -> None:
        pipeline.save(self._path)
        self._digest = pipeline.digest
        after_ns = self._loop.adopt(pipeline.estimation)
        self._on_change(ClassChange(label, self._digest, after_ns, tuple(stamps), replace))


def _fault(trial: Pipeline, press: Press) -> str:
    """Fault of a press that is of no use; empty: it is of use."""
    try:
        trial.enrol(recording_of(trial.layout, [press]), CANDIDATE)
    except ValueError as err:
        return str(err).replace(f'of {CANDIDATE!r} ', '')
    trial.forget(CANDIDATE)
    return ''


def _sentence(err: Exception) -> str:
    foreseen = isinstance(err, (TactileError, ValueError, OSError))
    return str(err) if foreseen else f'{type(err).__name__}: {err}'


class EnrolmentServer:
    """Action `~/enrol` and service `~/forget` of a node, served while there is an `enrolment`.

    A goal that cannot be is accepted and aborted at once: only a result can say why.
    """

    def __init__(self, node: Node) -> None:
        self.enrolment: Enrolment | None = None
        self._node = node
        self._current: ServerGoalHandle | None = None
        self._action = ActionServer(
            node, Enrol, '~/enrol',
            execute_callback=lambda _: None,  # each goal brings its own
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )  # fmt: skip
        self._service = node.create_service(ForgetContact, '~/forget', self._on_forget)
        self.destroy = self._action.destroy

    def close(self) -> None:
        """End an enrolment under way; nothing is served until there is another one."""
        enrolment, self.enrolment = self.enrolment, None
        if enrolment is not None:
            enrolment.close()

    def _on_accepted(self, handle: ServerGoalHandle) -> None:
        """Begin; the goal is executed once its result is known, since awaiting one polls."""
        goal, enrolment = handle.request, self.enrolment
        end = partial(self._end, handle)
        if enrolment is None:
            end(refusal(f'enrol {INACTIVE}'))
            return
        try:
            request = EnrolRequest(goal.label, goal.presses or 1, goal.timeout, goal.replace)
            enrolment.check()
        except ValueError as err:
            end(refusal(str(err)))
            return
        self._current = handle

        def on_press(presses: int, message: str) -> None:
            handle.publish_feedback(Enrol.Feedback(presses=presses, message=message))

        enrolment.begin(request, on_press, end)

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        """End the enrolment, unless its class is being written or is known."""
        current = self.enrolment is not None and handle is self._current
        ended = current and self.enrolment.cancel()
        return CancelResponse.ACCEPT if ended else CancelResponse.REJECT

    def _end(self, handle: ServerGoalHandle, result: Enrol.Result) -> None:

        def answer(_: ServerGoalHandle) -> Enrol.Result:
            finish = handle.canceled if result.message == CANCELLED else handle.abort
            (handle.succeed if result.success else finish)()
            return result

        handle.execute(answer)

    async def _on_forget(
        self, request: ForgetContact.Request, response: ForgetContact.Response
    ) -> ForgetContact.Response:
        """Undo an enrolment in a thread of its own, since it reads and writes."""
        enrolment = self.enrolment
        if enrolment is None:
            response.message = f'forget {INACTIVE}'
            return response
        done = Future(executor=self._node.executor)
        threading.Thread(
            target=lambda: done.set_result(enrolment.forget(request.label)), name='forget'
        ).start()
        response.success, response.message = await done
        return response


class EnrolmentClient(Closing):
    """Calls of one contact_node, each of which waits for its answer; starts ROS where need be."""

    def __init__(self, namespace: str = '') -> None:
        self._starts_ros = not rclpy.ok()
        if self._starts_ros:
            rclpy.init()
        self._node = Node('tactile_enrol', namespace=namespace)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._action = ActionClient(self._node, Enrol, f'{SERVER}/enrol')
        self._service = self._node.create_client(ForgetContact, f'{SERVER}/forget')

    def close(self) -> None:
        """End the node, and ROS where it was started."""
        self._action.destroy()
        self._executor.shutdown()
        self._node.destroy_node()
        if self._starts_ros:
            rclpy.try_shutdown()

    def enrol(self, request: EnrolRequest, hear: Callable[[int, str], None]) -> Enrol.Result:
        """Ask for a class and wait for the end; an interrupt cancels it.

        `hear` takes the count of presses and a sentence after each. TactileError: nobody answers.
        """
        self.wait_for_enrol()
        goal = Enrol.Goal(label=request.label, presses=request.presses, replace=request.replace)
        goal.timeout = float(request.timeout_s)
        sent = self._action.send_goal_async(
            goal, lambda m: hear(m.feedback.presses, m.feedback.message)
        )
        handle = self._answer(sent, ANSWER_S)
        ended = handle.get_result_async()
        try:
            return self._answer(ended, request.timeout_s + ANSWER_S).result
        except KeyboardInterrupt:
            self._answer(handle.cancel_goal_async(), ANSWER_S)
            return self._answer(ended, ANSWER_S).result

    def wait_for_enrol(self) -> None:
        """Wait until a node offers to learn; TactileError if none does."""
        self._require(self._action.wait_for_server(PATIENCE_S), 'enrol')

    def forget(self, label: str) -> tuple[bool, str]:
        """Undo an enrolment: True and a sentence, or why not."""
        self._require(self._service.wait_for_service(PATIENCE_S), 'forget')
        request = ForgetContact.Request(label=label)
        answer = self._answer(self._service.call_async(request), ANSWER_S)
        return answer.success, answer.message

    def wait_for_truth(self, holds: Callable[[TactileContacts], bool], timeout: float) -> None:
        """Wait until the truth of a twin is so; TactileError if not within `timeout` (s)."""
        seen = Future()

        def check(message: TactileContacts) -> None:
            if holds(message) and not seen.done():
                seen.set_result(True)

        truth = self._node.create_subscription(TactileContacts, 'truth/contacts', check, qos())
        try:
            self._answer(seen, timeout)
        finally:
            self._node.destroy_subscription(truth)

    def _require(self, is_there: bool, service: str) -> None:
        if not is_there:
            msg = (
                f'no {SERVER} in {self._node.get_namespace()} offers {service}: is it running, of '
                'a sensor with classes?'
            )
            raise TactileError(msg)

    def _answer(self, future: Future, timeout: float) -> object:
        self._executor.spin_until_future_complete(future, timeout)
        if not future.done():
            msg = f'{SERVER} did not answer within {timeout:g} s'
            raise TactileError(msg)
        return future.result()
