# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The cheapest model that a scene needs, and what is measured of all of them."""

from __future__ import annotations

import dataclasses

import magpylib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_ros.physics.fidelity import (
    SHARE,
    Choice,
    Model,
    Term,
    choose,
    rate,
    region,
    worth,
)
from tactile_ros.physics.field_table import SHAPES, table_disc_model, table_reach
from tactile_ros.physics.magnetics import RINGS, dipole_disc, disc_dipoles, exact_disc

PIXELS = 1e-3 * np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], float)
DISC = (2e-3, 1e-3, 1.4)
LOW = np.array([-1e-3, -1e-3, 1.6e-3, -0.1, -0.1])
HIGH = np.array([1e-3, 1e-3, 3.2e-3, 0.1, 0.1])
STATES = region(LOW, HIGH, 200)
EXACT = exact_disc(PIXELS, DISC)


def line(slope: float, cost: float) -> Model:
    return Model(f'{slope} x', lambda x: slope * x, cost)


def models() -> list[Model]:
    reach = table_reach(PIXELS, STATES)
    found = [dipole_disc(PIXELS, DISC, rings) for rings in RINGS]
    found += [table_disc_model(PIXELS, DISC, reach, s, d) for s in SHAPES for d in (1, 3)]
    return found


def test_the_exact_disc_is_that_of_magpylib_in_every_state() -> None:
    found = EXACT.readings(STATES[:40])
    for state, field in zip(STATES[:40], found, strict=True):
        magnet = magpylib.magnet.Cylinder(
            dimension=DISC[:2], polarization=(0, 0, DISC[2]), position=state[:3],
            orientation=Rotation.from_rotvec([*state[3:], 0.0]),
        )  # fmt: skip
        np.testing.assert_allclose(field, magnet.getB(PIXELS), atol=1e-11)


@pytest.mark.parametrize('noise', [1e-3, 1e-4, 9e-6, 1e-6, 1e-7])
def test_the_choice_holds_where_it_was_not_measured_and_nothing_cheaper_does(
    noise: float,
) -> None:
    choice = choose(models(), EXACT, STATES, noise, every=True)
    assert choice.chosen.worst <= SHARE * noise
    cheaper = [r for r in choice.rated if (r.operations, r.numbers) < (
        choice.chosen.operations, choice.chosen.numbers)]  # fmt: skip
    assert all(r.worst > SHARE * noise for r in cheaper)
    (model,) = [m for m in [*models(), EXACT] if m.name == choice.name]
    fresh = region(LOW, HIGH, 1000, seed=99)
    assert rate(model, EXACT.readings(fresh), fresh, np.array(noise)).share < 1.5 * SHARE


def test_less_noise_never_chooses_a_cheaper_model() -> None:
    found = [choose(models(), EXACT, STATES, noise).chosen for noise in (1, 1e-3, 1e-5, 1e-7)]
    costs = [(r.operations, r.numbers) for r in found]
    assert costs == sorted(costs)
    assert found[0].name == 'dipole'


def test_the_search_stops_at_the_choice_unless_all_are_asked_for() -> None:
    many, few = (choose(models(), EXACT, STATES, 9e-6, every=e) for e in (True, False))
    assert few.name == many.name
    assert few.rated == many.rated[: len(few.rated)]
    assert len(many.rated) == len(models()) + 1
    assert [r.operations for r in many.rated[:-1]] == sorted(r.operations for r in many.rated[:-1])


def test_where_no_model_serves_the_exact_one_does() -> None:
    choice = choose([line(1.01, 1), line(1.1, 0.5)], line(1.0, 9), np.ones((3, 1)), 1e-3)
    assert choice.name == '1.0 x'
    assert choice.chosen.worst == 0


def test_every_channel_has_its_own_noise() -> None:
    def off(x: np.ndarray) -> np.ndarray:
        return x + np.array([0.0, 1.0])

    rough, exact = Model('off', off, 1), Model('exact', lambda x: x, 2)
    states = np.zeros((3, 2))
    assert choose([rough], exact, states, np.array([0.1, 4.0])).name == 'off'
    assert choose([rough], exact, states, np.array([4.0, 0.1])).name == 'exact'


@pytest.mark.parametrize('noise', [0.0, -1.0, float('nan')])
def test_a_noise_that_is_none_is_refused(noise: float) -> None:
    with pytest.raises(ValueError, match='noise of a scene must be above 0'):
        choose([], line(1.0, 1), np.ones((1, 1)), noise)


def test_the_report_names_the_choice() -> None:
    choice = choose(models(), EXACT, STATES, 3e-6)
    (name,) = choice.report
    assert name == f'model: {choice.name}'
    assert choice.report[name]['worst_error'] <= 1e-6
    assert choice.report[name]['noise'] == 3e-6
    assert dataclasses.is_dataclass(choice)
    assert isinstance(choice, Choice)


def test_states_of_a_region_are_repeatable_and_hold_its_corners() -> None:
    assert len(STATES) == 32 + 200
    np.testing.assert_array_equal(STATES, region(LOW, HIGH, 200))
    assert (STATES >= LOW).all()
    assert (STATES <= HIGH).all()
    assert any((row == HIGH).all() for row in STATES[:32])


@pytest.mark.parametrize('rings', RINGS)
def test_dipoles_of_a_disc_have_its_moment_and_its_middle(rings: tuple[int, int, int]) -> None:
    places, shares = disc_dipoles(2e-3, 1e-3, rings)
    assert shares.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(shares @ places, 0, atol=1e-18)
    assert np.hypot(places[:, 0], places[:, 1]).max() < 1e-3
    if rings[2] > 1:  # second moments of a disc: a^2 / 4, and h^2 / 12 of its height
        spread = (shares[:, None] * places**2).sum(axis=0)
        np.testing.assert_allclose(spread[:2], 1e-6 / 4, rtol=1e-9)
        assert spread[2] == pytest.approx(1e-6 / 12)


def test_tables_and_dipoles_come_nearer_as_they_grow() -> None:
    choice = choose(models(), EXACT, STATES, 1e-6, every=True)
    by_name = {r.name: r.worst for r in choice.rated}
    for kind in ('linear', 'cubic'):
        errors = [by_name[f'{kind} table {a} x {b}'] for a, b in SHAPES]
        assert errors == sorted(errors, reverse=True)
    dipoles = [r.worst for r in choice.rated if 'dipole' in r.name]
    assert dipoles == sorted(dipoles, reverse=True)


def test_case_4_a_dipole_is_not_a_block_at_a_few_sizes() -> None:
    # on the axis of 2 x 2 x 1 mm: 9.6 times too large at 0.6 mm, 1.015 at 10 mm
    height = 1e-3 * np.array([0.6, 1.0, 2.0, 3.0, 6.0, 10.0])
    axis = np.column_stack([0 * height, 0 * height, height])
    magnet = magpylib.magnet.Cuboid(dimension=(2e-3, 2e-3, 1e-3), polarization=(0, 0, 1.4))
    moment = magpylib.misc.Dipole(moment=(0, 0, 1.4 * 4e-9 / (4e-7 * np.pi)))
    ratio = moment.getB(axis)[:, 2] / magnet.getB(axis)[:, 2]
    np.testing.assert_allclose(ratio, [9.6, 3.3, 1.43, 1.18, 1.04, 1.015], rtol=0.03)


RNG = np.random.default_rng(3)
SLOPES = RNG.normal(size=(5, 8, 3))
COLUMNS = RNG.normal(size=(5, 8, 2))
NOISE = 0.1


def estimated(columns: np.ndarray | None, spread: float, draws: int = 4000) -> float:
    """Rms error of three wanted numbers by least squares, with a disturbance of that spread."""
    rng, square = np.random.default_rng(0), []
    for slope, column in zip(SLOPES, COLUMNS, strict=True):
        both = slope if columns is None else np.concatenate([slope, column], axis=1)
        seen = (
            NOISE * rng.normal(size=(draws, 8)) + spread * rng.normal(size=(draws, 2)) @ column.T
        )
        found = seen @ np.linalg.pinv(both).T
        square.append((found[:, :3] ** 2).sum(axis=1).mean())
    return float(np.sqrt(np.mean(square)))


@pytest.mark.parametrize('spread', [0.5, 0.02])
def test_errors_are_those_of_least_squares(spread: float) -> None:
    (found,) = worth(SLOPES, NOISE, [Term('t', COLUMNS, spread)])
    assert found.without == pytest.approx(estimated(None, spread), rel=0.03)
    assert found.within == pytest.approx(estimated(COLUMNS, spread), rel=0.03)
    assert found.alone == pytest.approx(estimated(None, 0.0), rel=0.03)
    assert found.reads == pytest.approx(
        spread * np.sqrt((COLUMNS**2).sum(axis=2).mean()), rel=1e-9
    )
    assert found.pays == (spread > 0.1)
    assert found.cost == pytest.approx(found.within / found.alone)
    assert found.buys == pytest.approx(found.without / found.within)


def test_a_term_that_readings_do_not_see_costs_and_buys_nothing() -> None:
    (found,) = worth(SLOPES, NOISE, [Term('none', 0 * COLUMNS, 1.0)])
    assert found.reads == 0
    assert found.cost == pytest.approx(1.0)
    assert found.buys == pytest.approx(1.0)
    assert not found.within < found.alone * (1 - 1e-9)


def test_a_term_that_looks_like_what_is_wanted_does_not_pay() -> None:
    (found,) = worth(SLOPES, NOISE, [Term('twin', SLOPES[..., :1], 0.01)])
    assert not found.pays
    assert found.cost > 10


def test_only_what_is_wanted_counts() -> None:
    term = Term('t', COLUMNS, 0.5)
    (all_of_them,), (first,) = worth(SLOPES, NOISE, [term]), worth(SLOPES, NOISE, [term], 1)
    assert first.within < all_of_them.within
    turned = worth(SLOPES[..., ::-1], NOISE, [term], 2)[0]
    squares = first.within**2 + turned.within**2
    np.testing.assert_allclose(squares, all_of_them.within**2)
    assert first.report['term: t']['costs'] == first.cost
    assert first.report['term: t']['unknowns'] == 2


def test_units_do_not_matter_and_what_is_not_told_stays_finite() -> None:
    plain = worth(SLOPES, NOISE, [Term('t', COLUMNS, 0.5)])[0]
    fine = worth(1e3 * SLOPES, NOISE, [Term('t', 1e-5 * COLUMNS, 0.5e5)])[0]
    np.testing.assert_allclose(1e3 * fine.within, plain.within, rtol=1e-6)
    np.testing.assert_allclose(1e3 * fine.without, plain.without, rtol=1e-9)
    blind = np.concatenate([SLOPES, np.zeros((5, 8, 1))], axis=2)
    assert np.isfinite(worth(blind, NOISE, [Term('t', COLUMNS, 0.5)])[0].within)
