# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Node of a viewer: layouts, frames with their contacts, and grip states of namespaces."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import partial

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from std_srvs.srv import Trigger

from tactile_ros import messages
from tactile_ros.msg import GripState, TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.types import STATE_FIELDS, ContactState, Frame, Layout

Show = Callable[[str, Layout, Frame, ContactState], None]
ShowGrip = Callable[[str, GripState, int], None]
TOPICS = {
    'layout': TactileLayout, 'frame': TactileFrame, 'contacts': TactileContacts,
    'grip_node/state': GripState,
}  # fmt: skip
WAITING = 100  # frames that wait for their contacts, or contacts for their frame
LOOK_S, FIND_S = 0.1, 1.0
TARE_S = 5.0  # longest wait for the answer of a tare


class ViewerNode(Node):
    """Pair frames with the contacts that name them, and hand both on, per namespace.

    Without namespaces it listens to every sensor and grip that runs, or comes later.
    `show` takes (namespace, layout, frame, state), `show_grip` (namespace, message, stamp in ns).
    """

    def __init__(self, namespaces: Sequence[str], show: Show, show_grip: ShowGrip) -> None:
        if not rclpy.ok():
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        super().__init__('tactile_view')
        self._show, self._show_grip = show, show_grip
        self._layouts: dict[str, Layout] = {}
        self._waiting: dict[str, OrderedDict[int, dict[type, object]]] = {}
        for name in namespaces:
            self._listen(name)
        if not namespaces:
            self.create_timer(FIND_S, self._find)

    def _listen(self, name: str) -> None:
        self._waiting[name] = OrderedDict()
        special = {TactileLayout: self._on_layout, GripState: self._on_grip}
        for topic, kind in TOPICS.items():
            take, path = partial(special.get(kind, self._on_half), name), f'{name}/{topic}'
            self.create_subscription(kind, path.lstrip('/'), take, qos(topic, WAITING))

    def _find(self) -> None:
        for path, (kind, *_) in self.get_topic_names_and_types():
            for end in ('/layout', '/grip_node/state') if 'tactile_ros' in kind else ():
                if path.endswith(end) and (name := path[1 : -len(end)]) not in self._waiting:
                    self._listen(name)

    def tare(self, name: str) -> str:
        """Answer of contact_node of a namespace to a tare, in words; from another thread."""
        service = f'{name}/contact_node/tare'.lstrip('/')
        client = self.create_client(Trigger, service)
        try:
            if not client.wait_for_service(TARE_S):
                return f'nobody answers at {service}'
            answered, answer = threading.Event(), client.call_async(Trigger.Request())
            answer.add_done_callback(lambda _: answered.set())
            if not answered.wait(TARE_S):
                return f'{service} did not answer within {TARE_S:g} s'
            return str(answer.result().message)
        finally:
            self.destroy_client(client)

    def _on_layout(self, name: str, message: TactileLayout) -> None:
        self._layouts[name] = messages.read_layout(message)

    def _on_half(self, name: str, message: TactileFrame | TactileContacts) -> None:
        """A frame or its contacts; whichever comes first waits for the other."""
        waiting, layout = self._waiting[name], self._layouts.get(name)
        halves = waiting.setdefault(message.sequence, {})
        halves[type(message)] = message
        if len(halves) == 2:
            del waiting[message.sequence]
            if layout is not None:  # without one nothing has a place yet
                taxels = len(layout.positions)
                columns = messages.read_contacts([halves[TactileContacts]], taxels)
                columns = {name: x for name, x in columns.items() if name in STATE_FIELDS}
                frame = messages.read_frame(halves[TactileFrame], layout.shape)
                self._show(name, layout, frame, ContactState.assemble(taxels, columns))
        while len(waiting) > WAITING:
            waiting.popitem(last=False)

    def _on_grip(self, name: str, message: GripState) -> None:
        self._show_grip(name, message, messages.stamp_ns(message.header))

    def run(self, seconds: float | None) -> None:
        """Listen until Ctrl-C, or for so many seconds, and end."""
        executor = SingleThreadedExecutor()
        executor.add_node(self)
        end = float('inf') if seconds is None else time.monotonic() + seconds
        try:
            while time.monotonic() < end:
                executor.spin_once(timeout_sec=LOOK_S)
        finally:
            self.destroy_node()
            try_shutdown()
