"""player: a recording through a board's own bytes into a running graph, with its truth beside it.

Opens a simulated serial port, waits until the driver reads it, then sends row after row. Before
each touch it streams the resting reading and calls the tare, as a hand does before it closes.
Every step waits for what the graph shows (frames, contacts, the answer of the service), never for
a time: the same recording gives the same numbers at every speed.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from tactile_ros import messages
from tactile_ros.devices.player import Player
from tactile_ros.devices.reskin_protocol import encode, readings, words
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.errors import DeviceError, DeviceTimeout, TactileError
from tactile_ros.evaluation.recording_files import load_recording
from tactile_ros.msg import TactileContact, TactileContacts, TactileFrame
from tactile_ros.nodes.graph import SIMULATED_PORT, private_folder
from tactile_ros.nodes.lifecycle import ManagedNode, data, main_of, pairs
from tactile_ros.nodes.parameters import NodeOptions
from tactile_ros.sensors import load_sensor
from tactile_ros.types import STATE_FIELDS, ContactStates

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rclpy.client import Client
    from rclpy.subscription import Subscription

    from tactile_ros.types import Array, Bools, ContactStates, Frame, Recording

WARM_ROWS = 4
# T; makes every warm-up row another one, far below the noise of a chip
WARM_STEP = 1e-7
RETRY_S = 1.0
LOST_S = 2.0
MOST_LOST = 5


class Stopped(TactileError):
    """Playing was told to stop."""


@dataclass(frozen=True)
class Score:
    """What is played and how.

    Attributes
    ----------
    recording : Recording
        Rows, tare rows, truth.
    port : str
        Path at which the simulated port appears.
    speed_up : float
        Recorded time over played time.
    rate_hz : float
        Of rows that have no stamps (Hz).
    window : int
        Rows on their way at most.
    patience_s : float
        Longest wait for the graph (s).
    """

    recording: Recording
    port: str
    speed_up: float = 1.0
    rate_hz: float = 400.0
    window: int = 16
    patience_s: float = 30.0


@dataclass
class Tally:
    """How it went.

    Attributes
    ----------
    rows, lost : int
        Played; not come back.
    seconds, recorded_s : float
        Time of playing, and of the recording (s).
    tares, refused : int
        Tares done and refused.
    refusal : str
        Why the last one was refused.
    """

    rows: int = 0
    lost: int = 0
    seconds: float = 0.0
    recorded_s: float = 0.0
    tares: int = 0
    refused: int = 0
    refusal: str = ''

    def __str__(self) -> str:
        """One line."""
        faster = self.recorded_s / self.seconds if self.seconds else 0.0
        speed = f', {faster:.3g} times the recorded speed' if faster else ''
        return (
            f'played {self.rows} rows in {self.seconds:.2f} s{speed}; {self.lost} lost; '
            f'{self.tares} tares done, {self.refused} refused'
        )


def truth_states(recording: Recording) -> ContactStates:
    """Truth of every row as states: tare rows are untouched, what is not told is unknown."""
    known = {name: x for name, x in recording.truth.items() if name in STATE_FIELDS}
    if recording.tare is not None:
        told = known.get('in_contact', np.full(len(recording), -1, np.int64)).astype(np.int64)
        known['in_contact'] = np.where(recording.tare & (told < 0), 0, told)
    return ContactStates.assemble(len(recording), recording.layout.shape[0], known)


def runs(tare: Bools) -> list[tuple[int, int, bool]]:
    """First and last row (excluded) of the runs of resting and of other rows, in their order."""
    edges = np.flatnonzero(np.diff(tare.astype(np.int8))) + 1
    bounds = [0, *edges.tolist(), len(tare)]
    return [(a, b, bool(tare[a])) for a, b in pairwise(bounds) if a < b]


def as_received(data: bytes) -> Array:
    """Values of one frame's bytes, shape (t, 3), as the driver reads them."""
    values: Array = readings(words(np.frombuffer(data, np.uint8)[None]))[0][0]
    return values


def _unread(port: SimulatedSerialPort) -> str:
    """Why nothing can be played yet; empty where a driver has opened the port."""
    try:
        port.wait_for_reader(0.1)
    except DeviceTimeout:
        return 'nobody opens the simulated port: is sensor_node there?'
    return ''


@dataclass
class WatchedPort:
    """A port that notes every row in the ledger and keeps few of them on their way."""

    port: SimulatedSerialPort
    ledger: Ledger
    window: int
    stopped: Callable[[], bool]
    rows: Iterator[int] = field(default_factory=lambda: iter(()))

    def send(self, data: bytes) -> None:
        """Send one row once there is room for it."""
        oldest = self.ledger.sent - self.window
        if not self.ledger.wait(oldest, LOST_S, self.stopped):
            if self.stopped():
                raise Stopped
            self.ledger.give_up()
        self.ledger.send(next(self.rows), as_received(data))
        self.port.send(data)


class Performance:
    """Play a score in a thread of its own until its end or until stopped.

    Parameters
    ----------
    score : Score
        What is played.
    ledger : Ledger
        Told by the listener which frames came back.
    tare : callable or None
        Takes a tare within some seconds and returns whether it was done and the answer; called
        after every run of resting rows. None: rests are streamed, and nothing else.
    missing : callable
        What the graph still lacks before the start, in words; empty: nothing.
    """

    def __init__(
        self,
        score: Score,
        ledger: Ledger,
        tare: Callable[[float], tuple[bool, str]] | None,
        missing: Callable[[], str],
    ) -> None:
        self.tally = Tally()
        self._score = score
        self._ledger = ledger
        self._tare = tare
        self._missing = missing
        self._stop = threading.Event()
        self._lost_in_a_row = 0

    def stop(self) -> None:
        """End playing soon."""
        self._stop.set()
        self._ledger.wake()

    def is_stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stop.is_set()

    def play(self, loop: bool, on_end: Callable[[Tally], None]) -> None:
        """Offer the port, wait for the graph, warm up, play; again and again where `loop`.

        Raises
        ------
        DeviceError
            If the graph does not answer, with what is missing.
        Stopped
            If it was told to stop.
        """
        score = self._score
        link = Path(score.port)
        with SimulatedSerialPort() as port:
            link.parent.mkdir(parents=True, exist_ok=True)
            link.unlink(missing_ok=True)
            link.symlink_to(port.port)
            try:
                self._await(lambda: _unread(port))
                self._await(self._missing)
                self._warm_up(port)
                watched = WatchedPort(port, self._ledger, score.window, self.is_stopped)
                player = Player(watched, score.speed_up, 1.0 / score.rate_hz)
                self._once(player, watched, on_end)
                while loop:
                    self._once(player, watched, on_end)
            finally:
                link.unlink(missing_ok=True)

    def _await(self, missing: Callable[[], str]) -> None:
        """Wait until nothing is missing."""
        deadline = time.monotonic() + self._score.patience_s
        while missing():
            if self._stop.wait(0.02):
                raise Stopped
            if time.monotonic() > deadline:
                raise DeviceError(missing())

    def _warm_up(self, port: SimulatedSerialPort) -> None:
        """Send resting rows, all different, until the last comes back: the driver locked on."""
        tare = self._score.recording.tare
        first = 0 if tare is None or not tare.any() else int(np.argmax(tare))
        row = self._score.recording.values[first].copy()
        deadline = time.monotonic() + self._score.patience_s
        while True:
            for _ in range(WARM_ROWS):
                row[0, 0] += WARM_STEP
                data = encode(row)
                self._ledger.send(-1, as_received(data))
                port.send(data)
            if self._ledger.wait(self._ledger.sent - 1, RETRY_S, self.is_stopped):
                break
            if self.is_stopped():
                raise Stopped
            if time.monotonic() > deadline:
                msg = f'no frame came back from {self._score.port}: are all nodes active?'
                raise DeviceError(msg)
        self._ledger.lost = 0

    def _once(self, player: Player, watched: WatchedPort, on_end: Callable[[Tally], None]) -> None:
        """The whole recording, run by run."""
        recording = self._score.recording
        begin = time.monotonic()
        tare = np.zeros(len(recording), bool) if recording.tare is None else recording.tare
        for first, last, resting in runs(tare):
            watched.rows = iter(range(first, last))
            stamps = None if recording.stamp_ns is None else recording.stamp_ns[first:last]
            player.play(recording.values[first:last], stamps)
            if resting and self._tare is not None:
                self._settle()
                self._take_tare(self._tare)
        self._settle()
        self.tally.rows += len(recording)
        self.tally.lost = self._ledger.lost
        self.tally.seconds += time.monotonic() - begin
        if recording.stamp_ns is not None:
            self.tally.recorded_s += float(np.maximum(np.diff(recording.stamp_ns), 0).sum()) * 1e-9
        on_end(self.tally)

    def _settle(self) -> None:
        """Wait until everything sent went through."""
        if self._ledger.wait(self._ledger.sent - 1, LOST_S, self.is_stopped):
            self._lost_in_a_row = 0
            return
        if self.is_stopped():
            raise Stopped
        self._ledger.give_up()
        self._lost_in_a_row += 1
        if self._lost_in_a_row >= MOST_LOST:
            msg = f'{MOST_LOST} readings in a row did not come back: is the graph alive?'
            raise DeviceError(msg)

    def _take_tare(self, tare: Callable[[float], tuple[bool, str]]) -> None:
        """Take the tare and count the answer."""
        done, message = tare(self._score.patience_s)
        if self.is_stopped():
            raise Stopped
        if done:
            self.tally.tares += 1
        else:
            self.tally.refused += 1
            self.tally.refusal = message


class Ledger:
    """Rows on their way through a graph; safe to use from the sender and the listener.

    Attributes
    ----------
    sent : int
        Rows sent so far; the position of a row is its place among them.
    lost : int
        Rows that were overtaken by a later one, or given up.
    """

    def __init__(self) -> None:
        self.sent = 0
        self.lost = 0
        self._waiting: deque[tuple[int, int, Array]] = deque()
        self._sequences: dict[int, int] = {}
        self._settled = -1
        self._acknowledged = -1
        self._changed = threading.Condition()

    def send(self, row: int, values: Array) -> None:
        """Note that a row goes out; `values`, shape (t, c), as the receiver will read them."""
        with self._changed:
            self._waiting.append((self.sent, row, values))
            self.sent += 1

    def match(self, frame: Frame) -> int | None:
        """Row of a frame that came back; rows before it are lost, a stranger is None."""
        with self._changed:
            for steps, (position, row, values) in enumerate(self._waiting):
                if np.array_equal(values, frame.values, equal_nan=True):
                    for _ in range(steps + 1):
                        self._waiting.popleft()
                    self.lost += steps
                    self._settled = position
                    self._sequences[position] = frame.sequence
                    self._changed.notify_all()
                    return row
        return None

    def acknowledge(self, sequence: int) -> None:
        """All frames up to a sequence have gone through."""
        with self._changed:
            self._acknowledged = max(self._acknowledged, sequence)
            self._changed.notify_all()

    def is_through(self, position: int) -> bool:
        """Whether the row at a position, and so all before it, went through or is lost."""
        reached = self._sequences.get(position, -1)
        return self._settled >= position and self._acknowledged >= reached

    def wait(self, position: int, timeout: float, stopped: Callable[[], bool]) -> bool:
        """Wait until a row is through; False when `timeout` (s) is over or work was stopped."""
        with self._changed:
            return (
                self._changed.wait_for(lambda: stopped() or self.is_through(position), timeout)
                and not stopped()
            )

    def give_up(self) -> int:
        """Count all rows on their way as lost; return how many they were."""
        with self._changed:
            count = len(self._waiting)
            self.lost += count
            self._waiting.clear()
            self._settled = self.sent - 1
            self._acknowledged = max([self._acknowledged, *self._sequences.values()])
            return count

    def wake(self) -> None:
        """Let whoever waits look whether it shall stop."""
        with self._changed:
            self._changed.notify_all()


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
