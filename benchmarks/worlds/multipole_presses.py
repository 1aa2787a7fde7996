# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Trials of `tactile bench multipole_skin` in one world: nine heads, five new ones, three bars.

The world is `test/reference/multipole_world.py`; no two presses of a trial have the same noise.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.worlds import multipole_trials
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Integers

SENSOR = load_sensor('multipole_skin')
SPAN = 22e-3  # m, of places from the middle
DEPTH = (0.3e-3, 0.9e-3)  # m
CALIBRATING = 20  # presses of one head
SHOTS = (1, 3, 5)
STRAY = 5e-5 * np.array([1.0, -1.0, 0.9]) / np.sqrt(2.81)  # T, after the tare
BOUNDED = 8  # presses of which a bound is computed
TURNED, DEEPER = np.radians(4), 0.02  # rad and share, over which readings are differentiated
HALF_OF_ONE, HALF_OF_TWO = 0.6745, 1.1774  # median of a size over the deviation of a component
POSES = np.radians([0, 30, 60, 90, 120, 150])


@dataclass(frozen=True)
class Extent:
    """Seeds of worlds; presses, few-shot places and poses in each; `whole`: with slow tables."""

    seeds: tuple[int, ...]
    tested: int
    places: int  # none: no new heads
    posed: int  # none: neither the bar nor rest alone
    whole: bool = False


EXTENTS = {
    'quick': Extent((1,), 18, 0, 0),
    'normal': Extent((1, 21), 54, 2, 24),
    'full': Extent((1, 2, 3, 4, 5, 6), 90, 3, 48, whole=True),
}


class Trials:
    """Trials in one world.

    Parameters
    ----------
    world : module
        Of the world.
    seed : int
        Of its flaws and of everything drawn.
    size : Extent
        How many of everything.
    """

    def __init__(self, world: ModuleType, seed: int, size: Extent = EXTENTS['full']) -> None:
        self.world, self.seed, self.size = world, seed, size
        self.skin = world.World(seed)
        self.rng = np.random.default_rng([23, seed])
        self.heads = world.nine_heads()
        self.config = replace(self.skin.config, objects=self.heads)
        self.count = 0
        self.one = self.random(np.full(CALIBRATING, 3), self.config)

    def random(self, labels: Integers, config: object, **more: object) -> Recording:
        """Presses at random places, turns and depths; no two calls have the same noise."""
        n = len(labels)
        places = self.rng.uniform(-SPAN, SPAN, (n, 2))
        turns = self.rng.uniform(-np.pi, np.pi, n)
        return self.pressed(labels, places, turns, config, **more)

    def pressed(
        self, labels: Integers, places: Array, turns: Array, config: object, **more: object
    ) -> Recording:
        """Presses at random depths."""
        self.count += 1
        depths = self.rng.uniform(*DEPTH, len(labels))
        heads = config.objects  # type: ignore[attr-defined]
        found: Recording = self.world.collect(
            self.skin, more.pop('heads', heads), labels, places, turns, depths,
            100 * self.seed + self.count, config=config, **more,
        )  # fmt: skip
        return found

    def all(self, tables: bool) -> dict[str, float]:
        """Figures by name."""
        found = self.zero_shot()
        if self.size.places:
            found.update(self.few_shot())
        if self.size.posed:
            found.update(self.bar())
        if tables:
            found.update(self.split())
        return found

    def zero_shot(self) -> dict[str, float]:
        """Nine heads at new places, none of them pressed but one."""
        labels = self.rng.permutation(np.arange(self.size.tested) % 9)
        test = self.random(labels, self.config)
        self.ours = SENSOR.pipeline(self.config).fit(self.one)
        states, ends = self.ours.process_batch(test), self.ends(test)
        named = states.label[ends] == labels
        right = share(named)
        truth = test.truth['position'][ends, :2]
        sigma = np.sqrt(states.position_cov[ends][:, (0, 1), (0, 1)])
        off = np.abs(states.position[ends, :2] - truth) / sigma
        moved = Recording.from_arrays(
            test.layout, test.values + (~test.tare)[:, None, None] * self.skin.stray(STRAY),
            stamp_ns=test.stamp_ns, stream=test.stream, tare=test.tare, truth=test.truth,
        )  # fmt: skip
        disturbed = share(self.ours.process_batch(moved).label[ends] == labels)
        found = {
            'zero': right, 'stray': right - disturbed,
            **multipole_trials.reliability(states.label_probability[ends], named),
            'unnamed': share(states.label[ends] == -1),
            'sigma 1': share((off < 1)[np.isfinite(off)]),
            'sigma 2': share((off < 2)[np.isfinite(off)]),
        }  # fmt: skip
        if self.size.posed:
            rested = SENSOR.pipeline(self.config).fit(test.select(test.tare))  # type: ignore[arg-type]
            found['rest'] = share(rested.process_batch(test).label[ends] == labels)
        if self.size.whole:
            true = self.true(self.ours)
            found['zero bound'] = share(true.process_batch(test).label[ends] == labels)
        return found

    def true(self, fitted: Pipeline) -> Pipeline:
        """The same pipeline with the world's chips and bands."""
        found, skin = copy(fitted), self.skin
        found.estimation = copy(fitted.estimation)
        recogniser = copy(fitted.estimation.recogniser_)  # type: ignore[attr-defined]
        recogniser.model = replace(
            recogniser.model, chips=skin.chips, strengths=skin.strengths, shift=skin.aside,
            responses=skin.gain[:, :, None] * skin.axes, turning=skin.flaws.turning,
        )  # fmt: skip
        recogniser.common = recogniser.model.common
        recogniser.refresh()
        found.estimation.recogniser_ = recogniser  # type: ignore[attr-defined]
        return found

    def few_shot(self) -> dict[str, float]:
        """Five new heads at one place, from few presses, with nine old ones open."""
        news = self.world.new_heads()
        right: dict[str, list[float]] = {}
        for _ in range(self.size.places):
            place, turn = self.rng.uniform(-SPAN, SPAN, 2), self.rng.uniform(-np.pi, np.pi)
            lessons = [self.at(news, i, place, turn, max(SHOTS)) for i in range(len(news))]
            asked = [self.at(news, i, place, turn, 6) for i in range(len(news))]
            old = self.pressed(np.arange(9), np.tile(place, (9, 1)), np.full(9, turn), self.config)
            for shots in SHOTS:
                for i, head in enumerate(news):
                    some = lessons[i].stream < shots  # type: ignore[operator]
                    self.ours.enrol(lessons[i].select(some), head.name)
                for i, test in enumerate(asked):
                    label = self.ours.process_batch(test).label[self.ends(test)]
                    right.setdefault(f'shot {shots}', []).append(share(label == 9 + i))
                    peer, moved = (
                        share(self.prototypes(lessons, test, shots, stray) == i)
                        for stray in (np.zeros(3), STRAY)
                    )
                    right.setdefault(f'shot {shots} peer', []).append(peer)
                    if shots == max(SHOTS):
                        right.setdefault('stray peer', []).append(peer - moved)
                label = self.ours.process_batch(old).label[self.ends(old)]
                if shots == max(SHOTS):
                    right.setdefault('kept', []).append(share(label == np.arange(9)))
                for head in news:
                    self.ours.forget(head.name)
        return {name: float(np.mean(shares)) for name, shares in right.items()}

    def at(self, heads: object, label: int, place: Array, turn: float, count: int) -> Recording:
        """Presses of one head at one place, as well as a stage returns there."""
        places = place + 5e-5 * self.rng.normal(size=(count, 2))
        turns = turn + 0.01 * self.rng.normal(size=count)
        return self.pressed(np.full(count, label), places, turns, self.config, heads=heads)

    def windows(self, recording: Recording) -> Array:
        """Windows (n, frames x channels) less their tare."""
        rows = self.world.TARE + self.world.WINDOW
        values = recording.values.reshape(-1, rows, recording.values[0].size)
        tared = values[:, self.world.TARE :] - values[:, : self.world.TARE].mean(axis=1)[:, None]
        return np.asarray(tared.reshape(len(values), -1))

    def prototypes(
        self, lessons: list[Recording], test: Recording, shots: int, stray: Array
    ) -> Integers:
        """Nearest mean window, as [1] has it without its network; old heads are not even open.

        A field (3,) (T) may have come after the tare of what is tested.
        """
        means = np.array([self.windows(one)[:shots].mean(axis=0) for one in lessons])
        moved = np.tile(self.skin.stray(stray).ravel(), self.world.WINDOW)
        away = np.linalg.norm((self.windows(test) + moved)[:, None] - means, axis=2)
        return np.asarray(away.argmin(axis=1))

    def bar(self) -> dict[str, float]:
        """Six poses of a bar that is drawn but was never pressed, at new places."""
        bars = self.world.bars()
        config = replace(self.config, objects=bars)
        teach = np.repeat([0, 1], 15)
        lessons = self.random(teach, config)
        pipeline = SENSOR.pipeline(config).fit(lessons)
        count = self.size.posed
        poses = self.rng.integers(6, size=count)
        turns = POSES[poses] + np.radians(self.rng.uniform(-5, 5, count))
        test = self.pressed(
            np.full(count, 2), self.rng.uniform(-SPAN, SPAN, (count, 2)), turns, config
        )
        # neighbours know the poses of two bars; the third is new
        known = np.round(lessons.truth['yaw'][self.ends(lessons)] / POSES[1]).astype(int) % 6
        near = np.linalg.norm(
            self.windows(test)[:, None] - self.windows(lessons)[None], axis=2
        ).argmin(axis=1)
        return {
            **self.posed(pipeline, test, turns), **self.pose_bounds(bars[2], test),
            'pose peer': share(known[near] == poses),
        }  # fmt: skip

    def pose_bounds(self, head: object, test: Recording) -> dict[str, float]:
        """Medians of turn and place that noise, drift and tare alone leave (Cramer and Rao).

        Of a few presses, with everything known but place, turn and depth; steps are as wide as a
        cell of the world, to which it rounds punches.
        """
        flaws, frames = self.skin.flaws, self.world.WINDOW
        shared = flaws.drift**2 + flaws.noise**2 / self.world.TARE
        told = np.linalg.inv(flaws.noise**2 * np.eye(frames) + shared)
        turns, places = [], []
        for end in self.ends(test)[:BOUNDED]:
            j = self.slopes(head, test, np.arange(end + 1 - frames, end + 1))
            information = np.einsum('afd,fg,bgd->ab', j, told, j)
            scale = np.sqrt(np.diag(information))
            cov = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
            turns.append(np.degrees(np.sqrt(cov[2, 2])) * HALF_OF_ONE)
            places.append(1e3 * np.sqrt(np.trace(cov[:2, :2]) / 2) * HALF_OF_TWO)
        return {'turn bound': float(np.median(turns)), 'place bound': float(np.median(places))}

    def slopes(self, head: object, test: Recording, rows: Integers) -> Array:
        """How readings (f, d) of one press change with place, turn and depth, shape (4, f, d)."""
        pose = np.array([*test.truth['position'][rows[-1], :2], test.truth['yaw'][rows[-1]]])
        self.skin.press(head, pose[:2], pose[2], np.array([DEPTH[1]]))
        course = test.truth['force'][rows, 2] / self.skin.stiffness
        found = []
        for step in np.diag([self.world.GRID, self.world.GRID, TURNED]):
            high, low = (
                self.skin.press(head, at[:2], at[2], course).reshape(len(rows), -1)
                for at in (pose + step, pose - step)
            )
            found.append((high - low) / (2 * step.max()))
        both = np.concatenate([course, (1 + DEEPER) * course])
        now, deeper = self.skin.press(head, pose[:2], pose[2], both).reshape(2, len(rows), -1)
        return np.array([*found, (deeper - now) / DEEPER])

    def posed(self, pipeline: Pipeline, test: Recording, turns: Array) -> dict[str, float]:
        """Poses, turns and places of bars, of turns (n,) about `POSES`."""
        ends, states = self.ends(test), pipeline.process_batch(test)
        yaw, poses = states.yaw[ends], np.round(turns / POSES[1]).astype(int) % 6
        unturned = np.isnan(yaw)
        off = np.where(unturned, np.inf, np.abs(np.angle(np.exp(2j * (yaw - turns)))) / 2)
        named = np.where(unturned, -1, np.round(np.nan_to_num(yaw) / POSES[1]).astype(int) % 6)
        away = np.linalg.norm(states.position[ends, :2] - test.truth['position'][ends, :2], axis=1)
        return {
            'pose': share(named == poses), 'unturned': share(unturned),
            'turn': float(np.degrees(np.median(off))),
            'place': float(1e3 * np.median(np.where(np.isnan(away), np.inf, away))),
        }  # fmt: skip

    def split(self) -> dict[str, float]:
        """The paper's split: nine heads at 25 places, of which a fifth is held out."""
        whole = self.world.paper_protocol(self.skin, self.heads, self.seed, config=self.config)
        ends = self.ends(whole)
        places = np.unique(whole.truth['position'][ends, :2], axis=0, return_inverse=True)[1]
        held = np.isin(np.ravel(places), self.rng.permutation(25)[:5])
        out = np.repeat(held, self.world.TARE + self.world.WINDOW)
        test = whole.select(out)
        pipeline = SENSOR.pipeline(self.config).fit(whole.select(~out))
        labels = test.truth['label'][self.ends(test)]
        states = pipeline.process_batch(test)
        windows = self.windows(whole)
        near = np.linalg.norm(windows[held][:, None] - windows[~held][None], axis=2)
        named = whole.truth['label'][ends][~held][near.argmin(axis=1)]
        return {
            'split': share(states.label[self.ends(test)] == labels),
            'split peer': share(named == labels),
        }

    def ends(self, recording: Recording) -> Integers:
        """Last rows of windows."""
        rows = self.world.TARE + self.world.WINDOW
        return np.arange(rows - 1, len(recording), rows)


def share(right: Array) -> float:
    """Of what is true, in percent."""
    return 100 * float(np.mean(right))


def world_module() -> ModuleType:
    """The world, which needs the sources."""
    from reference import multipole_world

    return multipole_world
