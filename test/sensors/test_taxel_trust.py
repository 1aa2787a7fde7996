# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Sigmas of places, turns and forces on layouts, skins and parts that chose no constant."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from benchmarks.worlds import taxel_trust

COMPONENTS = ('x', 'y', 'turn', 'total force')
DEVIATIONS = 2.95  # 95 % for all 32 shares together (Bonferroni)


@lru_cache
def gathered() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    found: dict[str, tuple[np.ndarray, np.ndarray]] = taxel_trust.gathered(30)
    return found


@pytest.mark.parametrize('name', COMPONENTS)
def test_no_component_is_surer_of_itself_than_it_may_be(name: str) -> None:
    error, sigma = gathered()[name]
    assert len(error) > 60
    assert (sigma > 0).all()
    thirds = np.array_split(np.argsort(sigma, kind='stable'), 3)
    for sigmas, right in ((1, 0.6827), (2, 0.9545)):
        inside = np.abs(error) <= sigmas * sigma
        for part in (np.arange(len(error)), *thirds):
            allowed = max(0.05, DEVIATIONS * np.sqrt(right * (1 - right) / len(part)))
            assert inside[part].mean() >= right - allowed, (sigmas, len(part))


@pytest.mark.parametrize('name', COMPONENTS)
def test_sigmas_are_no_excuse(name: str) -> None:
    error, sigma = gathered()[name]
    usual = np.abs(error) <= 2 * sigma
    assert np.sqrt(np.mean(np.square(error / sigma)[usual])) > 0.5
