"""contact_node: frames of one sensor to contacts and standard messages; takes the tare."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String
from std_srvs.srv import Trigger

from tactile_ros import messages
from tactile_ros.enrolment import Allowed
from tactile_ros.msg import TactileContact, TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.contact_loop import ContactStage
from tactile_ros.nodes.enrolment_server import EnrolServer, EnrolStage
from tactile_ros.nodes.lifecycle import (
    ManagedNode,
    baselines,
    data,
    latched,
    main_of,
    overridable,
    pairs,
    serving,
)
from tactile_ros.nodes.parameters import ContactOptions
from tactile_ros.nodes.standard_messages import StandardTopics
from tactile_ros.sensors import load_sensor
from tactile_ros.types import FrameStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rclpy.subscription import Subscription
    from rclpy.timer import Timer

    from tactile_ros.nodes.enrolment_server import Change
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import ContactState, Frame

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


LISTENERS_PERIOD_S = 0.02


class ContactNode(ManagedNode):
    """Publish `contacts`, `baseline`, `calibration`, standard topics; serve `~/tare`.

    Where classes are learned, also `~/enrol` and `~/forget`.

    Parameters
    ----------
    direct : bool
        Frames come by `take` from the same process instead of the topic `frame`.
    downstream : callable or None
        Takes the full name of `contacts`, every frame and its state, those that came together at
        once, before they are published.
    arguments : sequence of str
        ROS arguments for this node alone.
    """

    def __init__(
        self,
        direct: bool = False,
        downstream: Callable[[str, Sequence[Frame], Sequence[ContactState]], None] | None = None,
        arguments: Sequence[str] = (),
    ) -> None:
        super().__init__('contact_node', arguments)
        self._stage: ContactStage | None = None
        self._unknown_as = ContactOptions().unknown_as
        self.declare(ContactOptions())
        self._spec = load_sensor(self.get_parameter('sensor').value)
        self.declare(self._spec.config())
        self._contacts = self.managed_publisher(TactileContacts, 'contacts', data())
        self._standard = StandardTopics(self, self._spec)
        self._baseline = self.managed_publisher(TactileFrame, 'baseline', baselines())
        self._calibration = self.managed_publisher(String, 'calibration', latched())
        self._direct, self._downstream = direct, downstream
        self.topic = self.resolve_topic_name('contacts')
        self._active = False
        self._options = ContactOptions()
        self._pipeline: Pipeline | None = None
        self._heard: list[Subscription] = []
        self._waiting: Timer | None = None
        self._refusal = self._complaint = ''
        self._previous = 0
        self._frame_id = ''
        self._tare = self.create_service(Trigger, '~/tare', self._on_tare)
        learns = self._spec.pipeline().estimation.learns_classes
        self._enrol = EnrolServer(self) if learns else None
        self._digest = ''

    def configure(self) -> None:
        """Read the calibration; CalibrationError names what does not fit."""
        self._options = self.options(ContactOptions)
        config = self.options(type(self._spec.config()))
        if self._options.calibration:
            self._pipeline = self._spec.load(self._options.calibration)
            self._digest = self._pipeline.digest
            if not config.track_baseline:
                self._pipeline.config = replace(self._pipeline.config, track_baseline=False)
                self._pipeline.reset()
            return
        self._pipeline = self._spec.pipeline(config)
        self._pipeline.warm_up()
        self.get_logger().warning(
            'no calibration was given: contacts say NOT_CALIBRATED and estimate what the nominal '
            'model knows; set the parameter calibration'
        )

    def activate(self) -> None:
        """Announce the calibration and begin to listen."""
        pipeline = self._pipeline
        self._stage = ContactStage(
            pipeline,
            self.get_parameter('tare_frames').value,
            self.get_parameter('allow_tare_in_contact').value,
            self._publish_baseline,
            self._complain,
        )
        self._stage.reset()
        self._refusal = self._complaint = ''
        self._previous = 0
        self._unknown_as = self.get_parameter('unknown_as').value
        if self._enrol is not None:
            self._enrol.stage = EnrolStage(
                self._stage,
                self._options.calibration,
                self._spec.load,
                self._digest,
                self._announce,
                Allowed(self._options.most_lost, self._options.most_lost_there),
            )
        self._announce()
        self._active = True
        self._listen()

    def _announce(self, change: Change | None = None) -> None:
        """Say which calibration is in use, and how it changed."""
        pipeline = self._pipeline
        if change is not None:
            self._digest = change.digest
        told = {
            'sha256': pipeline.digest,
            'sensor': pipeline.sensor,
            'estimators': dict(pipeline.estimators),
            'file': self._options.calibration,
            **({} if change is None else change.told()),
        }
        self._calibration.publish(String(data=json.dumps(told, sort_keys=True)))

    def _listen(self) -> None:
        """Subscribe to the sensor: to its frames once everybody hears what comes of them."""
        told = self.create_subscription(TactileLayout, 'layout', self._on_layout, latched())
        self._heard = [told]
        if self._direct:
            return
        if self.is_heard():
            self._listen_to_frames()
        else:
            self._waiting = self.steady_timer(LISTENERS_PERIOD_S, self._on_waiting)

    def _listen_to_frames(self) -> None:
        """Subscribe to `frame`."""
        options = overridable()
        self._incoming = self.create_subscription(
            TactileFrame, 'frame', self._on_frame, data(), qos_overriding_options=options
        )
        self._heard.append(self._incoming)

    def _on_waiting(self) -> None:
        """Look whether everybody is there."""
        if self.is_heard():
            self._end_waiting()
            self._listen_to_frames()

    def _end_waiting(self) -> None:
        """No timer runs once everybody is there, or while the node is not active."""
        if self._waiting is not None:
            self.destroy_timer(self._waiting)
            self._waiting = None

    def deactivate(self) -> None:
        """Listen no more."""
        self._active = False
        if self._enrol is not None:
            self._enrol.close()
        self._end_waiting()
        for subscription in self._heard:
            self.destroy_subscription(subscription)
        self._heard = []

    def destroy_node(self) -> None:
        """End the action with the node."""
        if self._enrol is not None:
            self._enrol.destroy()
        super().destroy_node()

    def cleanup(self) -> None:
        """Let the calibration go."""
        self._pipeline = self._stage = None

    def is_heard(self) -> bool:
        """Everybody who must see the first contacts is there."""
        return self._active and self._contacts.get_subscription_count() >= self._options.listeners

    def _on_layout(self, message: TactileLayout) -> None:
        """Refuse frames of a sensor that the calibration is not of."""
        try:
            layout = messages.read_layout(message)
        except ValueError as err:
            self._complain(f'layout is malformed: {err}')
            return
        wanted = (self._pipeline.sensor, self._pipeline.layout.shape)
        found = (layout.sensor, layout.shape)
        self._refusal = ''
        if found != wanted:
            self._refusal = (
                f'the calibration is of {wanted[0]} with {wanted[1]} taxels and channels, '
                f'the frames are of {found[0]} with {found[1]}: '
                'give the calibration of this sensor'
            )
            self._complain(self._refusal)

    def _complain(self, sentence: str) -> None:
        """Say once why something is not processed."""
        if sentence != self._complaint:
            self._complaint = sentence
            self.get_logger().error(sentence)

    def _on_frame(self, message: TactileFrame) -> None:
        """Frames from the topic: one, and those that wait behind it."""
        frames = []
        for one in (message, *backlog(self._incoming, TactileFrame)):
            try:
                frames.append(messages.read_frame(one, self._stage.shape))
            except ValueError as err:
                self._stage.tally.refused += 1
                self._complain(f'{err}; the calibration is of {self._pipeline.sensor}')
        if not frames:
            return
        try:
            self.take(frames, message.header.frame_id)
        except Exception as err:  # frames that cannot be estimated end nothing
            self._stage.tally.refused += len(frames)
            self._complain(f'frame {frames[0].sequence} failed: {type(err).__name__}: {err}')

    def take(self, frames: Sequence[Frame], frame_id: str) -> None:
        """Process the next frames and publish for whoever listens."""
        if not self._active:
            return
        if self._refusal:
            self._stage.tally.refused += len(frames)
            return
        self._frame_id = frame_id
        states = self._stage.process_all(frames)
        if self._downstream is not None:
            self._downstream(self.topic, frames, states)
        for frame, state in zip(frames, states, strict=True):
            self._publish(frame, state, frame_id)

    def _publish(self, frame: Frame, state: ContactState, frame_id: str) -> None:
        """Contacts and standard messages, each where somebody listens."""
        if self._contacts.get_subscription_count():
            message = TactileContacts()
            messages.fill_contacts(message, state, TactileContact)
            messages.fill_header(message.header, frame.stamp_ns, frame_id)
            message.sequence = frame.sequence
            message.label_name = self._label_name(int(state.label))
            self._contacts.publish(message)
        self._standard.publish(frame, state, frame_id, self._pipeline, self._unknown_as)

    def _label_name(self, label: int) -> str:
        """Name of a class, where the sensor has classes."""
        names = () if self._pipeline is None else self._pipeline.label_names
        return names[label] if 0 <= label < len(names) else ''

    def _publish_baseline(self, frame: Frame) -> None:
        """Baseline in use, latched."""
        message = TactileFrame()
        messages.fill_baseline(message, frame, self._frame_id)
        self._baseline.publish(message)

    def _on_tare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take the tare, or say why not."""
        if not self._active:
            response.message = 'tare needs an active node: activate it first'
            return response
        response.success, response.message = self._stage.tare()
        return response

    def apply(self, changes: dict[str, object]) -> None:
        """Let the rules of the tare, and what is told of the unknown, change while it runs."""
        self._unknown_as = changes.get('unknown_as', self._unknown_as)
        if self._stage is None:
            return
        if 'tare_frames' in changes:
            self._stage.set_tare_frames(changes['tare_frames'])
        if 'allow_tare_in_contact' in changes:
            self._stage.tare_in_contact = changes['allow_tare_in_contact']

    def diagnose(self) -> DiagnosticStatus:
        """Rate, validity, tares and what wrench says for the unknown."""
        tally = self._stage.tally
        rate, self._previous = max(0, tally.frames - self._previous), tally.frames
        reasons = [bit.name for bit in FrameStatus if tally.status & bit]
        level, sentence = DiagnosticStatus.OK, f'{rate} frames in the last second'
        if self._refusal:
            level, sentence = DiagnosticStatus.ERROR, self._refusal
        elif not tally.frames:
            level, sentence = DiagnosticStatus.STALE, 'no frame came yet'
        elif not rate:
            level, sentence = DiagnosticStatus.ERROR, 'no frame came in the last second'
        elif reasons:
            level, sentence = DiagnosticStatus.WARN, ' '.join([sentence, *reasons])
        status = DiagnosticStatus(level=level, name='contact', message=sentence)
        status.hardware_id = self._spec.key
        status.values = pairs(
            {
                'rate (Hz)': rate,
                'frames': tally.frames,
                'valid': tally.valid,
                'refused': tally.refused,
                'failed': self._stage.failures,
                'in contact': tally.in_contact,
                'tares': tally.tares,
                'tare state': tally.tare_state,
                'baseline age (s)': tally.baseline_age_s,
                'baseline tracking': self._tracking(),
                'faulty taxels': tally.flagged,
                'unknown in wrench': self.get_parameter('unknown_as').value,
                'calibration': self._options.calibration or 'none',
            }
        )
        return status

    def _tracking(self) -> str:
        """Whether the baseline follows drift now."""
        if not self._pipeline.config.track_baseline:
            return 'off'
        return 'frozen in contact' if self._stage.is_touching else 'on'


def build() -> Sequence[ManagedNode]:
    """The node of this executable."""
    return [ContactNode()]


def main() -> None:
    """Run contact_node until it is told to stop."""
    main_of(build, serving)


if __name__ == '__main__':
    main()
