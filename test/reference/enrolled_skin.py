# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A multipole skin that knows five heads by a few presses of the twin, and a new head to learn."""

from dataclasses import replace

import numpy as np

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.specimen import Specimen
from tactile_ros.sensors.multipole_skin.twin import DEPTH, NEW, NOISE, SPECIMEN, Pressing, played
from tactile_ros.types import Frame, Recording

SPEC = load_sensor('multipole_skin')
RESTING = 12  # frames before and after a press
PERIOD_NS = 12_500_000


def five_heads() -> Pipeline:
    """Pipeline that saw eight presses of the twin of seed 1, and has no drawing of the heads."""
    config = replace(SPEC.config(), objects=())  # type: ignore[type-var]
    train = SPEC.presses(config, 1).select(slice(0, 80 + 8 * 96))  # a rest first
    known = {name: train.truth[name] for name in ('label', 'in_contact', 'repetition')}
    return SPEC.pipeline(config).fit(replace(train, truth=known))


def new_head(count: int = 8) -> Recording:
    """Presses of one more head at one place."""
    config = SPEC.config()
    rng = np.random.default_rng(5)
    poses = np.tile([-16e-3, 0.0, 0.3], (count, 1))  # aside of those that are known
    pressing = Pressing((NEW,), np.zeros(count, np.int64), poses, rng.uniform(*DEPTH, count))
    return played(Specimen(config, seed=SPECIMEN), pressing, NOISE, 5)  # type: ignore[arg-type]


def press_of(recording: Recording, number: int, scale: float = 1.0) -> np.ndarray:
    """Readings of a press from rest to rest, so many times as strong."""
    touched = recording.truth['in_contact'] == 1
    mine = np.flatnonzero(touched & (recording.truth['repetition'] == number))
    rows = np.arange(mine[0] - RESTING, mine[-1] + RESTING)
    rest = recording.values[:20].mean(axis=0)
    deep = np.where(touched[rows], scale, 1.0)[:, None, None]
    return rest + deep * (recording.values[rows] - rest)


def frame_of(count: int, values: np.ndarray) -> Frame:
    """A frame of a stream at 80 Hz."""
    return Frame(1_000_000_000 + PERIOD_NS * count, count, values)
