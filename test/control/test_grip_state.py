"""Inputs of a law from contact states."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_ros.control import GripInput
from tactile_ros.types import ContactState


def state(force: tuple[float, float, float], valid: bool = True, slip: int = 0) -> ContactState:
    known = {
        'force': np.array([force]), 'valid': np.array([valid]),
        'slip': np.array([slip], np.int8),
    }  # fmt: skip
    return ContactState.assemble(2, known)


def test_forces_come_from_states() -> None:
    given = GripInput.of(
        [state((3.0, 4.0, 2.0), slip=1), None, state((np.nan, np.nan, 1.0), valid=False)],
        [0.0, 1.0, 0.01], [0.2], 0.0,
    )  # fmt: skip
    np.testing.assert_array_equal(given.normal, [2.0, np.nan, 1.0])
    np.testing.assert_array_equal(given.tangential, [5.0, np.nan, np.nan])
    assert given.valid.tolist() == [True, False, False]
    assert given.slip.tolist() == [1, -1, 0]


def test_misfits_are_named() -> None:
    with pytest.raises(ValueError, match=r'age of GripInput must have shape \(1,\)'):
        GripInput.of([None], [0.0, 0.0], [0.2], 0.0)
    given = GripInput.of([None], [0.0], [0.2], 0.0)
    with pytest.raises(ValueError, match=r'closure of GripInput must have shape \(2,\)'):
        given.refuse_misfit(1, 2)
    with pytest.raises(ValueError, match=r'normal of GripInput must have shape \(3,\)'):
        given.refuse_misfit(3, 1)
    given.refuse_misfit(1, 1)
    crossed = dataclasses.replace(given, new=np.zeros(2, bool))
    with pytest.raises(ValueError, match=r'new of GripInput must have shape \(1,\)'):
        crossed.refuse_misfit(1, 1)
