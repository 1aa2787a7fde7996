"""From estimates to states: what the untouched and the unusable say, flags, and patches."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.regression import Regression
from tactile_ros.sensors import load_sensor
from tactile_ros.signals import Signals
from tactile_ros.states import add_flags, add_patches, apply_contact, lacking, told
from tactile_ros.types import STATE_FIELDS, FrameStatus, TaxelStatus, field_shape

CONTACT = np.array([1, 0, -1, -1, 0], np.int8)
CONFIG = load_sensor('reskin_board').config()
GOOD = np.array([True, True, True, False, False])
FIELDS = [
    name
    for name in STATE_FIELDS
    if name not in ('valid', 'status', 'taxel_status', 'in_contact')
    and not name.startswith('contacts_')
]


def estimate(name: str) -> np.ndarray:
    shape = (len(CONTACT), *field_shape(name, 2))
    return np.full(shape, 3, STATE_FIELDS[name][1])


@pytest.mark.parametrize('name', FIELDS)
def test_the_untouched_and_the_unusable(name: str) -> None:
    known = {name: estimate(name)}
    apply_contact(known, CONTACT, GOOD)
    blank = STATE_FIELDS[name][2]
    free: float = blank
    if name in ('force', 'torque', 'taxel_force', 'deformation'):
        free = 0.0
    elif name in ('force_cov', 'torque_cov', 'stray_field', 'slip', 'slip_probability'):
        free = 3.0
    for row, wanted in enumerate([3.0, free, 3.0, blank, blank]):
        np.testing.assert_array_equal(known[name][row], np.full_like(known[name][row], wanted))


def test_components_that_a_sensor_cannot_see_stay_unknown_when_untouched() -> None:
    known = {'force': np.array([[np.nan, np.nan, 2.0]] * 2)}
    apply_contact(known, np.array([0, 1], np.int8), np.ones(2, bool))
    np.testing.assert_array_equal(known['force'], [[np.nan, np.nan, 0], [np.nan, np.nan, 2]])


def signals_of(delta: np.ndarray, good: np.ndarray) -> Signals:
    rows = len(delta)
    contact = np.zeros(rows, np.int8)
    rest = np.zeros_like(delta)
    return Signals(delta, delta, rest, None, None, np.ones(rows, bool), contact, good)


def test_what_forbids_use() -> None:
    delta = np.zeros((5, 2, 3))
    delta[1, 0, 0] = np.nan
    bits = np.zeros((5, 2), np.uint8)
    bits[2] = TaxelStatus.STALE
    bits[3, 0] = TaxelStatus.SATURATED
    own = np.array([0, 0, 0, 0, FrameStatus.ABSTAINED])
    known = {'status': own}
    signals = signals_of(delta, np.array([1, 1, 1, 0, 1], bool))
    signals.baseline[1, 0] = np.nan
    add_flags(known, signals, bits, 0)
    assert known['valid'].tolist() == [True, False, False, False, True]
    assert known['status'].tolist() == [
        0,
        FrameStatus.NO_BASELINE,
        FrameStatus.STALE,
        FrameStatus.SATURATED | FrameStatus.BAD_TAXELS,
        FrameStatus.ABSTAINED,
    ]
    np.testing.assert_array_equal(known['taxel_status'], bits)
    assert own.tolist() == [0, 0, 0, 0, FrameStatus.ABSTAINED]


def test_an_estimation_may_say_itself_that_a_frame_is_not_to_be_used() -> None:
    delta = np.zeros((3, 2, 3))
    signals = signals_of(delta, np.ones(3, bool))
    known = {'valid': np.array([True, False, True])}
    bits = np.zeros((3, 2), np.uint8)
    bits[2] = TaxelStatus.STALE
    apply_contact(known, signals.in_contact, signals.good)
    add_flags(known, signals, bits, 0)
    assert known['valid'].tolist() == [True, False, False]


@pytest.mark.parametrize('flag', list(FrameStatus))
def test_each_flag(flag: FrameStatus) -> None:
    known: dict[str, np.ndarray] = {}
    bits = np.zeros((1, 2), np.uint8)
    add_flags(known, signals_of(np.zeros((1, 2, 3)), np.ones(1, bool)), bits, int(flag))
    forbidding = {
        FrameStatus.NOT_CALIBRATED, FrameStatus.BAD_TAXELS, FrameStatus.SATURATED,
        FrameStatus.STALE,
    }  # fmt: skip
    assert bool(known['valid'][0]) == (flag not in forbidding)


def test_the_one_patch_is_where_the_contact_is() -> None:
    force, cov = np.arange(9.0).reshape(3, 3), np.arange(27.0).reshape(3, 3, 3)
    known = {'force': force, 'force_cov': cov}
    add_patches(known, np.array([0, -1, 1]))
    assert known['contacts_id'].tolist() == [[0], [-1], [1]]
    np.testing.assert_array_equal(known['contacts_force'][:, 0][[0, 2]], force[[0, 2]])
    np.testing.assert_array_equal(known['contacts_force_cov'][:, 0][[0, 2]], cov[[0, 2]])
    np.testing.assert_array_equal(known['contacts_normal'][2, 0], [0, 0, 1])
    for name in ('contacts_force', 'contacts_force_cov', 'contacts_normal'):
        assert np.isnan(known[name][1]).all()
    assert 'contacts_position' not in known


def test_a_sensor_may_bring_its_own_patches_or_know_of_none() -> None:
    own = {'contacts_id': np.array([[4, 5]]), 'force': np.zeros((1, 3))}
    add_patches(own, np.array([0]))
    assert own['contacts_id'].tolist() == [[4, 5]]
    assert 'contacts_force' not in own
    label = {'label': np.array([1])}
    add_patches(label, np.array([0]))
    assert list(label) == ['label']


def test_what_a_pipeline_lacks() -> None:
    assert lacking(True, True) == 0
    assert lacking(False, True) == FrameStatus.NOT_CALIBRATED
    assert lacking(True, False) == FrameStatus.NO_BASELINE


def test_a_sensor_may_say_itself_what_touches() -> None:
    class Divider(Regression):
        def contact(self, signals: Signals) -> np.ndarray:
            return (signals.delta[:, 0, 0] > 0).astype(np.int8)

    delta = np.array([[[1.0, 0, 0]], [[0.0, 9, 9]]])
    signals = signals_of(delta, np.ones(2, bool))
    assert told(Divider(CONFIG), signals).in_contact.tolist() == [1, 0]
    assert signals.in_contact.tolist() == [0, 0]
    assert told(Regression(CONFIG), signals) is signals
