"""What resting rows teach: baseline, noise, threshold; and what is said when nothing is known."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.conditioning.baseline import Rest

SHAPE = (2, 3)
ROWS = 200


def resting(seed: int = 0) -> np.ndarray:
    return 5.0 + 0.1 * np.random.default_rng(seed).normal(size=(ROWS, *SHAPE))


def no_restarts(rows: int = ROWS) -> np.ndarray:
    return np.arange(rows) == 0


@pytest.mark.parametrize('stated', [0.2, np.array([0.2, 0.3, 0.4])])
def test_stated_noise_counts_for_every_taxel(stated: float | np.ndarray) -> None:
    rest = Rest.unknown(SHAPE, stated)
    np.testing.assert_allclose(rest.noise, np.broadcast_to(stated, SHAPE))
    np.testing.assert_allclose(rest.scale, 5 * np.broadcast_to(stated, SHAPE))
    assert np.isnan(rest.baseline).all()
    learned = rest.learn(resting(), np.ones(ROWS, bool), None, no_restarts())
    np.testing.assert_allclose(learned.noise, np.broadcast_to(stated, SHAPE))
    with pytest.raises(ValueError, match='broadcast'):
        Rest.unknown(SHAPE, np.ones(2))


def test_a_baseline_has_the_temperatures_of_its_frames_where_they_are_heeded() -> None:
    values, rows = resting(), np.arange(ROWS) < 150
    chips = np.where(rows[:, None], [20.0, np.nan], 90.0)
    chips[:3, 1] = 21.0, 22.0, 23.0
    plain, warm = (Rest.unknown(SHAPE, 0.1, warms) for warms in (False, True))
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


def test_what_no_chip_can_have_and_chips_of_dead_taxels_tell_no_temperature() -> None:
    values, rows = resting(), np.arange(ROWS) < 150
    chips = np.full((ROWS, 2), 20.0)
    chips[3:8, 0] = -273.15, 1e9, np.inf, -np.inf, 1e300
    rest = Rest.unknown(SHAPE, 0.1, warms=True)
    learned = rest.learn(values, rows, None, no_restarts(), True, chips)
    np.testing.assert_allclose(learned.temperature_c, 20.0)
    partly = learned.threshold(values[:0], dead=np.array([False, True]))
    np.testing.assert_allclose(partly.level[:, -1], [20.0, np.nan])
    told = partly.tared_by(partly.with_temperature(values[:9], chips[:9])).temperature_c
    np.testing.assert_allclose(told, [20.0, np.nan])


@pytest.mark.parametrize('stamped', [True, False])
def test_resting_rows_give_baseline_and_noise(stamped: bool) -> None:
    values, rows = resting(), np.arange(ROWS) < 150
    values[150:] += 3.0
    stamp_ns = np.arange(ROWS) * 10_000_000 if stamped else None
    rest = Rest.unknown(SHAPE, None).learn(values, rows, stamp_ns, no_restarts())
    assert rest.tared
    np.testing.assert_allclose(rest.baseline, values[:150].mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(rest.noise, 0.1, rtol=0.35)


def test_the_order_of_independent_frames_does_not_matter_to_the_baseline() -> None:
    values, rows = resting(), np.random.default_rng(3).random(ROWS) < 0.5
    order = np.random.default_rng(4).permutation(ROWS)
    one = Rest.unknown(SHAPE, 0.1).learn(values, rows, None, no_restarts())
    other = Rest.unknown(SHAPE, 0.1).learn(values[order], rows[order], None, no_restarts())
    np.testing.assert_allclose(one.baseline, other.baseline, rtol=1e-13)


def test_without_resting_rows_readings_are_used_as_they_are() -> None:
    rest = Rest.unknown(SHAPE, None).learn(resting(), np.zeros(ROWS, bool), None, no_restarts())
    assert not rest.tared
    contact = rest.contact(np.ones((4, *SHAPE)), np.ones(4, bool), None)
    assert contact.tolist() == [-1] * 4


@pytest.mark.parametrize('rows', [1, 2])
def test_few_resting_rows(rows: int) -> None:
    few = np.arange(ROWS) < rows
    rest = Rest.unknown(SHAPE, None).learn(resting(), few, None, no_restarts())
    assert np.isfinite(rest.baseline).all()
    assert np.isfinite(rest.noise).all() == (rows == 2)


def test_a_taxel_that_was_never_read_stays_unknown() -> None:
    values = resting()
    values[:, 1] = np.nan
    stamp_ns = np.arange(ROWS) * 10_000_000
    rest = Rest.unknown(SHAPE, None).learn(values, np.ones(ROWS, bool), stamp_ns, no_restarts())
    assert np.isfinite(rest.baseline[0]).all()
    assert np.isnan(rest.baseline[1]).all()
    assert np.isnan(rest.noise[1]).all()
    # and its touches do not raise the threshold to NaN
    touched = values - rest.baseline
    assert np.isnan(rest.threshold(touched).scale[1]).all()


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


@pytest.mark.parametrize('noise', [0.1, None])
def test_a_row_alone_is_told_as_among_others(noise: float | None) -> None:
    rng = np.random.default_rng(11)
    delta = rng.choice([0.0, 0.3, 0.5, 0.6, -0.6, np.nan], (200, *SHAPE), p=[0.4, *[0.12] * 5])
    good = rng.random(200) < 0.8
    rest = Rest.unknown(SHAPE, noise)
    many = rest.contact(delta, good, None)
    alone = [rest.contact(delta[[i]], good[[i]], None) for i in range(200)]
    np.testing.assert_array_equal(np.concatenate(alone), many)
    assert {one.dtype for one in alone} == {many.dtype}
    assert set(many.tolist()) == ({-1, 0, 1} if noise else {-1})


def test_no_touches_leave_the_noise_to_decide() -> None:
    rest = Rest.unknown(SHAPE, 0.1)
    np.testing.assert_array_equal(rest.threshold(np.zeros((0, *SHAPE))).scale, rest.scale)
    lost = np.full((3, *SHAPE), np.nan)
    np.testing.assert_array_equal(rest.threshold(lost).scale, rest.scale)
    touched = np.full((3, *SHAPE), 4.0)
    np.testing.assert_allclose(rest.threshold(touched).scale, 1.6)


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
    assert dead.dead is not None
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
