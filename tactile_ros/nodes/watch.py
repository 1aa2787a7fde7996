"""What a viewer hears: layouts, frames, contacts and grip states of namespaces, by topics."""

from __future__ import annotations

import time
from collections import OrderedDict
from functools import partial
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tactile_ros import messages
from tactile_ros.msg import GripState, TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.lifecycle import data, latched, shut_down
from tactile_ros.types import ContactState

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Frame, Layout

    Show = Callable[[str, Layout, Frame, ContactState], None]
    ShowGrip = Callable[[str, GripState, int], None]

WAITING = 100  # frames that wait for their contacts, or contacts for their frame
LOOK_S = 0.1


class WatchNode(Node):
    """Pair frames with the contacts that name them, and hand both on.

    Parameters
    ----------
    namespaces : sequence of str
        One for each sensor.
    show, grip : callable
        Take (namespace, layout, frame, state), and (namespace, message, stamp in ns).
    """

    def __init__(self, namespaces: Sequence[str], show: Show, grip: ShowGrip) -> None:
        super().__init__('tactile_view')
        self._show, self._grip = show, grip
        self._layouts: dict[str, Layout] = {}
        self._waiting: dict[str, OrderedDict[int, dict[type, object]]] = {}
        for name in namespaces:
            self._waiting[name] = OrderedDict()
            heard = (
                (TactileLayout, 'layout', self._layout, latched()),
                (TactileFrame, 'frame', self._half, data()),
                (TactileContacts, 'contacts', self._half, data()),
                (GripState, 'grip_node/state', self._state, data()),
            )
            for kind, topic, call, quality in heard:
                path = f'{name}/{topic}' if name else topic
                self.create_subscription(kind, path, partial(call, name), quality)

    def _layout(self, name: str, message: TactileLayout) -> None:
        self._layouts[name] = messages.read_layout(message)

    def _half(self, name: str, message: TactileFrame | TactileContacts) -> None:
        """A frame or its contacts, whichever comes first waits for the other."""
        waiting = self._waiting[name]
        halves = waiting.setdefault(message.sequence, {})
        halves[type(message)] = message
        if len(halves) == 2:
            del waiting[message.sequence]
            self._both(name, halves[TactileFrame], halves[TactileContacts])
        while len(waiting) > WAITING:
            waiting.popitem(last=False)

    def _both(self, name: str, frame: TactileFrame, contacts: TactileContacts) -> None:
        """Show them; without a layout nothing has a place yet."""
        layout = self._layouts.get(name)
        if layout is None:
            return
        arrays = messages.read_contacts([contacts], len(layout.positions))
        known = {k: v for k, v in arrays.items() if k in ContactState.__dataclass_fields__}
        state = ContactState.assemble(len(layout.positions), known)
        self._show(name, layout, messages.read_frame(frame, layout.shape), state)

    def _state(self, name: str, message: GripState) -> None:
        self._grip(name, message, messages.stamp_ns(message.header))


def watch(namespaces: Sequence[str], show: Show, grip: ShowGrip, seconds: float | None) -> None:
    """Listen until Ctrl-C, or for so many seconds."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = WatchNode(namespaces, show, grip)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    end = float('inf') if seconds is None else time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=LOOK_S)
    finally:
        node.destroy_node()
        shut_down()
