# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The cheapest model that a scene needs, and gains of terms."""

import numpy as np
import pytest

from benchmarks.worlds.multipole_fidelity import RINGS, all_rated, dipole_disc, disc_dipoles
from tactile_ros.physics.fidelity import SHARE, Model, Term, choose, rate, region, term_gains
from tactile_ros.physics.field_table import SHAPES, table_disc_model
from tactile_ros.physics.magnetics import exact_disc

PIXELS = 1e-3 * np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]], float)
DISC = (2e-3, 1e-3, 1.4)
LOW = np.array([-1e-3, -1e-3, 1.6e-3, -0.1, -0.1])
HIGH = np.array([1e-3, 1e-3, 3.2e-3, 0.1, 0.1])
STATES = region(LOW, HIGH, 200)
EXACT = exact_disc(PIXELS, DISC)
REACH = (3.2e-3, 1.2e-3, 3.6e-3)  # farthest from the axis, least and most depth (m)
MODELS = [
    *[dipole_disc(PIXELS, DISC, rings) for rings in RINGS],
    *[table_disc_model(PIXELS, DISC, REACH, shape) for shape in SHAPES],
]


@pytest.mark.parametrize('noise', [1e-3, 9e-6, 1e-7])
def test_choose_takes_the_cheapest_model_that_holds_in_other_states_too(noise: float) -> None:
    choice, every = choose(MODELS, EXACT, STATES, noise), all_rated(MODELS, EXACT, STATES, noise)
    assert choice.rated == every.rated[: len(choice.rated)]
    assert choice.rated[-1] == choice.chosen
    assert choice.chosen.worst <= SHARE * noise
    assert all(rated.worst > SHARE * noise for rated in choice.rated[:-1])
    (model,) = [m for m in [*MODELS, EXACT] if m.name == choice.name]
    fresh = region(LOW, HIGH, 1000, seed=99)
    assert rate(model, EXACT.readings(fresh), fresh, np.array(noise)).share < 1.5 * SHARE
    figures = choice.report[f'model: {choice.name}']
    assert figures['worst_error'] == choice.chosen.worst
    assert figures['noise'] == noise


def test_tables_and_dipoles_come_nearer_as_they_grow() -> None:
    every = all_rated(MODELS, EXACT, STATES, 1e-6)
    for kind in ('cubic table', 'dipole'):
        errors = [rated.worst for rated in every.rated if kind in rated.name]
        assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize('rings', RINGS[1:])
def test_dipoles_of_a_disc_have_its_moments(rings: tuple[int, int, int]) -> None:
    places, shares = disc_dipoles(2e-3, 1e-3, rings)
    assert shares.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(shares @ places, 0, atol=1e-18)
    spread = (shares[:, None] * places**2).sum(axis=0)  # a^2 / 4, and h^2 / 12 of its height
    np.testing.assert_allclose(spread, [1e-6 / 4, 1e-6 / 4, 1e-6 / 12], rtol=1e-9)


def test_choose_takes_the_exact_model_where_no_cheaper_one_serves_all_channels() -> None:
    def line(slope: float, cost: float) -> Model:
        return Model(f'{slope} x', lambda x: slope * x, cost)

    choice = choose([line(1.01, 1), line(1.1, 0.5)], line(1.0, 9), np.ones((3, 1)), 1e-3)
    assert choice.name == '1.0 x'
    assert choice.chosen.worst == 0
    rough, states = Model('off', lambda x: x + np.array([0.0, 1.0]), 1), np.zeros((3, 2))
    for noise, name in ((np.array([0.1, 4.0]), 'off'), (np.array([4.0, 0.1]), '1.0 x')):
        assert choose([rough], line(1.0, 9), states, noise).name == name
    for wrong in (0.0, -1.0, float('nan')):
        with pytest.raises(ValueError, match='noise of a scene must be above 0'):
            choose([], line(1.0, 1), np.ones((1, 1)), wrong)


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
def test_term_gains_are_errors_of_least_squares(spread: float) -> None:
    (found,) = term_gains(SLOPES, NOISE, [Term('t', COLUMNS, spread)])
    assert found.without == pytest.approx(estimated(None, spread), rel=0.03)
    assert found.within == pytest.approx(estimated(COLUMNS, spread), rel=0.03)
    assert found.alone == pytest.approx(estimated(None, 0.0), rel=0.03)
    (fine,) = term_gains(1e3 * SLOPES, NOISE, [Term('t', 1e-5 * COLUMNS, 1e5 * spread)])
    np.testing.assert_allclose(1e3 * fine.within, found.within, rtol=1e-6)  # units do not matter
    first = term_gains(SLOPES, NOISE, [Term('t', COLUMNS, spread)], 1)[0]
    other = term_gains(SLOPES[..., ::-1], NOISE, [Term('t', COLUMNS, spread)], 2)[0]
    np.testing.assert_allclose(first.within**2 + other.within**2, found.within**2)
    figures = {'costs': found.within / found.alone, 'buys': found.without / found.within}
    assert found.report['term: t'] == pytest.approx({**figures, 'unknowns': 2.0})


def test_term_gains_of_what_is_not_seen_or_looks_like_what_is_wanted() -> None:
    unseen, twin = term_gains(
        SLOPES, NOISE, [Term('none', 0 * COLUMNS, 1.0), Term('twin', SLOPES[..., :1], 0.01)]
    )
    assert unseen.cost == pytest.approx(1.0)
    assert unseen.buys == pytest.approx(1.0)
    assert twin.within > twin.without
    assert twin.cost > 10
    blind = np.concatenate([SLOPES, np.zeros((5, 8, 1))], axis=2)
    assert np.isfinite(term_gains(blind, NOISE, [Term('t', COLUMNS, 0.5)])[0].within)
