# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""fidelity: error against time of every model of every magnetic sensor, and what terms are worth.

Each model is compared with the exact one over the states that its scene may visit; the cheapest
whose worst error is below a third of the noise is chosen, by operations, not by this machine's
times. Terms of a scene (stray field, temperature, tilt) are weighed by what they cost in precision
and save in bias.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks.harness.rows import BenchResult, Row
from benchmarks.worlds import multipole_fidelity as skin
from benchmarks.worlds.disc_dipoles import RINGS, dipole_disc
from tactile_ros.evaluation.figures import Plot, standalone
from tactile_ros.physics.fidelity import (
    LINEAR_COST,
    SHARE,
    Choice,
    Model,
    TermGain,
    region,
)
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
from tactile_ros.sensors.magnet_pad.body_model import movement
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from tactile_ros.types import Array

SEEDS = [0]
SPECIMENS = {'quick': (41,), 'normal': (41, 42), 'full': (41, 42, 43, 44, 45)}
NOISE = {'gradiometer': 3e-6, 'magnet_pad': 4e-6, 'multipole_skin': 4e-6}
MICRO = 1e6
BATCH = {'quick': 200, 'normal': 200, 'full': 1000}
HEADS = {'quick': 1, 'normal': 6, 'full': 20}
LOAD, AROUND = (1.5, 10.0), (0.5, np.pi - 0.5)  # N, rad: presses of [2]
GRIDS = ((9, 7, 5), (15, 11, 5), (29, 21, 9), (57, 41, 9))
BUDGET_S = 0.05
OTHERS = 1.25e-3  # m, pitch of carpets under other mechanics
KINDS = ('dipole', 'linear', 'cubic', 'exact')
Spot = tuple[str, float, float]  # name, time (us), worst error (uT)


def upright(touches: Array) -> Array:
    """Touches along the normal from places along and around, and forces, shape (s, 3)."""
    along, around, force = touches.T
    return np.column_stack([along, around, np.log(force), 0 * force, 0 * force])


def timed(model: Model, states: Array) -> tuple[float, float]:
    """Microseconds of one state alone and of one among all; the least of some repetitions."""
    found = []
    for rows in (states[:1], states):
        least, end = np.inf, time.perf_counter() + BUDGET_S
        while time.perf_counter() < end:
            began = time.perf_counter()
            model.readings(rows)
            least = min(least, time.perf_counter() - began)
        found.append(MICRO * least / len(rows))
    return found[0], found[1]


def rows_of(
    scene: str, choice: Choice, models: list[Model], states: Array
) -> tuple[list[Row], list[Spot]]:
    """A row and a spot for every model."""
    by_name = {model.name: model for model in models}
    rows, spots = [], []
    for rated in choice.rated:
        single, batch = timed(by_name[rated.name], states)
        chosen = rated.name == choice.name
        rows.append(
            Row(
                f'{scene}: {rated.name} (rms {MICRO * rated.rms:.2g})',
                'uT',
                MICRO * rated.worst,
                aim=MICRO * SHARE * choice.noise if chosen else None,
                us_single=single,
                us_batch=batch,
                compared=f'worst error of models: {scene}',
                method=rated.name,
            )
        )
        spots.append((rated.name, batch, MICRO * rated.worst))
    return rows, spots


def pad_region(config: MagnetPadConfig, count: int) -> Array:
    """Touches of [2] along the normal, shape (s, 3)."""
    reach = 0.45 * config.length
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
            weight = np.stack(lagrange(at - first - 1)[:4])
            place = [len(points)] + [1] * len(shape)
            place[axis + 1] = 4
            index.append((first[:, None] + np.arange(4)).reshape(place))
            weights.append(weight)
        near = values[tuple(index)]
        for weight in weights:
            near = np.einsum('sa...,as->s...', near, weight)
        return near

    return table


def touch_tables(config: MagnetPadConfig, noise: float) -> tuple[Choice, list[Model]]:
    """Choice among tables over the touches, whose values are exact mechanics and fields."""
    field = pad.block_field(config, 0)

    def readings(touches: Array) -> Array:
        moved, turned = movement(config, upright(touches))
        return field.readings(np.stack([moved, turned], axis=1).reshape(len(touches), -1))

    states = pad_region(config, 200)
    low, high = states.min(axis=0), states.max(axis=0)
    exact = Model('exact mechanics and blocks', readings, 1e5)
    models, width = [], exact.readings(states[:1]).size
    for shape in GRIDS:
        table = cubic_table(readings, low, high, shape)
        name = f'cubic table {shape[0]} x {shape[1]} x {shape[2]}'
        models.append(Model(name, table, 64.0 * 6 * 2 + 200, int(np.prod(shape)) * width, shape))
    return skin.all_rated(models, exact, states, noise), [*models, exact]


def linear_table(config: GradiometerConfig, shape: tuple[int, int]) -> Model:
    """Table of the disc's field, linear between its nodes."""
    diameter, height, remanence = gradiometer.disc_of(config)
    reach = reach_under(config.positions, config.gap, config.disc_height)

    @cache
    def built() -> RegularGridInterpolator:
        table, (step, least, rise, _) = disc_table(diameter, height, reach, shape)
        axes = step * (np.arange(shape[0]) - 1.0), least + rise * np.arange(shape[1])
        return RegularGridInterpolator(axes, table, bounds_error=False, fill_value=None)

    def field(own: Array) -> Array:
        near = built()(np.column_stack([own[:, 0] ** 2 + own[:, 1] ** 2, -own[:, 2]]))
        return remanence * np.column_stack([own[:, :2] * near[:, :1], near[:, 1]])

    count = len(config.positions)
    return Model(
        f'linear table {shape[0]} x {shape[1]}', on_pixels(config.positions, field),
        LINEAR_COST * count, 2 * shape[0] * shape[1], shape,
    )  # fmt: skip


def disc_models(config: GradiometerConfig, noise: float) -> tuple[Choice, list[Model]]:
    """Choice among all models of the disc at a noise (T), all of them measured; and the models."""
    disc, pixels = gradiometer.disc_of(config), config.positions
    reach = reach_under(pixels, config.gap, config.disc_height)
    models = [dipole_disc(pixels, disc, rings) for rings in RINGS]
    models += [linear_table(config, shape) for shape in SHAPES]
    models += [table_disc_model(pixels, disc, reach, shape) for shape in SHAPES]
    exact = exact_disc(pixels, disc)
    states = gradiometer.states_of(config)
    return skin.all_rated(models, exact, states, noise), [*models, exact]


def term_rows(scene: str, terms: tuple[TermGain, ...]) -> list[Row]:
    """Errors of a place without and with each term."""
    return [
        Row(
            f'{scene}: place with {term.name} ({term.unknowns} unknowns, costs '
            f'{term.cost:.3g}, buys {term.buys:.3g})',
            'um',
            MICRO * term.within,
            peer=MICRO * term.without,
            bound=MICRO * term.alone,
        )
        for term in terms
    ]


def skin_rows(config: MultipoleSkinConfig, heads: int) -> tuple[list[Row], list[Spot], str]:
    """Carpets of growing fineness, and other mechanics, beside the finest carpet; the choice."""
    states, noise = skin.pressed_states(heads, min(heads, 4)), NOISE['multipole_skin']
    choice, models, finest = skin.pressed_choice(config, noise, states)
    truth = finest.readings(states)
    others = [skin.pressed_model(config, OTHERS, law) for law in ('even', 'half-space', 'springs')]
    rows, spots = [], []
    for model in (*models, finest, *others):
        found = model.readings(states)
        likeness = float((found * truth).sum() / np.sqrt((found**2).sum() * (truth**2).sum()))
        error, (single, _) = found - truth, timed(model, states[:1])
        what = f'rms {MICRO * error.std():.2g}, cosine {likeness:.3f}'
        worst = MICRO * float(np.abs(error).max())
        limit = MICRO * SHARE * noise if model.name == choice.name else None
        name = f'multipole_skin pressed: {model.name} ({what})'
        rows.append(
            Row(name, 'uT', worst, aim=limit, us_single=single,
                compared='worst error of models: multipole_skin pressed', method=model.name)
        )  # fmt: skip
        spots.append((model.name, single, worst))
    return rows, spots, choice.name


def world() -> ModuleType | None:
    """Specimens of a gradiometer with fields of magpylib; None without it or the sources."""
    try:
        from reference import gradiometer_world
    except ImportError:
        return None
    return gradiometer_world


def estimated(module: ModuleType, extent: str) -> list[Row]:
    """Error of force (mN rms) with and without terms, over specimens that fits have not seen."""
    calm, outside = module.Scene(), module.Scene(stray=(1e-3, 5e-4, -1e-3))
    warm = module.Scene(span=50.0)
    cases = (
        ('stray_term', calm, {'no field outside': calm, '1.5 mT outside': outside}),
        ('thermal_term', warm, {'0 to 50 C': warm}),
    )
    rows = []
    for term, learned, scenes in cases:
        found = np.array([
            [_force_errors(module, seed, {term: on}, learned, scenes) for on in (True, False)]
            for seed in SPECIMENS[extent]
        ])  # fmt: skip
        for words, (within, without) in zip(scenes, 1e3 * _rms(found).T, strict=True):
            what = f'gradiometer: force, {words}, {term} (peer: without)'
            rows.append(Row(what, 'mN', within, peer=without))
    return rows


def _rms(errors: Array) -> Array:
    """Over the first axis, and NaN left out."""
    return np.asarray(np.sqrt(np.nanmean(errors**2, axis=0)))


def _force_errors(
    module: ModuleType,
    seed: int,
    terms: dict[str, bool],
    learned: object,
    scenes: dict[str, object],
) -> list[float]:
    """Rms error (N) of force on fresh presses in scenes, calibrated on 300 presses in another."""
    specimen = module.World(seed)
    config = replace(specimen.config, **terms)
    pipeline = load_sensor('gradiometer').pipeline(config).fit(specimen.record(300, 1, learned))
    found = []
    for scene in scenes.values():
        fresh = specimen.record(500, 2, scene)
        error = pipeline.process_batch(fresh).force - fresh.truth['force']
        found.append(float(_rms(error[specimen.rest :].reshape(-1))))
    return found


def drawing(spots: list[Spot], limit: float, told: str) -> str:
    """Worst error against time, with the line below which a model is good enough."""
    shown = [spot for spot in spots if spot[2] > 0]
    every, errors = [s[1] for s in spots], [s[2] for s in shown]
    wide = min(every) / 2, 2.5 * max(every)
    tall = min(*errors, limit) / 8, min(5 * max(errors), 99e3)  # a label of 1e5 is too wide
    plot = Plot(wide, tall, 'time of a frame (µs)', 'worst error (µT)', (560, 360),
                log_x=True, log_y=True, description=told)  # fmt: skip
    plot.line(np.array(wide), np.full(2, limit), 'line ink')
    plot.text(wide[0], limit, 'a third of the noise', shift=-12)
    last: dict[str, tuple[float, float, bool]] = {}
    for name, us, error in shown:
        kind = next((i for i, word in enumerate(KINDS) if word in name), 0)
        plot.mark(us, error, kind, f'fill c{kind}')
        words = name.replace(', bonded layer', '').replace('1.25 mm, ', '')
        below = 'table' in name or 'even' in name
        last[f'{KINDS[kind]} tables' if 'table' in name else words] = us, error, below
    for words, (us, error, below) in last.items():
        plot.text(us, error, words, 'middle', shift=17 if below else -14)
    for row, (name, us, _) in enumerate(spot for spot in spots if spot[2] == 0):
        plot.rule(us, name, row=row)
    return standalone(plot)


def scenes(extent: str) -> tuple[list[Row], dict[str, list[Spot]], list[str]]:
    """Rows, spots and choices of all scenes that have an exact model."""
    disc, magnets, sheet = GradiometerConfig(), MagnetPadConfig(), MultipoleSkinConfig()
    touches = pad_region(magnets, BATCH[extent] // 4)
    moved, turned = movement(magnets, upright(touches))
    shifts = region(-skin.PLAY * np.ones(3), skin.PLAY * np.ones(3), 2)[-2:]
    noise = NOISE['magnet_pad']
    blocks = [pad.block_field(magnets, n) for n in (*pad.EDGES, 0)]
    carried = np.stack([moved, turned], axis=1).reshape(len(moved), -1)
    chosen = skin.all_rated(blocks[:-1], blocks[-1], carried, noise)
    found = {
        'gradiometer': (
            *disc_models(disc, NOISE['gradiometer']),
            gradiometer.states_of(disc, BATCH[extent]),
        ),
        'magnet_pad': (chosen, blocks, carried),
        'magnet_pad, normal touches': (*touch_tables(magnets, noise), touches),
        'multipole_skin at rest': (*skin.rest_model(sheet, NOISE['multipole_skin']), shifts),
    }
    rows: list[Row] = []
    spots: dict[str, list[Spot]] = {}
    notes = []
    for scene, (choice, models, states) in found.items():
        more, spots[scene] = rows_of(scene, choice, models, states)
        rows += more
        notes.append(f'{scene}: {choice.name} at {MICRO * choice.noise:.2g} uT')
    return rows, spots, notes


def run(extent: str, command: str) -> BenchResult:
    """Every scene with all of its models, then terms."""
    rows, spots, choices = scenes(extent)
    pressed, carpets, carpet = skin_rows(MultipoleSkinConfig(), HEADS[extent])
    terms = gradiometer.terms(GradiometerConfig(), NOISE['gradiometer'])
    rows += pressed + term_rows('gradiometer', terms)
    rows += term_rows('magnet_pad', pad.terms(MagnetPadConfig(), NOISE['magnet_pad'], 100))
    module = None if extent == 'quick' else world()
    rows += [] if module is None else estimated(module, extent)
    notes = [
        'ours: worst error over the scene; aim: a third of the noise, for the chosen model',
        'terms: ours with the term, peer without it, bound where there is no such thing',
        *choices,
        f'multipole_skin pressed: {carpet}, beside 1.25 mm with 3 x 3 points on 4 levels',
    ]
    limit = {name: MICRO * SHARE * noise for name, noise in NOISE.items()}
    pads = spots['magnet_pad'] + spots['magnet_pad, normal touches']
    drawings = {
        'gradiometer': drawing(spots['gradiometer'], limit['gradiometer'], 'Models of a disc'),
        'magnet_pad': drawing(pads, limit['magnet_pad'], 'Models of blocks and of touches'),
        'multipole_skin': drawing(carpets, limit['multipole_skin'], 'Models of a pressed sheet'),
    }
    return BenchResult('fidelity', command, [*SEEDS, *SPECIMENS[extent]], rows, notes, drawings)
