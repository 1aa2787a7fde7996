"""Gains and limits: one sentence for what cannot be."""

from __future__ import annotations

import dataclasses

import pytest

from tactile_ros.control import GripConfig, qb_softhand


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'dead_time': -1.0}, 'dead_time of GripConfig must be a number from 0 to 1; received -1'),
        ({'safe_action': 'close'}, "must be one of hold, open; received 'close'"),
        ({'force_noise': float('nan')}, 'force_noise of GripConfig must be a number'),
        ({'closure_high': 0.0}, 'closure_low of GripConfig must be below closure_high'),
        ({'touch_force': 20.0}, 'touch_force of GripConfig must be below force_high'),
        ({'contact_off': 0.2}, 'contact_off of GripConfig must be below contact_on'),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(change: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence.replace('.', r'\.')):
        dataclasses.replace(GripConfig(), **change)


def test_every_field_says_what_it_is() -> None:
    for field in dataclasses.fields(GripConfig):
        assert field.metadata['help']


def test_stale_is_never_fewer_than_three_periods() -> None:
    assert GripConfig().stale_age == 0.1
    assert GripConfig(input_rate_hz=10.0).stale_age == pytest.approx(0.3)
    assert qb_softhand().stale_age == pytest.approx(3 / 25)
