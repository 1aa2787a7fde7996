"""Standard messages cost nothing while nobody listens, and reach whoever comes at once."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_ros.nodes.standard_messages import LOOK_NS, StandardTopics
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactState, Frame

MS = 1_000_000
BEGIN_NS = 5_000_000_000
STATE = ContactState.assemble(5, {})


class Publisher:
    """Counts how often it is asked who listens, and what it sends."""

    def __init__(self) -> None:
        self.listeners = self.asked = 0
        self.sent: list[object] = []
        self.publish = self.sent.append

    def get_subscription_count(self) -> int:
        self.asked += 1
        return self.listeners


class Talk:
    """Standard topics whose publishers are those."""

    def __init__(self) -> None:
        self.made: dict[str, Publisher] = {}
        node = SimpleNamespace(managed_publisher=self.publisher)
        self.topics = StandardTopics(node, load_sensor('reskin_board'))  # type: ignore[arg-type]
        self.wrench = self.made['wrench']

    def publisher(self, _: object, name: str, __: object) -> Publisher:
        return self.made.setdefault(name, Publisher())

    def say(self, at_ns: int) -> None:
        frame = Frame(at_ns, 0, np.zeros((5, 3)))
        self.topics.publish(frame, STATE, 'pad', None, 'nan')  # type: ignore[arg-type]


@pytest.fixture
def talk() -> Talk:
    return Talk()


def test_a_fast_stream_asks_rarely_who_listens(talk: Talk) -> None:
    for i in range(100):
        talk.say(BEGIN_NS + i * MS)
    assert talk.wrench.asked == 100 // (LOOK_NS // MS) + 1
    assert not talk.wrench.sent


def test_one_who_comes_is_heard_within_a_look_and_one_who_leaves_too(talk: Talk) -> None:
    for i in range(40):
        talk.wrench.listeners = int(5 <= i < 25)
        talk.say(BEGIN_NS + i * MS)
    stamps = [sent.header.stamp.nanosec // MS for sent in talk.wrench.sent]  # type: ignore[attr-defined]
    assert 5 <= stamps[0] <= 5 + LOOK_NS // MS
    assert stamps == list(range(stamps[0], 25))


@pytest.mark.parametrize('step_ns', [10 * MS, 0, -MS])
def test_slow_frames_and_clocks_that_stand_or_step_back_ask_every_time(
    talk: Talk, step_ns: int
) -> None:
    for i in range(10):
        talk.wrench.listeners = i % 2
        talk.say(BEGIN_NS + i * step_ns)
    assert len(talk.wrench.sent) == 5
