# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Frames of an array by compiled loops and by arrays: the same numbers on every road."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from reference import pick_world
from reference.pick_world import TaxelScene, TaxelSkin, even_loads
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import STATE_FIELDS, Frame, Recording

SPEC = load_sensor('taxel_array')
CONFIG = pick_world.magnet_gripper()
BROKEN = 5


@lru_cache
def washers() -> tuple[Pipeline, Recording]:
    rng = np.random.default_rng(21)
    skin = TaxelSkin.drawn(72, 1.5, rng, BROKEN)
    pipeline = SPEC.pipeline(CONFIG).fit(
        even_loads(SPEC.layout(CONFIG), CONFIG.areas, skin, rng, 3.0)
    )
    scene = TaxelScene(CONFIG)
    poses = np.column_stack([rng.uniform(-3e-3, 3e-3, (10, 2)), np.zeros(10)])
    loads = [scene.loads(CONFIG.objects[i % 5], pose, 20.0) for i, pose in enumerate(poses)]
    two = np.where(CONFIG.positions[:, 0] > 0, loads[0], loads[1]) * (
        np.abs(CONFIG.positions[:, 0]) > 9e-3
    )
    values = skin.read(np.array([*loads, two, 0.0 * two]), rng)
    return pipeline, Recording.from_arrays(SPEC.layout(CONFIG), values)


def test_live_is_batch_for_every_attribute() -> None:
    pipeline, recording = washers()
    states = pipeline.process_batch(recording)
    for i, row in enumerate(recording.values):
        state = pipeline.process(Frame(None, i, row))
        for name in STATE_FIELDS:
            np.testing.assert_allclose(
                getattr(state, name), getattr(states, name)[i], rtol=1e-9, atol=1e-12,
                err_msg=name,
            )  # fmt: skip
