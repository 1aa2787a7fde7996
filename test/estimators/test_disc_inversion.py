"""Places of a disc from exact fields, what is found beside the config, and uniform fields."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.calibration import flatten, restore
from tactile_ros.estimators.disc_inversion import DiscInversion
from tactile_ros.estimators.disc_model import UniformField
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.estimators.regression import Standardisation
from tactile_ros.physics.field_table import disc_table, table_disc
from tactile_ros.physics.magnetics import exact_disc

PIXELS = 1e-3 * np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], float)
AXES = np.tile(np.eye(3)[[0, 2]], (4, 1))
GAP, DISC = 2.5e-3, (2e-3, 1e-3, 1.0)
NOISE = 1e-6


def shifts(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    plane = 1.1e-3 / np.sqrt(2) * rng.uniform(-1, 1, (count, 2))
    return np.column_stack([plane, -rng.uniform(0, 1.4e-3, count)])


def readings(shift: np.ndarray, gap: float = GAP, remanence: float = 1.0) -> np.ndarray:
    centre = shift + np.array([0, 0, gap + 0.5e-3])
    disc = (DISC[0], DISC[1], remanence)
    field = exact_disc(PIXELS, disc).readings(np.pad(centre, ((0, 0), (0, 2))))
    return field[..., [0, 2]].reshape(len(shift), -1)


def inversion(tilt: float = 0.0) -> DiscInversion:
    differences = UniformField(AXES, NOISE).differences
    disc = np.array([GAP, *DISC])
    return DiscInversion(PIXELS, AXES, disc, tilt).given(differences, NOISE, absolute=False)


def test_the_table_is_the_disc_and_its_slopes_are_its_changes() -> None:
    table, grid = disc_table(2e-3, 1e-3, (5e-3, 1.2e-3, 4e-3))
    place = shifts(300) + np.array([0, 0, 3e-3])
    tilt = np.random.default_rng(1).normal(scale=0.05, size=(300, 2))
    field, slope = table_disc(PIXELS, place, tilt, table, grid)
    exact = exact_disc(PIXELS, (2e-3, 1e-3, 1.0)).readings(np.hstack([place, tilt]))
    assert np.abs(field - exact).max() < 2e-6
    assert np.sqrt(((field - exact) ** 2).mean()) < 1e-7
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        moved = table_disc(PIXELS, place + step, tilt, table, grid)[0]
        back = table_disc(PIXELS, place - step, tilt, table, grid)[0]
        assert np.allclose((moved - back) / 2e-6, slope[..., k], atol=5e-3 * np.abs(slope).max())


@pytest.mark.parametrize('stray', [0.0, 2e-3, 0.1])
def test_places_are_found_in_any_uniform_field(stray: float) -> None:
    shift = shifts(200)
    change = readings(shift) - readings(np.zeros((1, 3)))
    change = change + stray * np.tile([1.0, -1.0], 4)
    place, rest = inversion().invert(change)
    assert np.abs(GAP * place - shift).max() < 2e-6
    assert np.abs(rest).max() < 3e-5


def test_what_the_config_is_wrong_by_is_found_without_a_truth() -> None:
    shift = shifts(300)
    gap, remanence = 1.06 * GAP, 0.95
    change = readings(shift, gap, remanence) - readings(np.zeros((1, 3)), gap, remanence)
    change = change + NOISE * np.random.default_rng(2).normal(size=change.shape)
    plain = inversion()
    before = GAP * plain.invert(change)[0] - shift
    after = GAP * plain.fit(change).invert(change)[0] - shift
    assert np.abs(after).max() < 0.2 * np.abs(before).max()
    assert plain.report['gap'] == pytest.approx(gap, rel=0.01)
    assert plain.report['remanence'] == pytest.approx(remanence, rel=0.02)


def test_one_row_is_as_many_and_a_file_keeps_it() -> None:
    change = readings(shifts(50)) - readings(np.zeros((1, 3)))
    one = inversion(0.03).fit(change)
    many = one.invert(change)[0]
    assert np.allclose(one.invert(change[3:4])[0], many[3], atol=1e-12)
    classes = {c.__name__: c for c in (DiscInversion, PolynomialRidge, Standardisation)}
    again = restore(flatten(one, 'x'), 'x', classes)
    assert isinstance(again, DiscInversion)
    np.testing.assert_array_equal(again.invert(change)[0], many)


def test_lost_readings_stay_unknown() -> None:
    change = readings(shifts(5))
    change[2, 0] = np.nan
    place, rest = inversion().invert(change)
    assert np.isnan(place[2]).all()
    assert np.isnan(rest[2]).all()
    assert np.isfinite(place[[0, 1, 3, 4]]).all()


def test_gains_and_crossed_axes_are_learned_in_known_fields() -> None:
    rng = np.random.default_rng(3)
    true = AXES + 0.01 * rng.normal(size=AXES.shape)
    field = 2e-3 * rng.normal(size=(60, 3))
    change = field @ true.T + NOISE * rng.normal(size=(60, 8))
    plain, learned = UniformField(AXES, NOISE), UniformField(AXES, NOISE).fit(change, field)
    leak = [np.abs(field @ true.T @ one.differences).max() for one in (plain, learned)]
    assert leak[1] < 0.05 * leak[0]
    assert np.abs(learned.response_ - true).max() < 1e-3
    assert np.isnan(plain.solve(change)[:, 1]).all()
    assert np.abs((learned.solve(change) - field)[:, [0, 2]]).max() < 2e-4
