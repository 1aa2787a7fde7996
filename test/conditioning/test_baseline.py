"""The no-contact reference against plain loops: runs, means, tracking live and in batch."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.conditioning.baseline import (
    BaselineTracker,
    Tracking,
    stream_baselines,
    tare_means,
    tare_runs,
    track_streams,
)
from tactile_ros.types import Layout, Recording

SHAPE = (2, 3)
LAYOUT = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T')
SCALE = np.full(SHAPE, 1.0)
PERIOD_NS = 100
TRACKING = Tracking(SCALE, PERIOD_NS, 0.5)

ROWS = st.lists(st.tuples(st.booleans(), st.integers(0, 4)), max_size=30)


def plain_runs(tare: list[bool], restarts: list[bool]) -> tuple[list[int], list[int]]:
    """The definition, one row at a time."""
    runs, serves, count, running, serving = [], [], 0, False, -1
    for resting, again in zip(tare, restarts, strict=True):
        if again:
            running, serving = False, -1
        if resting and not running:
            serving, count = count, count + 1
        running = resting
        runs.append(serving if resting else -1)
        serves.append(serving)
    return runs, serves


@given(ROWS)
def test_runs_are_those_of_the_definition(rows: list[tuple[bool, int]]) -> None:
    tare = np.array([resting for resting, _ in rows], bool)
    restarts = np.array([i == 0 or again == 0 for i, (_, again) in enumerate(rows)], bool)
    run, serves = tare_runs(tare, restarts)
    wanted = plain_runs(tare.tolist(), restarts.tolist())
    assert (run.tolist(), serves.tolist()) == wanted


@given(st.lists(st.integers(-1, 3), max_size=20), st.integers(0, 99))
def test_means_pass_over_lost_readings(numbers: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(len(numbers), *SHAPE))
    values[rng.random(values.shape) < 0.2] = np.nan
    # runs are numbered without holes
    run = np.array(numbers, np.int64)
    run[run >= 0] = np.unique(run[run >= 0], return_inverse=True)[1].reshape(-1)
    means = tare_means(values, run)
    assert means.shape == (run.max(initial=-1) + 1, *SHAPE)
    for m, mean in enumerate(means):
        for taxel, channel in np.ndindex(*SHAPE):
            known = [x for x in values[run == m][:, taxel, channel] if not np.isnan(x)]
            wanted = sum(known) / len(known) if known else np.nan
            np.testing.assert_allclose(mean[taxel, channel], wanted, rtol=1e-12)


def plain_tracker(
    start: np.ndarray, values: np.ndarray, stamp_ns: np.ndarray, tracking: Tracking
) -> np.ndarray:
    """The definition with lists: a period's frames, then a step if all of them rested."""
    level, block, begin, held = start.copy(), [], 0, []
    for frame, now in zip(values, stamp_ns.tolist(), strict=True):
        if block and now - begin >= tracking.period_ns:
            if all((np.abs(x - level) <= tracking.scale).all() for x in block):
                level = level + tracking.gain * (np.mean(block, axis=0) - level)
            block = []
        if not block:
            begin = now
        block.append(frame)
        held.append(level)
    return np.array(held).reshape(len(values), *SHAPE)


def drifting(samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Drift, contacts, lost readings; irregular stamps with gaps."""
    rng = np.random.default_rng(seed)
    step = rng.integers(1, 60, samples)
    step[rng.random(samples) < 0.05] = 1000
    values = np.cumsum(rng.normal(0, 0.05, (samples, *SHAPE)), axis=0)
    touched = np.cumsum(rng.random(samples) < 0.05) % 2 == 1
    values[touched] += 3.0
    values[rng.random(values.shape) < 0.002] = np.nan
    return values, 1_700_000_000_000_000_000 + np.cumsum(step)


@given(st.integers(0, 80), st.integers(0, 10_000), st.lists(st.integers(0, 80), max_size=4))
@settings(max_examples=60)
def test_tracking_one_by_one_in_pieces_and_in_batch(
    samples: int, seed: int, cuts: list[int]
) -> None:
    values, stamp_ns = drifting(samples, seed)
    start = np.zeros(SHAPE)
    wanted = plain_tracker(start, values, stamp_ns, TRACKING)
    tracker = BaselineTracker(start, TRACKING)
    np.testing.assert_allclose(tracker(values, stamp_ns), wanted, rtol=0, atol=1e-12)
    edges = [0, *sorted(min(cut, samples) for cut in cuts), samples]
    for pieces in (
        list(pairwise(edges)),
        [(i, i + 1) for i in range(samples)],
    ):
        pieced = BaselineTracker(start, TRACKING)
        held = [pieced(values[a:b], stamp_ns[a:b]) for a, b in pieces]
        found = np.concatenate(held) if held else np.zeros((0, *SHAPE))
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)
        np.testing.assert_allclose(pieced.baseline, tracker.baseline, rtol=0, atol=1e-12)


def test_what_is_no_reading_is_followed_with_the_readings_and_says_nothing_about_rest() -> None:
    values, stamp_ns = drifting(400, 3)
    warmth = np.linspace(20.0, 90.0, 400)[:, None] * np.ones(SHAPE[0])
    warmth[200:] = np.nan
    start, beside = np.zeros(SHAPE), np.concatenate([values, warmth[..., None]], axis=2)
    plain = BaselineTracker(start, TRACKING)(values, stamp_ns)
    more = np.concatenate([start, np.full((SHAPE[0], 1), 20.0)], axis=1)
    held = BaselineTracker(more, TRACKING)(beside, stamp_ns)
    np.testing.assert_array_equal(held[..., :-1], plain)
    assert 20.0 < held[199, 0, -1] < 60.0  # a slow mean of what was told
    assert np.isnan(held[-1, :, -1]).all()
    unknown = np.concatenate([start, np.full((SHAPE[0], 1), np.nan)], axis=1)
    found = BaselineTracker(unknown, TRACKING)(beside[:200], stamp_ns[:200])
    np.testing.assert_array_equal(found[..., :-1], plain[:200])


@pytest.mark.parametrize('untold', [slice(None, None, 7), slice(30, 31), slice(40, 90)])
def test_frames_that_tell_no_temperature_cost_no_others(untold: slice) -> None:
    stamp_ns = np.arange(200) * 10  # ten frames a block
    values = np.zeros((200, *SHAPE))
    warmth = np.full((200, SHAPE[0], 1), 30.0)
    warmth[untold] = np.nan
    beside = np.concatenate([values, warmth], axis=2)
    start = np.concatenate([np.zeros(SHAPE), np.full((SHAPE[0], 1), 20.0)], axis=1)
    tracker = BaselineTracker(start, TRACKING)
    held = tracker(beside, stamp_ns)
    assert (held[-1, :, -1] > 29.0).all()
    pieced = BaselineTracker(start, TRACKING)
    one = np.concatenate([pieced(beside[i : i + 1], stamp_ns[i : i + 1]) for i in range(200)])
    np.testing.assert_array_equal(one, held)


def test_drift_is_followed_at_rest_and_a_held_contact_does_not_fade() -> None:
    stamp_ns = np.arange(4000) * 10
    drift = np.linspace(0, 8, 4000)[:, None, None] * np.ones(SHAPE)
    tracker = BaselineTracker(np.zeros(SHAPE), TRACKING)
    held = tracker(drift, stamp_ns)
    assert np.abs(held - drift).max() < 0.2
    level = tracker.baseline.copy()
    touch = np.full((2000, *SHAPE), 10.0)
    tracker(touch, stamp_ns[-1] + 10 + np.arange(2000) * 10)
    assert np.abs(tracker.baseline - level).max() < 0.2
    assert tracker.baseline.max() < 8.2


@pytest.mark.parametrize('what', ['no stamps', 'no tracking', 'no threshold', 'lost taxel'])
def test_nothing_is_followed_without(what: str) -> None:
    values, stamp_ns = np.full((50, *SHAPE), 0.5), np.arange(50) * PERIOD_NS
    start = np.zeros(SHAPE)
    tracking: Tracking | None = TRACKING
    if what == 'no tracking':
        tracking = None
    elif what == 'no threshold':
        tracking = Tracking(np.full(SHAPE, np.nan), PERIOD_NS)
    elif what == 'lost taxel':
        values[:, 0] = np.nan
    held = BaselineTracker(start, tracking)(values, None if what == 'no stamps' else stamp_ns)
    assert held.shape == values.shape
    assert not held.any()


@pytest.mark.parametrize(('size', 'followed'), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize('sign', [1, -1])
def test_the_threshold_of_contact_is_the_threshold_of_rest(
    size: float, followed: bool, sign: int
) -> None:
    values = np.zeros((50, *SHAPE))
    values[:, 1, 2] = sign * size
    tracker = BaselineTracker(np.zeros(SHAPE), TRACKING)
    tracker(values, np.arange(50) * PERIOD_NS // 5)
    assert (tracker.baseline[1, 2] != 0) == followed


def test_an_unknown_baseline_stays_unknown() -> None:
    start = np.array([[0.0, 0, 0], [0, np.nan, 0]])
    held = BaselineTracker(start, TRACKING)(np.zeros((9, *SHAPE)), np.arange(9) * PERIOD_NS)
    np.testing.assert_array_equal(held, np.broadcast_to(start, held.shape))


def plain_baselines(
    recording: Recording, values: np.ndarray, start: np.ndarray, tracking: Tracking | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The definition: walk the rows, tare at every run, follow frames in between."""
    samples = len(recording)
    base = np.zeros((samples, *SHAPE))
    restart = np.zeros(samples, bool)
    tare = np.zeros(samples, bool) if recording.tare is None else recording.tare.copy()
    tracker = BaselineTracker(start, tracking)
    row = 0
    while row < samples:
        if recording.restarts[row]:
            tracker = BaselineTracker(start, tracking)
        restart[row] = bool(recording.restarts[row]) or bool(tare[row - 1] and row > 0)
        if not tare[row]:
            stamp = None if recording.stamp_ns is None else recording.stamp_ns[row : row + 1]
            base[row] = tracker(values[row : row + 1], stamp)[0]
            row += 1
            continue
        end = row + 1
        while end < samples and tare[end] and not recording.restarts[end]:
            end += 1
        known = np.isfinite(values[row:end]).sum(axis=0)
        if (known == 0).any(axis=1).all():
            tare[row:end] = False
            continue
        total = np.nansum(values[row:end], axis=0)
        level = np.where(known > 0, total / np.maximum(known, 1), np.nan)
        base[row:end] = level
        restart[row + 1 : end] = True
        tracker = BaselineTracker(level, tracking)
        row = end
    if recording.stamp_ns is None:
        restart[:] = True
    return base, restart, tare


@given(
    st.integers(0, 60), st.integers(0, 10_000), st.sampled_from(['stamped', 'not']), st.booleans()
)
@settings(max_examples=80)
def test_baselines_of_a_recording_are_those_of_the_definition(
    samples: int, seed: int, stamped: str, tracked: bool
) -> None:
    rng = np.random.default_rng(seed)
    values, stamp_ns = drifting(samples, seed)
    stream = np.cumsum(rng.random(samples) < 0.08) % 3
    tare = rng.random(samples) < 0.15 if seed % 4 else None
    values[rng.random(samples) < 0.1] = np.nan
    recording = Recording.from_arrays(
        LAYOUT,
        values,
        stamp_ns=stamp_ns if stamped == 'stamped' else None,
        stream=stream,
        tare=tare,
    )
    tracking = TRACKING if tracked else None
    start = np.full(SHAPE, 0.25)
    base, _, restart, rows = stream_baselines(recording, values, start, tracking)
    wanted, again, tared = plain_baselines(recording, values, start, tracking)
    np.testing.assert_allclose(base, wanted, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(restart, again)
    np.testing.assert_array_equal(rows, tared)


def test_stretches_shorter_than_a_period_are_left_alone() -> None:
    base = np.zeros((6, *SHAPE))
    values, stamp_ns = np.full((6, *SHAPE), 0.5), np.array([0, 50, 99, 0, 60, 120])
    begins = np.array([True, False, False, True, False, False])
    track_streams(base, values, stamp_ns, begins, TRACKING)
    assert base[:, 0, 0].tolist() == [0, 0, 0, 0, 0, 0.25]
