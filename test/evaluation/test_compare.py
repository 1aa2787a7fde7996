# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Paired comparisons with known answers: equal, constructed, unequal, unlucky."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import compare
from tactile_ros.evaluation.recording_files import LiveContacts, LoadedRecording
from tactile_ros.evaluation.replay import replay
from tactile_ros.evaluation.report import write_comparison
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, Frame, Layout, Recording

BOARD = Layout(np.zeros((2, 3)), ('Bx',), 'T')
GROUPS, EACH = 20, 10
COUNT = GROUPS * EACH


def recording(groups: int = GROUPS, **changes: object) -> Recording:
    """Frames with a force, a place that never repeats and a label, in press cycles."""
    rng = np.random.default_rng(1)
    count = groups * EACH
    truth = {
        'force': rng.normal(size=(count, 3)), 'position': rng.normal(size=(count, 3)),
        'label': np.arange(count) % 3, 'repetition': np.repeat(np.arange(groups), EACH),
        **changes,
    }  # fmt: skip
    return Recording.from_arrays(BOARD, rng.normal(size=(count, 2, 1)), truth=truth)


def competitor(
    name: str, sigma: float, seed: int, one: Recording | None = None, **columns: np.ndarray
) -> compare.Competitor:
    """Estimates that err by so much, half of it in common in a press cycle."""
    one = recording() if one is None else one
    rng = np.random.default_rng(seed)
    count, cycle = len(one), one.truth['repetition']
    error = sigma * (rng.normal(size=(count, 3)) + rng.normal(size=(cycle.max() + 1, 3))[cycle])
    known = {
        'force': one.truth['force'] + error, 'position': one.truth['position'] + 1e-3 * error,
        'label': np.arange(count) % 3, 'valid': np.ones(count, bool), **columns,
    }  # fmt: skip
    return compare.Competitor(name, (one,), (ContactStates.assemble(count, 2, known),))


def test_equal_estimates_do_not_differ() -> None:
    found = compare.compare(competitor('a', 0.1, 0), competitor('b', 0.1 * (1 + 1e-13), 0))
    targets = ['position', 'force_x', 'force_y', 'force_z', 'label']
    assert [each.target for each in found] == targets
    for each in found:
        assert (each.low, each.difference, each.high, each.p) == (0.0, 0.0, 0.0, 1.0)


def test_a_constructed_difference_is_found_in_its_size() -> None:
    worse, better = competitor('a', 0.2, 1), competitor('b', 0.1, 2)
    place, force, *_, label = compare.compare(worse, better)
    assert (place.measure, place.unit, force.measure, force.unit) == ('mean', 'mm', 'RMSE', 'N')
    assert force.low < -0.1 * np.sqrt(2) < force.high < 0
    assert force.p < 0.001
    truth = worse.recordings[0].truth
    figures = (place.first, force.first), (place.second, force.second)
    for each, shown in zip((worse, better), figures, strict=True):
        off = each.states[0].position[:, :2] - truth['position'][:, :2]
        error = each.states[0].force[:, 0] - truth['force'][:, 0]
        mean, rms = np.linalg.norm(off, axis=1).mean(), np.sqrt((error**2).mean())
        assert shown == pytest.approx((1e3 * mean, rms))
    assert (label.first, label.p) == (0.0, 1.0)
    turned = compare.compare(better, worse)[1]
    assert turned.difference == pytest.approx(-force.difference)
    assert turned.p == pytest.approx(force.p, abs=0.001)
    again = compare.compare(worse, better, seed=5)[0]
    assert compare.row_of(again) == compare.row_of(compare.compare(worse, better, seed=5)[0])
    assert again.low != place.low
    twice = (compare.Competitor(c.name, c.recordings * 2, c.states * 2) for c in (worse, better))
    assert len(compare.compare(*twice)[1].by_group) == 2 * GROUPS


def test_wrong_and_missing_classes_are_wrong() -> None:
    label = recording().truth['label'].copy()
    label[:20], label[20:40] = -1, (label[20:40] + 1) % 3
    tared = replace(recording(), tare=np.arange(COUNT) >= 160)  # tares are not judged
    one, other = competitor('a', 0.1, 0, tared), competitor('b', 0.1, 0, tared, label=label)
    found = compare.compare(one, other)[-1]
    assert (found.second, found.unit, found.frames) == (pytest.approx(25.0), '%', 160)


def test_chance_alone_is_rarely_significant_and_inside_the_interval() -> None:
    small = recording(8)
    ran = [competitor('ab'[k % 2], 0.1, k, small) for k in range(120)]
    found = [compare.compare(*pair)[1] for pair in zip(ran[::2], ran[1::2], strict=True)]
    assert sum(each.p <= 0.05 for each in found) <= 7
    assert sum(each.low <= 0.0 <= each.high for each in found) >= 50


def test_few_groups_are_swapped_exactly_and_said() -> None:
    sums = np.array([[1.0, 2.0], [3.0, 3.5], [2.0, 1.0], [0.5, 4.0]])
    least = abs(np.subtract(*sums.sum(axis=0)))
    signs = product((1, -1), repeat=4)
    reached = [abs(np.dot(s, sums[:, 1] - sums[:, 0])) >= least - 1e-12 for s in signs]
    rng = np.random.default_rng(0)
    assert compare.swap_probability(sums, np.full(4, 2.0), False, rng) == np.mean(reached)
    small = recording(3)
    found = compare.compare(competitor('a', 0.3, 0, small), competitor('b', 0.1, 1, small))[1]
    assert found.p >= 0.25
    assert 'a and b, force_x: 3 groups: p cannot fall below 0.25' in found.sentences[0]


def test_frames_that_one_alone_estimates_are_left_out_and_told() -> None:
    one, other = competitor('a', 0.1, 0), competitor('b', 0.1, 1, valid=np.arange(COUNT) >= 7)
    found = compare.compare(one, other)[1]
    assert (found.frames, found.single) == (COUNT - 7, (7, 0))
    assert found.sentences == ['a and b, force_x: 7 frames that only a estimates are not compared']
    silent = replace(one, name='b', states=(ContactStates.assemble(COUNT, 2, {}),))
    with pytest.raises(ValueError, match='a and b estimate nothing in common'):
        compare.compare(one, silent)


@pytest.mark.parametrize(
    ('changed', 'why'),
    [
        (recording(5), '50 frames, not 200'),
        (replace(recording(), values=recording().values + 1e-9), 'frames with other readings'),
        (recording(label=np.zeros(COUNT, int)), 'another truth of label'),
        (recording(label=None), 'another truth of label'),
        (None, '2 recordings, not 1'),
    ],
)
def test_unequal_data_are_refused(changed: Recording | None, why: str) -> None:
    one = competitor('a', 0.1, 0)
    other = competitor('b', 0.1, 0, changed or recording())
    other = other if changed else compare.Competitor('b', one.recordings * 2, one.states * 2)
    wanted = f'^b must have the frames and the truth of a; it has {why}$'
    with pytest.raises(ValueError, match=wanted):
        compare.compare(one, other)


def test_estimators_are_judged_on_groups_that_they_did_not_learn() -> None:
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial']
    rows = np.flatnonzero(~spatial.tare & (spatial.truth['position'][:, 0] > 0.0115))
    presses = spatial.select(np.sort(np.r_[rows - 1, rows]))
    loaded = [LoadedRecording('presses', presses)]
    found = compare.held_out('grid_knn', lambda: spec.pipeline(None, 'grid_knn'), loaded)
    knows = compare.judge('all', spec.pipeline(None, 'grid_knn').fit(presses), loaded)
    (each,) = (one for one in compare.compare(found, knows) if one.target == 'position')
    assert each.frames == len(rows)
    assert each.second < 0.8 * each.first  # a fit that knows the places errs less on them
    assert each.p < 0.01


def test_tares_of_a_bag_that_tells_no_rest_are_left_out_and_told() -> None:
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial'].select(slice(0, 120))
    rows, truth = np.arange(120), {'position': spatial.truth['position']}
    run = replace(
        spatial, stamp_ns=10_000_000 * rows, sequence=rows, stream=0 * rows, tare=None, truth=truth
    )
    loaded = [LoadedRecording('bag', run, baselines=(Frame(0, 5, spatial.values[0]),))]
    found = compare.held_out('grid_knn', lambda: spec.pipeline(None, 'grid_knn'), loaded)
    assert np.isfinite(found.states[0].position[:, 0]).all()
    untared = spec.pipeline(None, 'grid_knn').fit(run)
    assert '1 tares of the bag are left out' in replay(loaded[0], untared).problems[0]


def test_live_runs_are_compared_by_what_they_said() -> None:
    one = competitor('a', 0.1, 0)
    rows = np.arange(COUNT)
    live_run = LiveContacts(rows, one.states[0], rows)
    bag = LoadedRecording('sensor', one.recordings[0], live_run)
    assert {each.p for each in compare.compare(one, compare.live('bag', [bag]))} == {1.0}
    named = replace(bag, label_names=('x', 'y', 'z'))  # their numbers are not known
    assert compare.compare(one, compare.live('bag', [named]))[-1].target == 'force_z'
    with pytest.raises(RecordingError, match='bag holds no contacts of a live run'):
        compare.live('bag', [replace(bag, contacts=None)])


@pytest.mark.parametrize('name', ['out/a.svg', 'out/a.html'])
def test_comparisons_are_drawn(name: str, tmp_path: Path) -> None:
    found = compare.compare(competitor('a<b>', 0.2, 1), competitor('c', 0.1, 2))
    text = write_comparison(tmp_path / name, found, 'tactile compare').read_text()
    assert 'Normal force' in text
    assert 'a&lt;b&gt;' in text
    assert 'a<b>' not in text
