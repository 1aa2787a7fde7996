"""What a live stream remembers: whether time goes on, and when memory begins anew."""

from __future__ import annotations

import numpy as np

from tactile_ros.conditioning.baseline import BaselineTracker
from tactile_ros.conditioning.stream import Stream


def new_stream() -> Stream:
    return Stream(BaselineTracker(np.zeros((1, 1)), None), None)


def test_memory_begins_at_the_first_stamped_frame_and_after_a_tare() -> None:
    stream = new_stream()
    begun = []
    for stamp in (None, 5, 6, None, 7):
        stamp_ns, restart = stream.admit(stamp)
        begun.append(bool(restart[0]))
        assert (stamp_ns is None) == (stamp is None)
    assert begun == [True, True, False, True, False]
    stream.rebase(BaselineTracker(np.ones((1, 1)), None))
    # an independent frame in between does not use the restart up
    assert [bool(stream.admit(stamp)[1][0]) for stamp in (None, 9, 10)] == [True, True, False]
    assert stream.tracker.baseline.tolist() == [[1.0]]


def test_time_that_does_not_increase_ends_the_stream() -> None:
    stream = new_stream()
    assert not stream.is_over(5)
    stream.admit(5)
    assert [stream.is_over(stamp) for stamp in (None, 6, 5, 4)] == [False, False, True, True]
