"""The action `~/enrol` and the service `~/forget`: classes from presses while the node runs."""

from __future__ import annotations

import threading
from functools import partial
from typing import TYPE_CHECKING

from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future

from tactile_ros.action import Enrol
from tactile_ros.nodes.enrol_stage import EnrolStage, Learned, Lesson
from tactile_ros.srv import ForgetContact

if TYPE_CHECKING:
    from rclpy.action.server import ServerGoalHandle
    from rclpy.node import Node

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
