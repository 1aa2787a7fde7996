"""A twin that shows something new: taught while it plays, and what came of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.evaluation.recording_files import LoadedRecording
    from tactile_ros.sensors.registry import TwinLesson

SHOWN_S = 60.0  # s, within which the new class must be seen
LEARNED_S = 30.0


def teach(lesson: TwinLesson, number: int, namespace: str, hear: Callable[[str], None]) -> None:
    """Enrol the new class once the truth says that it presses.

    Parameters
    ----------
    lesson : TwinLesson
        Of the twin that plays.
    number : int
        Of the new class in truth.
    namespace : str
        Of the sensor.
    hear : callable
        Takes what is said.

    Raises
    ------
    TactileError
        If it is not shown or not learned.
    """
    from tactile_ros.nodes.enrolment_server import Lesson, enrolling

    with enrolling(namespace) as client:
        client.wait_for_truth(lambda truth: bool(truth.label == number), SHOWN_S)
        hear(f'something unknown presses: enrolling it as {lesson.label!r}')
        learned = client.enrol(
            Lesson(lesson.label, lesson.presses, LEARNED_S), lambda _, said: hear(said)
        )
    if not learned.success:
        raise TactileError(learned.message)
    hear(learned.message)


def outcome(loaded: LoadedRecording, number: int) -> list[str]:
    """How windows of known classes and of the new one were named live, as sentences."""
    live, stamps = loaded.contacts, loaded.recording.stamp_ns
    if live is None or stamps is None or not loaded.changes:
        return []
    label = np.asarray(loaded.recording.truth['label'], np.int64)[live.rows]
    since = stamps[live.rows] > loaded.changes[0].after_ns
    # the last frame of a window is the one that says a place
    told = np.isfinite(live.states.position[:, 0]) & (live.states.in_contact == 1)
    known, new = told & (label >= 0) & (label != number), told & (label == number)
    name = loaded.changes[0].label
    return [
        _share('known heads before the lesson', live.states.label, label, known & ~since),
        _share(f'{name} before it', live.states.label, label, new & ~since),
        _share(f'{name} after it', live.states.label, label, new & since),
        _share('known heads after it', live.states.label, label, known & since),
    ]


def _share(what: str, said: np.ndarray, label: np.ndarray, rows: np.ndarray) -> str:
    """How many windows were named rightly."""
    right = int((said[rows] == label[rows]).sum())
    return f'{what}: {right} of {int(rows.sum())} windows named rightly'
