"""Figures of cells on a hand-made example."""

from __future__ import annotations

import numpy as np

from tactile_ros.evaluation.metrics import accuracy, average_euclidean_error, confusion

CENTRES = 1e-3 * np.array([[0.0, 0, 5], [8.0, 0, 5], [8.0, 6, 1]])
TRUE = np.array([0, 0, 0, 1, 1, 2])
SAID = np.array([0, 0, 2, 1, -1, 2])


def test_rows_of_a_confusion_are_true_cells() -> None:
    table = confusion(SAID, TRUE, 3)
    np.testing.assert_allclose(table[0], [200 / 3, 0, 100 / 3])
    np.testing.assert_allclose(table[1], [0, 50, 0])
    assert np.isnan(confusion(SAID[:3], TRUE[:3], 3)[1]).all()


def test_errors_are_means_over_touches_seen_from_above() -> None:
    known = SAID >= 0
    error = average_euclidean_error(SAID[known], TRUE[known], CENTRES)
    assert np.isclose(error, 10.0 / 5)
    assert np.isclose(accuracy(SAID, TRUE), 400 / 6)
