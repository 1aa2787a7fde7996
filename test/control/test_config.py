# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Gains and limits of a grip."""

import dataclasses

import pytest

from tactile_ros.control import GripConfig, qb_softhand


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'dead_time': -1.0}, 'dead_time of GripConfig must be a number from 0 to 1; received -1'),
        ({'safe_action': 'close'}, "must be one of hold, open; received 'close'"),
        ({'force_noise': float('nan')}, 'force_noise of GripConfig must be a number'),
        ({'stiffness_low': 400.0}, 'stiffness_low of GripConfig must be below stiffness_high'),
    ],
)  # fmt: skip
def test_grip_config_refuses_in_one_sentence(change: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence.replace('.', r'\.')):
        dataclasses.replace(GripConfig(), **change)


def test_grip_config_stale_age_is_at_least_three_periods() -> None:
    assert GripConfig().stale_age == 0.1
    assert GripConfig(input_rate_hz=10.0).stale_age == pytest.approx(0.3)
    assert qb_softhand().stale_age == pytest.approx(3 / 25)
