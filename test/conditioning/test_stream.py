"""What a live stream remembers: whether time goes on, and when memory begins anew."""

from __future__ import annotations

import numpy as np

from tactile_ros.conditioning.baseline import BaselineTracker, Stream


def new_stream() -> Stream:
    return Stream(BaselineTracker(np.zeros((1, 1)), None), None)


def stamps(*given: int | None) -> np.ndarray | None:
    return None if None in given else np.array(given, np.int64)


def test_memory_begins_at_the_first_stamped_frame_and_after_a_tare() -> None:
    stream = new_stream()
    begun = []
    for stamp in (None, 5, 6, None, 7):
        begun.append(bool(stream.admit(stamps(stamp), 1)[0]))
    assert begun == [True, True, False, True, False]
    stream.rebase(BaselineTracker(np.ones((1, 1)), None))
    # an independent frame in between does not use the restart up
    assert [bool(stream.admit(stamps(s), 1)[0]) for s in (None, 9, 10)] == [True, True, False]
    assert stream.tracker.baseline.tolist() == [[1.0]]


def test_time_that_does_not_increase_ends_the_stream() -> None:
    stream = new_stream()
    assert not stream.is_over(stamps(5))
    stream.admit(stamps(3, 5), 2)
    assert [stream.is_over(stamps(s)) for s in (None, 6, 5, 4)] == [False, False, True, True]


def test_of_many_frames_only_the_first_begins() -> None:
    stream = new_stream()
    assert stream.admit(stamps(3, 4, 5), 3).tolist() == [True, False, False]
    assert stream.admit(stamps(6, 7), 2).tolist() == [False, False]
    assert stream.admit(stamps(None), 3).all()
