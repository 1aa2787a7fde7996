"""The network of [1] beside presses as classes: tables III and V and figure 9 by their splits.

The shipped networks are asked at places that they did not learn from, about heads that they never
saw, and about a third bar; peer is what they answer, ours is the road of this package on the same
tasks, from the presses of the task alone. Both know the skin: the network by training, ours by
its resting field and twenty presses of one head.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import seen_classes, support_scores
from tactile_ros.estimators.press_window import press_vectors
from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.evaluation.sources import load_source
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.pronet import pronet

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.estimators.embedding import Embedding
    from tactile_ros.sensors.multipole_skin.recogniser import Recogniser
    from tactile_ros.types import Array

TRIALS = Path(__file__).resolve().parent / 'worlds' / 'multipole_trials.py'
SENSOR = load_sensor('multipole_skin')
SEED = 1  # of the split that the networks were trained with
ASKED = 101  # seed of presses that they were not
TASKS = {'quick': 20, 'normal': 200, 'full': 300}
OUR_TASKS = {'quick': 4, 'normal': 30, 'full': 60}
SHAPES = {1: (81.33, 90.0), 3: (84.18, None), 5: (84.60, 94.0)}
NEW_HEADS = 82.88  # of which shots, [1] does not say
POSTURES = {1: 92.23, 3: 95.78, 5: 98.44}
CALIBRATING = 20


def run(extent: str, command: str) -> BenchResult:
    """Shapes at held-out places, new heads, postures of a bar, then time."""
    trials = load_source(TRIALS, 'bench pronet')
    world = trials.world_module()
    skin = world.World(trials.SKIN)
    ours = recogniser(world, skin)
    count = TASKS[extent], OUR_TASKS[extent]
    _, held = trials.split_places(SEED)
    places, taken = world.stations(), trials.TAKEN
    old = trials.collection(skin, world.nine_heads(), places[held], ASKED, taken)
    net = pronet('shapes')
    rows = []
    for shots, (paper, aim) in SHAPES.items():
        what = f'shape, 5 of 9 heads at held-out places, {shots}-shot'
        rows.append(compared(trials, net, ours, old, shots, 5, count, what, paper, aim))
    if extent != 'quick':
        new = trials.collection(skin, world.new_heads(), places, ASKED, taken)
        for shots in SHAPES:
            what = f'shape, five new heads, {shots}-shot'
            rows.append(compared(trials, net, ours, new, shots, 5, count, what, NEW_HEADS, None))
        rows += postures(trials, world, skin, ours, count)
    if extent == 'full':
        rows += plain(trials, world, skin)
    took = cost(net, old.windows[:1])
    rows.append(
        Row('one window through the network (torch: 264)', 'us', took, aim=100.0, us_single=took)
    )
    notes = [
        'peer: Pronet-L of [1], shipped as ONNX, on the skin that it was trained on',
        'ours: presses of the task in the metric of few_shot.py; templates of nine drawn heads '
        'tell what shapes can do at a place, no press of them was learned from but 20 of one head',
        'all shots by one network: of one shot for shapes, of five for postures',
    ]
    return BenchResult('pronet', command, [SEED, ASKED], rows, notes)


def recogniser(world: ModuleType, skin: object) -> Recogniser:
    """What rest and twenty presses of one head tell of the skin."""
    config = replace(skin.config, objects=world.nine_heads())  # type: ignore[attr-defined]
    rng = np.random.default_rng(SEED)
    places = rng.uniform(-22e-3, 22e-3, (CALIBRATING, 2))
    turns, depths = rng.uniform(-3, 3, CALIBRATING), rng.uniform(0.3e-3, 0.9e-3, CALIBRATING)
    lessons = world.collect(
        skin, config.objects, np.full(CALIBRATING, 3), places, turns, depths, SEED, config=config
    )
    estimation = SENSOR.pipeline(config).fit(lessons).estimation
    found: Recogniser = estimation.recogniser_  # type: ignore[attr-defined]
    return found


def compared(
    trials: ModuleType, net: Embedding, ours: Recogniser, samples: object, shots: int, ways: int,
    count: tuple[int, int], what: str, paper: float | None, aim: float | None,
) -> Row:  # fmt: skip
    """Row of the same kind of tasks by the network and by us."""
    features = net.features(samples.windows)  # type: ignore[attr-defined]
    theirs = 100 * trials.few_shot(features, samples, shots, ways, count[0], SEED)
    rng = np.random.default_rng([29, SEED])
    right = []
    for _ in range(count[1]):
        known, asked = trials.task(samples, shots, ways, rng)
        label = samples.label  # type: ignore[attr-defined]
        named = answered(ours, samples.windows, label, known, asked)  # type: ignore[attr-defined]
        right.append((named == label[asked]).mean())
    return Row(what, '%', 100 * float(np.mean(right)), 'high', paper=paper, peer=theirs, aim=aim)


def answered(ours: Recogniser, windows: Array, label: Array, known: Array, asked: Array) -> Array:
    """Labels of asked presses by known ones."""
    lessons = press_vectors(list(windows[known].astype(float)), ours.basis)
    presses = press_vectors(list(windows[asked].astype(float)), ours.basis)
    supports = ours.supports(lessons, label[known], ours.matches(lessons))
    seen = seen_classes(supports, ours.noise, ours.still_, ours.error, ours.basis)
    score = support_scores(seen, presses, ours.noise, ours.common, ours.still_)
    return np.asarray(seen.supports.label[score.argmin(axis=1)])


def postures(
    trials: ModuleType, world: ModuleType, skin: object, ours: Recogniser, count: tuple[int, int]
) -> list[Row]:
    """Table V and figure 9: bars 1 and 2 taught, bar 3 is asked."""
    net, bar, turns = pronet('postures'), world.bars()[2:], trials.POSTURES
    somewhere = np.random.default_rng(ASKED).uniform(-trials.SPAN, trials.SPAN, (6, 2))
    rows = []
    for where, places, papers in (
        ('9 of 25 places', world.stations()[::3], POSTURES),
        ('random places', somewhere, dict.fromkeys(POSTURES)),
    ):
        samples = trials.collection(skin, bar, places, ASKED, trials.TAKEN, turns)
        # one bar: tasks take their head from `source`
        samples = replace(samples, source=np.full_like(samples.source, 2))
        for shots, paper in papers.items():
            what = f'posture of a third bar, {where}, {shots}-shot'
            rows.append(compared(trials, net, ours, samples, shots, 6, count, what, paper, None))
    return rows


def plain(trials: ModuleType, world: ModuleType, skin: object) -> list[Row]:
    """Nearest neighbours of whole windows, learned at twenty places and asked at five."""
    places = world.stations()
    known, asked = (
        trials.collection(skin, world.nine_heads(), places[some], SEED, trials.TAKEN)
        for some in trials.split_places(SEED)
    )
    right = 100 * trials.neighbours(known, asked, trials.plain)
    what = 'shape, 9 heads at held-out places, nearest neighbours'
    return [Row(what, '%', None, 'high', paper=34.59, peer=right)]


def cost(net: Embedding, window: Array) -> float:
    """Microseconds of one window: the least of many."""
    found = []
    for _ in range(500):
        began = time.perf_counter()
        net.features(window)
        found.append(time.perf_counter() - began)
    return 1e6 * min(found)
