"""A bag in pieces: every sensor's frames in turn, with memory that does not grow with the bag."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag_reader import BagContent, Message, read_parts
from tactile_ros.evaluation.definitions import PACKAGE, same_fields, split_name
from tactile_ros.evaluation.sensor_pieces import SensorPieces
from tactile_ros.evaluation.topics import FRAME, ROLES, ends_as, split_topic
from tactile_ros.evaluation.truth_topics import DEFAULT_TRUTH, Association, is_truth_type

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from tactile_ros.evaluation.sensor_pieces import Piece
    from tactile_ros.types import Layout

LEAVES = {leaf for leaf, _ in ROLES}
MOST_EARLY = 1000  # messages of truth that are kept until a frame is heard

class BagPieces:
    """Reads a bag once; iterate over it, then ask for its problems.

    Parameters
    ----------
    path : Path
        A rosbag2 folder, or one .mcap or .db3 file.
    layout : Layout or None
        For a bag that does not tell it.
    truth_topics : sequence of str
        As of `recording.load`.
    association : Association
        Of truth with frames.
    """

    def __init__(
        self,
        path: Path,
        layout: Layout | None = None,
        truth_topics: Sequence[str] = DEFAULT_TRUTH,
        association: Association = Association(),
    ) -> None:
        self.path = path
        self.sensors: dict[str, SensorPieces] = {}
        self.left_out: dict[str, str] = {}
        self._layout, self._truth_topics = layout, truth_topics
        self._association = association
        self._content = BagContent()
        self._takers: dict[str, list[Callable[[int, bytes], None]]] = {}
        self._early: deque[Message] = deque(maxlen=MOST_EARLY)
        self._now_ns = 0

    def __iter__(self) -> Iterator[tuple[str, Piece]]:
        """Namespace and piece, in the order in which pieces are complete.

        Raises
        ------
        RecordingError
            If there is no bag, or no frame that could be read.
        """
        for _ in read_parts(self.path, self._content, self._wanted):
            self._drain()
            yield from self._complete(final=False)
        self._drain()
        yield from self._complete(final=True)
        if not any(sensor.count for sensor in self.sensors.values()):
            why = '; '.join(self.problems[:3]) or 'it is empty'
            msg = f'{self.path} holds no frames that could be read ({why})'
            raise RecordingError(msg)

    @property
    def problems(self) -> list[str]:
        """Sentences about the bag as a whole, and about sensors that were left out."""
        types = self._content.types
        foreign = sorted(name for name, kind in types.items() if not self._wanted(name, kind))
        named = [f'topics that are not ours were left out: {", ".join(foreign)}'] * bool(foreign)
        out = [f'{space}/frame was left out: {why}' for space, why in self.left_out.items()]
        return [*self._content.problems, *named, *out]

    def _wanted(self, topic: str, kind: str) -> bool:
        return self._is_truth(topic, kind) or (split_topic(topic)[1], kind) in ROLES

    def _is_truth(self, topic: str, kind: str) -> bool:
        return is_truth_type(kind) and any(ends_as(topic, name) for name in self._truth_topics)

    def _drain(self) -> None:
        """Hand the messages that were read to the sensors."""
        for message in self._content.messages:
            topic, kind, log_ns, data = message
            if topic not in self._takers:
                if kind != FRAME and self._is_truth(topic, kind) and not self._spaces():
                    self._early.append(message)
                    continue
                self._takers[topic] = self._route(topic, kind)
            for take in self._takers[topic]:
                take(log_ns, data)
            self._now_ns = max(self._now_ns, log_ns)
        self._content.messages.clear()

    def _hear_early(self) -> None:
        """Ask anew who takes truth, and hand over what was heard before any frame."""
        kept = {t: found for t, found in self._takers.items() if split_topic(t)[1] in LEAVES}
        self._takers = kept
        early, self._early = self._early, deque(maxlen=MOST_EARLY)
        for topic, kind, log_ns, data in early:
            for take in self._route(topic, kind):
                take(log_ns, data)

    def _route(self, topic: str, kind: str) -> list[Callable[[int, bytes], None]]:
        """Who takes the messages of a topic: its namespace, and whom it tells the truth."""
        text = self._content.texts.get(kind)
        if text and split_name(kind)[0] == PACKAGE and not same_fields(kind, text):
            self._content.problems.append(f'{kind} of the bag is of another version; left out')
            return []
        space, leaf = split_topic(topic)
        found: list[Callable[[int, bytes], None]] = []
        if (leaf, kind) in ROLES:
            found.append(_own(self._sensor(space), leaf, kind))
        if is_frame(topic, kind):
            self._hear_early()
        if self._is_truth(topic, kind):
            spaces = self._spaces()
            for name in spaces:
                if len(spaces) == 1 or topic.startswith(f'{name}/'):
                    found.append(_true(self._sensor(name), topic, kind))
        return found

    def _spaces(self) -> list[str]:
        """Namespaces with frames, as far as the bag has told."""
        topics = {**self._content.announced, **self._content.types}.items()
        return sorted({split_topic(t)[0] for t, k in topics if is_frame(t, k)})

    def _sensor(self, space: str) -> SensorPieces:
        if space not in self.sensors:
            self.sensors[space] = SensorPieces(space, self._layout, self._association)
        return self.sensors[space]

    def _complete(self, *, final: bool) -> Iterator[tuple[str, Piece]]:
        """Pieces that are complete by now."""
        for space, sensor in self.sensors.items():
            while sensor.ready(self._now_ns) or (final and sensor.frames.logs):
                if space in self.left_out:
                    sensor.frames.take(len(sensor.frames))
                    continue
                try:
                    piece = sensor.piece(final=final)
                except RecordingError as err:
                    self.left_out[space] = str(err)
                    continue
                if piece is not None:
                    yield space, piece


def is_frame(topic: str, kind: str) -> bool:
    """Whether a topic holds the frames of a sensor."""
    return split_topic(topic)[1] == 'frame' and kind == FRAME


def _own(sensor: SensorPieces, leaf: str, kind: str) -> Callable[[int, bytes], None]:
    if leaf == 'frame':
        return sensor.frames.append
    return lambda log_ns, data: sensor.take(leaf, kind, log_ns, data)


def _true(sensor: SensorPieces, topic: str, kind: str) -> Callable[[int, bytes], None]:
    return lambda log_ns, data: sensor.truth.take(topic, kind, log_ns, data)
