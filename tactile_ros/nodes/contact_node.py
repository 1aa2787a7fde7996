# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""contact_node: frames of one sensor to contacts and standard messages; takes the tare."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.subscription import Subscription
from std_msgs.msg import String
from std_srvs.srv import Trigger

from tactile_ros import messages
from tactile_ros.enrolment import Allowed, ClassChange
from tactile_ros.msg import TactileContact, TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.contact_loop import ContactLoop, TimeCheck
from tactile_ros.nodes.enrolment_server import Enrolment, EnrolmentServer
from tactile_ros.nodes.lifecycle import ManagedNode, diagnostic
from tactile_ros.nodes.parameters import ContactOptions
from tactile_ros.nodes.standard_messages import StandardTopics
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactState, Frame, FrameStatus

Message = TypeVar('Message')
LISTENERS_PERIOD_S = 0.02
MOST_TOGETHER = 64
LIVE = {'tare_frames', 'allow_tare_in_contact', 'unknown_as'}


class ContactNode(ManagedNode):
    """Publish `contacts`, `baseline`, `calibration`, standard topics; serve `~/tare`.

    Where classes are learned, also `~/enrol` and `~/forget`. `direct`: frames come by `take` from
    the same process. `downstream` takes the full name of `contacts`, and all frames that came
    together with their states, before they are published.
    """

    def __init__(
        self,
        direct: bool = False,
        downstream: Callable[[str, Sequence[Frame], Sequence[ContactState]], None] | None = None,
        arguments: Sequence[str] = (),
    ) -> None:
        super().__init__('contact_node', arguments)
        self.loop: ContactLoop | None = None
        self._server: EnrolmentServer | None = None
        self._options = ContactOptions()
        self.declare(self._options)
        self._spec = load_sensor(self.get_parameter('sensor').value)
        self.declare(self._spec.config())
        self._contacts = self.managed_publisher(TactileContacts, 'contacts')
        self._standard = StandardTopics(self, self._spec)
        self._baseline = self.managed_publisher(TactileFrame, 'baseline')
        self._calibration = self.managed_publisher(String, 'calibration')
        self._direct, self._downstream = direct, downstream
        self.topic = self.resolve_topic_name('contacts')
        self._pipeline: Pipeline | None = None
        self._times = TimeCheck()
        self._refusal = self._complaint = self._frame_id = ''
        self._frames_before = 0
        self.create_service(Trigger, '~/tare', self._on_tare)
        if self._spec.pipeline().estimation.learns_classes:
            self._server = EnrolmentServer(self)

    def configure(self) -> None:
        """Read the calibration; CalibrationError names what does not fit."""
        self._options = self.options(ContactOptions)
        config, path = self.options(type(self._spec.config())), self._options.calibration
        pipeline = self._spec.load(path) if path else self._spec.pipeline(config)
        self._pipeline, self._digest = pipeline, pipeline.digest
        if path:
            if not config.track_baseline:
                pipeline.config = replace(pipeline.config, track_baseline=False)
                pipeline.reset()
            return
        pipeline.warm_up()
        self.get_logger().warning(
            'no calibration was given: contacts say NOT_CALIBRATED and estimate what the nominal '
            'model knows; set the parameter calibration'
        )

    def activate(self) -> None:
        """Announce the calibration and begin to listen."""
        live = self._options = self.options(ContactOptions)  # changed since configure, perhaps
        self.loop = ContactLoop(
            self._pipeline,
            live.tare_frames,
            live.allow_tare_in_contact,
            self._publish_baseline,
            self._complain,
        )
        self.loop.reset()
        self._times = TimeCheck()
        self._refusal = self._complaint = ''
        self._frames_before = 0
        if self._server is not None:
            self._server.enrolment = Enrolment(
                self.loop,
                live.calibration,
                self._spec.load,
                self._digest,
                self._announce,
                Allowed(live.most_lost, live.most_lost_there),
            )
        self._announce()
        self.subscribe(TactileLayout, 'layout', self._on_layout)
        if not self._direct:
            self._waiting = self.steady_timer(LISTENERS_PERIOD_S, self._listen)

    def _announce(self, change: ClassChange | None = None) -> None:
        """Say which calibration is in use, and how it changed."""
        pipeline = self._pipeline
        if change is not None:
            self._digest = change.digest
        content = {
            'sha256': pipeline.digest,
            'sensor': pipeline.sensor,
            'estimators': dict(pipeline.estimators),
            'file': self._options.calibration,
            **({} if change is None else change.announcement()),
        }
        self._calibration.publish(String(data=json.dumps(content, sort_keys=True)))

    def _listen(self) -> None:
        """Subscribe to frames once everybody hears what comes of them."""
        if self.is_ready():
            self.destroy_timer(self._waiting)
            self._incoming = self.subscribe(TactileFrame, 'frame', self._on_frame)

    def deactivate(self) -> None:
        """End the enrolment under way."""
        if self._server is not None:
            self._server.close()

    def destroy_node(self) -> None:
        """End the action with the node."""
        if self._server is not None:
            self._server.destroy()
        super().destroy_node()

    def cleanup(self) -> None:
        """Let the calibration go."""
        self._pipeline = self.loop = None

    def is_ready(self) -> bool:
        """Everybody who must see the first contacts is there."""
        count = self._contacts.get_subscription_count()
        return self.is_active and count >= self._options.listeners

    def _on_layout(self, message: TactileLayout) -> None:
        """Refuse frames of a sensor that the calibration is not of."""
        try:
            layout = messages.read_layout(message)
        except ValueError as err:
            self._complain(f'layout is malformed: {err}')
            return
        wanted = (self._pipeline.sensor, self._pipeline.layout.shape)
        received = (layout.sensor, layout.shape)
        self._refusal = ''
        if received != wanted:
            self._refusal = (
                f'the calibration is of {wanted[0]} with {wanted[1]} taxels and channels, '
                f'the frames are of {received[0]} with {received[1]}: '
                'give the calibration of this sensor'
            )
            self._complain(self._refusal)

    def _complain(self, sentence: str) -> None:
        if sentence != self._complaint:
            self._complaint = sentence
            self.get_logger().error(sentence)

    def _on_frame(self, message: TactileFrame) -> None:
        """Frames from the topic: one, and those that wait behind it."""
        frames = []
        for one in (message, *drain_queue(self._incoming, TactileFrame)):
            try:
                frames.append(messages.read_frame(one, self._pipeline.layout.shape))
            except ValueError as err:
                self.loop.statistics.refused += 1
                self._complain(f'{err}; the calibration is of {self._pipeline.sensor}')
        self.take(frames, message.header.frame_id)

    def take(self, frames: Sequence[Frame], frame_id: str) -> None:
        """Process the next frames and publish for whoever listens."""
        if not self.is_active or not frames:
            return
        if self._refusal:
            self.loop.statistics.refused += len(frames)
            return
        self._frame_id = frame_id
        now_ns = self.now_ns()
        frames = [self._times.admit(frame, now_ns) for frame in frames]
        states = self.loop.process(frames)
        if self._downstream is not None:
            self._downstream(self.topic, frames, states)
        unknown_as = self._options.unknown_as
        for frame, state in zip(frames, states, strict=True):
            if self._contacts.get_subscription_count():
                self._publish(frame, state)
            self._standard.publish(frame, state, frame_id, self._pipeline, unknown_as)

    def _publish(self, frame: Frame, state: ContactState) -> None:
        message = TactileContacts()
        messages.fill_contacts(message, state, TactileContact)
        messages.fill_header(message.header, frame.stamp_ns, self._frame_id)
        message.sequence = frame.sequence
        names, label = self._pipeline.label_names, int(state.label)
        message.label_name = names[label] if 0 <= label < len(names) else ''
        self._contacts.publish(message)

    def _publish_baseline(self, baseline: Frame) -> None:
        message = TactileFrame()
        messages.fill_baseline(message, baseline, self._frame_id)
        self._baseline.publish(message)

    def _on_tare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = 'tare needs an active node: activate it first'
        if self.is_active:
            response.success, response.message = self.loop.tare()
        return response

    def apply(self, changes: dict[str, object]) -> None:
        """Let the rules of the tare, and the value of the unknown, change while it runs."""
        live = {name: changes[name] for name in LIVE & changes.keys()}
        self._options = replace(self._options, **live)
        if self.loop is not None:
            self.loop.set_tare_frames(self._options.tare_frames)
            self.loop.tare_in_contact = self._options.allow_tare_in_contact

    def diagnose(self) -> DiagnosticStatus:
        """Rate, validity, tares and what wrench says for the unknown."""
        counts = self.loop.statistics
        rate = max(0, counts.frames - self._frames_before)
        self._frames_before = counts.frames
        sources = self.count_publishers('frame')
        level, sentence = self._judge(rate, sources)
        tracking = 'frozen in contact' if self.loop.is_touching else 'on'
        values = {
            'rate (Hz)': rate,
            'frames': counts.frames,
            'valid': counts.valid,
            'refused': counts.refused,
            'failed': self._pipeline.failures,
            **self._times.counts,
            'publishers of frame': sources,
            'in contact': counts.in_contact,
            'tares': counts.tares,
            'tare state': counts.tare_state,
            'baseline age (s)': counts.baseline_age_s,
            'baseline tracking': tracking if self._pipeline.config.track_baseline else 'off',
            'faulty taxels': counts.faulty_taxels,
            'unknown in wrench': self._options.unknown_as,
            'calibration': self._options.calibration or 'none',
        }
        return diagnostic('contact', sentence, values, level, self._spec.key)

    def _judge(self, rate: int, sources: int) -> tuple[bytes, str]:
        """Level and sentence for the last second, with its frames and publishers of frames."""
        counts, wrong = self.loop.statistics, self._times.report()
        if self._refusal:
            return DiagnosticStatus.ERROR, self._refusal
        if not counts.frames:
            return DiagnosticStatus.STALE, 'no frame came yet'
        if not rate:
            return DiagnosticStatus.ERROR, 'no frame came in the last second'
        flags = [bit.name for bit in FrameStatus if int(counts.state.status) & bit]
        sentences = [' '.join([f'{rate} frames in the last second', *flags])]
        sentences += [wrong] if wrong else []
        if sources > 1 and not self._direct:
            sentences.append(f'{sources} publishers send {self.resolve_topic_name("frame")}')
        warns = flags or len(sentences) > 1
        level = DiagnosticStatus.WARN if warns else DiagnosticStatus.OK
        return level, '; '.join(sentences)


def drain_queue(subscription: Subscription, kind: type[Message]) -> Iterator[Message]:
    """Messages behind the one just handed over; executors allow for finding nothing then."""
    handle = subscription.handle
    with handle:
        for _ in range(MOST_TOGETHER):
            taken = handle.take_message(kind, False)
            if taken is None:
                return
            yield taken[0]
