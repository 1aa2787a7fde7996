"""Costs and gains of terms against estimates that are really made."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.fidelity import Term, worth

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
