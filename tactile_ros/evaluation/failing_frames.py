"""States of a whole recording, of which frames that cannot be estimated cost themselves alone."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.follow import batch_of, gathered
from tactile_ros.frame_guard import ERROR, sentence_of, unknown
from tactile_ros.types.recording import refuse_foreign

if TYPE_CHECKING:
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import ContactStates, Integers, Recording


def estimated(recording: Recording, pipeline: Pipeline) -> tuple[ContactStates, tuple[str, ...]]:
    """States as `process_batch` gives them, whatever an estimator makes of single frames.

    Parameters
    ----------
    recording : Recording
        Of the pipeline's shape.
    pipeline : Pipeline
        Stays as it is.

    Returns
    -------
    states : ContactStates
        One for each row; a frame that fails has the status ERROR at every taxel, as live.
    problems : tuple of str
        How many frames failed, and why the first of them did.

    Raises ValueError if the shape, the unit or a channel differs from the layout.
    """
    refuse_foreign(pipeline.sensor, pipeline.layout, recording)
    states, reason = _tried(recording, pipeline)
    if states is not None:
        return states, ()
    rows = np.array(_failing(recording, pipeline), np.int64)
    states, _ = _tried(_marked(recording, rows), pipeline)
    if states is None:  # not even as lost ones: the others go on without them
        states = _without(recording, rows, pipeline)
    return states, (sentence_of(len(rows), reason),)


def _tried(recording: Recording, pipeline: Pipeline) -> tuple[ContactStates | None, str]:
    """States of all rows, or why there are none."""
    try:
        return pipeline.process_batch(recording), ''
    except MemoryError:
        raise
    except Exception as err:  # whatever an estimator makes of a frame
        return None, f'{type(err).__name__}: {err}'


def _failing(recording: Recording, pipeline: Pipeline) -> list[int]:
    """Rows that fail alone; parts that a tare lies before are not tared.

    What fails is halved, what succeeds is doubled, as a `Follower` does.
    """
    failing: list[int] = []
    first, size = 0, len(recording)
    while first < len(recording):
        part = recording.select(slice(first, first + size))
        fails = _tried(part, pipeline)[0] is None
        if fails and len(part) > 1:
            size = len(part) // 2
            continue
        failing += [first] * fails
        size = 1 if fails else 2 * size
        first += len(part)
    return failing


def _marked(recording: Recording, rows: Integers) -> Recording:
    """A recording of which no taxel of these rows is to be used."""
    count, taxels = len(recording), recording.layout.shape[0]
    known = recording.status
    status = np.zeros((count, taxels), np.uint8) if known is None else known.copy()
    status[rows] |= ERROR
    return replace(recording, status=status)


def _without(recording: Recording, rows: Integers, pipeline: Pipeline) -> ContactStates:
    """States of the other rows, as if these had not been read."""
    count, taxels = len(recording), recording.layout.shape[0]
    rest = np.setdiff1d(np.arange(count), rows)
    parts = [pipeline.process_batch(recording.select(rest))] if len(rest) else []
    parts += [batch_of(unknown(taxels))] * len(rows)
    return gathered(parts, np.concatenate([rest, rows]), count, taxels)
