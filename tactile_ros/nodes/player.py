"""player: a recording through a board's own bytes into a running graph, with its truth beside it.

Opens a simulated serial port, waits until the driver reads it, then sends row after row. Before
each touch it streams the resting reading and calls the tare, as a hand does before it closes.
Every step waits for what the graph shows (frames, contacts, the answer of the service), never for
a time: the same recording gives the same numbers at every speed.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from tactile_ros import messages
from tactile_ros.errors import TactileError
from tactile_ros.evaluation.archive import load_recording
from tactile_ros.msg import TactileContact, TactileContacts, TactileFrame
from tactile_ros.nodes.graph import SIMULATED_PORT, private_folder
from tactile_ros.nodes.ledger import Ledger
from tactile_ros.nodes.lifecycle import ManagedNode, main_of, pairs
from tactile_ros.nodes.node_options import NodeOptions
from tactile_ros.nodes.performance import Performance, Score, Stopped, Tally, truth_states
from tactile_ros.nodes.quality import data
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.client import Client
    from rclpy.subscription import Subscription

    from tactile_ros.types import ContactStates, Recording


@dataclass(frozen=True)
class PlayerOptions(NodeOptions):
    """Parameters of player."""

    recording: str = field(
        default='', metadata={'help': 'a recording (.npz), or the name of one that is shipped'}
    )
    sensor: str = field(
        default='reskin_board',
        metadata={'help': 'key of the sensor whose recordings are shipped', 'read_only': True},
    )
    port: str = field(
        default='',
        metadata={'help': 'where the simulated port appears; empty: a private place, logged'},
    )
    speed_up: float = field(
        default=1.0,
        metadata={'help': 'recorded time over played time', 'range': (1e-3, float('inf'))},
    )
    rate_hz: float = field(
        default=400.0,
        metadata={'help': 'rows without stamps', 'unit': 'Hz', 'range': (0.1, 1e9)},
    )
    window: int = field(
        default=16, metadata={'help': 'rows on their way at most', 'range': (1, 40)}
    )
    loop: bool = field(default=False, metadata={'help': 'begin again at the end'})
    tare: bool = field(default=True, metadata={'help': 'call the tare after resting rows'})
    tare_service: str = field(
        default='contact_node/tare', metadata={'help': 'name of the service'}
    )
    wait_for: str = field(
        default='contacts',
        metadata={'help': 'what says that a row is through', 'choices': ('contacts', 'frame')},
    )
    listeners: int = field(
        default=0,
        metadata={'help': 'subscriptions to truth/contacts before the start', 'range': (0, 100)},
    )
    patience_s: float = field(
        default=30.0,
        metadata={'help': 'longest wait for the graph', 'unit': 's', 'range': (0.1, 1e6)},
    )


class PlayerNode(ManagedNode):
    """Play a recording into a port; publish `truth/contacts` for the frames that come back."""

    def __init__(self) -> None:
        super().__init__('player')
        self.declare(PlayerOptions())
        self._truth = self.managed_publisher(TactileContacts, 'truth/contacts', data())
        self._options = PlayerOptions()
        self._recording: Recording | None = None
        self._states: ContactStates | None = None
        self._client: Client | None = None
        self._performance: Performance | None = None
        self._thread: threading.Thread | None = None
        self._heard: list[Subscription] = []
        self._ledger = Ledger()

    def configure(self) -> None:
        """Load the recording."""
        self._options = self.options(PlayerOptions)
        name = self._options.recording
        shipped = load_sensor(self._options.sensor).recordings()
        if not name:
            msg = f'recording must be a file (.npz) or one of {", ".join(shipped)}; none was given'
            raise ValueError(msg)
        self._recording = shipped[name] if name in shipped else load_recording(name)
        self._states = truth_states(self._recording)
        if self._options.tare:
            self._client = self.create_client(Trigger, self._options.tare_service)

    def activate(self) -> None:
        """Listen to what comes back, and play in a thread."""
        options = self._options
        self._ledger = Ledger()
        self._heard = [self.create_subscription(TactileFrame, 'frame', self._on_frame, data())]
        if options.wait_for == 'contacts':
            self._heard.append(
                self.create_subscription(TactileContacts, 'contacts', self._on_contacts, data())
            )
        port = options.port or str(private_folder() / SIMULATED_PORT)
        self.get_logger().info(f'the board appears at {port}')
        score = Score(
            self._recording, port, options.speed_up, options.rate_hz, options.window,
            options.patience_s,
        )  # fmt: skip
        tare = self._take_tare if options.tare else None
        self._performance = Performance(score, self._ledger, tare, self._missing)
        self._thread = threading.Thread(target=self._play, name='player', daemon=True)
        self._thread.start()

    def deactivate(self) -> None:
        """Stop playing."""
        self._performance.stop()
        self._thread.join()
        for subscription in self._heard:
            self.destroy_subscription(subscription)
        self._heard = []

    def cleanup(self) -> None:
        """Let the recording go."""
        self._recording = self._states = None

    def _on_frame(self, message: TactileFrame) -> None:
        """Find the row of a frame and publish its truth under the frame's name."""
        frame = messages.read_frame(message, self._recording.layout.shape)
        row = self._ledger.match(frame)
        if self._options.wait_for == 'frame':
            self._ledger.acknowledge(frame.sequence)
        if row is None or row < 0 or not self._truth.get_subscription_count():
            return
        truth = TactileContacts()
        messages.fill_contacts(truth, self._states[row], TactileContact)
        truth.header = message.header
        truth.sequence = message.sequence
        for name in ('session', 'repetition'):
            if name in self._recording.truth:
                setattr(truth, name, int(self._recording.truth[name][row]))
        self._truth.publish(truth)

    def _on_contacts(self, message: TactileContacts) -> None:
        """A frame has gone through."""
        self._ledger.acknowledge(message.sequence)

    def _missing(self) -> str:
        """What the graph lacks."""
        if self._truth.get_subscription_count() < self._options.listeners:
            return f'truth/contacts has fewer than {self._options.listeners} listeners'
        if self._client is not None and not self._client.service_is_ready():
            return f'service {self._client.srv_name} does not appear: is contact_node there?'
        return ''

    def _take_tare(self, timeout: float) -> tuple[bool, str]:
        """Call the service from the player's thread; the executor's thread hears the answer."""
        answered = threading.Event()
        future = self._client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: answered.set())
        waited = 0.0
        while not answered.wait(0.1):
            waited += 0.1
            if self._performance.is_stopped() or waited > timeout:
                return False, f'service {self._client.srv_name} does not answer'
        answer = future.result()
        return answer.success, answer.message

    def _play(self) -> None:
        """Play, and say how it went."""
        try:
            self._performance.play(self._options.loop, self._tell)
        except Stopped:
            return
        except (TactileError, OSError) as err:
            self.get_logger().error(str(err))
            self.exit_code = 1
        self.finished.set()

    def _tell(self, tally: Tally) -> None:
        """One line on what was played, one on what was refused."""
        self.get_logger().info(str(tally))
        if tally.refused:
            self.get_logger().warning(f'the last refusal: {tally.refusal}')

    def diagnose(self) -> DiagnosticStatus:
        """Rows sent and lost."""
        status = DiagnosticStatus(name='player', message=f'{self._ledger.sent} rows sent')
        status.values = pairs({'sent': self._ledger.sent, 'lost': self._ledger.lost})
        return status


def build() -> Sequence[ManagedNode]:
    """The node of this executable."""
    return [PlayerNode()]


def main() -> None:
    """Play until the end, or until told to stop."""
    main_of(build)


if __name__ == '__main__':
    main()
