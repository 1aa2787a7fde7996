# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The states of every sensor's pipeline on stored recordings: what a change of form must keep."""

import numpy as np
import pytest

from reference import oracle

RELATIVE = 1e-6  # of a column's largest value: fits iterate, and processors round differently


@pytest.mark.parametrize('sensor', sorted(oracle.SCENES))
def test_pipeline_gives_the_stored_states(sensor: str, request: pytest.FixtureRequest) -> None:
    if request.config.getoption('--write-oracle'):
        oracle.write(sensor)
    with np.load(oracle.FOLDER / f'{sensor}.npz', allow_pickle=False) as file:
        arrays = dict(file)
    states = oracle.answers(sensor, oracle.SCENES[sensor]()[0], arrays)
    for name in oracle.STATES:
        if (stored := arrays.get(f'states/{name}')) is None:
            continue
        actual = getattr(states, name)
        if stored.dtype.kind == 'f':
            size = float(np.nanmax(np.abs(stored)))
            np.testing.assert_allclose(
                actual, stored, rtol=0, atol=RELATIVE * size, err_msg=f'{sensor}: {name}'
            )
        else:
            np.testing.assert_array_equal(actual, stored, err_msg=f'{sensor}: {name}')
