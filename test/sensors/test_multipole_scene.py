# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The lesson of the multipole skin's twin: who presses when, where, and how."""

import numpy as np
import pytest

from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin import twin
from tactile_ros.types import Recording

SPEC = load_sensor('multipole_skin')
HEADS = len(SPEC.config().objects)  # type: ignore[attr-defined]


@pytest.fixture(scope='module')
def played() -> Recording:
    """One known head and the new one, since each costs a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(twin, 'KNOWN', 1)
        return twin.new_head(SPEC.config(), seed=3, noise=0.0)  # type: ignore[arg-type]


def of_presses(recording: Recording, name: str) -> np.ndarray:
    """Truth of each press."""
    column = recording.truth[name]
    touched = recording.truth['in_contact'] == 1
    numbers = recording.truth['repetition'][touched]
    return np.array([column[touched][numbers == i][0] for i in range(numbers.max() + 1)])


def test_known_heads_press_then_the_new_one_then_all(played: Recording) -> None:
    lesson, labels = SPEC.lesson, of_presses(played, 'label')
    assert (lesson.label, lesson.presses) == (twin.NEW.name, twin.SHOTS)
    assert twin.NEW.name not in [head.name for head in SPEC.config().objects]  # type: ignore[attr-defined]
    assert twin.SHOTS < twin.TAUGHT
    taught = slice(twin.BEFORE, twin.BEFORE + twin.TAUGHT)
    assert (labels[taught] == HEADS).all()
    assert (labels[: twin.BEFORE] < HEADS).all()
    late = labels[twin.BEFORE + twin.TAUGHT :]
    assert len(late) == twin.AFTER
    assert set(late) == {labels[0], HEADS}
    place = of_presses(played, 'position')[:, :2]
    new = labels == HEADS
    assert np.ptp(place[new], axis=0).max() < 10 * twin.RETURNS[0]
    assert np.ptp(place[~new], axis=0).min() > twin.SPAN


def test_readings_grow_with_depth_and_return_to_rest(played: Recording) -> None:
    change = np.abs(played.values - played.values[0]).max(axis=(1, 2))
    touched = played.truth['in_contact'] == 1
    assert change[~touched].max() < 0.1 * change.max()
    force = played.truth['force'][:, 2]
    assert 1 < np.nanmax(force) < 12
    one = touched & (played.truth['repetition'] == 0)
    assert np.corrcoef(change[one], force[one])[0, 1] > 0.99
