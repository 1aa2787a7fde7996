# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Faults: what readings and status bits say about taxels and about frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tactile_ros.conditioning.faults import frame_status, taxel_faults, usable_rows, without_faults
from tactile_ros.types import FrameStatus, Layout, TaxelStatus

LIMIT = np.array([1.0, np.inf])


def layout(limit: object = LIMIT, unit: str = '1', channels: int = 2) -> Layout:
    """Three taxels."""
    names = tuple(f'c{i}' for i in range(channels))
    return Layout(np.zeros((3, 3)), names, unit, saturation=limit)  # type: ignore[arg-type]


READINGS = arrays.arrays(
    np.float64,
    st.tuples(st.integers(0, 4), st.just(3), st.just(2)),
    elements=st.one_of(st.floats(-2, 2), st.sampled_from([np.nan, np.inf, -np.inf, 1.0, -1.0])),
)


def plain_bits(values: np.ndarray, status: np.ndarray | None) -> np.ndarray:
    """The definition, one taxel at a time."""
    bits = np.zeros(values.shape[:2], np.uint8) if status is None else status.copy()
    for s, t in np.ndindex(*values.shape[:2]):
        for reading, limit in zip(values[s, t], LIMIT, strict=True):
            if not np.isfinite(reading):
                bits[s, t] |= TaxelStatus.ERROR
            if abs(reading) >= limit:
                bits[s, t] |= TaxelStatus.SATURATED
    return bits


@given(READINGS, st.booleans(), st.integers(0, 2**32 - 1))
def test_bits_are_those_of_the_definition(values: np.ndarray, told: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    status = rng.choice([0, 0, 1, 2, 16], values.shape[:2]).astype(np.uint8) if told else None
    bits = taxel_faults(values, status, layout())
    np.testing.assert_array_equal(bits, plain_bits(values, status))
    assert bits.dtype == np.uint8
    usable = without_faults(values, bits)
    bad = (bits & ~np.uint8(TaxelStatus.STALE)) > 0
    assert np.isnan(usable[bad]).all()
    np.testing.assert_array_equal(usable[~bad], values[~bad])
    np.testing.assert_array_equal(usable_rows(bits), ~bad.any(axis=1))


def test_a_chip_whose_field_is_exactly_0_on_all_axes_is_dead() -> None:
    values = np.full((4, 3, 2), 1e-6)
    values[1, 2] = values[2, :2] = 0.0
    values[3] = 0.0  # a skin without power
    values[0, 0, 0] = 0.0  # one axis may be there by chance
    bits = taxel_faults(values, None, layout(unit='T'))
    dead = int(TaxelStatus.DEAD)
    assert bits.tolist() == [[0, 0, 0], [0, 0, dead], [dead, dead, 0], [dead, dead, dead]]
    stale = np.ones(bits.shape, np.uint8)
    told = taxel_faults(values, stale, layout(unit='T'))
    np.testing.assert_array_equal(told, bits | stale)
    # a fraction of an ADC's range, or a chip of one axis, may well be 0
    assert not taxel_faults(values, None, layout()).any()
    single = taxel_faults(values[..., :1], None, layout(np.inf, 'T', 1))
    assert not single.any()


@pytest.mark.parametrize(
    ('bits', 'flags'),
    [
        ([0, 0, 0], 0), ([1, 0, 0], FrameStatus.STALE), ([1, 1, 1], FrameStatus.STALE),
        ([2, 0, 0], FrameStatus.SATURATED | FrameStatus.BAD_TAXELS),
        ([0, 4, 0], FrameStatus.BAD_TAXELS), ([0, 0, 8], FrameStatus.BAD_TAXELS),
        ([16, 0, 0], FrameStatus.BAD_TAXELS), ([32, 0, 0], FrameStatus.BAD_TAXELS),
        ([1, 3, 1], FrameStatus.STALE | FrameStatus.SATURATED | FrameStatus.BAD_TAXELS),
    ],
)  # fmt: skip
def test_bits_of_taxels_become_bits_of_the_frame(bits: list[int], flags: int) -> None:
    found, valid, still = np.zeros(1, np.int64), np.ones(1, bool), np.zeros((1, 3, 1))
    frame_status(np.array([bits], np.uint8), still, still, found, valid)
    assert found.tolist() == [flags]
