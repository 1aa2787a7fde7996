"""stack: sensor_node and contact_node in one process, a direct call between them.

One loop reads, estimates and publishes; the executor's thread serves services and parameters
only. Names of nodes, topics, services and parameters are those of the two processes.
"""

from __future__ import annotations

import gc
import sys
from typing import TYPE_CHECKING

from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.lifecycle import ManagedNode, main_of
from tactile_ros.nodes.sensor_node import SensorNode

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Frame

# s; at the default of 5 ms a busy thread delays the loop by tens of milliseconds
SWITCH_INTERVAL_S = 2e-4
WARM_FRAMES = 100


def frozen_after(
    take: Callable[[Frame, str], None], frames: int = WARM_FRAMES
) -> Callable[[Frame, str], None]:
    """Hand frames on and, once warm, keep the garbage collector off all that stays."""
    count = 0

    def step(frame: Frame, frame_id: str) -> None:
        nonlocal count
        take(frame, frame_id)
        count += 1
        if count == frames:
            gc.collect()
            gc.freeze()

    return step


def build() -> Sequence[ManagedNode]:
    """Contact first: it is ready before the first frame."""
    contact = ContactNode(direct=True)
    return [contact, SensorNode(frozen_after(contact.take), contact.is_heard)]


def main() -> None:
    """Run the stack until it is told to stop."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    main_of(build)


if __name__ == '__main__':
    main()
