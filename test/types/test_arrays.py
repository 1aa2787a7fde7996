"""What is no number, or of another shape, is one sentence."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.types import as_shape


@pytest.mark.parametrize('value', ['far', [[1, 2], [3]], [object()], {'a': 1}])
def test_what_is_no_number_is_refused(value: object) -> None:
    with pytest.raises(ValueError, match=r'^positions of X must be numbers; received ') as refused:
        as_shape('positions of X', value, (-1, 3))
    assert refused.value.__cause__ is not None


def test_what_was_received_is_told_in_few_words() -> None:
    with pytest.raises(ValueError, match='must be numbers') as refused:
        as_shape('values of X', 'far' * 1000, (1,))
    assert len(str(refused.value)) < 120


def test_another_shape_is_refused_and_one_that_fits_is_float64() -> None:
    with pytest.raises(ValueError, match='must have shape'):
        as_shape('values of X', np.zeros((2, 2)), (-1, 3))
    assert as_shape('values of X', [[1, 2, 3]], (-1, 3)).dtype == np.float64
