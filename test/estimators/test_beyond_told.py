"""What answers may err by that are larger than any that was told."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.estimators.covariance import BEYOND, extrapolation_error


def test_what_was_told_is_known() -> None:
    assert extrapolation_error(np.array([0.0, 1.0, BEYOND * 2.0]), 2.0) is None
    assert extrapolation_error(np.array([[0.0, 1e9]]), np.inf) is None


def test_what_lies_beyond_is_unsure_by_half_of_it() -> None:
    error = extrapolation_error(np.array([[1.0, 2.2, 3.2]]), 2.0)
    assert error is not None
    assert error == pytest.approx(np.array([[0.0, 0.0, 0.5]]))
