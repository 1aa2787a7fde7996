# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The data collection of [1] and its trials, on a skin of the multipole world.

Heads come down at twenty-five places, many times each; a class is a head, or a posture of a bar.
A task takes some classes at one place: a few presses of each are known, the others are asked.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from reference import multipole_world as world
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.prototypes import Prototypes
from tactile_ros.types import Array, Integers, Outline

SKIN = 100  # seed of the skin that the networks are trained on
DEPTH = (0.3e-3, 0.9e-3)  # m
POSTURES = np.radians([0, 30, 60, 90, 120, 150])
HELD_OUT = 5  # of 25 places, on which nothing is learned
WAYS, TAKEN = 5, 10  # classes of a task of shapes, and presses of each
SHOTS = (1, 3, 5)
SPAN = 22e-3  # m, of random places from the middle
NEIGHBOURS = 5
RETURNS = 5e-5, 0.01  # m and rad, by which a stage comes back


@dataclass(frozen=True)
class Samples:
    """Presses (n): windows (n, w, d) of changes of field (T), and what they were.

    `label` (n,) is the class, `place` and `source` (n,) are numbers of the place and head.
    """

    windows: npt.NDArray[np.float32]
    label: Integers
    place: Integers
    source: Integers

    def rows(self, chosen: npt.NDArray[np.intp]) -> Samples:
        """Some of them."""
        names = ('windows', 'label', 'place', 'source')
        return Samples(*(getattr(self, name)[chosen] for name in names))


def collection(
    skin: world.World, heads: Sequence[Outline], places: Array, seed: int,
    turns: Sequence[float] = (0.0,),
) -> Samples:  # fmt: skip
    """Data collection of [1]: heads at places (p, 2) (m) and turns (rad), some presses of each.

    With more than one turn, the turns are the classes. `seed` is of depths, speeds, drift and
    noise; each press is a little aside of the one before, as a stage comes back.
    """
    rng = np.random.default_rng([17, seed])
    windows, what = [], []
    for i, head in enumerate(heads):
        for j, place in enumerate(places):
            for k, turn in enumerate(turns):
                for _ in range(TAKEN):
                    at = place + RETURNS[0] * rng.normal(size=2)
                    terms = _terms(skin, head, at, turn + RETURNS[1] * rng.normal())
                    windows.append(_window(skin, terms, rng))
                    what.append((i if len(turns) == 1 else k, j, i))
    return Samples(np.array(windows, np.float32), *np.array(what).T)


def _terms(skin: world.World, head: Outline, place: Array, turn: float) -> Array:
    """Change of readings (4, d) for the powers 1 to 4 of the depth over the largest one."""
    change, _ = skin.changes(head, place, turn, DEPTH[1])
    powers = np.vander(world.STORED[1:], 5, increasing=True)[:, 1:]
    return np.asarray(np.linalg.solve(powers, skin._read(change[1:]).reshape(4, -1)))


def _window(skin: world.World, terms: Array, rng: np.random.Generator) -> Array:
    """One window less its tare."""
    flaws = skin.flaws
    part = world.ramp(rng, rng.uniform(*DEPTH)) / DEPTH[1]
    found = part[:, None] ** np.arange(1, 5) @ terms
    tare = flaws.noise * rng.normal(size=found.shape[1]) / np.sqrt(world.TARE)
    drift = flaws.drift * rng.normal(size=found.shape[1])
    return np.asarray(found + drift - tare + flaws.noise * rng.normal(size=found.shape))


def split_places(seed: int, count: int = 25) -> tuple[Integers, Integers]:
    """Places to learn from, and held-out ones."""
    order = np.random.default_rng([19, seed]).permutation(count)
    return np.sort(order[HELD_OUT:]), np.sort(order[:HELD_OUT])


def few_shot(
    features: Array, samples: Samples, shots: int, ways: int, tasks: int, seed: int
) -> float:
    """Share of queries that prototypes of features (n, p) name rightly."""
    return float(np.mean(few_shot_tasks(features, samples, shots, ways, tasks, seed)[1]))


def few_shot_tasks(
    features: Array, samples: Samples, shots: int, ways: int, tasks: int, seed: int
) -> tuple[Integers, Array]:
    """Place of each task, and the share of its queries that is named rightly."""
    rng = np.random.default_rng([29, seed])
    places, right = [], []
    for _ in range(tasks):
        known, asked = task(samples, shots, ways, rng)
        found = Prototypes().fit(features[known], samples.label[known])
        places.append(samples.place[asked[0]])
        right.append((found.predict(features[asked]) == samples.label[asked]).mean())
    return np.array(places), np.array(right)


def task(
    samples: Samples, shots: int, ways: int, rng: np.random.Generator
) -> tuple[Integers, Integers]:
    """Rows of known and of asked presses: one place, one head where postures are the classes."""
    place = rng.choice(np.unique(samples.place))
    rows = np.flatnonzero(samples.place == place)
    if not np.array_equal(samples.label, samples.source):
        rows = rows[samples.source[rows] == rng.choice(np.unique(samples.source[rows]))]
    classes = rng.choice(np.unique(samples.label[rows]), ways, replace=False)
    taken = [rng.choice(rows[samples.label[rows] == one], TAKEN, replace=False) for one in classes]
    known = np.concatenate([one[:shots] for one in taken])
    return known, np.concatenate([one[shots:] for one in taken])


def neighbours(known: Samples, asked: Samples, features: Callable[[Samples], Array]) -> float:
    """Share of presses that votes of the nearest known ones name rightly."""
    classes = np.unique(known.label)
    shares = (known.label[:, None] == classes).astype(float)
    votes = GridKnn(NEIGHBOURS).fit(features(known), shares).predict(features(asked))
    return float((classes[votes.argmax(axis=1)] == asked.label).mean())


def plain(samples: Samples) -> Array:
    """Whole windows as features (n, w d)."""
    return np.asarray(samples.windows.reshape(len(samples.windows), -1), np.float64)
