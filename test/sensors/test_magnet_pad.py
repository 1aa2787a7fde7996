"""The pad in worlds of their own: exact blocks, tips as rings, stray fields, re-mounts."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.physics.magnetics import cuboid_field
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad.regression import nearest, partition, shares_of_cells
from tactile_ros.types import ContactStates, Recording

if TYPE_CHECKING:
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array

SPEC = load_sensor('magnet_pad')
NOISE = 4e-6
LEVEL = np.linspace(1e-3, 2e-3, 6).reshape(2, 3)
TARE = 60


def carried(
    config: MagnetPadConfig, place: Array, normal: Array, force: Array, tip: float
) -> Array:
    """Centres of the magnets after a press by a ring and its centre, by scalar formulas."""
    side = np.array([1.0, 0.0, 0.0])
    other = np.cross(normal, side)
    moved = config.magnet_positions.copy()
    for angle in np.arange(12) * np.pi / 6:
        for radius in np.sqrt([1 / 6, 3 / 6, 5 / 6]) * tip:
            at = place + radius * (np.cos(angle) * side + np.sin(angle) * other)
            for i, centre in enumerate(config.magnet_positions):
                r = centre - at
                d = np.sqrt(r @ r)
                moved[i] -= (force / d + r * (force @ r) / d**3) / (
                    36 * 4 * np.pi * config.shear_modulus
                )
    return moved


def field(config: MagnetPadConfig, magnets: Array) -> Array:
    """Exact field of blocks that do not turn, shape (t, 3)."""
    total = np.zeros((len(config.positions), 3))
    for at in magnets:
        total += cuboid_field(
            config.positions - at, config.magnet_size, np.array([0, 0, config.remanence])
        )
    return total


def world(
    seed: int,
    count: int,
    *,
    config: MagnetPadConfig | None = None,
    stray: float = 0.0,
    tip: float = 3e-3,
    jitter: float = 1.0,
    session: int = 0,
) -> Recording:
    """Presses along the normal at random places of random cells, each with its truth."""
    config = SPEC.config() if config is None else config
    rng = np.random.default_rng(seed)
    cell = rng.permutation(np.arange(count) % len(config.cells))
    half = 0.5 * jitter * np.array([config.length / 5, 2 * config.radius / 3])
    plan = config.cells[cell, :2] + half * rng.uniform(-1, 1, (count, 2))
    y = np.clip(plan[:, 1] / config.radius, -0.97, 0.97)
    normal = np.column_stack([np.zeros(count), y, np.sqrt(1 - y * y)])
    place = config.radius * normal
    place[:, 0] = plan[:, 0]
    force = rng.uniform(1.5, 10, (count, 1)) * normal
    rest = field(config, config.magnet_positions)
    change = np.stack(
        [
            field(config, carried(config, *row, tip)) - rest
            for row in zip(place, normal, force, strict=True)
        ]
    )
    outside = rng.normal(size=(count, 3))
    outside *= stray / np.linalg.norm(outside, axis=1, keepdims=True)
    values = np.concatenate([np.zeros((TARE, 2, 3)), change + outside[:, None]]) + LEVEL
    values += NOISE * rng.normal(size=values.shape)
    blank = np.full((TARE, 3), np.nan)
    truth = {
        'position': np.concatenate([blank, place]),
        'force': np.concatenate([blank, force]),
        'cell': np.concatenate([np.full(TARE, -1), cell]),
        'in_contact': (np.arange(TARE + count) >= TARE).astype(np.int8),
        'repetition': np.concatenate([np.zeros(TARE, int), np.arange(count)]),
        'session': np.full(TARE + count, session),
        'stray_field': np.concatenate([np.zeros((TARE, 3)), outside]),
    }
    layout = SPEC.layout(config)
    tare = np.arange(len(values)) < TARE
    return Recording.from_arrays(layout, values, tare=tare, truth=truth)


@lru_cache
def known() -> Pipeline:
    """A pad that has learned touches near the centres of cells."""
    return SPEC.pipeline().fit(world(1, 600, jitter=0.2))


def errors(states: ContactStates, recording: Recording) -> np.ndarray:
    away = states.position - recording.truth['position']
    return np.linalg.norm(away, axis=1)[~recording.tare]


def hits(states: ContactStates, recording: Recording) -> float:
    return float((states.cell == recording.truth['cell'])[~recording.tare].mean())


def test_before_any_truth_it_finds_touches() -> None:
    fresh = world(2, 250)
    rests = fresh.select(fresh.tare)
    pipeline = SPEC.pipeline().fit(rests)
    assert set(pipeline.estimators.values()) == {'nominal'}
    states = pipeline.process_batch(fresh)
    assert np.nanmean(errors(states, fresh)) < 0.9e-3
    assert hits(states, fresh) > 0.85
    sigma = np.sqrt(np.diagonal(states.position_cov, axis1=1, axis2=2))[~fresh.tare]
    away = np.abs(states.position - fresh.truth['position'])[~fresh.tare]
    assert (away <= 2 * sigma).mean() > 0.9
    # never fitted: the same answers once it is tared, without a word on contact
    bare = SPEC.pipeline()
    bare.tare([fresh.frame(i) for i in range(TARE)])
    live = bare.process(fresh.frame(TARE + 3))
    assert live.in_contact == -1
    np.testing.assert_allclose(live.position, states.position[TARE + 3], atol=1e-9)


def test_a_stray_field_costs_little_near_the_centres_of_cells() -> None:
    clean, stray = world(3, 200, jitter=0.1), world(3, 200, jitter=0.1, stray=0.5e-3)
    pipeline = known()
    assert hits(pipeline.process_batch(clean), clean) > 0.98
    states = pipeline.process_batch(stray)
    assert hits(states, stray) > 0.75
    plain = SPEC.pipeline(estimator='grid_knn').fit(world(1, 600, jitter=0.2))
    assert hits(plain.process_batch(stray), stray) < 0.4
    right = (states.cell == stray.truth['cell']) & ~stray.tare
    away = np.abs(states.stray_field - stray.truth['stray_field'])[right]
    assert np.median(away) < 0.1e-3


def test_without_a_stray_field_none_is_seen() -> None:
    fresh = world(4, 200, jitter=0.2)
    states = known().process_batch(fresh)
    seen = np.linalg.norm(states.stray_field[~fresh.tare], axis=1)
    assert (seen > 0).mean() < 0.02


def test_live_is_batch_in_a_stray_field() -> None:
    stray = world(5, 40, jitter=0.2, stray=0.3e-3)
    pipeline = known()
    batch = pipeline.process_batch(stray)
    pipeline.tare([stray.frame(i) for i in range(TARE)])
    pipeline.reset()
    for row in range(TARE, len(stray)):
        state = pipeline.process(stray.frame(row))
        for name in ('position', 'position_cov', 'force', 'cell', 'stray_field'):
            np.testing.assert_allclose(getattr(state, name), getattr(batch, name)[row], atol=1e-9)


def test_cells_follow_from_places_and_places_from_cells() -> None:
    train, fresh = world(1, 600), world(2, 200)
    for missing in ('cell', 'position'):
        told = {k: v for k, v in train.truth.items() if k != missing}
        states = SPEC.pipeline().fit(dataclasses.replace(train, truth=told)).process_batch(fresh)
        if missing == 'cell':
            assert hits(states, fresh) > 0.85
        else:
            assert np.nanmean(errors(states, fresh)) < 4e-3


def test_sessions_are_held_out_where_there_are_several() -> None:
    rng = np.random.default_rng(0)
    config = SPEC.config()
    mounts = [
        dataclasses.replace(
            config, magnet_positions=config.magnet_positions + 1e-4 * rng.normal(size=(3, 3))
        )
        for _ in range(4)
    ]
    many = [world(i, 300, config=m, jitter=0.4, session=i) for i, m in enumerate(mounts[:3])]
    pipeline = SPEC.pipeline().fit(*many)
    assert pipeline.report['position_xyz']['groups'] == 3
    fresh = world(9, 150, config=mounts[3], jitter=0.4)
    assert hits(pipeline.process_batch(fresh), fresh) >= 0.97


def test_a_place_belongs_to_the_nearest_centre() -> None:
    cells = SPEC.config().cells
    told = np.arange(len(cells))
    assert partition(cells, told, cells) == (0, 1, 2)
    assert partition(cells, told[::-1].copy(), cells) == ()
    assert nearest(cells, cells, (0, 1)).tolist() == told.tolist()
    cov = np.tile(1e-12 * np.eye(3), (len(cells), 1, 1))
    shares = shares_of_cells(cells, cov, cells, (0, 1))
    np.testing.assert_allclose(shares, np.eye(len(cells)), atol=1e-12)
    middle = 0.5 * (cells[:1] + cells[1:2])
    half = shares_of_cells(middle, 1e-6 * np.eye(3)[None], cells, (0, 1))
    assert half[0, :2] == pytest.approx(0.5, abs=0.05)


def told_of_rest(recording: Recording, rows: int) -> Recording:
    """Its first rows, of whose rest truth says that the force is 0."""
    truth = {name: np.array(column[:rows]) for name, column in recording.truth.items()}
    truth['force'][:TARE], truth['in_contact'] = 0.0, (np.arange(rows) >= TARE).astype(np.int8)
    return Recording.from_arrays(
        SPEC.layout(SPEC.config()),
        recording.values[:rows],
        tare=np.arange(rows) < TARE,
        truth=truth,
    )


def test_a_force_of_0_at_rest_is_no_touch_and_the_nominal_model_speaks() -> None:
    recording = world(41, 20)
    rested = SPEC.pipeline(SPEC.config()).fit(told_of_rest(recording, TARE))
    assert set(rested.estimators.values()) == {'nominal'}
    assert np.isfinite(rested.process_batch(recording).position[-20:]).all()


def test_sigmas_of_few_touches_after_a_long_rest_are_those_of_touches() -> None:
    few = SPEC.pipeline(SPEC.config()).fit(told_of_rest(world(42, 10), TARE + 10))
    test = world(43, 100)
    states = few.process_batch(test)
    there = states.in_contact == 1
    error = (states.force - test.truth['force'])[there][:, 1:]
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))[there][:, 1:]
    assert (np.abs(error) < 2 * sigma).mean() > 0.7


def test_touches_that_change_nothing_are_no_failure() -> None:
    recording = world(44, 40)
    still = np.broadcast_to(recording.values[:1], recording.values.shape)
    same = Recording.from_arrays(
        SPEC.layout(SPEC.config()), still, tare=np.arange(len(still)) < TARE, truth=recording.truth
    )
    states = SPEC.pipeline(SPEC.config()).fit(same).process_batch(recording)
    assert len(states.valid) == len(recording.values)


def test_before_any_truth_sigmas_of_force_hold_for_a_softer_body() -> None:
    softer = dataclasses.replace(SPEC.config(), shear_modulus=1.3 * SPEC.config().shear_modulus)
    test = world(45, 100)
    states = SPEC.pipeline(softer).fit(test.select(test.tare)).process_batch(test)
    error = (states.force - test.truth['force'])[TARE:]
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))[TARE:]
    assert (np.abs(error) < 2 * sigma)[:, 1:].mean() > 0.8
