"""Each baseline of a live run comes in before the frame that it held for."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.evaluation.replay import baselines_by_row
from tactile_ros.types import Frame, Layout, Recording

LAYOUT = Layout(np.zeros((1, 3)), ('p',), '1')


def run(sequence: list[int], stamped: bool = True) -> Recording:
    """Frames whose counter begins anew where it goes back."""
    rows = np.arange(len(sequence))
    stamps = 1000 + 10 * rows if stamped else None
    stream = np.cumsum(np.diff(sequence, prepend=sequence[0]) < 0)
    return Recording.from_arrays(
        LAYOUT, np.zeros((len(rows), 1, 1)), stamps, sequence=np.array(sequence), stream=stream
    )


def frame(stamp_ns: int | None, sequence: int, level: float = 0.0) -> Frame:
    return Frame(stamp_ns, sequence, np.full((1, 1), level))


@pytest.mark.parametrize(
    ('baselines', 'expected'),
    [
        ([(1000, 0)], {0: 0}),  # in use when the run began
        ([(1020, 3)], {3: 0}),  # a tare of frames up to 2
        ([(1010, 3)], {3: 0}),  # frame 2 was processed and not averaged
        ([(1060, 3)], {7: 0}),  # the first of the run, after the counter began anew
        ([(1000, 0), (1040, 0), (1060, 3)], {0: 0, 4: 1, 7: 2}),
        ([(1020, 3), (9999, 1)], {3: 0, 5: 1}),  # of no frame: by its sequence
        ([(1020, 3), (1020, 3)], {3: 1}),  # the last of two
        ([(1070, 4)], {}),  # for a frame that never came
    ],
)
def test_a_baseline_is_of_the_stream_of_its_stamp(
    baselines: list[tuple[int, int]], expected: dict[int, int]
) -> None:
    recording = run([0, 1, 2, 3, 0, 1, 2, 3])
    told = [frame(*one, level=i) for i, one in enumerate(baselines)]
    found = baselines_by_row(recording, np.arange(8), told)
    assert {row: int(one[0].values[0, 0]) for row, one in found.items()} == expected


def test_without_stamps_sequences_alone_tell() -> None:
    recording = run([0, 1, 2, 0, 1, 2], stamped=False)
    told = [frame(None, 1, 0.0), frame(None, 0, 1.0)]
    found = baselines_by_row(recording, np.arange(6), told)
    assert sorted(found) == [1, 3]
    assert baselines_by_row(recording, np.arange(0), told) == {}
