# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Laws of taxels: zero at zero, rising, chosen by held-out error; silent taxels found."""

import numpy as np
import pytest

from tactile_ros.conditioning.equilibration import LAWS, Equilibration, silent_taxels


def pressed(samples: int, seed: int, power: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Outputs and forces of four taxels whose gains differ by 55 %, rounded to 10 bits."""
    rng = np.random.default_rng(seed)
    force = rng.uniform(0, 40, (samples, 4))
    gain = 1 / np.array([1.0, 1.2, 1.4, 1.55])
    output = gain * force**power / (force**power + 20**power)
    return np.round(output * 1023) / 1023, force


def test_a_divider_is_equilibrated_to_two_percent() -> None:
    u, force = pressed(300, 1)
    fitted = Equilibration().fit(u, force, np.arange(300))
    assert fitted.name in ('power', 'pchip')
    u, force = pressed(100, 2)
    firm = force > 4
    assert np.std((fitted.forces(u) / force)[firm]) < 0.02


def test_a_power_of_the_load_is_found_and_goes_on_beyond_what_was_learned() -> None:
    u, force = pressed(300, 6, power=0.7)
    fitted = Equilibration('power').fit(u, force, np.arange(300))
    u, force = pressed(100, 7, power=0.7)
    firm = force > 4
    assert np.std((fitted.forces(u) / force)[firm]) < 0.01
    beyond = fitted.forces(np.linspace(0.9, 3.0, 50)[:, None] * fitted.top_)
    assert np.isfinite(beyond).all()
    assert (np.diff(beyond, axis=0) > 0).all()
    np.testing.assert_allclose(fitted.forces(-u), -fitted.forces(u))


def test_hard_case_9_dead_stuck_and_quadratic_at_rest() -> None:
    u, force = pressed(150, 8)
    u[:, 0], u[:, 1] = 0.0, 0.4 - 0.4  # dead; stuck, less its baseline
    for law in LAWS:
        fitted = Equilibration(law).fit(u, force, np.arange(150))
        found = fitted.forces(u)
        assert not np.nan_to_num(found[:, :2]).any()
        assert np.isfinite(found[:, 2:]).all()
        assert not fitted.forces(np.zeros((1, 4)))[0, 2:].any()


@pytest.mark.parametrize('law', LAWS)
def test_readings_far_below_rest_and_beyond_the_range_stay_finite(law: str) -> None:
    u, force = pressed(150, 9)
    u[::20], force[::20] = -1.2, 0.0
    fitted = Equilibration(law).fit(u, force, np.arange(150))
    far = fitted.forces(np.linspace(-2, 5, 300)[:, None] * np.ones(4))
    assert np.isfinite(far).all()
    beyond = np.linspace(1.0, 5.0, 100)[:, None] * fitted.top_
    assert (np.diff(fitted.forces(beyond), axis=0) >= 0).all()
    # the same to one fit after another: nothing of the last is left
    fitted.fit(u[:, ::-1], force[:, ::-1], np.arange(150))
    again = Equilibration(law).fit(u[:, ::-1], force[:, ::-1], np.arange(150))
    np.testing.assert_array_equal(fitted.forces(beyond), again.forces(beyond))


def test_equilibration_judges_laws_by_rows_where_few_groups_bear_loads() -> None:
    u = np.repeat(np.linspace(0.02, 0.9, 24)[:, None], 3, axis=1)
    force = np.full((80, 3), np.nan)
    force[:24] = np.expm1(3 * u)
    output = np.concatenate([u, np.full((56, 3), 0.4)])
    # loads grow: a group of them held out would ask for loads that no other row tells
    law = Equilibration().fit(output, force, np.arange(80) // 12)
    assert law.errors_[law.name] < 0.02


def test_untouched_taxels_are_not_called_silent() -> None:
    u, force = pressed(100, 5)
    u[:, 3], force[:, 3] = 0.0, 0.0
    assert not silent_taxels(u, force, np.full(4, 1e-3)).any()
