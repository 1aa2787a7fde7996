"""The area law of [4]: printed forms agree, and the share is 1 where a taxel is wholly pressed."""

from __future__ import annotations

import numpy as np

from tactile_ros.conditioning.viscoelastic import step_response
from tactile_ros.physics.coverage import area_current, area_share, law_of_response

LAW = law_of_response(2.0, 20e-6, 400e-6, 5e-6)


def test_equation_two_is_equation_one_with_the_area_for_the_time() -> None:
    area = np.linspace(0, 120e-6, 13)
    np.testing.assert_allclose(
        area_current(area, LAW), step_response(area, 2.0, 20e-6, 400e-6, 5e-6), rtol=1e-12
    )


def test_the_share_rises_to_one_and_never_falls_to_nothing() -> None:
    whole = np.array([110e-6])
    share = area_share(np.linspace(0, 110e-6, 20)[:, None], whole, LAW)[:, 0]
    assert (np.diff(share) > 0).all()
    assert share[-1] == 1.0
    assert area_share(np.zeros((1, 1)), whole, np.array([0.0, 1.0, 0.0, 1.0])).tolist() == [[0.05]]
