# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""multipole_skin in a world of its own: shapes and poses of drawn heads from few presses or none.

The world (`test/reference/multipole_world.py`) solves body, punch and field otherwise than the
package, and has flaws that no config tells: chips misplaced by 0.15 mm, tilted and of unlike gain,
an uneven sheet, the field of the Earth, drift, 4 uT of noise. Presses and places are drawn anew
for every seed; no two presses have the same noise.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row, shortest, within
from benchmarks.worlds.multipole_trials import DEPTH, POSTURES, SPAN
from reference import multipole_world as world
from tactile_ros.estimators.few_shot import press_patterns
from tactile_ros.physics import compiled
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
from tactile_ros.types import Array, Frame, Integers, Recording

SENSOR = load_sensor('multipole_skin')
SECONDS = {'quick': np.inf, 'normal': 400.0, 'full': np.inf}  # of all worlds
AGAIN = 30  # of which the fastest counts
CALIBRATING = 20  # presses of one head
STRAY = 5e-5 * np.array([1.0, -1.0, 0.9]) / np.sqrt(2.81)  # T, after the tare
FRAMES = world.TARE + world.WINDOW
FIGURES = (
    ('shape, new places, 9 heads: rest alone', '%', 'rest', 'high', None, None),
    ('shape, new places, 9 heads: 20 presses of one', '%', 'zero', 'high', None, 90.0),
    ('  the same, not named', '%', 'unnamed', 'low', None, None),
    ('  the same, 0.05 mT after the tare: points lost', '1', 'stray', 'low', None, 4.0),
    ('pose of six, bar never pressed, new place', '%', 'pose', 'high', 98.4, 98.0),
    ('  without a turn', '%', 'unturned', 'low', None, None),
    ('  its turn, median', 'deg', 'turn', 'low', None, 1.5),
    ('  its place, median', 'mm', 'place', 'low', None, 0.35),
    ('places inside 1 sigma', '%', 'sigma 1', 'high', None, None),
    ('places inside 2 sigma', '%', 'sigma 2', 'high', None, None),
    *((f'named with {low} to {high} %: {what}', '%', f'{what} {low}', 'high', None, None)
      for low, high in ((0, 70), (70, 90), (90, 100)) for what in ('stated', 'right')),
)  # fmt: skip


@dataclass(frozen=True)
class Extent:
    """Seeds of worlds; presses and poses in each."""

    seeds: tuple[int, ...]
    tested: int
    posed: int  # none: neither the bar nor rest alone


EXTENTS = {
    'quick': Extent((1,), 18, 0),
    'normal': Extent((1, 21), 54, 24),
    'full': Extent((1, 2, 3, 4, 5, 6), 90, 48),
}


def run(extent: str, command: str) -> BenchResult:
    """Shapes, poses and disturbances in every world, then time."""
    size = EXTENTS[extent]
    trials, found = [], []
    for seed in within(SECONDS[extent], size.seeds):
        trials.append(Trials(seed, size))
        found.append(trials[-1].all())

    def mean(name: str) -> float | None:
        known = [one[name] for one in found if name in one]
        return float(np.mean(known)) if known else None

    rows = [
        Row.mean(
            what, unit, [one[name] for one in found if name in one], better, paper=paper,
            peer=mean(f'{name} peer'), aim=aim,
        )
        for what, unit, name, better, paper, aim in FIGURES if mean(name) is not None
    ]  # fmt: skip
    rows += trials[0].cost() + independent_rows('multipole_skin', extent)
    notes = [
        f'{len(trials)} of {len(size.seeds)} worlds; {size.tested} presses of nine heads and '
        f'{size.posed} poses in each; what is not named, or has no turn, is wrong',
        'peer: nearest neighbours, which learned the poses of other bars',
        'paper: on its own sheet and heads, of which it gives no drawing',
    ]
    return BenchResult('multipole_skin', command, [one.seed for one in trials], rows, notes)


class Trials:
    """Trials in the world of a seed, which is of everything drawn too."""

    def __init__(self, seed: int, size: Extent = EXTENTS['full']) -> None:
        self.seed, self.size = seed, size
        self.skin = world.World(seed)
        self.rng = np.random.default_rng([23, seed])
        self.heads = world.nine_heads()
        self.config = replace(self.skin.config, objects=self.heads)
        self.count = 0
        self.one = self.random(np.full(CALIBRATING, 3), self.config)

    def random(self, labels: Integers, config: MultipoleSkinConfig) -> Recording:
        """Presses at random places, turns and depths."""
        places = self.rng.uniform(-SPAN, SPAN, (len(labels), 2))
        return self.pressed(labels, places, self.rng.uniform(-np.pi, np.pi, len(labels)), config)

    def pressed(
        self, labels: Integers, places: Array, turns: Array, config: MultipoleSkinConfig
    ) -> Recording:
        """Presses at random depths."""
        self.count += 1
        depths = self.rng.uniform(*DEPTH, len(labels))
        return world.collect(
            self.skin, config.objects, labels, places, turns, depths,
            100 * self.seed + self.count, config=config,
        )  # fmt: skip

    def all(self) -> dict[str, float]:
        """Figures by name."""
        found = self.zero_shot()
        return found | self.bar() if self.size.posed else found

    def zero_shot(self) -> dict[str, float]:
        """Nine heads at new places, none of them pressed but one."""
        labels = self.rng.permutation(np.arange(self.size.tested) % 9)
        test = self.random(labels, self.config)
        self.ours = SENSOR.pipeline(self.config).fit(self.one)
        states, ends = self.ours.process_batch(test), self.ends(test)
        named, chance = states.label[ends] == labels, 100 * states.label_probability[ends]
        sigma = np.sqrt(states.position_cov[ends][:, (0, 1), (0, 1)])
        off = np.abs(states.position[ends, :2] - test.truth['position'][ends, :2]) / sigma
        outside = (~test.tare)[:, None, None] * self.skin.stray(STRAY)
        moved = replace(test, values=test.values + outside)
        disturbed = share(self.ours.process_batch(moved).label[ends] == labels)
        found = {
            'zero': share(named), 'stray': share(named) - disturbed,
            'unnamed': share(states.label[ends] == -1),
            'sigma 1': share((off < 1)[np.isfinite(off)]),
            'sigma 2': share((off < 2)[np.isfinite(off)]),
        }  # fmt: skip
        for low, high in ((0, 70), (70, 90), (90, 101)):
            rows = (chance >= low) & (chance < high)
            if rows.any():
                found[f'stated {low}'] = float(chance[rows].mean())
                found[f'right {low}'] = share(named[rows])
        if self.size.posed:
            rested = SENSOR.pipeline(self.config).fit(test.select(test.tare))
            found['rest'] = share(rested.process_batch(test).label[ends] == labels)
        return found

    def windows(self, recording: Recording) -> Array:
        """Windows (n, frames x channels) less their tare."""
        values = recording.values.reshape(-1, FRAMES, recording.values[0].size)
        tared = values[:, world.TARE :] - values[:, : world.TARE].mean(axis=1)[:, None]
        return np.asarray(tared.reshape(len(values), -1))

    def bar(self) -> dict[str, float]:
        """Six poses of a bar that is drawn but was never pressed, at new places."""
        count, config = self.size.posed, replace(self.config, objects=world.bars())
        lessons = self.random(np.repeat([0, 1], 15), config)
        pipeline = SENSOR.pipeline(config).fit(lessons)
        poses = self.rng.integers(6, size=count)
        turns = POSTURES[poses] + np.radians(self.rng.uniform(-5, 5, count))
        places = self.rng.uniform(-SPAN, SPAN, (count, 2))
        test = self.pressed(np.full(count, 2), places, turns, config)
        # neighbours know the poses of two bars; the third is new
        known = np.round(lessons.truth['yaw'][self.ends(lessons)] / POSTURES[1]).astype(int) % 6
        apart = self.windows(test)[:, None] - self.windows(lessons)[None]
        near = np.linalg.norm(apart, axis=2).argmin(axis=1)
        ends, states = self.ends(test), pipeline.process_batch(test)
        yaw, right = states.yaw[ends], np.round(turns / POSTURES[1]).astype(int) % 6
        unturned = np.isnan(yaw)
        off = np.where(unturned, np.inf, np.abs(np.angle(np.exp(2j * (yaw - turns)))) / 2)
        named = np.where(unturned, -1, np.round(np.nan_to_num(yaw) / POSTURES[1]).astype(int) % 6)
        away = np.linalg.norm(states.position[ends, :2] - test.truth['position'][ends, :2], axis=1)
        return {
            'pose': share(named == right), 'pose peer': share(known[near] == poses),
            'unturned': share(unturned), 'turn': float(np.degrees(np.median(off))),
            'place': float(1e3 * np.median(np.where(np.isnan(away), np.inf, away))),
        }  # fmt: skip

    def ends(self, recording: Recording) -> Integers:
        """Last rows of windows."""
        return np.arange(FRAMES - 1, len(recording), FRAMES)

    def cost(self) -> list[Row]:
        """Microseconds of a window's last frame, and of its search among templates."""
        tare, window = np.split(self.one.values[:FRAMES], [world.TARE])
        self.ours.tare([Frame(i, i, row) for i, row in enumerate(tare)])
        recogniser = self.ours.estimation.recogniser_
        change = (window - tare.mean(axis=0)).reshape(len(window), -1)
        presses = press_patterns([change], len(recogniser.noise))

        def frames() -> Array:
            self.ours.reset()
            ends = [time.perf_counter()]
            for i, row in enumerate(window):
                self.ours.process(Frame(10**9 + 12_500_000 * i, i, row))
                ends.append(time.perf_counter())
            return np.diff(ends)[-2:]

        fast = 'numba' if compiled.AVAILABLE else 'arrays alone'
        before, last = np.min([frames() for _ in range(AGAIN)], axis=0)
        search = shortest(lambda: recogniser.matches(presses), AGAIN)
        return [
            Row(f'{what} ({fast})', 'us', 1e6 * took, aim=aim, us_single=1e6 * took)
            for what, took, aim in (
                ('templates of nine heads', search, 500.0),
                ('all that recognises a window', last - before, 500.0),
                ('a frame', before, None), ('the last frame of a window', last, None),
            )
        ]  # fmt: skip


def share(right: Array) -> float:
    """Of what is true, in percent."""
    return 100 * float(np.mean(right))
