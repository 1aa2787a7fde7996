"""Messages that wait behind the one that a subscription has just handed over."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.subscription import Subscription

Message = TypeVar('Message')

MOST_TOGETHER = 64


def backlog(subscription: Subscription, kind: type[Message]) -> Iterator[Message]:
    """Take what has come already, so that a node that is late catches up.

    Executors are not told; they find nothing to take then, which they allow for.
    """
    handle = subscription.handle
    with handle:
        for _ in range(MOST_TOGETHER):
            taken = handle.take_message(kind, False)
            if taken is None:
                return
            yield taken[0]
