# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Tables of figures: every row has a cell for every column."""

import numpy as np
import pytest

from tactile_ros.types import GripCommand, JointLimits, Table

GOOD = {'lower': [0.0, -1.0], 'upper': [1.0, 1.0], 'velocity': [2.0, 2.0], 'effort': [1.0, np.inf]}


def test_limits_are_arrays_and_an_effort_may_be_unknown() -> None:
    limits = JointLimits(**GOOD)
    assert limits.upper.dtype == np.float64
    assert np.isinf(limits.effort[1])
    command = GripCommand(7, limits.lower, np.full(2, np.nan))
    assert (command.stamp_ns, command.position.tolist()) == (7, [0.0, -1.0])


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'upper': [1.0]}, r'upper of JointLimits must have shape \(2,\)'),
        ({'lower': [0.0, np.nan]}, 'lower and upper of JointLimits must be finite'),
        ({'upper': [np.inf, 1.0]}, 'lower and upper of JointLimits must be finite'),
        ({'lower': [0.0, 1.0]}, r'must be below upper; received 1\.0 and 1\.0 for joint 1'),
        ({'velocity': [2.0, 0.0]}, 'velocity of JointLimits must be above 0'),
        ({'velocity': [2.0, np.inf]}, 'velocity of JointLimits must be above 0'),
        ({'effort': [np.nan, 1.0]}, 'effort of JointLimits must be above 0'),
    ],
)
def test_limits_that_cannot_be_are_one_sentence(
    change: dict[str, list[float]], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        JointLimits(**{**GOOD, **change})


def test_rows_have_a_cell_for_each_column() -> None:
    Table('t', ('a', 'b'), ((1.0, None), ('x', 2)))
    with pytest.raises(ValueError, match="rows of 't' must have 2 cells"):
        Table('t', ('a', 'b'), ((1.0,),))
