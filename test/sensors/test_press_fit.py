# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Groups by which roads of the multipole skin are compared, and skins known by rest alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactile_ros.estimators.few_shot import Presses
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.press_fit import FOLDS, Labels, class_heads, drawn_skin
from tactile_ros.sensors.multipole_skin.recogniser import Recogniser

PLACES = np.repeat(1e-3 * np.array([[0, 0], [5, 0], [0, 5], [5, 5], [9, 9], [-9, 9.0]]), 6, axis=0)
COUNT = len(PLACES)
CONFIG = load_sensor('multipole_skin').config()
POSES = np.array([[4e-3, 6e-3, 0.1], [-8e-3, 3e-3, 0.5]])


def labels(place: np.ndarray, number: np.ndarray, group: np.ndarray | None = None) -> Labels:
    place = np.column_stack([place, np.zeros(COUNT)])
    group = np.zeros(COUNT, np.int64) if group is None else group
    return Labels(np.arange(COUNT) % 3, place, np.zeros(COUNT), group, number)


def test_folds_hold_places_presses_or_groups_out_together() -> None:
    # hard case 8: presses of one place in both parts are told by their place
    number, group, unknown = np.arange(COUNT), np.arange(COUNT) // 4, np.full_like(PLACES, np.nan)
    for some, kept in (
        (labels(PLACES, number), PLACES @ [1e3, 1e6]),
        (labels(PLACES + 1e-3 * (number % 2)[:, None], number // 2), number // 2),  # heads rolled
        (labels(unknown, number, group), group),
    ):
        for fold in range(FOLDS):
            out = some.folds == fold
            assert not set(kept[out]) & set(kept[~out])
            assert out.any()


def test_class_heads_explain_all_presses_of_a_class() -> None:
    matches = SimpleNamespace(cost=np.array([[3.0, 4, 9], [8, 2, 9], [5, 6, 1], [1, 5, 2]]))
    found = class_heads(matches, np.array([4, 4, 7, 7]))  # type: ignore[arg-type]
    assert found.tolist() == [1, 1, 2, 2]


@pytest.fixture(scope='module')
def recogniser() -> Recogniser:
    drawn = drawn_skin(CONFIG)  # type: ignore[arg-type]
    heads = CONFIG.objects[:2]  # type: ignore[attr-defined]
    found = Recogniser(drawn, heads, np.full(drawn.chips.size, 1e-6), drawn.common)
    found.turnings = (1.0,)
    return found


@pytest.mark.parametrize('turning', [0.0, 1.0])
def test_magnets_may_turn_with_the_body_or_not_where_no_press_told(
    recogniser: Recogniser, turning: float
) -> None:
    skin = Recogniser(
        replace(recogniser.model, turning=turning), recogniser.outlines, recogniser.noise,
        recogniser.common,
    )  # fmt: skip
    parts = skin.search.bank.at(np.array([0, 1]), POSES)[:, 0]
    patterns = np.einsum('p,npd->nd', 4e-4 ** np.arange(1, 4), parts)
    answers = recogniser.answer(Presses(patterns, np.full(2, 10.0)))
    assert answers.label.tolist() == [0, 1]
    away = np.linalg.norm(answers.pose[:, :2] - POSES[:, :2], axis=1)
    assert away.max() < 0.3e-3
