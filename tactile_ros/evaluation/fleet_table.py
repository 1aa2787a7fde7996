"""Outcomes of many recordings as one table, and as files: json for people, npz for programs."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.calibration import write_beside
from tactile_ros.evaluation.archive import save_arrays
from tactile_ros.evaluation.fleet import merged
from tactile_ros.evaluation.tally import BINS, LEAST, RATIO

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from tactile_ros.evaluation.answer_tally import AnswerTally
    from tactile_ros.evaluation.fleet import Outcome
    from tactile_ros.evaluation.metrics import Spread
    from tactile_ros.evaluation.sensor_tally import SensorTally
    from tactile_ros.evaluation.tally import Magnitudes, TargetTally

Cell = str | float | int | None
COLUMNS = (
    'recording', 'estimator', 'calibration', 'place mean (mm)', 'p50', 'p95', 'normal RMSE (N)',
    'shear RMSE (N)', 'place in 1 sigma (%)', 'force in 1 sigma (%)', 'contact right (%)',
    'cell right (%)', 'label right (%)', 'slip right (%)', 'latency p50 (ms)', 'p99 (ms)',
    'dropped', 'frames', 'us/frame', 'us/frame batch',
)  # fmt: skip
SCHEMA = 1


def table(outcomes: Sequence[Outcome]) -> tuple[list[str], list[list[Cell]]]:
    """Columns and rows: one row per sensor and calibration, then all together.

    Parameters
    ----------
    outcomes : sequence of Outcome
        Of `tally_all`.

    Returns
    -------
    columns : list of str
        Units in the names.
    rows : list of list
        Columns that nobody has a value for are left out.
    """
    tallies = [one for outcome in outcomes for one in outcome.tallies]
    whole = merged(outcomes)
    every = tallies if whole is None else [*tallies, whole]
    rows = [row_of(one, answer) for one in every for answer in one.answers]
    if len({row[2] for row in rows}) < 2:
        for row in rows:
            row[2] = None
    kept = [i for i in range(len(COLUMNS)) if any(_known(row[i]) for row in rows)]
    return [COLUMNS[i] for i in kept], [[row[i] for i in kept] for row in rows]


def row_of(one: SensorTally, answer: AnswerTally) -> list[Cell]:
    """Cells of `COLUMNS`; None: not measured."""
    place, normal = answer.targets.get('position'), answer.targets.get('force_z')
    seen = None if place is None else place.errors.spread
    forces = [t for name, t in answer.targets.items() if name.startswith('force')]
    delay = one.latency.spread
    shear = answer.shear
    return [
        one.title,
        answer.name,
        answer.calibration,
        *((None, None, None) if seen is None else [1e3 * x for x in _place(seen)]),
        None if normal is None else normal.errors.spread.rms,
        shear.spread.rms if shear.count else None,
        _share([] if place is None else [place]),
        _share(forces),
        *(_right(answer, name) for name in ('in_contact', 'cell', 'label', 'slip')),
        1e3 * delay.p50 if delay.count else None,
        1e3 * delay.p99 if delay.count else None,
        one.dropped,
        one.frames,
        answer.us_single,
        answer.us_batch,
    ]


def _place(seen: Spread) -> tuple[float, float, float]:
    return seen.mean, seen.p50, seen.p95


def _share(targets: Sequence[TargetTally]) -> float | None:
    """Share of all components inside one sigma (%)."""
    judged = sum(t.judged for t in targets)
    inside = sum(t.inside for t in targets)
    return 100 * inside / judged if judged else None


def _right(answer: AnswerTally, name: str) -> float | None:
    """Share of right answers (%)."""
    return 100 * answer.classes[name].share if name in answer.classes else None


def _known(cell: Cell) -> bool:
    return cell is not None and not (isinstance(cell, float) and math.isnan(cell))


def save(
    path: Path, outcomes: Sequence[Outcome], command: str, environment: Mapping[str, str]
) -> tuple[Path, Path]:
    """Write the result beside one another as `<path>.json` and `<path>.npz`.

    Parameters
    ----------
    path : Path
        Without a suffix.
    outcomes : sequence of Outcome
        Of `tally_all`.
    command : str
        That repeats it.
    environment : mapping
        Of `benchmark.environment`.

    Returns
    -------
    tuple of Path
        Both files. The npz holds the histograms of all errors, `<i>/<j>/<target>` for recording i
        and answer j as the json lists them, and the edges of their bins.
    """
    whole = merged(outcomes)
    tallies = [one for outcome in outcomes for one in outcome.tallies]
    document = {
        'schema': SCHEMA,
        'command': command,
        'environment': dict(environment),
        'quantiles': 'from bins of 1 %: to within half a per cent; sums are exact',
        'recordings': [_sensor(one) for one in tallies],
        'all': None if whole is None else _sensor(whole),
        'failed': {o.job.recording: o.failure for o in outcomes if o.failure},
    }
    arrays: dict[str, npt.NDArray[np.generic]] = {
        'schema': np.array(SCHEMA), 'bin_edges': LEAST * RATIO ** np.arange(BINS + 1)
    }  # fmt: skip
    for i, one in enumerate(tallies):
        for j, answer in enumerate(one.answers):
            for name, target in answer.targets.items():
                arrays[f'{i}/{j}/{name}'] = target.errors.bins
    text = json.dumps(document, indent=1, allow_nan=False) + '\n'
    return (
        write_beside(path.with_name(f'{path.name}.json'), text.encode()),
        save_arrays(arrays, path.with_name(f'{path.name}.npz')),
    )


def _sensor(one: SensorTally) -> dict[str, object]:
    """A sensor as json has it."""
    return {
        'recording': one.source,
        'sensor': one.name,
        'frames': one.frames,
        'dropped': one.dropped,
        'seconds': _number(one.seconds),
        'latency': _magnitudes(one.latency, 's'),
        'truth': dict(one.association),
        'problems': list(one.problems),
        'answers': [_answer(answer) for answer in one.answers],
    }


def _answer(answer: AnswerTally) -> dict[str, object]:
    agreement = answer.agreement
    return {
        'estimator': answer.name,
        'calibration': answer.calibration,
        'us_single': _number(answer.us_single),
        'us_batch': _number(answer.us_batch),
        'difference_to_live': None if agreement is None else _number(agreement.largest),
        'frames_without_contacts': None if agreement is None else agreement.without_contacts,
        'problems': list(answer.problems),
        'targets': {
            name: {
                **_magnitudes(target.errors, target.unit),
                'inside_one_sigma': target.inside,
                'judged': target.judged,
                'missed': target.missed,
                'invalid': target.invalid,
            }
            for name, target in answer.targets.items()
        },
        'classes': {
            name: {'right': c.right, 'wrong': c.wrong, 'abstained': c.abstained}
            for name, c in answer.classes.items()
        },
    }


def _magnitudes(found: Magnitudes, unit: str) -> dict[str, object]:
    """Summary, and the exact sums (2**-1200 of the unit, hexadecimal) that can be added up."""
    seen = found.spread
    return {
        'unit': unit,
        'count': found.count,
        **{n: _number(getattr(seen, n)) for n in ('mean', 'rms', 'p50', 'p95', 'p99', 'largest')},
        'sum': hex(found.total),
        'sum_of_squares': hex(found.squares),
    }


def _number(value: float) -> float | None:
    """A number as json has it."""
    return float(value) if math.isfinite(value) else None
