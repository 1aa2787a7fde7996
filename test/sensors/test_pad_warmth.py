"""A pad that is warmer than at its tare is no pad that is pressed."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.cli.calibrate import sentences
from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad.temperature import UNSURE, Warmth
from tactile_ros.types import ContactStates, Frame, Recording, TaxelStatus

pytest.importorskip('magpylib')
reference = import_module('reference.magnet_pad_world')
SPEC = load_sensor('magnet_pad')
CONFIG = SPEC.config()
LAYOUT = SPEC.layout(CONFIG)
WORLD = reference.PadWorld(CONFIG, seed=6)
REST, TABLE = 60, 'table_gauss_newton'


@lru_cache
def presses(seed: int, count: int) -> tuple[object, Recording]:
    touches = reference.Touches.in_cells(CONFIG, (5, 3), count, 1.0, seed, loads=(1.5, 10.0))
    return touches, WORLD.record(touches, seed + 100, layout=LAYOUT)


def warm(rise: float, seed: int = 8, count: int = 200, **more: float) -> tuple[object, Recording]:
    """Presses by `rise` (degrees) above their tare."""
    touches, seen = presses(seed, count)
    above = np.where(np.arange(len(seen)) < REST, 0.0, rise)
    return touches, WORLD.warmed(seen, above, seed, layout=LAYOUT, **more)


def untold(seen: Recording) -> Recording:
    """The same without temperatures."""
    return Recording.from_arrays(LAYOUT, seen.values, tare=seen.tare, truth=dict(seen.truth))


@lru_cache
def known(estimator: str) -> Pipeline:
    learnt = [] if estimator == 'nominal' else [warm(0.0, 1, 300)[1]]
    return SPEC.pipeline(estimator=estimator).fit(*(learnt or [warm(0.0)[1].select(slice(REST))]))


def judged(states: ContactStates, touches: object) -> tuple[float, float]:
    """Root mean square error of Fz (N), and its share inside two sigma."""
    error = states.force[REST:, 2] - touches.force[:, 2]
    sigma = np.sqrt(states.force_cov[REST:, 2, 2])
    return float(np.sqrt((error**2).mean())), float((np.abs(error) < 2 * sigma).mean())


@pytest.mark.parametrize('estimator', [TABLE, 'kernel_ridge', 'nominal'])
def test_forces_above_the_temperature_of_the_tare_are_as_good(estimator: str) -> None:
    pipeline = known(estimator)
    usual, _ = judged(pipeline.process_batch(warm(0.0)[1]), warm(0.0)[0])
    for rise in (-5.0, 2.0, 5.0):
        touches, seen = warm(rise)
        error, inside = judged(pipeline.process_batch(seen), touches)
        assert error < 1.1 * usual
        assert inside > 0.9


def test_temperatures_that_nobody_tells_cost_what_they_cost() -> None:
    touches, seen = warm(5.0)
    error, inside = judged(known(TABLE).process_batch(untold(seen)), touches)
    assert error > 2 * judged(known(TABLE).process_batch(seen), touches)[0]
    assert inside < 0.5


def test_magnets_of_another_kind_are_doubted_more_the_warmer_they_are() -> None:
    sigmas = []
    for rise in (0.0, 2.0, 5.0, 20.0):
        touches, seen = warm(rise, slope=(1 - UNSURE) * REMANENCE_SLOPE)
        states = known(TABLE).process_batch(seen)
        sigmas.append(np.median(np.sqrt(states.force_cov[REST:, 2, 2])))
        assert judged(states, touches)[1] > 0.85
    assert sigmas[0] < sigmas[1] < sigmas[2] < 0.5 * sigmas[3]


def warm_rests(slope: float) -> list[Recording]:
    """Recordings that grow warm after their tares, at rest too."""
    parts = []
    for seed, rise in enumerate((-4.0, 3.0, 5.0)):
        _, seen = presses(20 + seed, 60)
        rest = np.arange(REST) % len(seen)
        seen = seen.select(np.concatenate([rest, rest, np.arange(REST, len(seen))]))
        tare = np.arange(len(seen)) < REST
        seen = Recording.from_arrays(LAYOUT, seen.values, tare=tare, truth=dict(seen.truth))
        above = np.where(tare, 0.0, rise * np.arange(len(seen)) / len(seen))
        parts.append(WORLD.warmed(seen, above, seed, slope=slope, layout=LAYOUT))
    return parts


def test_rests_at_other_temperatures_tell_the_slope() -> None:
    slope = -2e-3
    found = SPEC.pipeline(estimator=TABLE).fit(*warm_rests(slope)).estimation.tares_.warmth_
    assert found.slope_ == pytest.approx(slope, rel=0.25)
    assert found.unsure_ < 0.8 * Warmth().unsure_


def test_the_noise_of_thermometers_moves_no_force() -> None:
    rough = known(TABLE).process_batch(warm(0.0)[1])
    pipeline = SPEC.pipeline(estimator=TABLE).fit(warm(0.0, 1, 300, thermometer=5.0)[1])
    states = pipeline.process_batch(warm(0.0, thermometer=5.0)[1])
    touches = warm(0.0)[0]
    assert judged(states, touches)[0] < 1.1 * judged(rough, touches)[0]


def test_a_fit_is_the_same_whatever_was_fitted_before() -> None:
    pipeline = SPEC.pipeline(estimator='kernel_ridge').fit(*warm_rests(-2e-3))
    digest = pipeline.digest
    assert pipeline.fit(*warm_rests(-2e-3)).digest == digest
    told = [said for said in sentences(pipeline.report) if said.startswith('found: ')]
    assert len(told) == 1
    assert 'per degree -0.001' in told[0]


def with_chips(seen: Recording, chips: np.ndarray, status: np.ndarray | None = None) -> Recording:
    return Recording.from_arrays(
        LAYOUT, seen.values, temperature_c=chips, tare=seen.tare, truth=dict(seen.truth),
        status=status,
    )  # fmt: skip


@pytest.mark.parametrize('told', [-273.15, 1e9, 1e300, -np.inf])
def test_a_temperature_that_no_chip_can_have_is_none(told: float) -> None:
    _, seen = warm(5.0)
    chips = np.array(seen.temperature_c)
    chips[REST:, 1] = told
    without = np.where(chips == told, np.nan, chips)
    found, wanted = (known(TABLE).process_batch(with_chips(seen, c)) for c in (chips, without))
    np.testing.assert_array_equal(found.force, wanted.force)


def test_one_chip_may_tell_nothing_and_that_of_a_dead_taxel_may_stand_still() -> None:
    rises = []
    for chip, dead in ((np.nan, 0), (25.0, TaxelStatus.DEAD)):
        given = []
        for seen in (warm(0.0, 1, 300, thermometer=1.0)[1], warm(5.0)[1]):
            chips, bits = np.array(seen.temperature_c), np.zeros((len(seen), 2), np.uint8)
            chips[:, 1], bits[:, 1] = chip, dead
            given.append(with_chips(seen, chips, bits))
        pipeline = SPEC.pipeline(estimator='kernel_ridge').fit(given[0])
        warmth = pipeline.estimation.tares_.warmth_
        assert warmth.thermometer_ == pytest.approx(1.0, rel=0.2)
        warmth.thermometer_ = 0.0
        read = pipeline._readings(given[1].values, given[1].status, pipeline.rest_.dead)
        conditioned = pipeline._condition_rows(given[1], *read)
        rises.append(warmth.rise(conditioned.rest_temperature_c, conditioned.temperature_c)[REST:])
    np.testing.assert_allclose(rises, 5.0, atol=0.1)


@pytest.mark.parametrize('estimator', [TABLE, 'nominal'])
def test_a_tare_brings_its_temperature_live_in_a_file_and_in_a_bag(
    estimator: str, tmp_path: Path
) -> None:
    known(estimator).save(tmp_path / 'pad.npz')
    pipeline = SPEC.load(tmp_path / 'pad.npz')
    _, seen = warm(4.0)
    batch = pipeline.process_batch(seen)
    digest, rest = pipeline.digest, [seen.frame(i) for i in range(REST)]
    pipeline.tare(rest)
    assert pipeline.digest == digest
    np.testing.assert_allclose(pipeline.baseline_temperature_c, 25.0, atol=0.02)
    for row in (REST, REST + 7):
        live = pipeline.process(seen.frame(row))
        np.testing.assert_array_equal(live.force, batch.force[row])
        np.testing.assert_array_equal(live.force_cov, batch.force_cov[row])
    pipeline.save(tmp_path / 'tared.npz')
    told: list[Frame] = []
    stage = ContactLoop(SPEC.load(tmp_path / 'tared.npz'), 10, False, told.append)
    state = stage.process(seen.frame(REST + 9))
    other = SPEC.load(tmp_path / 'pad.npz')
    other.tare(told)
    np.testing.assert_array_equal(other.process(seen.frame(REST + 9)).force, state.force)
    assert stage.tare()[0]
    state = stage.process(seen.frame(REST + 10))
    other.tare(told[-1:])
    replayed = other.process(seen.frame(REST + 10))
    assert told[-1].averaged == other.tare_frames == 1
    np.testing.assert_array_equal(replayed.force_cov, state.force_cov)
    blind = SPEC.load(tmp_path / 'pad.npz')
    blind.tare([Frame(None, 0, told[0].values, averaged=0)])
    assert np.isnan(blind.baseline_temperature_c).all()
    assert not np.array_equal(blind.process(seen.frame(REST + 9)).force, state.force)
