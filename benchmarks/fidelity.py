"""fidelity: error against time of every model of every magnetic sensor, and what terms are worth.

Each model is compared with the exact one over the states that its scene may visit; the cheapest
whose worst error is below a third of the noise is chosen, by operations, not by this machine's
times. Terms of a scene (stray field, temperature, tilt) are weighed by what they cost in precision
and save in bias.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.evaluation.drawing import standalone
from tactile_ros.evaluation.svg import Plot
from tactile_ros.physics.elastomer import disc_press
from tactile_ros.physics.fidelity import SHARE, Choice, Model, choose, region
from tactile_ros.physics.grid_table import GridTable
from tactile_ros.physics.scene_terms import Term, Worth, worth
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.sensors.gradiometer import fidelity as gradiometer
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.magnet_pad import fidelity as pad
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.multipole_skin import fidelity as skin
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig

if TYPE_CHECKING:
    from tactile_ros.types import Array

SEEDS = [0]
NOISE = {'gradiometer': 3e-6, 'magnet_pad': 4e-6, 'multipole_skin': 4e-6}
MICRO = 1e6
BATCH = {'quick': 200, 'normal': 1000, 'full': 1000}
HEADS = {'quick': 2, 'normal': 6, 'full': 20}
LOAD, TIP, AROUND = (1.5, 10.0), 3e-3, (0.5, np.pi - 0.5)  # N, m, rad: presses of [2]
GRIDS = ((9, 7, 5), (15, 11, 5), (29, 21, 9), (57, 41, 9))
BUDGET_S = 0.2
KINDS = ('dipole', 'linear', 'cubic', 'exact')


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
) -> tuple[list[Row], list[tuple[str, float, float]]]:
    """A row for every model, and (name, time, worst error) of each in microseconds and uT."""
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
            )
        )
        spots.append((rated.name, batch, MICRO * rated.worst))
    return rows, spots


def pad_movement(config: MagnetPadConfig, touches: Array) -> tuple[Array, Array]:
    """Shifts and turns of the magnets under touches (s, 3): along (m), around (rad), force (N)."""
    along, around, force = touches.T
    normal = np.column_stack([0 * along, np.cos(around), np.sin(around)])
    place = config.radius * normal + along[:, None] * np.eye(3)[0]
    tip, bond = np.full(len(along), TIP), np.full(len(along), 0.5)

    def displacement(points: Array) -> Array:
        wide = np.broadcast_to(points, (len(place), *points.shape))
        push = -force[:, None] * normal
        return disc_press(wide, place, normal, push, tip, config.shear_modulus, bond)

    return pad.blocks_of(config, 1).carried(displacement)


def pad_region(config: MagnetPadConfig, count: int) -> Array:
    """Touches of [2] along the normal, shape (s, 3)."""
    reach = 0.45 * config.length
    low, high = np.array([-reach, AROUND[0], LOAD[0]]), np.array([reach, AROUND[1], LOAD[1]])
    return region(low, high, count)


def touch_tables(config: MagnetPadConfig, noise: float) -> tuple[Choice, list[Model]]:
    """Choice among tables over the touches, whose values are exact mechanics and fields."""
    field = pad.block_field(config, 0)

    def readings(touches: Array) -> Array:
        moved, turned = pad_movement(config, touches)
        return field.readings(np.stack([moved, turned], axis=1).reshape(len(touches), -1))

    states = pad_region(config, 200)
    low, high = states.min(axis=0), states.max(axis=0)
    exact = Model('exact mechanics and blocks', readings, 1e5)
    models = []
    for shape in GRIDS:
        table = GridTable.of(readings, low, high, shape)
        name = f'cubic table {shape[0]} x {shape[1]} x {shape[2]}'
        models.append(Model(name, table.at, 64.0 * 6 * 2 + 200, table.values.size, shape))
    return choose(models, exact, states, noise, every=True), [*models, exact]


def pad_terms(config: MagnetPadConfig, noise: float) -> tuple[Worth, ...]:
    """What a stray field and a temperature cost and buy, in place of a touch (m)."""
    touches = pad_region(config, 100)[8:]
    field = pad.block_field(config, 0)

    def readings(at: Array) -> Array:
        moved, turned = pad_movement(config, at)
        return field.readings(np.stack([moved, turned], axis=1).reshape(len(at), -1))

    step = np.array([1e-6, 1e-6 / config.radius, 1e-3])
    slopes = [
        (readings(touches + e) - readings(touches - e)) / (2 * size)
        for e, size in zip(np.diag(step), [1e-6, 1e-6, 1e-3], strict=True)
    ]
    even = np.tile(np.eye(3), (len(config.positions), 1))
    uniform = np.broadcast_to(even, (len(touches), *even.shape))
    still = np.zeros((1, len(config.magnet_positions), 3))
    blocks = pad.blocks_of(config, 0)
    level = blocks.field(config.positions, still, still).reshape(1, -1)
    warm = REMANENCE_SLOPE * (level + readings(touches))[..., None]
    terms = (
        Term('uniform stray field', uniform, 0.3e-3),
        Term('temperature of the magnets', warm, 5.0),
    )
    return worth(np.stack(slopes, axis=-1), noise, terms, wanted=2)


def term_rows(scene: str, terms: tuple[Worth, ...]) -> list[Row]:
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


def skin_rows(config: MultipoleSkinConfig, heads: int) -> list[Row]:
    """Carpets of growing fineness, and other mechanics, beside the finest carpet."""
    states = skin.pressed_states(heads)
    truth = skin.pressed_model(config, skin.FINEST).readings(states)
    kinds = [(pitch, 'bonded') for pitch in skin.PITCHES]
    kinds += [(skin.PITCHES[-1], law) for law in ('even', 'half-space', 'springs')]
    rows = []
    for pitch, law in kinds:
        model = skin.pressed_model(config, pitch, law)
        found = model.readings(states)
        likeness = float((found * truth).sum() / np.sqrt((found**2).sum() * (truth**2).sum()))
        error, (single, _) = found - truth, timed(model, states[:1])
        what = f'rms {MICRO * error.std():.2g}, cosine {likeness:.3f}'
        worst = MICRO * float(np.abs(error).max())
        rows.append(
            Row(f'multipole_skin pressed: {model.name} ({what})', 'uT', worst, us_single=single)
        )
    return rows


def drawing(spots: list[tuple[str, float, float]], limit: float, told: str) -> str:
    """Worst error against time in a batch, with the line below which a model is good enough."""
    shown = [spot for spot in spots if spot[2] > 0]
    times, errors = [s[1] for s in shown], [s[2] for s in shown]
    wide, tall = (min(times) / 2, 2 * max(times)), (min(*errors, limit) / 3, 3 * max(errors))
    plot = Plot(wide, tall, 'time of a frame in a batch (µs)', 'worst error (µT)', (560, 360),
                log_x=True, log_y=True, told=told)  # fmt: skip
    ends = np.array(wide)
    plot.line(ends, np.full(2, limit), 'line ink')
    plot.text(wide[0], limit, 'a third of the noise', shift=-12)
    for name, us, error in shown:
        kind = next((i for i, word in enumerate(KINDS) if word in name), 1)
        plot.mark(us, error, kind, f'fill c{kind}')
    exact = [spot for spot in spots if spot[2] == 0]
    for name, us, _ in exact:
        plot.rule(us, name)
    return standalone(plot)


def run(extent: str, command: str) -> BenchResult:
    """Every scene with all of its models, then terms."""
    rows: list[Row] = []
    notes = ['ours: worst error over the scene; aim: a third of the noise, for the chosen model']
    notes.append('terms: ours with the term, peer without it, bound where there is no such thing')
    disc, noise = GradiometerConfig(), NOISE['gradiometer']
    choice, models = gradiometer.every_model(disc, noise)
    found, spots = rows_of(
        'gradiometer', choice, models, gradiometer.states_of(disc, BATCH[extent])
    )
    rows += found
    choices = {'gradiometer': choice}
    magnets = MagnetPadConfig()
    touches = pad_region(magnets, BATCH[extent] // 4)
    moved, turned = pad_movement(magnets, touches)
    noise = NOISE['magnet_pad']
    choice = pad.block_model(magnets, noise, moved, turned, every=True)
    blocks = [pad.block_field(magnets, n) for n in (*pad.EDGES, 0)]
    states = np.stack([moved, turned], axis=1).reshape(len(moved), -1)
    rows += rows_of('magnet_pad', choice, blocks, states)[0]
    choices['magnet_pad'] = choice
    choice, models = touch_tables(magnets, noise)
    found, over_touches = rows_of('magnet_pad, normal touches', choice, models, touches)
    rows += found
    choices['magnet_pad, normal touches'] = choice
    sheet = MultipoleSkinConfig()
    choice, models = skin.rest_model(sheet, NOISE['multipole_skin'])
    shifts = region(-skin.PLAY * np.ones(3), skin.PLAY * np.ones(3), 2)[-2:]
    rows += rows_of('multipole_skin at rest', choice, models, shifts)[0]
    choices['multipole_skin at rest'] = choice
    rows += skin_rows(sheet, HEADS[extent])
    rows += term_rows('gradiometer', gradiometer.terms(disc, NOISE['gradiometer']))
    rows += term_rows('magnet_pad', pad_terms(magnets, noise))
    notes += [f'{scene}: {c.name} at {MICRO * c.noise:.2g} uT' for scene, c in choices.items()]
    notes.append('multipole_skin pressed: beside the finest carpet, 0.625 mm; no closed form')
    third = MICRO * SHARE
    drawings = {
        'gradiometer': drawing(spots, third * NOISE['gradiometer'], 'Models of a disc'),
        'magnet_pad': drawing(over_touches, third * noise, 'Tables over touches'),
    }
    return BenchResult('fidelity', command, SEEDS, rows, notes, drawings)
