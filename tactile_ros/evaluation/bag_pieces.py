"""A bag in pieces: every sensor's frames in turn, with memory that does not grow with the bag."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag_reader import BagContent, read_parts
from tactile_ros.evaluation.definitions import PACKAGE, same_fields, split_name
from tactile_ros.evaluation.sensor_pieces import SensorPieces
from tactile_ros.evaluation.topics import ROLES, ends_as, is_frame, split_topic
from tactile_ros.evaluation.truth import DEFAULT_TRUTH, Association, is_truth_type

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from tactile_ros.evaluation.bag_reader import Taker
    from tactile_ros.evaluation.sensor_pieces import Piece
    from tactile_ros.types import Layout

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
    association : Association or None
        Of truth with frames.
    """

    def __init__(
        self,
        path: Path,
        layout: Layout | None = None,
        truth_topics: Sequence[str] = DEFAULT_TRUTH,
        association: Association | None = None,
    ) -> None:
        self.path = path
        self.sensors: dict[str, SensorPieces] = {}
        self.left_out: dict[str, str] = {}
        self._layout, self._truth_topics = layout, truth_topics
        self._association = association or Association()
        self._content = BagContent()
        self._routes: dict[str, tuple[str, list[Taker]]] = {}
        self._early: deque[tuple[str, int, bytes]] = deque(maxlen=MOST_EARLY)

    def __iter__(self) -> Iterator[tuple[str, Piece]]:
        """Namespace and piece, in the order in which pieces are complete.

        Raises
        ------
        RecordingError
            If there is no bag, or no frame that could be read.
        """
        for _ in read_parts(self.path, self._content, self._taker):
            yield from self._complete(final=False)
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

    def _taker(self, topic: str, kind: str) -> Taker | None:
        """Who takes the messages of a topic: its namespace, or whom it tells the truth."""
        truth = self._is_truth(topic, kind)
        space, leaf = split_topic(topic)
        if not truth and (leaf, kind) not in ROLES:
            return None
        text = self._content.texts.get(kind)
        if text and split_name(kind)[0] == PACKAGE and not same_fields(kind, text):
            self._content.problems.append(f'{kind} of the bag is of another version; left out')
            return None
        if not truth:
            return self._own(space, leaf)
        self._routes[topic] = (kind, self._hearers(topic, kind))
        return lambda log_ns, data: self._hear(topic, log_ns, data)

    def _own(self, space: str, leaf: str) -> Taker:
        """Who takes a topic of the sensor of a namespace."""
        if space not in self.sensors:
            self.sensors[space] = SensorPieces(space, self._layout, self._association)
        if leaf == 'frame':  # the first frame may tell whose the truth is
            for topic, (kind, _) in self._routes.items():
                self._routes[topic] = (kind, self._hearers(topic, kind))
            early, self._early = self._early, deque(maxlen=MOST_EARLY)
            for topic, log_ns, data in early:
                self._hear(topic, log_ns, data)
        return self.sensors[space].taker(leaf)

    def _hearers(self, topic: str, kind: str) -> list[Taker]:
        """Sensors that a topic tells the truth, as far as the bag has told of sensors."""
        spaces = self._spaces()
        return [
            self.sensors[space].truth.taker(topic, kind)
            for space in spaces
            if space in self.sensors and (len(spaces) == 1 or topic.startswith(f'{space}/'))
        ]

    def _hear(self, topic: str, log_ns: int, data: bytes) -> None:
        """Hand truth on; what comes before any frame waits."""
        hearers = self._routes[topic][1]
        for take in hearers:
            take(log_ns, data)
        if not hearers:
            self._early.append((topic, log_ns, data))

    def _spaces(self) -> list[str]:
        """Namespaces with frames, as far as the bag has told."""
        topics = {**self._content.announced, **self._content.types}.items()
        return sorted({split_topic(t)[0] for t, k in topics if is_frame(t, k)})

    def _complete(self, *, final: bool) -> Iterator[tuple[str, Piece]]:
        """Pieces that are complete by now."""
        now = max((sensor.now_ns for sensor in self.sensors.values()), default=0)
        for space, sensor in self.sensors.items():
            while sensor.ready(now) or (final and sensor.frames.logs):
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
