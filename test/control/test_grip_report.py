"""What a step tells is complete, and a copy."""

from __future__ import annotations

import dataclasses

import numpy as np

from tactile_ros.control import GripConfig, GripForce, GripInput, GripStep


def given(force: float) -> GripInput:
    return GripInput(
        np.array([force, np.nan]), np.array([0.1, 0.1]), np.array([True, True]),
        np.zeros(2, np.int8), np.array([0.02, 0.01]), np.array([0.3, 0.3]), 0.0,
    )  # fmt: skip


def test_every_field_is_told_in_its_shape() -> None:
    law = GripForce(GripConfig(), (0, 1))
    law.enable()
    law.grasp(2.0)
    for _ in range(5):
        made = law.step(given(1.0), 0.01)
    assert set(vars(made)) == {field.name for field in dataclasses.fields(GripStep)}
    assert made.force[0] == 1.0
    assert np.isnan(made.force[1])
    assert made.touching.tolist() == [True, False]
    assert made.touching.dtype == made.slipping.dtype == bool
    assert made.load[0] == 0.1
    assert made.input_age == 0.02
    for name in ('closure', 'stiffness', 'stiffness_std'):
        assert getattr(made, name).shape == (2,)


def test_a_later_step_does_not_change_it() -> None:
    law = GripForce(GripConfig(), (0, 1))
    law.enable()
    law.grasp(2.0)
    first = law.step(given(0.0), 0.01)
    kept = first.closure.copy()
    law.step(given(0.0), 0.01)
    np.testing.assert_array_equal(first.closure, kept)
