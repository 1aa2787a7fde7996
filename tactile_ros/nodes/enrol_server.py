"""The action `~/enrol` and the service `~/forget`: classes from presses while the node runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.action import ActionServer, CancelResponse, GoalResponse

from tactile_ros.action import Enrol
from tactile_ros.nodes.enrol_stage import EnrolStage, Learned, Lesson
from tactile_ros.srv import ForgetContact

if TYPE_CHECKING:
    from rclpy.action.server import ServerGoalHandle
    from rclpy.node import Node


class EnrolServer:
    """Serve enrolments of a node that has a stage for them while it is active.

    Parameters
    ----------
    node : Node
        Whose action and service they are.
    """

    def __init__(self, node: Node) -> None:
        self.stage: EnrolStage | None = None
        self._node = node
        self._handle: ServerGoalHandle | None = None
        self._learned = Learned(False, '')
        self._action = ActionServer(
            node, Enrol, '~/enrol',
            execute_callback=self._execute,
            goal_callback=self._on_goal,
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

    def _on_goal(self, goal: Enrol.Goal) -> GoalResponse:
        """Accept what can be done."""
        reason = 'enrol needs an active node: activate it first'
        if self.stage is not None:
            reason = self.stage.refusal(_lesson(goal))
        if reason:
            self._node.get_logger().error(f'enrol refused: {reason}')
        return GoalResponse.REJECT if reason else GoalResponse.ACCEPT

    def _on_accepted(self, handle: ServerGoalHandle) -> None:
        """Begin; the goal is executed once its result is known, since awaiting it polls."""
        self._handle = handle
        assert self.stage is not None
        self.stage.begin(_lesson(handle.request), self._tell, self._end)

    def _on_cancel(self, _: ServerGoalHandle) -> CancelResponse:
        """End the lesson."""
        if self.stage is not None:
            self.stage.cancel()
        return CancelResponse.ACCEPT

    def _tell(self, presses: int, message: str) -> None:
        """Say how it goes."""
        if self._handle is not None:
            self._handle.publish_feedback(Enrol.Feedback(presses=presses, message=message))

    def _end(self, learned: Learned) -> None:
        """Let the executor answer."""
        self._learned = learned
        if self._handle is not None:
            self._handle.execute()

    def _execute(self, handle: ServerGoalHandle) -> Enrol.Result:
        """The result, which is there."""
        learned = self._learned
        if handle.is_cancel_requested and learned.cancelled:
            handle.canceled()
        elif learned.success:
            handle.succeed()
        else:
            handle.abort()
        return Enrol.Result(success=learned.success, message=learned.message, index=learned.index)

    def _on_forget(
        self, request: ForgetContact.Request, response: ForgetContact.Response
    ) -> ForgetContact.Response:
        """Undo an enrolment."""
        if self.stage is None:
            response.message = 'forget needs an active node: activate it first'
            return response
        response.success, response.message = self.stage.forget(request.label)
        return response


def _lesson(goal: Enrol.Goal) -> Lesson:
    """What a goal asks for."""
    return Lesson(goal.label, goal.presses or 1, goal.timeout, goal.replace)
