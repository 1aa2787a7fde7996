from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_ros.evaluation.metrics import (
    frames_dropped,
    place_groups,
    spread,
    target_errors,
)
from tactile_ros.types import ContactStates, Layout, Recording

LAYOUT = Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T')


def plain_percentile(values: list[float], percent: float) -> float:
    """Linear interpolation between order statistics, written out."""
    ordered = sorted(values)
    place = percent / 100 * (len(ordered) - 1)
    low = math.floor(place)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (place - low) * (ordered[high] - ordered[low])


def test_spread_against_plain_sums() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=101)
    values[::7] = np.nan
    known = [abs(x) for x in values.tolist() if not math.isnan(x)]
    found = spread(values)
    assert found.count == len(known)
    assert found.mean == pytest.approx(sum(known) / len(known), rel=1e-14)
    assert found.rms == pytest.approx(math.sqrt(sum(x * x for x in known) / len(known)), rel=1e-14)
    for name, percent in (('p50', 50), ('p95', 95), ('p99', 99)):
        assert getattr(found, name) == pytest.approx(plain_percentile(known, percent), rel=1e-14)
    assert found.largest == max(known)
    assert spread([math.nan]).count == 0
    assert math.isnan(spread([]).mean)


def states_of(**known: np.ndarray) -> ContactStates:
    samples = len(next(iter(known.values())))
    return ContactStates.assemble(samples, 5, {'valid': np.ones(samples, bool), **known})


def test_errors_of_position_and_force_against_plain_loops() -> None:
    rng = np.random.default_rng(3)
    samples = 60
    place = np.repeat(rng.uniform(-0.01, 0.01, (12, 2)), 5, axis=0)
    position = np.column_stack([place, np.full(samples, np.nan)])
    position[7] = np.nan
    force = np.full((samples, 3), np.nan)
    force[::2, 2] = rng.uniform(0, 5, 30)
    guess = position + rng.normal(0, 1e-3, (samples, 3))
    guess[9] = np.nan
    push = np.nan_to_num(force) + rng.normal(0, 0.1, (samples, 3))
    recording = Recording.from_arrays(
        LAYOUT, np.zeros((samples, 5, 3)), truth={'position': position, 'force': force}
    )
    valid = np.ones(samples, bool)
    valid[11] = False
    states = states_of(
        position=guess,
        position_cov=np.tile(1e-6 * np.eye(3), (samples, 1, 1)),
        force=push,
        force_cov=np.tile(0.01 * np.eye(3), (samples, 1, 1)),
        valid=valid,
    )
    place_error, push_error = target_errors(recording, states)
    rows = [k for k in range(samples) if k not in (7, 9, 11)]
    sizes = [math.hypot(*(guess[k, :2] - position[k, :2])) for k in rows]
    assert place_error.spread.mean == pytest.approx(sum(sizes) / len(sizes), rel=1e-12)
    assert (place_error.missed, place_error.invalid) == (1, 1)
    inside = [abs(guess[k, a] - position[k, a]) <= 1e-3 for k in rows for a in (0, 1)]
    assert place_error.coverage.share == pytest.approx(sum(inside) / len(inside))
    assert place_error.coverage.groups == 12
    assert (place_error.name, place_error.unit) == ('position', 'm')
    squares = [(push[k, 2] - force[k, 2]) ** 2 for k in range(0, samples, 2)]
    assert push_error.name == 'force_z'
    assert push_error.spread.rms == pytest.approx(math.sqrt(sum(squares) / 30), rel=1e-12)
    assert push_error.rows.tolist() == list(range(0, samples, 2))


def test_nothing_known_means_no_errors() -> None:
    recording = Recording.from_arrays(LAYOUT, np.zeros((4, 5, 3)))
    assert target_errors(recording, states_of(force=np.zeros((4, 3)))) == ()


def test_places_that_do_not_repeat_give_way_to_other_groups() -> None:
    plane = np.array([[0.0, 0.0], [0.0, 1e-6], [1e-3, 0.0], [1e-3, 0.0], [np.nan, 0.0]])
    otherwise = np.arange(5)
    assert place_groups(plane, otherwise).tolist() == [0, 0, 1, 1, -1]
    lone = np.column_stack([np.arange(5.0), np.zeros(5)])
    assert place_groups(lone, otherwise) is otherwise


def test_dropped_frames_are_gaps_inside_streams() -> None:
    sequence = np.array([5, 6, 9, 10, 0, 1, 4])
    restarts = np.array([True, False, False, False, True, False, False])
    assert frames_dropped(sequence, restarts) == 2 + 2
    assert frames_dropped(None, restarts) == 0
    assert frames_dropped(sequence[:1], restarts[:1]) == 0
