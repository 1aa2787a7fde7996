# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""player: a recording through a board's own bytes into a running graph, with its truth beside it.

Before each touch it streams the resting reading and calls the tare, as a hand does before it
closes. Every step waits for what the graph shows (frames, contacts, the answer of the service),
never for a time: the same recording gives the same numbers at every speed.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.client import Client
from rclpy.duration import Duration
from std_srvs.srv import Trigger

from tactile_ros import messages
from tactile_ros.devices.reskin_protocol import encode, readings, words
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.errors import DeviceError, DeviceTimeout, TactileError
from tactile_ros.evaluation.recording_files import load_recording
from tactile_ros.msg import TactileContacts, TactileFrame
from tactile_ros.nodes.graph import SIMULATED_PORT, private_folder
from tactile_ros.nodes.lifecycle import ManagedNode, diagnostic
from tactile_ros.nodes.parameters import PlayerOptions
from tactile_ros.nodes.standard_messages import TruthMessages
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array, Bools, Frame, Recording

WARM_UP_ROWS = 4
WARM_UP_STEP = 1e-7  # T; makes every row another one, far below the noise of a chip
RETRY_S = 1.0
TARE = 'contact_node/tare'
LOST_S = 2.0
MOST_LOST = 5
ACKNOWLEDGED_S = 5.0  # a listener may discover a publisher with its next announcement, after 3 s


class Stopped(TactileError):
    """Request to stop playing."""


class FrameMatcher:
    """Match frames that come back to the rows that were sent, by order and content, not by time.

    Of the `sent` rows the first `through` came back and were acknowledged, or are lost; `lost`
    rows were overtaken by a later one, or given up. Two threads may use it.
    """

    def __init__(self) -> None:
        self.sent = self.lost = self.through = 0
        self.is_stopped = False
        self._waiting: deque[tuple[int, Array]] = deque()
        self._returned: deque[tuple[int, int]] = deque()  # sequence, rows sent up to it
        self._acknowledged = -1
        self._changed = threading.Condition()

    def send(self, row: int, values: Array) -> None:
        """Note that a row goes out; `values`, shape (t, c), as the receiver will read them."""
        with self._changed:
            self._waiting.append((row, values))
            self.sent += 1

    def match(self, frame: Frame) -> int | None:
        """Row of a frame that came back; rows before it are lost, a stranger is None."""
        with self._changed:
            for steps, (row, values) in enumerate(self._waiting):
                if np.array_equal(values, frame.values, equal_nan=True):
                    for _ in range(steps + 1):
                        self._waiting.popleft()
                    self.lost += steps
                    self._returned.append((frame.sequence, self.sent - len(self._waiting)))
                    self._advance()
                    return row
        return None

    def acknowledge(self, sequence: int) -> None:
        """Note that all frames up to a sequence have gone through."""
        with self._changed:
            self._acknowledged = max(self._acknowledged, sequence)
            self._advance()

    def _advance(self) -> None:
        while self._returned and self._returned[0][0] <= self._acknowledged:
            self.through = self._returned.popleft()[1]
        self._changed.notify_all()

    def wait(self, count: int, timeout: float) -> bool:
        """Wait until so many rows are through; False after `timeout` (s), Stopped by `stop`."""
        with self._changed:
            self._changed.wait_for(lambda: self.is_stopped or self.through >= count, timeout)
            if self.is_stopped:
                raise Stopped
            return self.through >= count

    def give_up(self) -> None:
        """Count all rows on their way as lost."""
        with self._changed:
            self.lost += len(self._waiting)
            self._waiting.clear()
            self._returned.clear()
            self.through = self.sent

    def stop(self) -> None:
        """End the waiting for rows."""
        with self._changed:
            self.is_stopped = True
            self._changed.notify_all()


@dataclass
class PlaybackCounts:
    """Rows played and lost, time of playing and of the recording (s), tares done and refused."""

    rows: int = 0
    lost: int = 0
    seconds: float = 0.0
    recorded_s: float = 0.0
    tares: int = 0
    refused: int = 0
    refusal: str = ''

    def __str__(self) -> str:
        faster = self.recorded_s / self.seconds if self.seconds else 0.0
        speed = f', {faster:.3g} times the recorded speed' if faster else ''
        return (
            f'played {self.rows} rows in {self.seconds:.2f} s{speed}; {self.lost} lost; '
            f'{self.tares} tares done, {self.refused} refused'
        )


def runs(tare: Bools) -> list[tuple[int, int, bool]]:
    """First and last row (excluded) of the runs of resting and of other rows, in their order."""
    edges = np.flatnonzero(np.diff(tare.astype(np.int8))) + 1
    bounds = [0, *edges.tolist(), len(tare)]
    return [(a, b, bool(tare[a])) for a, b in pairwise(bounds) if a < b]


def as_received(data: bytes) -> Array:
    """Values of one frame's bytes, shape (t, 3), as the driver reads them."""
    values: Array = readings(words(np.frombuffer(data, np.uint8)[None]))[0][0]
    return values


class Playback:
    """Play a recording without ROS until its end or the matcher's stop.

    `tare` takes a tare within some seconds and returns whether it was done and the answer, after
    every run of resting rows (None: none is asked for). `missing` says what the graph still lacks.
    """

    def __init__(
        self,
        recording: Recording,
        options: PlayerOptions,
        matcher: FrameMatcher,
        tare: Callable[[float], tuple[bool, str]] | None,
        missing: Callable[[], str],
    ) -> None:
        self.counts = PlaybackCounts()
        self._recording, self._options, self._matcher = recording, options, matcher
        count = len(recording)
        self._resting = np.zeros(count, bool) if recording.tare is None else recording.tare
        self._tare, self._missing = tare, missing
        self._lost_in_a_row = 0
        self._due_s = 0.0

    def play(self, on_end: Callable[[PlaybackCounts], None]) -> None:
        """Offer the port, wait for the graph, warm up, play; again and again where `loop`.

        Raises DeviceError if the graph does not answer, with what is missing.
        """
        link = Path(self._options.port)
        with SimulatedSerialPort() as port:
            self._port = port
            link.parent.mkdir(parents=True, exist_ok=True)
            link.unlink(missing_ok=True)
            link.symlink_to(port.port)
            try:
                self._await(self._unread)
                self._await(self._missing)
                self._warm_up()
                self._play_once(on_end)
                while self._options.loop:
                    self._play_once(on_end)
            finally:
                link.unlink(missing_ok=True)

    def _unread(self) -> str:
        try:
            self._port.wait_for_reader(0.1)
        except DeviceTimeout:
            return 'nobody opens the simulated port: is sensor_node there?'
        return ''

    def _await(self, missing: Callable[[], str]) -> None:
        deadline = time.monotonic() + self._options.patience_s
        while missing():
            self._matcher.wait(self._matcher.sent + 1, 0.02)
            if time.monotonic() > deadline:
                raise DeviceError(missing())

    def _send(self, row: int, values: Array) -> None:
        data = encode(values)
        self._matcher.send(row, as_received(data))
        self._port.send(data)

    def _warm_up(self) -> None:
        """Send resting rows, all different, until the last comes back: the driver locked on."""
        values = self._recording.values[np.argmax(self._resting)].copy()
        deadline = time.monotonic() + self._options.patience_s
        while True:
            for _ in range(WARM_UP_ROWS):
                values[0, 0] += WARM_UP_STEP
                self._send(-1, values)
            if self._matcher.wait(self._matcher.sent, RETRY_S):
                break
            if time.monotonic() > deadline:
                msg = f'no frame came back from {self._options.port}: are all nodes active?'
                raise DeviceError(msg)
        self._matcher.lost = 0

    def _play_once(self, on_end: Callable[[PlaybackCounts], None]) -> None:
        recording, counts = self._recording, self.counts
        begin = self._due_s = time.monotonic()
        for first, last, resting in runs(self._resting):
            self._play_rows(first, last)
            if resting and self._tare is not None:
                self._settle()
                done, message = self._tare(self._options.patience_s)
                counts.tares += done
                counts.refused += not done
                counts.refusal = counts.refusal if done else message
        self._settle()
        counts.rows += len(recording)
        counts.lost = self._matcher.lost
        counts.seconds += time.monotonic() - begin
        if recording.stamp_ns is not None:
            counts.recorded_s += float(np.maximum(np.diff(recording.stamp_ns), 0).sum()) * 1e-9
        on_end(counts)

    def _play_rows(self, first: int, last: int) -> None:
        """Send rows, each at its time and once few enough are on their way."""
        options, stamps = self._options, self._recording.stamp_ns
        for row in range(first, last):
            gap = 1.0 / options.rate_hz
            if stamps is not None and row > first:
                gap = float(stamps[row] - stamps[row - 1]) * 1e-9 / options.speed_up
            # a slow reader delays the schedule; the rows that follow do not come in a burst
            self._due_s = max(self._due_s + gap, time.monotonic() - gap)
            time.sleep(max(0.0, self._due_s - time.monotonic()))
            if not self._matcher.wait(self._matcher.sent + 1 - options.window, LOST_S):
                self._matcher.give_up()
            self._send(row, self._recording.values[row])

    def _settle(self) -> None:
        if self._matcher.wait(self._matcher.sent, LOST_S):
            self._lost_in_a_row = 0
            return
        self._matcher.give_up()
        self._lost_in_a_row += 1
        if self._lost_in_a_row >= MOST_LOST:
            msg = f'{MOST_LOST} readings in a row did not come back: is the graph alive?'
            raise DeviceError(msg)


class PlayerNode(ManagedNode):
    """Play a recording into a port; publish `truth/contacts` for the frames that come back."""

    def __init__(self) -> None:
        super().__init__('player')
        self._options = PlayerOptions()
        self.declare(self._options)
        self._truths = self.managed_publisher(TactileContacts, 'truth/contacts')
        self._recording: Recording | None = None
        self._truth: TruthMessages | None = None
        self._client: Client | None = None
        self._matcher = FrameMatcher()

    def configure(self) -> None:
        """Load the recording."""
        self._options = self.options(PlayerOptions)
        name = self._options.recording
        shipped = load_sensor(self._options.sensor).recordings()
        if not name:
            msg = f'recording must be a file (.npz) or one of {", ".join(shipped)}; none was given'
            raise ValueError(msg)
        self._recording = shipped[name] if name in shipped else load_recording(name)
        self._truth = TruthMessages(self._recording)
        if self._options.tare:
            self._client = self.create_client(Trigger, TARE)

    def activate(self) -> None:
        """Listen to what comes back, and play in a thread."""
        port = self._options.port or str(private_folder() / SIMULATED_PORT)
        options = replace(self._options, port=port)
        self._matcher = FrameMatcher()
        self.subscribe(TactileFrame, 'frame', self._on_frame)
        self.subscribe(
            TactileContacts, 'contacts', lambda m: self._matcher.acknowledge(m.sequence)
        )
        self.get_logger().info(f'the board appears at {port}')
        tare = self._take_tare if options.tare else None
        self._playback = Playback(self._recording, options, self._matcher, tare, self._missing)
        self._thread = threading.Thread(target=self._play, name='player', daemon=True)
        self._thread.start()

    def deactivate(self) -> None:
        """Stop playing."""
        self._matcher.stop()
        self._thread.join()

    def cleanup(self) -> None:
        """Let the recording go."""
        self._recording = self._truth = None

    def _on_frame(self, message: TactileFrame) -> None:
        frame = messages.read_frame(message, self._recording.layout.shape)
        row = self._matcher.match(frame)
        if row is not None and row >= 0 and self._truths.get_subscription_count():
            self._truths.publish(self._truth.message(row, message.header, message.sequence))

    def _missing(self) -> str:
        if self._truths.get_subscription_count() < self._options.listeners:
            return f'truth/contacts has fewer than {self._options.listeners} listeners'
        if self._client is not None and not self._client.service_is_ready():
            return f'service {self._client.srv_name} does not appear: is contact_node there?'
        return ''

    def _take_tare(self, timeout: float) -> tuple[bool, str]:
        """Call the service from the player's thread; the executor's thread hears the answer."""
        answered = threading.Event()
        future = self._client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: answered.set())
        deadline = time.monotonic() + timeout
        while not answered.wait(0.1):
            if self._matcher.is_stopped or time.monotonic() > deadline:
                return False, f'service {self._client.srv_name} does not answer'
        answer = future.result()
        return answer.success, answer.message

    def _play(self) -> None:
        try:
            self._playback.play(self._log_counts)
        except Stopped:
            return
        except (TactileError, OSError) as err:
            self.get_logger().error(str(err))
            self.exit_code = 1
        self.finished.set()

    def _log_counts(self, counts: PlaybackCounts) -> None:
        self.get_logger().info(str(counts))
        if not self._truths.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED_S)):
            self.get_logger().warning('a listener did not receive all of truth/contacts')
        if counts.refused:
            self.get_logger().warning(f'the last refusal: {counts.refusal}')

    def diagnose(self) -> DiagnosticStatus:
        """Rows sent and lost."""
        sent, lost = self._matcher.sent, self._matcher.lost
        return diagnostic('player', f'{sent} rows sent', {'sent': sent, 'lost': lost})
