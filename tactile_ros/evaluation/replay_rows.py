"""A saved result of `tactile replay` as rows of figures, beside those of benches."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

from tactile_ros.evaluation.benchmark import BenchResult, Row

if TYPE_CHECKING:
    from collections.abc import Iterator

MILLI = 1e3


class TargetJson(TypedDict):
    """Errors of one target."""

    unit: str
    mean: float | None
    rms: float | None


class AnswerJson(TypedDict):
    """One calibration on one recording."""

    estimator: str
    calibration: str
    us_single: float | None
    us_batch: float | None
    targets: dict[str, TargetJson]


class RecordingJson(TypedDict):
    """One recording and all that was answered to it."""

    recording: str
    sensor: str
    answers: list[AnswerJson]


class ReplayJson(TypedDict):
    """What `tactile replay` saves."""

    command: str
    recordings: list[RecordingJson]
    failed: dict[str, str]


def replay_result(told: ReplayJson, name: str) -> BenchResult:
    """Every error of a replay, calibrations of one recording as methods on the same data.

    Parameters
    ----------
    told : dict
        Document of a saved replay.
    name : str
        Of its file.

    Returns
    -------
    BenchResult
        Mean error of places (mm), root mean square of all else; recordings that could not be read
        are its notes.

    Raises
    ------
    KeyError, TypeError, AttributeError
        If it is no such document.
    """
    rows = [row for recording in told['recordings'] for row in _rows(recording)]
    notes = [f'left out: {sentence}' for sentence in told['failed'].values()]
    return BenchResult(f'replay {name}', told['command'], [], rows, notes)


def _rows(recording: RecordingJson) -> Iterator[Row]:
    """Figures of one recording."""
    answers = recording['answers']
    names = [answer['estimator'] for answer in answers]
    for answer in answers:
        method = answer['estimator']
        if names.count(method) > 1:
            method = f'{method}, {answer["calibration"]}'
        for target, found in answer['targets'].items():
            place = found['unit'] == 'm'
            error = found['mean'] if place else found['rms']
            what = f'{recording["recording"] or recording["sensor"]}: {target.replace("_", " ")}'
            yield Row(
                f'{what}, {method}', 'mm' if place else found['unit'],
                MILLI * error if place and error is not None else error,
                us_single=answer['us_single'], us_batch=answer['us_batch'],
                compared=what, method=method,
            )  # fmt: skip
