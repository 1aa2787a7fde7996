from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.evaluation import kept_rows
from tactile_ros.evaluation.answer_tally import AnswerTally
from tactile_ros.evaluation.kept_rows import AnswerRows, Rows, SensorRows
from tactile_ros.evaluation.metrics import named, target_errors
from tactile_ros.evaluation.replay import Agreement
from tactile_ros.evaluation.report import render
from tactile_ros.evaluation.result import Result, table
from tactile_ros.evaluation.sensor_tally import SensorTally
from tactile_ros.evaluation.tallied import dataset_of
from tactile_ros.evaluation.tally import Magnitudes
from tactile_ros.types import STATE_FIELDS, ContactStates, Layout, Recording

if TYPE_CHECKING:
    from tactile_ros.types import Integers

LAYOUT = Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T')
COUNT = 900


@pytest.mark.parametrize('cuts', [[], [1], [399, 400, 401], list(range(0, COUNT, 7))])
def test_which_rows_stay_does_not_depend_on_pieces(
    monkeypatch: pytest.MonkeyPatch, cuts: list[int]
) -> None:
    monkeypatch.setattr(kept_rows, 'MOST', 100)
    rows = Rows()
    for part in np.split(np.arange(COUNT), cuts):
        rows.add({'row': part, 'twice': 2 * part})
    assert rows.step == 16
    assert rows.columns['row'].tolist() == list(range(0, COUNT, 16))
    assert np.array_equal(rows.columns['twice'], 2 * rows.columns['row'])


def test_few_rows_all_stay() -> None:
    rows = Rows()
    assert rows.columns == {}
    rows.add({'row': np.arange(3)})
    assert (rows.step, rows.columns['row'].tolist()) == (1, [0, 1, 2])


def made(seed: int = 0) -> tuple[Recording, ContactStates]:
    """Presses at nine places, forces and cells with noise."""
    rng = np.random.default_rng(seed)
    cell = np.arange(COUNT) // 20 % 9
    place = np.column_stack([1e-3 * (cell % 3), 1e-3 * (cell // 3), np.zeros(COUNT)])
    force = np.column_stack([np.sin(np.arange(COUNT)), np.zeros(COUNT), np.full(COUNT, np.nan)])
    truth = {
        'position': place, 'force': force, 'cell': cell, 'repetition': np.arange(COUNT) // 20,
    }  # fmt: skip
    recording = Recording.from_arrays(
        LAYOUT, np.zeros((COUNT, 5, 3)), stamp_ns=np.arange(COUNT) * 10**7,
        stream=np.arange(COUNT) // 500, truth=truth,
    )  # fmt: skip
    known = {
        'position': place + rng.normal(0, 1e-4, (COUNT, 3)),
        'position_cov': np.tile(1e-8 * np.eye(3), (COUNT, 1, 1)),
        'force': force + rng.normal(0, 0.1, (COUNT, 3)),
        'force_cov': np.tile(1e-2 * np.eye(3), (COUNT, 1, 1)),
        'cell': np.where(rng.random(COUNT) < 0.1, -1, cell),
        'valid': rng.random(COUNT) > 0.02,
    }
    return recording, ContactStates.assemble(COUNT, 5, known)


def tallied(recording: Recording, states: ContactStates, cuts: list[int]) -> SensorTally:
    """The same in pieces."""
    rows, answer = SensorRows(LAYOUT.positions), AnswerTally('ridge', 'c')
    rows.answers['c'] = AnswerRows()
    latency = Magnitudes()
    for part in np.split(np.arange(COUNT), cuts):
        piece, found = recording.select(part), some(states, part)
        rows.answers['c'].add(piece.truth, found, rows.about(piece))
        answer += AnswerTally.of(piece.truth, found)
        rows.latency.add({'latency_s': 1e-3 * (1 + part)})
        latency += Magnitudes.of(1e-3 * (1 + part))
    return SensorTally('sensor', 'bag', (answer,), COUNT, 0, 9.0, latency, rows=rows)


def some(states: ContactStates, rows: Integers) -> ContactStates:
    return ContactStates(**{name: getattr(states, name)[rows] for name in STATE_FIELDS})


@pytest.mark.parametrize('cuts', [[], [1, 37, 640]])
def test_pieces_have_the_groups_and_figures_of_the_whole(cuts: list[int]) -> None:
    recording, states = made()
    dataset = dataset_of(tallied(recording, states, cuts))
    for found, whole in zip(
        dataset.answers[0].targets, target_errors(recording, states), strict=True
    ):
        assert found.name == whole.name
        assert np.array_equal(found.groups, whole.groups)
        assert np.array_equal(found.time_s, whole.time_s)
        assert (found.spread, found.coverage) == (whole.spread, whole.coverage)
    assert dataset.answers[0].named[0].right == named(recording, states)[0].right
    assert dataset.latency.count == COUNT
    assert dataset.problems == ()


def test_figures_of_a_long_recording_are_of_all_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    recording, states = made()
    whole = target_errors(recording, states)
    monkeypatch.setattr(kept_rows, 'MOST', 200)
    dataset = dataset_of(tallied(recording, states, [300]))
    (answer,) = dataset.answers
    for found, other in zip(answer.targets, whole, strict=True):
        assert len(found.rows) <= 200
        assert found.known == COUNT
        assert found.spread.rms == pytest.approx(other.spread.rms, rel=1e-12)
        assert found.spread.largest == other.spread.largest
        assert found.spread.p95 == pytest.approx(other.spread.p95, rel=0.02)
        assert found.coverage.share == other.coverage.share
        assert found.coverage.count == other.coverage.count
    assert answer.named[0].right == pytest.approx(named(recording, states)[0].right)
    assert answer.named[0].abstained == pytest.approx(named(recording, states)[0].abstained)
    assert dataset.latency.largest == 1e-3 * COUNT
    assert 'they show every 8th row with truth' in dataset.problems[0]
    assert 'nan' not in render(Result('x', 'x', {}, (dataset,)))


def test_answers_of_one_estimator_are_told_apart_by_their_calibrations() -> None:
    one = tallied(*made(), [])
    other = replace(one.answers[0], calibration='d')
    assert one.rows is not None
    one.rows.answers['d'] = one.rows.answers['c']
    dataset = dataset_of(replace(one, answers=(one.answers[0], other)))
    assert [answer.name for answer in dataset.answers] == ['ridge, c', 'ridge, d']
    assert len(table(Result('x', 'x', {}, (dataset,)))[1]) == 2


def test_what_truth_can_judge_comes_first_with_the_nearest_agreement() -> None:
    one = tallied(*made(), [])
    assert one.rows is not None
    one.rows.answers['d'] = AnswerRows()
    far, near = (Agreement(1, 0, {'force': apart}) for apart in (np.inf, 1e-13))
    blind = AnswerTally('grid_knn', 'd', agreement=far)
    dataset = dataset_of(replace(one, answers=(blind, replace(one.answers[0], agreement=near))))
    assert [answer.name for answer in dataset.answers] == ['ridge', 'grid_knn']
    assert dataset.agreement is near


def test_rows_that_nobody_kept_are_not_drawn() -> None:
    nothing = SensorTally('sensor', 'bag', (), 1, 0, math.nan)
    with pytest.raises(ValueError, match='must be kept'):
        dataset_of(nothing)
