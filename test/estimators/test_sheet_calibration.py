# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A sheet that is fitted by its resting field and by presses, and how it explains others."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_ros.estimators.sheet_calibration import (
    NODES,
    USUAL,
    LabelledPress,
    SheetCalibration,
    SkinModel,
    _share,
)
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.press_fit import drawn_skin
from tactile_ros.types import Outline

CONFIG = load_sensor('multipole_skin').config()
DRAWN = drawn_skin(CONFIG)  # type: ignore[arg-type]
HEADS = CONFIG.objects[:2]  # type: ignore[attr-defined]
NOISE = 4e-6
PRESSES = 4
TURNED = np.array([0.0, 0.0, 0.1])


def made(skin: SkinModel, head: Outline, pose: np.ndarray) -> LabelledPress:
    """A press of 0.4 mm as a skin reads it."""
    fit = SheetCalibration(skin, NOISE)
    press = LabelledPress(head, pose, True, np.zeros(60), np.full(60, 1e-14))
    state = np.array([*pose, 4e-4, 0, 0, 0, 0, 0.0])
    return replace(press, pattern=fit._read(skin, press, state))


class Bench:
    """A skin unlike its drawing, fitted by its resting field and some presses."""

    def __init__(self) -> None:
        rng = np.random.default_rng(6)
        self.skin = replace(
            DRAWN,
            chips=DRAWN.chips + 1.5e-4 * rng.normal(size=DRAWN.chips.shape),
            responses=DRAWN.responses * (1 + 0.03 * rng.normal(size=(len(DRAWN.chips), 3, 1))),
            uneven=0.05 * rng.normal(size=(NODES, NODES)),
        )
        self.rest = self.skin.rest()
        self.fit = SheetCalibration(DRAWN, NOISE)
        assert self.fit.fit_rest(self.rest)
        places = rng.uniform(-15e-3, 15e-3, (PRESSES, 2))
        poses = np.column_stack([places, rng.uniform(-3, 3, PRESSES)])
        self.presses = [made(self.skin, HEADS[i % 2], pose) for i, pose in enumerate(poses)]
        self.expected = self.fit.expected(HEADS)
        self.fit._poses = [self.fit._first_state(one) for one in self.presses]
        self.before = _share(np.array(self.fit._residuals(self.presses)), self.presses)
        self.fit.fit_presses(self.rest, self.presses)


@pytest.fixture(scope='module')
def bench() -> Bench:
    return Bench()


def test_presses_fit_what_rest_leaves_and_less_where_they_were_left_out(bench: Bench) -> None:
    patterns, without = bench.fit.held_out(bench.presses, np.arange(PRESSES))
    assert bench.fit.error <= without < bench.before
    assert np.isfinite(patterns).all()


def test_errors_that_are_expected_after_a_rest_are_about_those_that_come(bench: Bench) -> None:
    assert 0.4 < bench.expected / bench.before < 2.5


def test_a_turn_without_a_label_is_estimated(bench: Bench) -> None:
    some = [replace(one, pose=one.pose + TURNED, turn_known=False) for one in bench.presses]
    fit = SheetCalibration(DRAWN, NOISE)
    fit.fit_rest(bench.rest)
    fit.fit_presses(bench.rest, some)
    off = [state[2] - one.pose[2] for state, one in zip(fit._poses, bench.presses, strict=True)]
    assert np.abs(off).max() < 0.05


def test_kinds_of_parameters_say_how_far_they_usually_are() -> None:
    exact, rough = SheetCalibration(DRAWN, NOISE), SheetCalibration(DRAWN, NOISE)
    rng = np.random.default_rng(7)
    far = replace(DRAWN, chips=DRAWN.chips + 5e-4 * rng.normal(size=DRAWN.chips.shape))
    exact.fit_rest(DRAWN.rest())
    rough.fit_rest(far.rest())
    some = exact.parts['place'].start
    assert exact.prior[some] < USUAL['place'] < rough.prior[some]


@pytest.mark.parametrize('turning', [0.0, 0.35])
def test_presses_say_how_far_magnets_turn_with_the_body(turning: float) -> None:
    skin, fit = replace(DRAWN, turning=turning), SheetCalibration(DRAWN, NOISE)
    poses = np.array([[0.0, 0.0, 0.0], [9e-3, -4e-3, 1.0], [-7e-3, 8e-3, 2.0]])
    fit.fit_presses(skin.rest(), [made(skin, HEADS[0], pose) for pose in poses])
    assert fit.model.turning == pytest.approx(turning, abs=0.05)
