# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The action `~/grasp`: one goal at a time, a newer one takes its place."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from rclpy.action import ActionServer, CancelResponse, GoalResponse

from tactile_ros.action import Grasp
from tactile_ros.control import GraspOutcome

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.action.server import ServerGoalHandle
    from rclpy.node import Node

    from tactile_ros.nodes.grip_loop import Decision


LAST_TURNS = 5
FEEDBACK_S = 0.02  # the least between two


class GraspServer:
    """Serve grasps; all but `note` runs in the thread of the executor.

    `refuse` says why a goal cannot be (empty: it can); `begin` takes an accepted goal, which a
    ValueError ends at once; `cancel` is called when the client cancels.
    """

    def __init__(
        self,
        node: Node,
        refuse: Callable[[Grasp.Goal], str],
        begin: Callable[[Grasp.Goal], None],
        cancel: Callable[[], None],
    ) -> None:
        self._node = node
        self._refuse, self._begin, self._cancel = refuse, begin, cancel
        self._handle: ServerGoalHandle | None = None
        self._ends: dict[bytes, tuple[str, Grasp.Result]] = {}
        self._force: list[float] = []
        self._newest: Decision | None = None
        self._last: Decision | None = None
        self._fed_s = -math.inf
        self._server = ActionServer(
            node, Grasp, '~/grasp',
            execute_callback=self._execute,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    @property
    def is_busy(self) -> bool:
        """A grasp is under way."""
        return self._handle is not None

    def close(self) -> None:
        """End a grasp that is under way, then the action."""
        self.finish(GraspOutcome.FAULT, 'grip_node ended')
        executor = self._node.executor
        for _ in range(LAST_TURNS if executor is not None else 0):
            if self._ends:  # a client still waits for its result
                executor.spin_once(timeout_sec=0.0)
        self._server.destroy()

    def _on_goal(self, goal: Grasp.Goal) -> GoalResponse:
        """Accept what can be done."""
        reason = self._refuse(goal)
        if reason:
            self._node.get_logger().error(f'grasp refused: {reason}')
        return GoalResponse.REJECT if reason else GoalResponse.ACCEPT

    def _on_accepted(self, handle: ServerGoalHandle) -> None:
        """Take the place of the grasp before."""
        self.finish(GraspOutcome.FAULT, 'a newer grasp took its place')
        self._handle = handle
        self._force, self._fed_s = [], -math.inf
        try:
            self._begin(handle.request)
        except ValueError as err:
            self.finish(GraspOutcome.FAULT, str(err))

    def _execute(self, handle: ServerGoalHandle) -> Grasp.Result:
        """Hand the result over."""
        state, result = self._ends.pop(bytes(handle.goal_id.uuid))
        getattr(handle, state)()
        return result

    def forget(self) -> None:
        """Drop decisions, which belong to the grasp before."""
        self._newest = self._last = None

    def note(self, decision: Decision) -> None:
        """Keep what a step decided, from whatever thread; the end of a grasp stays."""
        self._newest = decision
        if decision.ended is not None:
            self._last = decision

    def tell(self) -> None:
        """Tell the client how it goes, and the end; in the thread of the executor."""
        decision, self._newest = self._last or self._newest, None
        now_s = time.monotonic()
        if self._handle is None or decision is None:
            return
        made = decision.made
        self._force = made.force.tolist()
        if decision.ended is not None:
            self.finish(decision.ended.outcome, decision.ended.message)
        elif self._handle.is_cancel_requested:
            self._cancel()
            self.finish(GraspOutcome.FAULT, 'cancelled', 'canceled')
        elif now_s - self._fed_s >= FEEDBACK_S:
            self._fed_s = now_s
            margins = [x for x in made.slip_margin.tolist() if math.isfinite(x)]
            feedback = Grasp.Feedback(phase=int(made.phase), force=self._force)
            feedback.slip_margin = min(margins, default=math.nan)
            self._handle.publish_feedback(feedback)

    def finish(self, outcome: GraspOutcome, message: str, state: str = '') -> None:
        """End the grasp that is under way, if there is one."""
        handle, self._handle = self._handle, None
        if handle is None:
            return
        closes = handle.request.target_force or handle.request.forces
        wanted = GraspOutcome.HELD if closes else GraspOutcome.NO_OBJECT
        ending = state or ('succeed' if outcome == wanted else 'abort')
        result = Grasp.Result(outcome=int(outcome), message=message, force=self._force)
        self._ends[bytes(handle.goal_id.uuid)] = ending, result
        # only now: executors ask a coroutine that waits again and again, at the price of a core
        handle.execute()
