# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Laws, creep, objects and patches of taxel arrays, in a world of cells that is not their own."""

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.worlds import taxel_skins
from reference import taxel_world as world
from reference.pick_world import TaxelScene, TaxelSkin, even_loads, turn_between
from tactile_ros.enrolment import thinned
from tactile_ros.estimators import regression
from tactile_ros.physics.coverage import part_pressure, washer
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import (
    TaxelArrayConfig,
    grid_positions,
    radial_positions,
    sectors,
)
from tactile_ros.types import (
    STATE_FIELDS,
    ContactStates,
    Frame,
    FrameStatus,
    Outline,
    Recording,
    TaxelStatus,
)

SPEC = load_sensor('taxel_array')
CONFIG = SPEC.config()
RADII = ((16e-3, 8e-3), (14e-3, 6.5e-3), (12e-3, 5e-3), (18e-3, 9e-3), (10e-3, 4e-3))
WASHERS = tuple(washer(f'washer_{i}', *pair) for i, pair in enumerate(RADII))


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """No perceptron is chosen here."""
    monkeypatch.setattr(regression, 'FEWEST_STEPS', 50)


def on_matrix(rows: int, columns: int, pitch: float, *objects: Outline) -> TaxelArrayConfig:
    return TaxelArrayConfig(
        positions=grid_positions(rows, columns, pitch),
        areas=np.full(rows * columns, pitch**2),
        force_range=np.array([0.0, 5.0]),
        objects=objects,
    )


def loads(config: TaxelArrayConfig, part: Outline, *pose: float) -> np.ndarray:
    """Load of each square taxel at 1 N on a wholly covered one, by 1600 points."""
    line = np.sqrt(config.areas[0]) * ((np.arange(40) + 0.5) / 40 - 0.5)
    points = config.positions[:, None, :2] + np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    x, y, yaw = pose
    cos, sin = np.cos(yaw), np.sin(yaw)
    own = (points.reshape(-1, 2) - np.array([x, y])) @ np.array([[cos, -sin], [sin, cos]])
    return part_pressure(part, own).reshape(len(config.positions), -1).mean(axis=1)


def disc(x: float, y: float, radius: float) -> tuple[Outline, float, float, float]:
    """Outline of a disc (mm), and its pose."""
    turn = 2 * np.pi * np.arange(64) / 64
    rim = 1e-3 * radius * np.column_stack([np.cos(turn), np.sin(turn)])
    return Outline('disc', (rim,)), 1e-3 * x, 1e-3 * y, 0.0


def read(force: np.ndarray, seed: int, spoilt: dict[int, float] | None = None) -> np.ndarray:
    """Outputs of 10 bits of taxels whose gains differ by 55 %, some stuck at a level."""
    gain = 1 / (1 + 0.55 * np.random.default_rng(9).uniform(size=force.shape[-1]))
    output = gain * force / (force + 1.5)
    for taxel, level in (spoilt or {}).items():
        output[..., taxel] = level
    output = output + 5e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.round(np.clip(output, 0, 0.999) * 1023)[..., None] / 1023


def fitted(
    config: TaxelArrayConfig, spoilt: dict[int, float] | None = None, **truth: float
) -> Pipeline:
    """Equilibrated by even loads; further truth is a factor of the force."""
    force = np.random.default_rng(1).uniform(0.05, 3, (150, 1)).repeat(len(config.positions), 1)
    force[:15] = 0
    told = {
        'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8),
        **{name: factor * force for name, factor in truth.items()},
    }  # fmt: skip
    values = read(force, 2, spoilt)
    return SPEC.pipeline(config).fit(
        Recording.from_arrays(SPEC.layout(config), values, truth=told)
    )


def asked(pipeline: Pipeline, *values: np.ndarray) -> Recording:
    return Recording.from_arrays(pipeline.layout, np.concatenate(values))


# ---------------------------------------------------------------- laws


def squares(samples: int, seed: int, pressed: int = 16) -> Recording:
    """Outputs whose forces are a u + b u^2 with an a and b of each taxel."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.05, 0.9, (samples, 16))
    u[::4] = 0
    u[:, pressed:] = 0
    force = np.linspace(1, 3, 16) * u + np.linspace(5, 20, 16) * u**2
    truth = {'taxel_force': force, 'in_contact': (np.arange(samples) % 4 > 0).astype(np.int8)}
    noise = 1e-5 * rng.normal(size=u.shape)
    return Recording.from_arrays(SPEC.layout(CONFIG), (u + noise)[..., None], truth=truth)


def test_polynomial_law_is_each_taxels_own_and_zero_is_zero() -> None:
    pipeline = SPEC.pipeline(CONFIG, 'polynomial').fit(squares(80, 1))
    assert pipeline.estimators == {'taxel_force': 'polynomial'}
    fresh = squares(40, 2)
    states = pipeline.process_batch(fresh)
    np.testing.assert_allclose(states.taxel_force, fresh.truth['taxel_force'], atol=5e-3)
    assert not states.taxel_force[::4].any()
    assert pipeline.report['taxel_force']['fit_rmse'] < 1e-3


def test_law_of_a_taxel_that_was_never_pressed_says_nothing() -> None:
    recording = squares(80, 1, pressed=12)
    recording.truth['taxel_force'][:, 14] = np.nan
    states = SPEC.pipeline(CONFIG, 'polynomial').fit(recording).process_batch(squares(40, 2))
    touched = states.in_contact == 1
    assert np.isfinite(states.taxel_force[touched, :12]).all()
    assert np.isnan(states.taxel_force[touched, 14]).all()


def test_fit_learns_all_targets_of_a_simple_programme() -> None:
    pipeline = SPEC.pipeline(CONFIG).fit(thinned(SPEC.presses(CONFIG, 0, 24), 10.0))
    assert set(pipeline.estimators) == {'position', 'force', 'taxel_force'}
    test = thinned(SPEC.presses(CONFIG, 1, 6), 10.0)
    states = pipeline.process_batch(test)
    touched = test.truth['in_contact'] == 1
    miss = (states.taxel_force - test.truth['taxel_force'])[touched]
    assert np.sqrt(np.mean(miss**2)) < 0.1
    force = (states.force - test.truth['force'])[touched, 2]
    assert np.sqrt(np.nanmean(force**2)) < 1.2
    assert np.isnan(states.force[:, :2]).all()


@pytest.mark.parametrize('taxels', [1, 72])
def test_fit_takes_any_count_of_taxels(taxels: int) -> None:
    positions = np.zeros((taxels, 3))
    positions[:, 0] = 5e-3 * np.arange(taxels)
    config = dataclasses.replace(CONFIG, positions=positions)  # type: ignore[type-var]
    train = thinned(SPEC.presses(config, 0, 20), 10.0)
    states = SPEC.pipeline(config, 'polynomial').fit(train).process_batch(train)
    assert states.taxel_force.shape == (len(train), taxels)


RING = world.radial((8e-3, 25e-3), (16,))
TOP, RATE = 3.0, 20.0


@pytest.mark.parametrize('law', ['divider', 'exponential', 'logarithm'])
def test_taxels_agree_within_two_percent_on_any_law(law: str) -> None:
    config, skin = world.config(RING), world.Skin(8, 16, 1.5, law=law)
    pipeline = SPEC.pipeline(config).fit(world.even_loads(RING, config, skin, TOP, 9))
    test = world.even_loads(RING, config, skin, TOP, 10)
    states, force = pipeline.process_batch(test), test.truth['taxel_force']
    firm = force[:, 0] > 0.3
    assert ((states.taxel_force / np.maximum(force, 1e-9))[firm]).std(axis=1).mean() < 0.02
    assert not np.nan_to_num(states.force[states.in_contact == 0, 2]).any()
    assert np.abs(states.force[firm, 2] / force[firm].sum(axis=1) - 1).mean() < 0.01


# ---------------------------------------------------------------- creep


def programme(seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (s,) and even loads (s, 16): ramps, holds of 1 to 25 s, rests."""
    rng = np.random.default_rng(seed)
    time, now = np.arange(0, seconds, 1 / RATE), 1.0
    load = np.zeros(len(time))
    while now < seconds:
        ramp, hold = rng.uniform(0.1, 0.6), rng.choice([1, 3, 8, 25], p=[0.35, 0.3, 0.2, 0.15])
        end = now + 2 * ramp + hold
        load += (
            rng.uniform(0.1, 1) * TOP * np.clip(np.minimum(time - now, end - time) / ramp, 0, 1)
        )
        now = end + rng.uniform(1, 4)
    return time, np.repeat(load[:, None], 16, axis=1)


def held(seconds: float, gap: tuple[float, float] = (0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """1.8 N that are held from 1.2 s on, without frames in a gap."""
    time = np.arange(0, seconds + 12, 1 / RATE)
    time = time[(time < gap[0]) | (time >= gap[1])]
    rise = np.clip(np.minimum(time - 1, seconds + 1.4 - time) / 0.2, 0, 1)
    return time, np.repeat(1.8 * rise[:, None], 16, axis=1)


def recorded(skin: world.Skin, time: np.ndarray, force: np.ndarray, seed: int) -> Recording:
    """Readings of a stream that begins with a tare."""
    values = skin.read(force, np.random.default_rng(seed), time)
    truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
    return Recording.from_arrays(
        SPEC.layout(world.config(RING)), values, stamp_ns=(1e9 * time).astype(np.int64) + 1,
        stream=np.zeros(len(time), int), tare=np.arange(len(time)) < 10, truth=truth,
    )  # fmt: skip


def learned(skin: world.Skin, seed: int, seconds: float = 200.0) -> Pipeline:
    recording = recorded(skin, *programme(seed, seconds), 3)
    return SPEC.pipeline(world.config(RING)).fit(recording)


@lru_cache
def creeping() -> tuple[world.Skin, Pipeline]:
    skin = world.Skin(2, 16, 1.5, creep=(0.08, 0.05, 0.03))
    return skin, learned(skin, 2)


def drift(total: np.ndarray, time: np.ndarray, end: float) -> float:
    """Change of a held load from its first seconds to its last."""
    early, late = (time > 2) & (time < 6), (time > end - 8) & (time < end)
    assert abs(total[late].mean() / 1.8 - 1) < 0.02
    return abs(float(total[late].mean() / total[early].mean()) - 1)


def test_creep_of_a_hold_is_undone_and_leaves_no_contact() -> None:
    skin, pipeline = creeping()
    assert 'with creep' in pipeline.estimators['taxel_force']
    time, force = held(60.0)
    states = pipeline.process_batch(recorded(skin, time, force, 4))
    assert drift(states.taxel_force.mean(axis=1), time, 60.0) < 0.003
    released = time > 63
    assert np.abs(states.taxel_force[released]).max() < 0.05
    assert states.in_contact[released].mean() < 0.1


def test_creep_is_found_without_tare_rows() -> None:
    # the baseline of such a fit has in it what the skin has not yet forgotten
    def untared(one: Recording) -> Recording:
        return dataclasses.replace(one, tare=None)

    skin = world.Skin(12, 16, 1.5, creep=(0.08, 0.06))
    lesson = recorded(skin, *programme(12, 200.0), 3)
    pipeline = SPEC.pipeline(world.config(RING)).fit(untared(lesson))
    assert 'with creep' in pipeline.estimators['taxel_force']
    lacks = pipeline.report['not learned: rest before any load (no tare rows)']
    assert 0.1 < lacks['share of a load that rests may still hold'] < 0.25
    time, force = held(60.0)
    hold = recorded(skin, time, force, 4)
    for one in (hold, untared(hold)):
        total = pipeline.process_batch(one).taxel_force.mean(axis=1)
        assert drift(total, time, 60.0) < 0.004


def test_total_force_knows_what_all_taxels_have_in_common() -> None:
    skin = world.Skin(13, 16, 1.5, creep=(0.08, 0.06), play=0.02)
    pipeline = learned(skin, 13)
    time, force = programme(63, 80.0)
    states = pipeline.process_batch(recorded(skin, time, force, 5))
    pressed = (force[:, 0] > 0.1) & (states.in_contact == 1)
    error = np.abs(states.force[pressed, 2] - force[pressed].sum(axis=1))
    assert (error <= 2 * np.sqrt(states.force_cov[pressed, 2, 2])).mean() > 0.8


def test_gap_of_ten_seconds_in_a_hold_leaves_no_trace() -> None:
    skin, pipeline = creeping()
    time, force = held(40.0, (20.0, 30.0))
    total = pipeline.process_batch(recorded(skin, time, force, 5)).taxel_force.mean(axis=1)
    before, after = (time > 15) & (time < 20), (time > 30) & (time < 35)
    assert abs(total[after].mean() / total[before].mean() - 1) < 0.003


def test_saturated_readings_in_a_hold_poison_nothing_that_follows() -> None:
    skin, pipeline = creeping()
    recording = recorded(skin, *held(40.0), 6)
    clean = pipeline.process_batch(recording).taxel_force
    recording.values[400:420, 3] = 1.0
    states = pipeline.process_batch(recording)
    assert (states.taxel_status[400:420, 3] & TaxelStatus.SATURATED).all()
    assert np.isnan(states.taxel_force[400:420, 3]).all()
    assert np.isfinite(states.taxel_force[400:420, 4]).all()
    np.testing.assert_allclose(states.taxel_force[425:700], clean[425:700], atol=0.01)


def test_live_is_batch_with_creep_bit_for_bit() -> None:
    skin, pipeline = creeping()
    plain = dataclasses.replace(recorded(skin, *held(5.0), 7), tare=None, truth={})
    states = pipeline.process_batch(plain)
    pipeline.reset()
    for i in range(len(plain)):
        state = pipeline.process(plain.frame(i))
        np.testing.assert_array_equal(state.taxel_force, states.taxel_force[i])
        np.testing.assert_array_equal(state.force, states.force[i])


def test_skin_without_creep_is_not_given_any() -> None:
    assert 'creep' not in learned(world.Skin(5, 16, 1.5), 5, 100.0).estimators['taxel_force']


def test_play_is_learned_and_stated_alike_at_any_rate() -> None:
    uneven = np.array([1.0, 0.7, 0.4, 0.15])  # of the largest load: other levels of a law
    array = world.radial((8e-3, 25e-3), (4,))

    def pressed(rate: float, seed: int, count: int, shares: np.ndarray) -> Recording:
        rng, corners, load = np.random.default_rng(seed), [0.0, 1.0], [0.0, 0.0]
        for i in range(count):
            rise, fall = rng.uniform(0.3, 1.2, 2)
            corners += (corners[-1] + np.round(np.cumsum([rise, 0.2, fall, 0.4]), 1)).tolist()
            load += [one := TOP * (0.5, 1.0, 0.75, 0.95)[i % 4], one, 0.0, 0.0]
        time = np.arange(round(corners[-1] * rate)) / rate
        force = np.interp(time, corners, load)[:, None] * shares
        values = world.Skin(7, 4, 1.5, play=0.02, bits=14).read(force, np.random.default_rng(seed))
        truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
        return Recording.from_arrays(
            SPEC.layout(world.config(array)), values, np.round(1e9 * time).astype(np.int64),
            stream=np.zeros(len(time), int), tare=time < 0.5, truth=truth,
        )  # fmt: skip

    found = []
    for rate in (20.0, 100.0):
        pipeline = SPEC.pipeline(world.config(array)).fit(pressed(rate, 1, 8, np.ones(4)))
        recording, step = pressed(rate, 2, 3, uneven), round(rate / 20.0)
        states = pipeline.process_batch(recording)
        truth = recording.truth['taxel_force'].sum(axis=1)[::step]
        firm = truth > 0.1 * truth.max()
        sigma = np.sqrt(states.force_cov[::step, 2, 2][firm])
        found.append((states.force[::step, 2][firm], sigma, truth[firm]))
    (slow, slow_sigma, truth), (fast, fast_sigma, _) = found
    assert np.abs(fast - slow).max() < 0.015 * truth.max()
    assert fast_sigma == pytest.approx(slow_sigma, rel=0.5)
    assert (np.abs(fast - truth) <= 2 * fast_sigma).mean() > 0.9


# ---------------------------------------------------------------- objects

BAD = {3: 0.0, 17: 0.0, 30: 0.0, 44: 0.3, 61: 0.3}
GRIPPER = on_matrix(8, 9, 5e-3, *WASHERS)


@lru_cache
def gripper() -> Pipeline:
    return fitted(GRIPPER, BAD)


def test_washers_are_recognised_with_bad_taxels_that_nobody_marked() -> None:
    rng, bad = np.random.default_rng(4), list(BAD)
    label, place = rng.integers(5, size=60), rng.uniform(-3e-3, 3e-3, (60, 2))
    force = np.array([1.5 * loads(GRIPPER, WASHERS[i], *at, 0.0)
                      for i, at in zip(label, place, strict=True)])  # fmt: skip
    states = gripper().process_batch(asked(gripper(), read(force, 5, BAD)))
    right = states.label == label
    assert right.mean() >= 0.97
    miss = np.linalg.norm(states.position[right, :2] - place[right], axis=1)
    assert np.median(miss) < 0.06e-3
    assert (states.symmetry[right] == 0).all()
    assert np.isnan(states.yaw[right]).all()
    assert (states.taxel_status[:, bad] & TaxelStatus.DEAD).all()
    assert np.isnan(states.taxel_force[:, bad]).all()
    healthy = np.setdiff1d(np.arange(72), bad)
    firm = force[:, healthy] > 0.2
    ratio = (states.taxel_force[:, healthy] / np.maximum(force[:, healthy], 1e-9))[firm]
    assert abs(np.mean(ratio) - 1) < 0.01
    assert np.std(ratio) < 0.02
    total = force[right].sum(axis=1)
    np.testing.assert_allclose(states.force[right, 2], total, rtol=0.02)
    # what bad taxels hide is neither surer nor vaguer than what the others say
    ratio = (states.force[right, 2] - total) / np.sqrt(states.force_cov[right, 2, 2])
    assert 0.6 < np.sqrt(np.mean(np.square(ratio))) < 1.5


def test_rest_and_strange_objects_are_none_of_these() -> None:
    bar = 2.0 * (np.abs(GRIPPER.positions[:, 1]) < 3e-3)
    force = np.vstack([np.zeros((5, 72)), bar])
    states = gripper().process_batch(asked(gripper(), read(force, 6, BAD)))
    assert states.in_contact.tolist() == [0] * 5 + [1]
    assert (states.label == -1).all()
    assert np.isnan(states.label_probability).all()
    assert np.isnan(states.object_pose).all()
    assert not np.nansum(states.force[:5, 2])


SQUARE = Outline('square', (1e-3 * np.array([[-6, -6], [6, -6], [6, 6], [-6, 6.0]]),))
PARTS = (
    (Outline('rectangle', (1e-3 * np.array([[-9, -5], [9, -5], [9, 5], [-9, 5.0]]),)), 2),
    (SQUARE, 4),
    (washer('washer', 11e-3, 5e-3), 0),
    (Outline('trapezoid', (1e-3 * np.array([[-10, -6], [10, -6], [5, 6], [-5, 6.0]]),)), 1),
)


@pytest.mark.parametrize(('part', 'order'), PARTS, ids=[part.name for part, _ in PARTS])
def test_class_of_turns_is_told_and_nothing_flips(part: Outline, order: int) -> None:
    config, rng = on_matrix(16, 18, 2e-3, part), np.random.default_rng(7)
    pipeline = fitted(config)
    poses = rng.uniform(-1, 1, (6, 3)) * np.array([2e-3, 2e-3, np.pi])
    force = np.array([loads(config, part, *pose) for pose in poses])
    states = pipeline.process_batch(asked(pipeline, read(force, 5)))
    assert (states.label == 0).all()
    assert (states.symmetry == order).all()
    assert np.median(np.linalg.norm(states.position[:, :2] - poses[:, :2], axis=1)) < 0.1e-3
    if order == 0:
        assert np.isnan(states.yaw).all()
        assert np.isnan(states.yaw_std).all()
        return
    turns = [turn_between(a, b, order) for a, b in zip(states.yaw, poses[:, 2], strict=True)]
    assert np.rad2deg(max(turns)) < 3.0
    assert (np.abs(states.yaw) <= np.pi / order + 1e-9).all()


def test_object_without_an_outline_is_learned_from_labelled_poses() -> None:
    corners = 1e-3 * np.array([[-8, -6], [10, -6], [10, 0], [-2, 0], [-2, 8], [-8, 8.0]])
    array, rng = world.radial((4e-3, 12e-3, 20e-3), (10, 14)), np.random.default_rng(3)
    config, skin = world.config(array), world.Skin(4, 24, 1.5)
    poses = rng.uniform(-1, 1, (90, 3)) * np.array([3e-3, 3e-3, np.pi])
    force = np.zeros((90, 24))
    for row, (x, y, yaw) in enumerate(poses[10:], 10):
        u, v, cos, sin = array.x - x, array.y - y, np.cos(yaw), np.sin(yaw)
        pressure = world.on_polygon(cos * u + sin * v, cos * v - sin * u, corners)
        force[row] = rng.uniform(0.8, 2) * array.forces(pressure) / array.areas.mean()
    poses[:10] = np.nan
    truth = {
        'taxel_force': force, 'in_contact': force.any(axis=1).astype(np.int8), 'yaw': poses[:, 2],
        'position': np.column_stack([poses[:, :2], np.full(90, np.nan)]),
    }  # fmt: skip
    whole = Recording.from_arrays(SPEC.layout(config), skin.read(force, rng), truth=truth)
    pipeline = SPEC.pipeline(config).fit(whole.select(slice(0, 75)))
    assert pipeline.estimators['yaw'] == 'learned fields of pressure'
    states = pipeline.process_batch(whole.select(slice(75, 90)))
    miss = np.angle(np.exp(1j * (states.yaw - poses[75:, 2])))
    assert np.isfinite(miss).mean() > 0.8
    assert np.nanmedian(np.abs(miss)) < np.deg2rad(5)


def test_surface_is_no_0_over_0_and_that_of_a_rigid_array_is_flat() -> None:
    config = on_matrix(16, 18, 2e-3)
    force = loads(config, SQUARE, 0.0, 0.0, 0.0)
    untouched, whole = force == 0, force > 0.9
    for depth, truth in ((2e-4, {'deformation': 2e-4}), (0.0, {})):
        pipeline = fitted(config, **truth)
        pipeline.tare([Frame(None, 0, read(0 * force, 8))])
        points = pipeline.estimation.surface(pipeline.process(Frame(None, 1, read(force, 9))))
        assert np.isnan(points[untouched]).mean() > 0.97
        np.testing.assert_allclose(points[whole, 2], -depth * force[whole], rtol=0.05)
        np.testing.assert_array_equal(points[whole, :2], config.positions[whole, :2])
        rest = pipeline.process(Frame(None, 2, read(0 * force, 10)))
        assert np.isnan(pipeline.estimation.surface(rest)).all()


@pytest.mark.parametrize('broken', ['nan', 'constant', 'count'])
def test_bad_input_is_no_plausible_number(broken: str) -> None:
    good = read(1.5 * loads(GRIPPER, WASHERS[0], 0.0, 0.0, 0.0), 13, BAD)
    if broken == 'count':
        with pytest.raises(ValueError, match='72'):
            gripper().process(Frame(None, 0, good[:-1]))
        return
    values = np.full_like(good, np.nan if broken == 'nan' else 0.5)
    state = gripper().process(Frame(None, 0, values))
    assert int(state.label) == -1
    assert np.isnan(state.object_pose).all()
    if broken == 'nan':
        assert not state.valid
        assert (state.contacts_id == -1).all()
    else:
        assert state.status & FrameStatus.ABSTAINED


def test_twin_places_and_turns_a_washer_and_a_tube_that_are_recognised() -> None:
    config = SPEC.config(**SPEC.demo)
    train, test = (thinned(SPEC.presses(config, i, n), 4.0) for i, n in ((1, 30), (2, 12)))
    truth, there = test.truth, test.truth['in_contact'] == 1
    assert set(np.unique(truth['label'][there])) == {0, 1}
    assert (truth['label'][~there] == -1).all()
    tube = truth['label'] == 1
    assert np.isfinite(truth['yaw'][tube]).all()
    assert np.isnan(truth['yaw'][~tube]).all()
    load = truth['taxel_force'].astype(float)
    np.testing.assert_allclose(load.sum(axis=1)[there], truth['force'][there, 2].astype(float))
    states = SPEC.pipeline(config).fit(train).process_batch(test)
    firm = there & (load.max(axis=1) > 0.5)
    right = states.label[firm] == truth['label'][firm]
    assert right.mean() > 0.8  # a tube at the rim may be none of these, but not the washer
    assert right.all() or (states.label[firm][~right] == -1).all()
    miss = np.linalg.norm((states.position - truth['position'])[firm][right, :2], axis=1)
    assert np.median(miss) < 0.3e-3
    plain = dataclasses.replace(config, objects=(), parts='')
    assert 'label' not in SPEC.presses(plain, 3, 3).truth  # without objects it presses footprints


# ---------------------------------------------------------------- patches

PLATE = on_matrix(14, 18, 2e-3)
LEFT, RIGHT = disc(-10, 4, 3.5), disc(9, -5, 5)


@lru_cache
def plate() -> Pipeline:
    return fitted(PLATE)


def stream(*rows: np.ndarray) -> Recording:
    """Rows 10 ms apart after a rest that is a tare."""
    force = np.stack([np.zeros(252), *rows])
    tare = np.arange(len(force)) == 0
    stamps = 10_000_000 * np.arange(len(force))
    return Recording.from_arrays(SPEC.layout(PLATE), read(force, 5), stamps, tare=tare)


def test_two_bodies_are_two_contacts_with_their_own_places_and_forces() -> None:
    force = 0.8 * loads(PLATE, *LEFT) + 0.5 * loads(PLATE, *RIGHT)
    states = plate().process_batch(stream(*[force] * 3))
    assert (states.contacts_id[1:, :2] == [0, 1]).all()
    assert (states.contacts_id[:, 2:] == -1).all()
    places = states.contacts_position[1:, :2, :2]
    wanted = 1e-3 * np.array([[9, -5], [-10, 4]])
    assert np.abs(places - wanted).max() < 0.1e-3
    sigma = np.sqrt(states.contacts_position_cov[1:, :2, [0, 1], [0, 1]])
    assert (np.abs(places - wanted) < 3 * sigma).all()
    left = force[PLATE.positions[:, 0] < 0].sum()
    np.testing.assert_allclose(
        states.contacts_force[1:, :2, 2], [[force.sum() - left, left]] * 3, rtol=0.02
    )
    assert np.isnan(states.contacts_force[1:, :2, :2]).all()
    np.testing.assert_allclose(states.contacts_normal[1:, :2], [[[0, 0, 1.0]] * 2] * 3)
    # the state speaks of the strongest
    np.testing.assert_array_equal(states.position, states.contacts_position[:, 0])
    np.testing.assert_allclose(states.force[1:, 2], force.sum(), rtol=0.02)
    assert len(states[1].contacts) == 2


def test_ids_live_while_bodies_slide_and_one_lifts() -> None:
    other = 0.5 * loads(PLATE, *disc(9, -5, 4))
    rows = [
        0.8 * loads(PLATE, *disc(-12 + 0.5 * i, 3, 3.5)) + (5 <= i < 15) * other for i in range(20)
    ]
    rows[8:8] = [np.zeros(252)]  # a frame in which nothing touches ends all
    states = plate().process_batch(stream(*rows))
    ids = [sorted(set(row[row >= 0].tolist())) for row in states.contacts_id]
    assert ids == [[], *[[0]] * 5, *[[0, 1]] * 3, [], *[[2, 3]] * 7, *ids[17:]]
    left = np.nan_to_num(states.contacts_position[17:, :, 0], nan=1.0).argmin(axis=1)
    assert len(set(states.contacts_id[17:][np.arange(len(left)), left].tolist())) == 1


def test_live_is_batch_for_every_attribute_of_patches_and_objects() -> None:
    rng = np.random.default_rng(4)
    rows = [
        sum(0.6 * loads(PLATE, *disc(x, y, 2.5)) for x, y in rng.uniform(-11, 11, (4, 2)))
        for _ in range(8)
    ]
    washers = [1.5 * loads(GRIPPER, WASHERS[i], 1e-3 * i, 0.0, 0.0) for i in range(3)]
    several = asked(gripper(), read(np.array([*washers, 0 * washers[0]]), 5, BAD))
    for pipeline, recording in ((plate(), stream(*rows)), (gripper(), several)):
        states = pipeline.process_batch(recording)
        first = 0
        if recording.tare is not None:
            pipeline.tare([recording.frame(0)])
            first = 1
        for i in range(first, len(recording)):
            state = pipeline.process(recording.frame(i))
            for name in STATE_FIELDS:
                np.testing.assert_allclose(
                    getattr(state, name), getattr(states, name)[i], rtol=1e-9, atol=1e-12,
                    err_msg=name,
                )  # fmt: skip


def test_lost_taxel_parts_no_contact_and_a_stuck_one_is_none() -> None:
    middle = 130
    pipeline = fitted(PLATE, {middle: 0.0, 20: 0.4})
    at = 1e3 * PLATE.positions[middle]
    bar = sum(loads(PLATE, *disc(at[0] + x, at[1], 1.2)) for x in (-4, -2, 0, 2, 4))
    values = read(np.stack([0 * bar, bar]), 7, {middle: 0.0, 20: 0.4})
    states = pipeline.process_batch(asked(pipeline, values))
    assert (states.contacts_id >= 0).sum(axis=1).tolist() == [0, 1]
    assert not np.nansum(states.taxel_force[0])
    np.testing.assert_allclose(states.contacts_force[1, 0, 2], states.force[1, 2])


def test_without_a_law_patches_have_places_and_no_force() -> None:
    rest = Recording.from_arrays(
        SPEC.layout(PLATE), read(np.zeros((20, 252)), 1),
        truth={'in_contact': np.zeros(20, np.int8)},
    )  # fmt: skip
    force = 0.8 * loads(PLATE, *LEFT) + 0.5 * loads(PLATE, *RIGHT)
    states = SPEC.pipeline(PLATE).fit(rest).process_batch(stream(force))
    assert (states.contacts_id[1] >= 0).sum() == 2
    assert np.abs(states.contacts_position[1, 0, :2] - [9e-3, -5e-3]).max() < 0.4e-3
    assert np.isnan(states.contacts_force[1]).all()


# ---------------------------------------------------------------- sigmas


def pressed(
    config: TaxelArrayConfig, seed: int, places: np.ndarray, radii: tuple[float, float]
) -> tuple[ContactStates, np.ndarray]:
    """States of frames in which a body lies at each of places (s, n, 2), and loads (s, n, t)."""
    rng, scene = np.random.default_rng(seed), TaxelScene(config)
    skin = TaxelSkin.drawn(scene.taxels, 1.5, rng)
    layout = SPEC.layout(config)
    pipeline = SPEC.pipeline(config).fit(even_loads(layout, config.areas, skin, rng, 3.0))

    def body(at: np.ndarray) -> np.ndarray:
        away = np.linalg.norm(scene.points - at, axis=1) / rng.uniform(*radii)
        peak, domed = rng.uniform(0.3, 2.5), rng.random() < 0.5
        press = np.sqrt(np.maximum(1 - away**2, 0)) if domed else np.ones(len(away))
        load = np.bincount(scene.owner, np.where(away < 1, press, 0) * scene.part, scene.taxels)
        return peak * load / load.max()

    force = np.array([[body(at) for at in row] for row in places])
    states = pipeline.process_batch(
        Recording.from_arrays(layout, skin.read(force.sum(axis=1), rng))
    )
    return states, force


def test_sigmas_of_two_contacts_are_what_their_errors_are() -> None:
    rng = np.random.default_rng(41)
    x = rng.uniform(8e-3, 12e-3, (100, 2)) * np.array([-1, 1])
    places = np.stack([x, rng.uniform(-6e-3, 6e-3, (100, 2))], axis=2)
    states, force = pressed(PLATE, 41, places, (2.5e-3, 5e-3))
    assert ((states.contacts_id >= 0).sum(axis=1) == 2).all()
    found: dict[str, list[tuple[float, float]]] = {'x': [], 'y': [], 'force': []}
    for row, k in np.ndindex(100, 2):
        place = states.contacts_position[row, k]
        own = int(place[0] > 0)
        sigma = np.sqrt(np.diag(states.contacts_position_cov[row, k]))
        for n, name in enumerate('xy'):
            found[name].append((place[n] - places[row, own, n], sigma[n]))
        error = states.contacts_force[row, k, 2] - force[row, own].sum()
        found['force'].append((error, np.sqrt(states.contacts_force_cov[row, k, 2, 2])))
    for name, pairs in found.items():
        error, sigma = np.array(pairs).T
        ratio = np.abs(error) / sigma
        thirds = np.array_split(np.argsort(sigma, kind='stable'), 3)
        for sigmas, right in ((1, 0.6827), (2, 0.9545)):
            for rows in (np.arange(len(ratio)), *thirds):
                allowed = max(0.05, 1.96 * np.sqrt(right * (1 - right) / len(rows)))
                assert (ratio[rows] < sigmas).mean() >= right - allowed, (name, sigmas, len(rows))
        # errors of edges are of many sizes: more of them are small than of a bell
        assert 0.65 < np.sqrt(np.mean(ratio**2)) < 1.25, name
        if name != 'force':
            assert np.sqrt(np.mean(error**2)) < 0.02e-3
            assert np.sqrt(np.mean(sigma**2)) < 0.03e-3


def test_ring_tells_no_radius_and_its_sigma_says_so() -> None:
    ring = dataclasses.replace(  # type: ignore[type-var]
        CONFIG, positions=radial_positions(16, 8e-3, 25e-3), objects=(),
        taxel_outlines=sectors(16, 8e-3, 25e-3),
        areas=np.full(16, np.pi * (25e-3**2 - 8e-3**2) / 16),
    )  # fmt: skip
    rng = np.random.default_rng(44)
    angle, radius = rng.uniform(-np.pi, np.pi, 90), rng.uniform(9e-3, 24e-3, 90)
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    at = radius[:, None] * out
    states, _ = pressed(ring, 45, at[:, None], (2e-3, 5e-3))
    one = (states.contacts_id[:, 0] >= 0) & (states.contacts_id[:, 1] < 0)
    assert one.mean() > 0.9
    error = states.contacts_position[:, 0, :2] - at
    cov = states.contacts_position_cov[:, 0, :2, :2]
    for way in (out, np.column_stack([-out[:, 1], out[:, 0]])):
        off = np.abs((error * way).sum(axis=1)) / np.sqrt(np.einsum('si,sij,sj->s', way, cov, way))
        assert (off[one] < 1).mean() > 0.55
        assert (off[one] < 2).mean() > 0.9


def test_no_component_is_surer_of_itself_than_it_may_be_and_sigmas_are_no_excuse(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(taxel_skins, 'LAWS', taxel_skins.LAWS[:1])  # the bench has both
    for name, (error, sigma) in taxel_skins.gathered(40).items():
        assert len(error) > 40
        assert (sigma > 0).all()
        thirds = np.array_split(np.argsort(sigma, kind='stable'), 3)
        for sigmas, right in ((1, 0.6827), (2, 0.9545)):
            inside = np.abs(error) <= sigmas * sigma
            for part in (np.arange(len(error)), *thirds):
                # 95 % for all 32 shares together (Bonferroni)
                allowed = max(0.05, 2.95 * np.sqrt(right * (1 - right) / len(part)))
                assert inside[part].mean() >= right - allowed, (name, sigmas, len(part))
        usual = np.abs(error) <= 2 * sigma
        assert np.sqrt(np.mean(np.square(error / sigma)[usual])) > 0.5, name
