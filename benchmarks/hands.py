# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Grips of Allegro hands by their shipped files: gains of vendors, objects, and what goes wrong.

The hand, its drives and the objects are those of `test/reference/allegro_world.py`, in MuJoCo on
virtual time; what moves the hand is the loop of grip_node with the parameters that it ships.
"""

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.control import GraspOutcome

if find_spec('mujoco'):
    from reference import allegro_world as world

SEEDS = {'quick': 1, 'normal': 5, 'full': 10}
FRICTIONS, OBJECTS = (0.4, 0.7, 1.0), ('sphere', 'box', 'cylinder', 'soft', 'heavy')
FORCE, PULL, HOLDS = 1.5, 1.0, 4.0  # N, N, s
DRAWS = 12  # hands of a seed whose drives are others than their file says
TOUCHED = 0.1  # N
NAMES = {'v4': 'V4, stock gains', 'sense': 'V5 Sense, stock gains', 'stiff': '3 N m/rad, pinch'}


def run(extent: str, command: str) -> BenchResult:
    """Measure everything; without MuJoCo nothing."""
    if not find_spec('mujoco'):
        note = 'Hands are left out: they need mujoco: pip install mujoco.'
        return BenchResult('hands', command, [], [], [note])
    seeds = list(range(SEEDS[extent]))
    rows = [*_reach_rows(seeds), *_object_rows(seeds), *_drawn_rows(seeds), *_case_rows(seeds)]
    notes = [
        'Hands by their shipped files and parameters, 15 ms from command to drive, contacts and '
        'joint states at 100 Hz. Drives: gains and torque clips of the vendors, and 3 N m/rad '
        'with 0.4 N m. Forces are the true ones of the simulation.',
        f'Objects are held still until {FORCE:g} N is held, handed over in 0.5 s, then pulled by '
        f'{PULL:g} N; kept: moved by less than {1e3 * world.DROPPED:g} mm.',
        'A goal that is refused, or that ends with the names of the fingers that are short, '
        'counts as said; one that neither holds nor says so does not.',
    ]
    return BenchResult('hands', command, seeds, rows, notes)


def _row(what: str, unit: str, values: list[float], aim: float | None, better: str = 'low') -> Row:
    """Worst value of all seeds where less is better, their mean where more is."""
    if not values or not np.isfinite(values).all():
        return Row(what, unit, None, better, aim=aim)
    ours = max(values) if better == 'low' else float(np.mean(values))
    return Row(what, unit, ours, better, aim=aim, by_seed=tuple(values))


def _reach_rows(seeds: list[int]) -> list[Row]:
    """Touch, hold and error of each drive at 1 and 2 N."""
    rows = []
    for drive, name in NAMES.items():
        for force in (1.0, 2.0):
            touch, held, error, said = [], [], [], []
            for seed in seeds:
                one = world.AllegroWorld(drive, 'box' if drive == 'stiff' else 'beam', seed=seed)
                begins = one.time
                ended = one.grasp(force, adapt=False)
                good = ended.outcome == GraspOutcome.HELD
                named = any(word in ended.message for word in ('press', 'touches nothing'))
                said.append(float(good or named))
                if good:
                    touched = [at for at, forces in one.trace if max(forces.values()) > TOUCHED]
                    touch.append(touched[0] - begins)
                    held.append(one.time - begins)
                    early = one.errors(0.1)
                    one.run(2.0)
                    error.append(100.0 * max(early, one.errors()))
            what = f'{name}, {force:g} N'
            rows += [
                _row(f'{what}: held, or the reason named', '1', said, 1.0, 'high'),
                _row(f'{what}: held', '1', [len(held) / len(seeds)], None, 'high'),
                _row(f'{what}: first touch', 's', touch, 2.0),
                _row(f'{what}: time to HELD', 's', held, 4.0),
                _row(f'{what}: worst error of a finger, at HELD and 2 s after', '%', error, 10.0),
            ]
    return rows


def _object_rows(seeds: list[int]) -> list[Row]:
    """Share of objects that stay in the hand through hand-over and pull."""
    rows = []
    for kind in OBJECTS:
        for friction in FRICTIONS:
            kept = []
            for seed in seeds:
                one = _held(kind=kind, friction=friction, seed=seed)
                if one is None:
                    kept.append(0.0)
                    continue
                one.hand_over(PULL)
                one.run(HOLDS)
                kept.append(float(one.moved < world.DROPPED))
            aim = 0.98 if kind != 'heavy' and friction > FRICTIONS[0] else None
            rows.append(_row(f'{kind}, friction {friction:g}: kept', '1', kept, aim, 'high'))
    return rows


def _drawn_rows(seeds: list[int]) -> list[Row]:
    """Share of objects held and kept by hands whose drives are not those of their file."""
    rows = []
    for drive, name, objects, aims in (
        ('stiff', '', OBJECTS[:4], (0.95, 0.9)),
        ('v4', 'V4: ', ('beam',), (None, None)),
    ):
        held, kept = [], []
        for seed in seeds:
            rng, ends = np.random.default_rng(seed), []
            for draw in range(DRAWS):
                about = {'kind': objects[draw % len(objects)], 'drive': drive}
                friction, force = rng.uniform(*FRICTIONS[::2]), rng.uniform(1.0, 2.0)
                number = 1000 * seed + draw
                one = _held(force, **about, friction=friction, seed=number, drawn=True)
                ends.append([one is not None, False])
                if one is not None:
                    one.hand_over(PULL)
                    one.run(HOLDS)
                    ends[-1][1] = one.moved < world.DROPPED
            for column, share in zip((held, kept), np.mean(ends, axis=0), strict=True):
                column.append(float(share))
        what = f'{name}gains, clips and dead time drawn'
        rows += [
            _row(f'{what}: held', '1', held, aims[0], 'high'),
            _row(f'{what}: kept', '1', kept, aims[1], 'high'),
        ]
    return rows


def _held(force: float = FORCE, **about: object) -> object | None:
    """A world with an object that is held; None: it is not."""
    one = world.AllegroWorld(**about)
    return one if one.grasp(force).outcome == GraspOutcome.HELD else None


def _case_rows(seeds: list[int]) -> list[Row]:
    """Starts, and sensors and joints that fail."""
    cases: dict[str, tuple[Callable[..., float], str, float, str]] = {
        'second goal, force kept': (lambda seed: _kept(seed, lambda _: None), '1', 0.7, 'high'),
        'disable, enable and a goal, force kept': (_enabled, '1', 0.7, 'high'),
        'no joint states for 1.5 s and a goal, force kept': (_mute, '1', 0.7, 'high'),
        'restart of the node and a goal, force kept': (_restarted, '1', 0.7, 'high'),
        'sensors turned by 35 degrees: final force over asked': (_tilted, '1', 1.2, 'low'),
        '1 N of bias: found before closing': (_biased, '1', 1.0, 'high'),
        'thumb reads 0: peak force over asked': (
            lambda seed: _weak(seed, 0, 'thumb'),
            '1',
            1.2,
            'low',
        ),
        'all forces read a tenth: peak over asked': (
            lambda seed: _weak(seed, 0.1),
            '1',
            1.3,
            'low',
        ),
        'forces freeze while loading: peak over asked': (_frozen, '1', 1.3, 'low'),
        'noise of 0.1 N, 2 N: time to HELD': (_noisy, 's', 5.0, 'low'),
        'friction 0.8 to 0.3: kept': (_slippery, '1', 0.95, 'high'),
        'index falls silent: time to its name': (_silent, 's', 0.5, 'low'),
    }
    return [
        _row(what, unit, [case(seed) for seed in seeds], aim, better)
        for what, (case, unit, aim, better) in cases.items()
    ]


def _kept(seed: int, event: Callable[[object], None]) -> float:
    """Least share of the thumb's force on a free sphere through an event and a new goal."""
    one = _held(kind='sphere', seed=seed)
    if one is None:
        return 0.0
    one.hand_over()
    one.run(1.5)
    before, since = one.force['thumb'], one.time
    event(one)
    one.loop.grasp(FORCE, (), 10.0, True)
    one.run(2.0)
    return float(min(f['thumb'] for at, f in one.trace if at > since) / max(before, 1e-3))


def _enabled(seed: int) -> float:
    def event(one: object) -> None:
        one.loop.disable()
        one.run(0.3)
        one.loop.enable()
        one.run(0.3)

    return _kept(seed, event)


def _mute(seed: int) -> float:
    def event(one: object) -> None:
        one.mute = True
        one.run(1.5)
        one.mute = False
        one.run(0.5)

    return _kept(seed, event)


def _restarted(seed: int) -> float:
    def event(one: object) -> None:
        one.restart()
        one.run(0.5)

    return _kept(seed, event)


def _tilted(seed: int) -> float:
    one = _held(2.0, tilt=np.deg2rad(35.0), seed=seed)
    if one is None:
        return float('inf')
    one.run(8.0)
    return one.force['thumb'] / 2.0


def _biased(seed: int) -> float:
    one = world.AllegroWorld(seed=seed)
    one.bias = dict.fromkeys(one.loop.fingers, 1.0)
    one.run(0.5)
    return float('tare' in one.grasp(2.0).message and max(one.force.values()) < TOUCHED)


def _peak(one: object, force: float) -> float:
    return max(max(forces.values()) for _, forces in one.trace) / force


def _weak(seed: int, share: float, *names: str) -> float:
    one = world.AllegroWorld(seed=seed)
    one.gain = dict.fromkeys(names or one.loop.fingers, share)
    one.grasp(2.0)
    one.run(1.0)
    return _peak(one, 2.0)


def _frozen(seed: int) -> float:
    one = world.AllegroWorld(seed=seed)
    one.loop.grasp(2.0, (), 8.0, False)
    while one.force['thumb'] < 0.5 and one.time < 8.0:
        one.step()
    one.frozen = True
    one.run(5.0)
    return _peak(one, 2.0)


def _noisy(seed: int) -> float:
    one = world.AllegroWorld(noise=0.1, seed=seed)
    begins = one.time
    good = one.grasp(2.0).outcome == GraspOutcome.HELD
    return one.time - begins if good else float('inf')


def _slippery(seed: int) -> float:
    one = _held(friction=0.8, seed=seed)
    if one is None:
        return 0.0
    one.hand_over()
    one.run(2.0)
    one.slippery(0.3)
    one.run(3.0)
    return float(one.moved < world.DROPPED)


def _silent(seed: int) -> float:
    one = _held(seed=seed)
    if one is None:
        return float('inf')
    one.silent, since = {'index'}, one.time
    while 'index' not in one.step().refusal and one.time < since + 2.0:
        pass
    return one.time - since
