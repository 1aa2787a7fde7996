"""A node that asks contact_node for a class, and hears how it goes."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import rclpy
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from tactile_ros.action import Enrol
from tactile_ros.errors import TactileError
from tactile_ros.msg import TactileContacts
from tactile_ros.nodes.enrol_stage import Learned, Lesson
from tactile_ros.nodes.quality import data
from tactile_ros.srv import ForgetContact

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.task import Future

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
