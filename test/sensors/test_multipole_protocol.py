"""The data collection of [1] on a specimen of the package."""

from __future__ import annotations

import numpy as np

from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin import twin
from tactile_ros.sensors.multipole_skin.config import nine_heads
from tactile_ros.sensors.multipole_skin.specimen import Specimen

SPEC = load_sensor('multipole_skin')
CONFIG = SPEC.config()
SKIN = Specimen(CONFIG, seed=3)  # type: ignore[arg-type]


def test_heads_places_and_bars_are_those_of_the_paper() -> None:
    heads = nine_heads()
    assert len({head.name for head in heads}) == 9
    for head, size in zip(heads[::3], (10e-3, 15e-3, 20e-3), strict=True):
        np.testing.assert_allclose(np.ptp(head.loops[0], axis=0), size)
    triangle = heads[1].loops[0]
    np.testing.assert_allclose(np.linalg.norm(triangle[0] - triangle[1]), 10e-3)
    np.testing.assert_allclose(triangle.mean(axis=0), 0, atol=1e-12)
    assert len(np.unique(twin.stations(), axis=0)) == 25
    assert len(twin.bars()) == 3
    assert len(twin.POSTURES) == 6


def test_every_press_is_a_stream_of_a_tare_and_a_window() -> None:
    bars, places = twin.bars()[:2], twin.stations()[:2]
    turns = twin.POSTURES[:2]
    found = twin.collected(SKIN, bars, places, 1, samples=4, turns=turns)
    count, rows = 2 * 2 * 2 * 4, twin.TARE + 10
    assert len(found) == count * rows
    touched = found.truth['in_contact'] == 1
    assert found.tare is not None
    np.testing.assert_array_equal(found.tare, ~touched)
    assert (found.truth['label'][~touched] == -1).all()
    for column, several in (('label', 2), ('yaw', 2)):
        assert len(np.unique(found.truth[column][touched])) == several
    assert len(np.unique(found.truth['position'][touched], axis=0)) == 2
    windows = twin.windows_of(found, 10)
    assert windows.shape == (count, 10, 60)
    # a press grows, and force with it
    last = np.abs(windows[:, -1]).max(axis=1)
    assert (last > np.abs(windows[:, 0]).max(axis=1)).mean() > 0.95
    force = found.truth['force'][touched, 2].reshape(count, 10)
    assert (np.diff(force, axis=1) >= 0).all()
    again = twin.collected(SKIN, bars, places, 1, samples=4, turns=turns)
    np.testing.assert_array_equal(again.values, found.values)
