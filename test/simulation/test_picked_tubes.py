"""How many picked tubes a rule that knows the world may place: the bound beside pick and place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from tactile_ros.evaluation.sources import load_source
from tactile_ros.simulation import grippers
from tactile_ros.simulation.taxel_scene import TaxelScene, TaxelSkin

PICKS = Path(__file__).parents[2] / 'benchmarks' / 'worlds' / 'taxel_picks.py'


@pytest.fixture(scope='module')
def bench() -> ModuleType:
    return load_source(PICKS, 'a test')


def limit(bench: ModuleType, bends: tuple[float, float], noise: float = 5e-4) -> float:
    """Of four tubes that lie somewhere."""
    config = replace(grippers.suction_cup(), objects=grippers.tubes(bends))
    scene, rng = TaxelScene(config), np.random.default_rng(5)
    skin = replace(TaxelSkin.drawn(16, 8.0, rng), noise=noise)
    gripper = SimpleNamespace(config=config, scene=scene, skin=skin)
    poses = np.column_stack([rng.uniform(-2e-3, 2e-3, (4, 2)), rng.uniform(-np.pi, np.pi, 4)])
    picks = [
        SimpleNamespace(
            part=i % 2, pose=pose, loads=scene.loads(config.objects[i % 2], pose, 20.0)
        )
        for i, pose in enumerate(poses)
    ]
    return float(bench._limit([gripper], [picks]))


def test_bends_far_apart_are_all_told(bench: ModuleType) -> None:
    assert limit(bench, (90.0, 135.0)) == pytest.approx(100.0, abs=1e-6)


def test_bends_that_are_alike_are_told_by_a_coin(bench: ModuleType) -> None:
    assert limit(bench, (90.0, 90.02)) == pytest.approx(50.0, abs=4.0)


def test_noise_brings_the_bound_down(bench: ModuleType) -> None:
    assert 80.0 < limit(bench, (90.0, 100.0), noise=0.01) < 97.0
