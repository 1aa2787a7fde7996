"""A skin that is mended by presses, and what it says of presses that it was not mended with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_ros.estimators.sheet_calibration import USUAL, SheetCalibration
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.press_fit import drawn_skin

CONFIG = load_sensor('multipole_skin').config()
NOISE = 4e-6
PRESSES = 4


class Bench:
    """A skin unlike its drawing, fitted by its resting field and some presses."""

    def __init__(self) -> None:
        rng = np.random.default_rng(6)
        drawn = drawn_skin(CONFIG)  # type: ignore[arg-type]
        self.skin = replace(
            drawn,
            chips=drawn.chips + 1.5e-4 * rng.normal(size=drawn.chips.shape),
            responses=drawn.responses * (1 + 0.03 * rng.normal(size=(len(drawn.chips), 3, 1))),
        )
        self.rest = self.skin.rest()
        self.fit = SheetCalibration(drawn, NOISE)
        assert self.fit.fit_rest(self.rest)
        places = rng.uniform(-15e-3, 15e-3, (PRESSES, 2))
        poses = np.column_stack([places, rng.uniform(-3, 3, PRESSES)])
        heads = CONFIG.objects[:2]  # type: ignore[attr-defined]
        made = [self.fit.press.made(self.skin, heads[i % 2], pose) for i, pose in enumerate(poses)]
        noise = NOISE * rng.normal(size=(PRESSES, drawn.chips.size))
        self.presses = [
            replace(one, pattern=one.pattern + own) for one, own in zip(made, noise, strict=True)
        ]
        self.expected = self.fit.expected(self.presses)
        self.before = self.missed(self.fit)
        self.fit.fit_presses(self.rest, self.presses)

    def missed(self, fit: SheetCalibration) -> np.ndarray:
        return np.array([fit.press.miss(fit.found, one)[2] for one in self.presses])


@pytest.fixture(scope='module')
def bench() -> Bench:
    return Bench()


def test_presses_mend_what_the_resting_field_leaves_and_less_where_they_were_left_out(
    bench: Bench,
) -> None:
    within = bench.missed(bench.fit)
    patterns, without = bench.fit.left_out(bench.presses, np.arange(PRESSES))
    assert np.median(within) < 0.5 * np.median(without)
    assert np.median(without) < np.median(bench.before)
    # the pattern differs from this skin's template as the press from the other one's
    for pattern, press, share in zip(patterns, bench.presses, without, strict=True):
        again = bench.fit.press.miss(bench.fit.found, replace(press, pattern=pattern))[2]
        assert again == pytest.approx(share, rel=0.2)


def test_what_is_left_out_is_what_a_fit_without_it_finds(bench: Bench) -> None:
    without = bench.fit.left_out(bench.presses, np.arange(PRESSES))[1]
    other = SheetCalibration(drawn_skin(CONFIG), NOISE)  # type: ignore[arg-type]
    other.fit_rest(bench.rest)
    other.fit_presses(bench.rest, bench.presses[1:])
    assert other.press.miss(other.found, bench.presses[0])[2] == pytest.approx(without[0], rel=0.2)


def test_errors_that_are_expected_after_a_rest_are_about_those_that_come(bench: Bench) -> None:
    assert 0.5 < bench.expected / np.sqrt(np.mean(np.square(bench.before))) < 2.5


def test_kinds_of_parameters_tell_how_far_they_usually_are() -> None:
    drawn = drawn_skin(CONFIG)  # type: ignore[arg-type]
    exact, rough = SheetCalibration(drawn, NOISE), SheetCalibration(drawn, NOISE)
    rng = np.random.default_rng(7)
    far = replace(drawn, chips=drawn.chips + 5e-4 * rng.normal(size=drawn.chips.shape))
    exact.fit_rest(drawn.rest())
    rough.fit_rest(far.rest())
    some = exact.parts['place'].start
    assert exact.prior[some] < USUAL['place'] < rough.prior[some]


@pytest.mark.parametrize('turning', [0.0, 0.35])
def test_presses_tell_how_far_magnets_turn_with_the_body(turning: float) -> None:
    drawn = drawn_skin(CONFIG)  # type: ignore[arg-type]
    skin, fit = replace(drawn, turning=turning), SheetCalibration(drawn, NOISE)
    head = CONFIG.objects[0]  # type: ignore[attr-defined]
    poses = np.array([[0.0, 0.0, 0.0], [9e-3, -4e-3, 1.0], [-7e-3, 8e-3, 2.0]])
    fit.fit_presses(skin.rest(), [fit.press.made(skin, head, pose) for pose in poses])
    assert fit.found.turning == pytest.approx(turning, abs=0.02)
