"""Groups by which roads of the multipole skin are compared: places, and presses as a whole."""

from __future__ import annotations

import numpy as np

from tactile_ros.sensors.multipole_skin.press_fit import FOLDS, Told

PLACES = np.repeat(1e-3 * np.array([[0, 0], [5, 0], [0, 5], [5, 5], [9, 9], [-9, 9.0]]), 6, axis=0)
COUNT = len(PLACES)


def told(place: np.ndarray, number: np.ndarray, group: np.ndarray | None = None) -> Told:
    place = np.column_stack([place, np.zeros(COUNT)])
    group = np.zeros(COUNT, np.int64) if group is None else group
    return Told(np.arange(COUNT) % 3, place, np.zeros(COUNT), group, number)


def test_all_heads_of_a_place_are_held_out_together() -> None:
    # hard case 8: presses of one place in both parts are told by their place
    some = told(PLACES, np.arange(COUNT))
    at = PLACES @ [1e3, 1e6]
    for fold in range(FOLDS):
        out = some.folds == fold
        assert not set(at[out]) & set(at[~out])
        assert out.any()


def test_windows_of_one_press_stay_together_where_a_head_rolled() -> None:
    rolled = PLACES + 1e-3 * (np.arange(COUNT) % 2)[:, None]
    some = told(rolled, np.arange(COUNT) // 2)
    folds = some.folds.reshape(-1, 2)
    np.testing.assert_array_equal(folds[:, 0], folds[:, 1])


def test_without_places_groups_of_the_recording_are_held_out() -> None:
    group = np.arange(COUNT) // 4
    some = told(np.full_like(PLACES, np.nan), np.arange(COUNT), group)
    for fold in range(FOLDS):
        out = some.folds == fold
        assert not set(group[out]) & set(group[~out])
