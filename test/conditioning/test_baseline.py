# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The no-contact reference against plain loops: runs, means, tracking live and in batch."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.conditioning.baseline import (
    GAIN,
    PERIOD_NS,
    BaselineTracker,
    Rest,
    Stream,
    held_noise,
    motion_noise,
    rest_noise,
    stream_baselines,
)
from tactile_ros.types import Layout, Recording

SHAPE = (2, 3)
LAYOUT = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T')
SCALE = np.full(SHAPE, 1.0)


def plain_tracker(start: np.ndarray, values: np.ndarray, stamp_ns: np.ndarray) -> np.ndarray:
    """The definition with lists: a period's frames, then a step if all of them rested."""
    level, block, begin, held = start.copy(), [], 0, []
    for frame, now in zip(values, stamp_ns.tolist(), strict=True):
        if block and now - begin >= PERIOD_NS:
            if all((np.abs(x - level) <= SCALE).all() for x in block):
                level = level + GAIN * (np.mean(block, axis=0) - level)
            block = []
        if not block:
            begin = now
        block.append(frame)
        held.append(level)
    return np.array(held).reshape(len(values), *SHAPE)


def drifting(samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Drift, contacts, lost readings; irregular stamps with gaps."""
    rng = np.random.default_rng(seed)
    step = rng.integers(1, 60, samples) * 10_000_000
    step[rng.random(samples) < 0.05] = 10 * PERIOD_NS
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
    wanted = plain_tracker(start, values, stamp_ns)
    tracker = BaselineTracker(start, SCALE)
    np.testing.assert_allclose(tracker.follow(values, stamp_ns)[0], wanted, rtol=0, atol=1e-12)
    edges = [0, *sorted(min(cut, samples) for cut in cuts), samples]
    for pieces in (list(pairwise(edges)), [(i, i + 1) for i in range(samples)]):
        pieced = BaselineTracker(start, SCALE)
        held = [pieced.follow(values[a:b], stamp_ns[a:b])[0] for a, b in pieces]
        found = np.concatenate(held) if held else np.zeros((0, *SHAPE))
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)
        np.testing.assert_allclose(pieced.baseline, tracker.baseline, rtol=0, atol=1e-12)


def test_what_is_no_reading_is_followed_with_the_readings_and_says_nothing_about_rest() -> None:
    values, stamp_ns = drifting(400, 3)
    values = np.where(np.abs(values) > 2, values, 0.3 * values)
    warmth = np.linspace(20.0, 90.0, 400)[:, None] * np.ones(SHAPE[0])
    warmth[200:] = np.nan
    start, beside = np.zeros(SHAPE), np.concatenate([values, warmth[..., None]], axis=2)
    plain = BaselineTracker(start, SCALE).follow(values, stamp_ns)[0]
    more = np.concatenate([start, np.full((SHAPE[0], 1), 20.0)], axis=1)
    held = BaselineTracker(more, SCALE).follow(beside, stamp_ns)[0]
    np.testing.assert_array_equal(held[..., :-1], plain)
    assert 20.0 < held[199, 0, -1] < 60.0  # a slow mean of what was told
    assert np.isnan(held[-1, :, -1]).all()
    unknown = np.concatenate([start, np.full((SHAPE[0], 1), np.nan)], axis=1)
    found = BaselineTracker(unknown, SCALE).follow(beside[:200], stamp_ns[:200])[0]
    np.testing.assert_array_equal(found[..., :-1], plain[:200])


def plain_baselines(
    recording: Recording, values: np.ndarray, start: np.ndarray, scale: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The definition: walk the rows, tare at every run, follow frames in between."""
    samples = len(recording)
    base = np.zeros((samples, *SHAPE))
    restart = np.zeros(samples, bool)
    tare = np.zeros(samples, bool) if recording.tare is None else recording.tare.copy()
    tracker = BaselineTracker(start, scale)
    row = 0
    while row < samples:
        if recording.restarts[row]:
            tracker = BaselineTracker(start, scale)
        restart[row] = bool(recording.restarts[row]) or bool(tare[row - 1] and row > 0)
        if not tare[row]:
            stamp = None if recording.stamp_ns is None else recording.stamp_ns[row : row + 1]
            base[row] = tracker.follow(values[row : row + 1], stamp)[0][0]
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
        tracker = BaselineTracker(level, scale)
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
    scale = SCALE if tracked else None
    start = np.full(SHAPE, 0.25)
    found = stream_baselines(recording, values, BaselineTracker(start, scale))
    wanted, again, tared = plain_baselines(recording, values, start, scale)
    np.testing.assert_allclose(found.levels, wanted, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.restart, again)
    np.testing.assert_array_equal(found.tare, tared)


SAMPLES = 200


def resting(seed: int = 0) -> np.ndarray:
    return 5.0 + 0.1 * np.random.default_rng(seed).normal(size=(SAMPLES, *SHAPE))


def no_restarts(rows: int = SAMPLES) -> np.ndarray:
    return np.arange(rows) == 0


def test_a_baseline_has_the_temperatures_of_its_frames_where_they_are_heeded() -> None:
    values, rows = resting(), np.arange(SAMPLES) < 150
    chips = np.where(rows[:, None], [20.0, np.nan], 90.0)
    chips[:3, 1] = 21.0, 22.0, 23.0
    plain, warm = (Rest.unknown(SHAPE, 0.1, uses) for uses in (False, True))
    given = values, rows, None, no_restarts(), True, chips
    assert plain.learn(*given).temperature_c is None
    assert plain.with_temperature(values, chips) is values
    assert plain.split(values) == (values, None)
    learned = warm.learn(*given)
    np.testing.assert_allclose(learned.temperature_c, [20.0, 22.0])
    np.testing.assert_array_equal(learned.baseline, plain.learn(*given).baseline)
    assert learned.level.shape == (2, 4)
    level, told = learned.split(learned.level)
    np.testing.assert_array_equal(level, learned.baseline)
    np.testing.assert_array_equal(told, learned.temperature_c)
    tared = learned.tared_by(learned.with_temperature(values[-9:], chips[-9:]))
    np.testing.assert_allclose(tared.baseline, values[-9:].mean(axis=0))
    np.testing.assert_allclose(tared.temperature_c, 90.0)
    assert np.isnan(learned.tared_by(learned.with_temperature(values, None)).temperature_c).all()
    with pytest.raises(ValueError, match='usable reading'):
        learned.tared_by(learned.with_temperature(np.full((4, *SHAPE), np.nan), chips[:4]))


def test_contact_is_told_only_where_it_can_be() -> None:
    rest = Rest.unknown(SHAPE, 0.1)
    delta = np.zeros((6, *SHAPE))
    delta[1, 0, 0] = 0.6
    delta[2, 1, 2] = np.nan
    delta[3:5] = 2.0
    good = np.array([True, True, True, True, False, True])
    assert rest.contact(delta, good, None).tolist() == [0, 1, -1, 1, -1, 0]
    tare = np.arange(6) >= 3
    assert rest.contact(delta, good, tare).tolist() == [0, 1, -1, 0, -1, 0]
    blind = Rest.unknown(SHAPE, None)
    assert blind.contact(delta, good, None).tolist() == [-1] * 6


def touches(
    rests: int, drift: float, seed: int, count: int = 200, rows: int = 4
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Held touches of 1 .. 50, rests before each of them, noise 0.3 and drift in between."""
    rng = np.random.default_rng(seed)
    level = np.cumsum(drift * rng.normal(size=(count, 1, *SHAPE)), axis=0)
    size = rng.uniform(1, 50, count)
    pattern = rng.uniform(-1, 1, (count, 1, *SHAPE))
    pattern /= np.abs(pattern).max(axis=(2, 3), keepdims=True)
    resting = np.arange(rests + rows) < rests
    press = np.where(resting, 0.0, size[:, None])[..., None, None] * pattern
    values = level + press + 0.3 * rng.normal(size=press.shape)
    stamp_ns = np.arange(count)[:, None] * 3_000_000_000 + np.arange(rests + rows) * 10_000_000
    flat = values.reshape(-1, *SHAPE)
    return flat, np.tile(resting, count), stamp_ns.ravel(), np.repeat(size, rests + rows)


@pytest.mark.parametrize('drift', [0.0, 1.0, 20.0, 200.0])
@pytest.mark.parametrize('stamped', [True, False])
@pytest.mark.parametrize('rests', [1, 3])
def test_drift_between_touches_is_no_noise(drift: float, stamped: bool, rests: int) -> None:
    values, resting, stamp_ns, size = touches(rests, drift, seed=7)
    restarts = np.tile(np.arange(rests + 4) == 0, 200)
    # every touch less the rest before it
    ahead = values.reshape(200, rests + 4, *SHAPE)
    delta = (ahead - ahead[:, :rests].mean(axis=1, keepdims=True)).reshape(values.shape)
    rest = Rest.unknown(SHAPE, None).learn(
        values, resting, stamp_ns if stamped else None, restarts
    )
    rest = rest.threshold(delta[~resting])
    contact = rest.contact(delta, np.ones(len(values), bool), None)
    assert (contact[~resting & (size > 8)] == 1).all()
    assert (contact[~resting] == 0).mean() < 0.06
    np.testing.assert_allclose(rest.noise, 0.3, rtol=0.2)
    # and what does not touch is not felt
    free = 0.3 * np.random.default_rng(8).normal(size=(2000, *SHAPE)) * np.sqrt(1 + 1 / rests)
    assert (rest.contact(free, np.ones(2000, bool), None) == 1).mean() < 0.01


def test_rests_that_end_are_not_compared() -> None:
    """Frames far apart, in another stream, or with a touch between them, are two rests."""
    rows = 40
    steps = np.random.default_rng(5).normal(size=(rows, *SHAPE))
    near = np.arange(rows) * 10_000_000
    alternate = np.arange(rows) % 2 == 0
    none, resting = np.arange(rows) == 0, np.ones(rows, bool)
    for stamp_ns, restarts, rests, drifts in (
        (near, none, resting, False),
        (None, none, resting, False),
        (near * 100, none, resting, True),
        (near, resting, resting, True),
        (None, none, alternate, True),
        (near, none, np.arange(rows) < 5, True),
    ):
        rest = Rest.unknown(SHAPE, None).learn(steps, rests, stamp_ns, restarts)
        assert rest.drifts == drifts
        assert not Rest.unknown(SHAPE, 1.0).learn(steps, rests, stamp_ns, restarts).drifts


def test_firm_touches_limit_a_threshold_that_drift_would_raise() -> None:
    firm = np.linspace(20, 50, 100)[:, None, None] * np.ones(SHAPE)
    none = np.zeros((0, *SHAPE))
    rest = Rest(np.zeros(SHAPE), np.full(SHAPE, 40.0), np.full(SHAPE, np.nan), drifts=True)
    np.testing.assert_allclose(rest.threshold(none).scale, 200.0)
    np.testing.assert_allclose(rest.threshold(none, firm).scale, np.quantile(firm, 0.05))
    # lighter ones do where no other is known: frames may be called touched before they are
    np.testing.assert_allclose(rest.threshold(firm / 4).scale, np.quantile(firm, 0.05) / 4)
    np.testing.assert_allclose(rest.threshold(firm / 4, firm).scale, np.quantile(firm, 0.05))
    sure = Rest(np.zeros(SHAPE), np.full(SHAPE, 40.0), np.full(SHAPE, np.nan))
    np.testing.assert_allclose(sure.threshold(none, firm).scale, 200.0)
    dead = sure.threshold(none, None, np.array([False, True]))
    assert dead.scale[:, 0].tolist() == [200.0, np.inf]
    assert dead.dead.tolist() == [False, True]
    assert sure.dead is None


def test_readings_below_a_quantum_leave_a_threshold() -> None:
    """A bound of no noise is no bound: one rest a touch, readings that do not move within it."""
    rng = np.random.default_rng(2)
    level = np.round(rng.normal(size=(150, 1, *SHAPE)) * 3)
    values = np.repeat(level, 4, axis=1).reshape(600, *SHAPE)
    resting = np.arange(600) % 4 == 0
    for stamp_ns in (None, np.arange(600) * 10_000_000):
        rest = Rest.unknown(SHAPE, None).learn(values, resting, stamp_ns, resting)
        assert (rest.noise > 0).all()


def test_the_order_of_independent_frames_says_nothing() -> None:
    rng = np.random.default_rng(3)
    values = 1e-7 * rng.normal(size=(400, *SHAPE)) + 2e-6 * np.linspace(0, 1, 400)[:, None, None]
    order, none = rng.permutation(400), np.arange(400) == 0
    resting = np.ones(400, bool)
    first, second = (
        Rest.unknown(SHAPE, None).learn(rows, resting, None, none, ordered=False).noise
        for rows in (values, values[order])
    )
    np.testing.assert_array_equal(first, second)
    assert (first > 3e-7).all()


def restarts(stream: Stream, *stamps: int | None) -> list[bool]:
    """Rows of the next frames before which memory is forgotten."""
    stamp_ns = None if None in stamps else np.array(stamps, np.int64)
    return stream.follow(np.zeros((len(stamps), 1, 1)), stamp_ns).restart.tolist()


SIGMA = np.array([[0.5, 2.0, 0.0]])


@pytest.mark.parametrize('rows', [2, 3, 5, 40])
def test_noise_inside_held_touches_in_any_order(rows: int) -> None:
    rng = np.random.default_rng(rows)
    group = np.repeat(np.arange(500), rows)
    values = 100.0 * rng.normal(size=(500, 1, 3))[group] + SIGMA * rng.normal(
        size=(len(group), 1, 3)
    )
    found = held_noise(values, group)
    np.testing.assert_allclose(found[0, :2], SIGMA[0, :2], rtol=0.1)
    order = rng.permutation(len(group))
    np.testing.assert_allclose(held_noise(values[order], 7 - group[order]), found, atol=1e-12)
    values[::7] = np.nan
    if rows > 2:
        np.testing.assert_allclose(held_noise(values, group)[0, :2], SIGMA[0, :2], rtol=0.15)


def test_an_unknown_baseline_stays_unknown() -> None:
    start = np.array([[0.0, 0, 0], [0, np.nan, 0]])
    held = BaselineTracker(start, SCALE).follow(np.zeros((9, *SHAPE)), np.arange(9) * PERIOD_NS)[0]
    np.testing.assert_array_equal(held, np.broadcast_to(start, held.shape))


@pytest.mark.parametrize('stated', [0.2, np.array([0.2, 0.3, 0.4])])
def test_stated_noise_counts_for_every_taxel(stated: float | np.ndarray) -> None:
    rest = Rest.unknown(SHAPE, stated)
    np.testing.assert_allclose(rest.noise, np.broadcast_to(stated, SHAPE))
    np.testing.assert_allclose(rest.scale, 5 * np.broadcast_to(stated, SHAPE))
    assert np.isnan(rest.baseline).all()
    learned = rest.learn(resting(), np.ones(SAMPLES, bool), None, no_restarts())
    np.testing.assert_allclose(learned.noise, np.broadcast_to(stated, SHAPE))
    with pytest.raises(ValueError, match='broadcast'):
        Rest.unknown(SHAPE, np.ones(2))


def test_noise_is_at_least_a_quantums_and_frames_far_apart_tell_nothing() -> None:
    rest = np.zeros((100, 1, 1))
    rest[50] = 3.0
    np.testing.assert_allclose(rest_noise(rest, np.zeros(100, int)), 3.0 / np.sqrt(12))
    values, stamp_ns = np.random.default_rng(5).normal(size=(50, 1, 3)), 10**9 * np.arange(50)
    assert np.isnan(motion_noise(values, stamp_ns, np.zeros(50, bool))).all()
    assert np.isnan(motion_noise(values, stamp_ns // 100, np.ones(50, bool))).all()


def test_what_no_chip_can_have_and_chips_of_dead_taxels_tell_no_temperature() -> None:
    values, rows = resting(), np.arange(SAMPLES) < 150
    chips = np.full((SAMPLES, 2), 20.0)
    chips[3:8, 0] = -273.15, 1e9, np.inf, -np.inf, 1e300
    rest = Rest.unknown(SHAPE, 0.1, uses_temperature=True)
    learned = rest.learn(values, rows, None, no_restarts(), True, chips)
    np.testing.assert_allclose(learned.temperature_c, 20.0)
    partly = learned.threshold(values[:0], dead=np.array([False, True]))
    np.testing.assert_allclose(partly.level[:, -1], [20.0, np.nan])
    told = partly.tared_by(partly.with_temperature(values[:9], chips[:9])).temperature_c
    np.testing.assert_allclose(told, [20.0, np.nan])


@pytest.mark.parametrize('rows', [1, 2])
def test_few_resting_rows(rows: int) -> None:
    few = np.arange(SAMPLES) < rows
    rest = Rest.unknown(SHAPE, None).learn(resting(), few, None, no_restarts())
    assert np.isfinite(rest.baseline).all()
    assert np.isfinite(rest.noise).all() == (rows == 2)
