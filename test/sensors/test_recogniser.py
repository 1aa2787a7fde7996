"""Heads on a skin of which a rest alone is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_ros.estimators.few_shot import PressVectors
from tactile_ros.estimators.sheet_calibration import PressMisfit
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.press_fit import drawn_skin
from tactile_ros.sensors.multipole_skin.recogniser import Recogniser

CONFIG = load_sensor('multipole_skin').config()
NOISE = 1e-6
POSES = np.array([[4e-3, 6e-3, 0.1], [-8e-3, 3e-3, 0.5]])


@pytest.fixture(scope='module')
def recogniser() -> Recogniser:
    drawn = drawn_skin(CONFIG)  # type: ignore[arg-type]
    heads = CONFIG.objects[:2]  # type: ignore[attr-defined]
    found = Recogniser(drawn, heads, np.full(drawn.chips.size, NOISE), drawn.common)
    found.turnings = (1.0,)
    return found


@pytest.mark.parametrize('turning', [0.0, 1.0])
def test_magnets_may_turn_with_the_body_or_not_where_no_press_told(
    recogniser: Recogniser, turning: float
) -> None:
    assert recogniser.model is not None
    skin, press = replace(recogniser.model, turning=turning), PressMisfit(NOISE)
    made = [press.made(skin, recogniser.outlines[i % 2], pose) for i, pose in enumerate(POSES)]
    patterns = np.array([one.pattern for one in made])
    answers = recogniser.answer(PressVectors(patterns, np.ones((2, 3)), np.full(2, 10.0)))
    assert answers.label.tolist() == [0, 1]
    away = np.linalg.norm(answers.pose[:, :2] - POSES[:, :2], axis=1)
    assert away.max() < 0.3e-3
