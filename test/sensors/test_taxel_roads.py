"""Frames of an array by compiled loops and by arrays: the same numbers on every road."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from reference import pick_world
from reference.pick_world import TaxelScene, TaxelSkin, even_loads
from tactile_ros.physics import compiled
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import STATE_FIELDS, ContactStates, Frame, Recording

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


def told(states: ContactStates) -> dict[str, np.ndarray]:
    return {name: np.asarray(getattr(states, name), float) for name in STATE_FIELDS}


@pytest.mark.skipif(not compiled.available(), reason='numba is not installed')
def test_arrays_give_what_loops_give(monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline, recording = washers()
    looped = told(pipeline.process_batch(recording))
    assert (looped['label'][:10] == np.arange(10) % 5).all()
    monkeypatch.setattr(compiled, 'AVAILABLE', False)
    plain = told(pipeline.process_batch(recording))
    for name, column in looped.items():
        size = max(np.abs(np.nan_to_num(column)).max(), 1e-30)
        np.testing.assert_allclose(plain[name] / size, column / size, atol=1e-12, err_msg=name)


@pytest.mark.skipif(not compiled.available(), reason='numba is not installed')
def test_patches_of_one_frame_are_the_same_on_both_roads(monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline, recording = washers()

    def live() -> list[dict[str, np.ndarray]]:
        frames = [Frame(None, i, row) for i, row in enumerate(recording.values)]
        states = [pipeline.process(frame) for frame in frames]
        return [{n: np.asarray(getattr(s, n), float) for n in STATE_FIELDS} for s in states]

    looped = live()
    monkeypatch.setattr(compiled, 'AVAILABLE', False)
    for one, other in zip(looped, live(), strict=True):
        for name, column in one.items():
            size = max(np.abs(np.nan_to_num(column)).max(), 1e-30)
            np.testing.assert_allclose(other[name] / size, column / size, atol=1e-12, err_msg=name)
    assert sum(one['contacts_id'].max() > 0 for one in looped) >= 1


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
