# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""fidelity: error against time of every model of every magnetic sensor, and what terms are worth.

Each model is compared with the exact one over the states that its scene may visit; the cheapest
whose worst error is below a third of the noise is chosen, by operations, not by this machine's
times. Terms of a scene (stray field, temperature, tilt) are weighed by what they cost in precision
and save in bias.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks.harness.package_page import contests, pareto
from benchmarks.harness.rows import BenchResult, Row
from benchmarks.worlds import multipole_fidelity as skin
from reference import gradiometer_world
from tactile_ros.evaluation.figures import standalone
from tactile_ros.physics.fidelity import LINEAR_COST, SHARE, Choice, Model, TermGain, region
from tactile_ros.physics.field_table import (
    SHAPES,
    disc_table,
    lagrange,
    reach_under,
    table_disc_model,
)
from tactile_ros.physics.magnetics import exact_disc, on_pixels
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.gradiometer import twin as gradiometer
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.magnet_pad import body_model as pad
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
from tactile_ros.types import Array

DISC, PAD, SKIN = GradiometerConfig(), MagnetPadConfig(), MultipoleSkinConfig()
SEEDS = [0]
SPECIMENS = {'quick': (41,), 'normal': (41, 42), 'full': (41, 42, 43, 44, 45)}
NOISE = {'gradiometer': 3e-6, 'magnet_pad': 4e-6, 'multipole_skin': 4e-6}
MICRO = 1e6
LIMIT = {name: MICRO * SHARE * noise for name, noise in NOISE.items()}
BATCH = {'quick': 200, 'normal': 200, 'full': 1000}
HEADS = {'quick': 1, 'normal': 6, 'full': 20}
LOAD, AROUND = (1.5, 10.0), (0.5, np.pi - 0.5)  # N, rad: presses of [2]
GRIDS = ((9, 7, 5), (15, 11, 5), (29, 21, 9), (57, 41, 9))
BUDGET_S = 0.05
OTHERS = 1.25e-3  # m, pitch of carpets under other mechanics


def timed(model: Model, states: Array) -> float:
    """Microseconds of a state among some; the least of some repetitions."""
    least, end = np.inf, time.perf_counter() + BUDGET_S
    while time.perf_counter() < end:
        began = time.perf_counter()
        model.readings(states)
        least = min(least, time.perf_counter() - began)
    return MICRO * least / len(states)


def rows_of(scene: str, choice: Choice, models: list[Model], states: Array) -> list[Row]:
    """A row for every model."""
    by_name = {model.name: model for model in models}
    return [
        Row(
            f'{scene}: {rated.name} (rms {MICRO * rated.rms:.2g})', 'uT', MICRO * rated.worst,
            aim=MICRO * SHARE * choice.noise if rated.name == choice.name else None,
            us_single=timed(by_name[rated.name], states[:1]),
            us_batch=timed(by_name[rated.name], states),
            compared=f'worst error of models: {scene}', method=rated.name,
        )
        for rated in choice.rated
    ]  # fmt: skip


def carried(touches: Array) -> tuple[Array, Array]:
    """Movements and turns of magnets under normal touches (s, 3): along, around, force."""
    along, around, force = touches.T
    upright = np.column_stack([along, around, np.log(force), 0 * force, 0 * force])
    return pad.movement(PAD, upright)


def pad_region(count: int) -> Array:
    """Touches of [2] along the normal, shape (s, 3)."""
    reach = 0.45 * PAD.length
    low, high = np.array([-reach, AROUND[0], LOAD[0]]), np.array([reach, AROUND[1], LOAD[1]])
    return region(low, high, count)


def cubic_table(
    function: Callable[[Array], Array], low: Array, high: Array, shape: tuple[int, ...]
) -> Callable[[Array], Array]:
    """Cubic interpolation (s, c) at points (s, d) in a function's values on a regular grid."""
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, shape, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, len(shape))
    values = function(nodes).reshape(*shape, -1)
    step = (high - low) / (np.array(shape) - 1)

    def table(points: Array) -> Array:
        index, weights = [], []
        for axis, count in enumerate(shape):
            at = (points[:, axis] - low[axis]) / step[axis]
            first = np.clip(np.floor(at).astype(np.int64) - 1, 0, count - 4)
            place = [len(points)] + [1] * len(shape)
            place[axis + 1] = 4
            index.append((first[:, None] + np.arange(4)).reshape(place))
            weights.append(np.stack(lagrange(at - first - 1)[:4]))
        near = values[tuple(index)]
        for weight in weights:
            near = np.einsum('sa...,as->s...', near, weight)
        return near

    return table


def touch_tables(noise: float) -> tuple[Choice, list[Model]]:
    """Choice among tables over the touches, whose values are exact mechanics and fields."""
    field = pad.block_field(PAD, 0)

    def readings(touches: Array) -> Array:
        return field.readings(np.stack(carried(touches), axis=1).reshape(len(touches), -1))

    states = pad_region(200)
    low, high = states.min(axis=0), states.max(axis=0)
    exact = Model('exact mechanics and blocks', readings, 1e5)
    models, width = [], exact.readings(states[:1]).size
    for shape in GRIDS:
        table = cubic_table(readings, low, high, shape)
        name = f'cubic table {shape[0]} x {shape[1]} x {shape[2]}'
        models.append(Model(name, table, 64.0 * 6 * 2 + 200, int(np.prod(shape)) * width, shape))
    return skin.all_rated(models, exact, states, noise), [*models, exact]


def linear_table(shape: tuple[int, int]) -> Model:
    """Table of the disc's field, linear between its nodes."""
    diameter, height, remanence = gradiometer.disc_of(DISC)
    reach = reach_under(DISC.positions, DISC.gap, DISC.disc_height)

    @cache
    def built() -> RegularGridInterpolator:
        table, (step, least, rise, _) = disc_table(diameter, height, reach, shape)
        axes = step * (np.arange(shape[0]) - 1.0), least + rise * np.arange(shape[1])
        return RegularGridInterpolator(axes, table, bounds_error=False, fill_value=None)

    def field(own: Array) -> Array:
        near = built()(np.column_stack([own[:, 0] ** 2 + own[:, 1] ** 2, -own[:, 2]]))
        return remanence * np.column_stack([own[:, :2] * near[:, :1], near[:, 1]])

    return Model(
        f'linear table {shape[0]} x {shape[1]}', on_pixels(DISC.positions, field),
        LINEAR_COST * len(DISC.positions), 2 * shape[0] * shape[1], shape,
    )  # fmt: skip


def disc_models(noise: float) -> tuple[Choice, list[Model]]:
    """Choice among all models of the disc at a noise (T), all of them measured; and the models."""
    disc, pixels = gradiometer.disc_of(DISC), DISC.positions
    reach = reach_under(pixels, DISC.gap, DISC.disc_height)
    models = [skin.dipole_disc(pixels, disc, rings) for rings in skin.RINGS]
    models += [linear_table(shape) for shape in SHAPES]
    models += [table_disc_model(pixels, disc, reach, shape) for shape in SHAPES]
    exact = exact_disc(pixels, disc)
    return skin.all_rated(models, exact, gradiometer.states_of(DISC), noise), [*models, exact]


def scenes(extent: str) -> tuple[dict[str, list[Row]], list[str]]:
    """Rows and choices of all scenes that have an exact model."""
    touches = pad_region(BATCH[extent] // 4)
    magnets = np.stack(carried(touches), axis=1).reshape(len(touches), -1)
    shifts = region(-skin.PLAY * np.ones(3), skin.PLAY * np.ones(3), 2)[-2:]
    blocks, noise = [pad.block_field(PAD, n) for n in (*pad.EDGES, 0)], NOISE['magnet_pad']
    chosen = skin.all_rated(blocks[:-1], blocks[-1], magnets, noise)
    states = gradiometer.states_of(DISC, BATCH[extent])
    found = {
        'gradiometer': (*disc_models(NOISE['gradiometer']), states),
        'magnet_pad': (chosen, blocks, magnets),
        'magnet_pad, normal touches': (*touch_tables(noise), touches),
        'multipole_skin at rest': (*skin.rest_model(SKIN, NOISE['multipole_skin']), shifts),
    }
    notes = [
        f'{scene}: {choice.name} at {MICRO * choice.noise:.2g} uT'
        for scene, (choice, _, _) in found.items()
    ]
    return {scene: rows_of(scene, *one) for scene, one in found.items()}, notes


def skin_rows(heads: int) -> tuple[list[Row], str]:
    """Carpets of growing fineness, and other mechanics, beside the finest carpet; the choice."""
    states, noise = skin.pressed_states(heads, min(heads, 4)), NOISE['multipole_skin']
    choice, models, finest = skin.pressed_choice(SKIN, noise, states)
    truth = finest.readings(states)
    others = [skin.pressed_model(SKIN, OTHERS, law) for law in ('even', 'half-space', 'springs')]
    rows = []
    for model in (*models, finest, *others):
        found = model.readings(states)
        likeness = float((found * truth).sum() / np.sqrt((found**2).sum() * (truth**2).sum()))
        error = found - truth
        what = f'rms {MICRO * error.std():.2g}, cosine {likeness:.3f}'
        rows.append(
            Row(f'multipole_skin pressed: {model.name} ({what})', 'uT',
                MICRO * float(np.abs(error).max()),
                aim=LIMIT['multipole_skin'] if model.name == choice.name else None,
                us_single=timed(model, states[:1]), method=model.name,
                compared='worst error of models: multipole_skin pressed')
        )  # fmt: skip
    return rows, choice.name


def term_rows(scene: str, terms: tuple[TermGain, ...]) -> list[Row]:
    """Errors of a place without and with each term."""
    return [
        Row(
            f'{scene}: place with {term.name} ({term.unknowns} unknowns, costs '
            f'{term.cost:.3g}, buys {term.buys:.3g})',
            'um', MICRO * term.within, peer=MICRO * term.without, bound=MICRO * term.alone,
        )
        for term in terms
    ]  # fmt: skip


def estimated(specimens: tuple[int, ...]) -> list[Row]:
    """Error of force (mN rms) with and without terms, over specimens that fits have not seen."""
    calm = gradiometer_world.Scene()
    outside = gradiometer_world.Scene(stray=(1e-3, 5e-4, -1e-3))
    warm = gradiometer_world.Scene(span=50.0)
    rows = []
    for term, learned, words, scene in (
        ('stray_term', calm, 'no field outside', calm),
        ('stray_term', calm, '1.5 mT outside', outside),
        ('thermal_term', warm, '10 to 60 C', warm),
    ):
        errors = [
            [_force_error(seed, {term: on}, learned, scene) for on in (True, False)]
            for seed in specimens
        ]
        within, without = 1e3 * _rms(np.array(errors))
        what = f'gradiometer: force, {words}, {term} (peer: without)'
        rows.append(Row(what, 'mN', within, peer=without))
    return rows


def _rms(errors: Array) -> Array:
    """Over the first axis, and NaN left out."""
    return np.asarray(np.sqrt(np.nanmean(errors**2, axis=0)))


def _force_error(seed: int, terms: dict[str, bool], learned: object, scene: object) -> float:
    """Rms error (N) of force on fresh presses in a scene, calibrated on 300 in another."""
    specimen = gradiometer_world.World(seed)
    config = replace(specimen.config, **terms)
    pipeline = load_sensor('gradiometer').pipeline(config).fit(specimen.record(300, 1, learned))
    fresh = specimen.record(500, 2, scene)
    error = pipeline.process_batch(fresh).force - fresh.truth['force']
    return float(_rms(error[specimen.rest :].reshape(-1)))


def drawing(rows: list[Row], title: str) -> str:
    """Worst error against time in a batch, and the line below which a model is good enough."""
    (contest,) = contests(replace(row, us_single=row.us_batch or row.us_single) for row in rows)
    figure = pareto(contest)
    return standalone(*figure.plots, title=f'{title}: worst error against time', key=figure.key)


def run(extent: str, command: str) -> BenchResult:
    """Every scene with all of its models, then terms."""
    found, choices = scenes(extent)
    pressed, carpet = skin_rows(HEADS[extent])
    rows = [row for scene in found.values() for row in scene]
    rows += pressed + term_rows('gradiometer', gradiometer.terms(DISC, NOISE['gradiometer']))
    rows += term_rows('magnet_pad', pad.terms(PAD, NOISE['magnet_pad'], 100))
    rows += estimated(SPECIMENS[extent]) if extent != 'quick' else []
    notes = [
        'ours: worst error over the scene; aim: a third of the noise, for the chosen model',
        'terms: ours with the term, peer without it, bound where there is no such thing',
        *choices,
        f'multipole_skin pressed: {carpet}, beside 1.25 mm with 3 x 3 points on 4 levels',
    ]
    drawings = {
        name: drawing(spots, title)
        for name, spots, title in (
            ('gradiometer', found['gradiometer'], 'Models of a disc'),
            ('magnet_pad', found['magnet_pad'], 'Models of blocks'),
            ('multipole_skin', pressed, 'Models of a pressed sheet'),
        )
    }
    return BenchResult('fidelity', command, [*SEEDS, *SPECIMENS[extent]], rows, notes, drawings)
