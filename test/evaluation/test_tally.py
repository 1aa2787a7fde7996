"""Statistics of parts are those of the whole, to the last bit."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.evaluation.metrics import spread
from tactile_ros.evaluation.tally import QUANTILE_ERROR, SCALE, Magnitudes, exact_sum

FLOATS = st.lists(st.floats(-1e140, 1e140), max_size=30)


@given(FLOATS)
@settings(max_examples=60)
def test_sums_are_exact(values: list[float]) -> None:
    assert Fraction(exact_sum(values), 1 << SCALE) == sum(map(Fraction, values))


@given(FLOATS, st.integers(0, 30))
@settings(max_examples=60)
def test_parts_in_any_order_are_the_whole(values: list[float], cut: int) -> None:
    whole = Magnitudes.of(values)
    for joined in (
        Magnitudes.of(values[:cut]) + Magnitudes.of(values[cut:]),
        Magnitudes.of(values[cut:]) + Magnitudes.of(values[:cut]),
    ):
        assert (joined.count, joined.total, joined.squares) == (
            whole.count, whole.total, whole.squares,
        )  # fmt: skip
        np.testing.assert_array_equal(joined.bins, whole.bins)
        assert joined.largest == whole.largest


def test_summaries_are_those_of_all_values() -> None:
    values = np.random.default_rng(1).lognormal(-7, 2, 20_000)
    values[::7] = np.nan
    found, known = Magnitudes.of(values).spread, spread(values)
    assert found.count == known.count
    assert found.mean == pytest.approx(known.mean, rel=1e-14)
    assert found.rms == pytest.approx(known.rms, rel=1e-14)
    assert found.largest == known.largest
    for name in ('p50', 'p95', 'p99'):
        assert getattr(found, name) == pytest.approx(getattr(known, name), rel=2 * QUANTILE_ERROR)


def test_of_nothing_nothing_is_known() -> None:
    assert np.isnan(Magnitudes.of([np.nan]).spread.rms)
    assert Magnitudes.of([0.0]).quantile(0.5) == 0.0
