"""A recording that was judged in pieces as reports take it: drawings of kept rows, exact sums."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.metrics import TARGETS, Judged, Named, place_groups, summarised
from tactile_ros.evaluation.result import Answer, Dataset

if TYPE_CHECKING:
    from tactile_ros.evaluation.answer_tally import AnswerTally
    from tactile_ros.evaluation.kept_rows import AnswerRows, Rows, SensorRows
    from tactile_ros.evaluation.metrics import TargetErrors
    from tactile_ros.evaluation.sensor_tally import SensorTally
    from tactile_ros.evaluation.tally import TargetTally


def dataset_of(one: SensorTally) -> Dataset:
    """One sensor for a report.

    Parameters
    ----------
    one : SensorTally
        With rows, as `Job.drawn` asks for.

    Returns
    -------
    Dataset
        Every figure is of all rows; drawings show those that were kept. Answers that truth can
        judge come first; the agreement is that of the one nearest to the live run.

    Raises
    ------
    ValueError
        If no rows were kept.
    """
    rows = one.rows
    if rows is None:
        msg = f'rows of {one.name} must be kept to be drawn; received none'
        raise ValueError(msg)
    latency = rows.latency.columns.get('latency_s', np.zeros(0))
    answers = sorted(one.answers, key=lambda answer: not _judged(answer))
    agreements = [answer.agreement for answer in answers if answer.agreement is not None]
    sentences = [*one.problems, *(text for answer in one.answers for text in answer.problems)]
    return Dataset(
        name=one.title,
        summary='; '.join(f'{topic}: {how}' for topic, how in one.association.items()),
        answers=tuple(_answer(answer, rows, _name(answer, one)) for answer in answers),
        frames=one.frames,
        dropped=one.dropped,
        chips=rows.chips,
        latency_s=np.asarray(latency, np.float64),
        late=one.latency.spread if rows.latency.step > 1 else None,
        agreement=min(agreements, key=lambda found: found.largest, default=None),
        problems=tuple(dict.fromkeys([*sentences, *_thinned(one, rows)])),
    )


def _judged(answer: AnswerTally) -> bool:
    """Whether any error is known."""
    return any(target.errors.count for target in answer.targets.values())


def _name(answer: AnswerTally, one: SensorTally) -> str:
    """Of the estimators; with the calibration where several have the same ones."""
    same = [other.name for other in one.answers].count(answer.name) > 1
    return f'{answer.name}, {answer.calibration}' if same else answer.name


def _answer(answer: AnswerTally, rows: SensorRows, name: str) -> Answer:
    """One pipeline's errors and names."""
    own = rows.answers[answer.calibration]
    targets = [
        _target(name, kept, answer.targets[name], rows) for name, kept in own.targets.items()
    ]
    order = list(TARGETS)
    return Answer(
        name,
        tuple(sorted(targets, key=lambda target: order.index(target.name))),
        answer.us_single,
        answer.us_batch,
        named=_named(answer, own),
    )


def _target(name: str, kept: Rows, tally: TargetTally, rows: SensorRows) -> TargetErrors:
    """Errors of one target."""
    columns = kept.columns
    truth, estimate, variance = (
        np.asarray(columns[key], np.float64) for key in ('truth', 'estimate', 'variance')
    )
    seen = Judged(
        np.asarray(columns['row'], np.int64), truth, estimate, estimate - truth, variance,
        tally.missed, tally.invalid,
    )  # fmt: skip
    groups = rows.groups(columns)
    if name == 'position':
        groups = place_groups(truth, groups)
    found = summarised(name, seen, groups, np.asarray(columns['time_s'], np.float64))
    if kept.step == 1:
        return found
    share = tally.inside / tally.judged if tally.judged else float('nan')
    coverage = replace(found.coverage, share=share, count=tally.judged)
    return replace(found, spread=tally.errors.spread, coverage=coverage)


def _named(answer: AnswerTally, own: AnswerRows) -> tuple[Named, ...]:
    """Classes that are both known and named somewhere."""
    found = []
    for kind, kept in own.named.items():
        tally, columns = answer.classes[kind], kept.columns
        if tally.right + tally.wrong:
            true, said = (np.asarray(columns[key], np.int64) for key in ('true', 'said'))
            found.append(Named(kind, true, said, tally if kept.step > 1 else None))
    return tuple(found)


def _thinned(one: SensorTally, rows: SensorRows) -> list[str]:
    """A sentence where drawings show some of the rows only."""
    steps = [kept.step for own in rows.answers.values() for kept in own.targets.values()]
    if max(steps, default=1) == 1:
        return []
    return [
        f'{one.frames:,} frames are more than drawings hold: they show every {max(steps)}th row '
        'with truth; figures are of all, quantiles to within half a per cent'
    ]
