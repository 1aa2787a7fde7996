# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Benches take as many seeds as fit, the first in any case."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest

from benchmarks.harness.rows import within


@pytest.mark.parametrize(
    ('seconds', 'taken'), [(0.0, 1), (9.9, 1), (10.1, 2), (29.9, 5), (30.1, 6), (np.inf, 8)]
)
def test_as_many_are_taken_as_end_in_time(seconds: float, taken: int) -> None:
    clock = count(0.0, 5.0)  # asked once at the start and before each but the first
    assert list(within(seconds, range(8), clock.__next__)) == list(range(taken))


def test_nothing_is_taken_of_nothing() -> None:
    assert list(within(1.0, [])) == []
