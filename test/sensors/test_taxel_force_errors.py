"""Errors of forces and of their sum, measured where they were put in."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.conditioning.equilibration import Equilibration
from tactile_ros.conditioning.loading_direction import loading_signs
from tactile_ros.sensors.taxel_array.force_errors import (
    LEVELS,
    ForceErrors,
    force_errors,
    largest_forces,
    shared_part,
)

ROWS, TAXELS, LOUD = 4000, 40, 0.6


def test_what_taxels_share_is_found_at_the_loads_where_they_do() -> None:
    rng = np.random.default_rng(5)
    force = np.repeat(rng.uniform(0.02, 3.0, (ROWS, 1)), TAXELS, axis=1)
    law = Equilibration('polynomial').fit(force / 4, force, np.arange(ROWS))
    most = largest_forces(law)
    assert most == pytest.approx(3.0, rel=1e-2)
    own = 3e-3 * force * rng.normal(size=force.shape)
    alike = np.where(force > LOUD * 3.0, 2e-3, 0.0) * force * rng.normal(size=(ROWS, 1))
    found = force_errors(own + alike, force, law, 0.25)
    loud = LEVELS >= LOUD
    assert found.own[:-1][~loud] == pytest.approx(3e-3, rel=0.03)
    assert found.alike[0, 1:][loud] == pytest.approx(2e-3, rel=0.15)
    assert (found.alike[0, :-1][~loud] < 3e-4).all()
    level = np.searchsorted(LEVELS, force / most)
    variance = np.square(found.own[level] * force).sum(axis=1)
    variance += np.square(shared_part(force, level, found.alike) * force.sum(axis=1))
    inside = np.square((own + alike).sum(axis=1)) < variance
    for part in (force[:, 0] < LOUD * 3.0, force[:, 0] > LOUD * 3.0):
        assert inside[part].mean() == pytest.approx(0.683, abs=0.04)


def test_rows_of_one_taxel_tell_nothing_that_taxels_share() -> None:
    force = np.where(np.eye(6, dtype=bool)[np.arange(60) % 6], 1.0, 0.0)
    law = Equilibration('polynomial').fit(force / 4, force, np.arange(60))
    found = force_errors(0.01 * force, force, law, 0.25)
    assert (found.alike == 0).all()
    assert found.own == pytest.approx(0.01 * np.sqrt((1 + 0.2) / (1 - 0.2)))


@pytest.mark.parametrize('play', [0.0, 0.02])
def test_hysteresis_is_found_and_makes_sums_err_to_one_side(play: float) -> None:
    rng = np.random.default_rng(8)
    top = rng.uniform(0.2, 3.0, 300)
    ramp = np.concatenate([np.linspace(0, 1, 9), [1.0], np.linspace(1, 0, 9)[1:]])
    pressed = np.arange(300)[:, None] % TAXELS == np.arange(TAXELS)  # one by one
    force = (top[:, None] * ramp).ravel()[:, None] * np.repeat(pressed, len(ramp), axis=0)
    law = Equilibration('polynomial').fit(force / 4, force, np.arange(len(force)))
    restart = np.arange(len(force)) == 0
    miss = -play * loading_signs(force, restart) * force + 3e-3 * force * rng.normal(
        size=force.shape
    )
    found = force_errors(miss, force, law, 0.25, restart)
    assert found.alike[1] == pytest.approx(play, abs=1e-3)
    assert (force_errors(miss, force, law, 0.25).alike[1] == 0).all()
    load = rng.uniform(0.3, 2.5, (200, TAXELS))
    level = np.searchsorted(LEVELS, load / largest_forces(law))
    total = np.sqrt(np.square(found.own[level] * load).sum(axis=1))
    whole = np.hypot(total, shared_part(load, level, found.alike) * load.sum(axis=1))
    assert (play * load.sum(axis=1) < 1.1 * whole).all()
    assert play == 0 or (whole > 3 * total).all()


def presses_at(rate: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (s,) and one load (s,) of 16 presses of some slow and some quick ramps (N)."""
    rng, corners, loads = np.random.default_rng(seed), [0.0, 0.3], [0.0, 0.0]
    for _ in range(16):
        rise, hold, fall = rng.uniform(0.3, 1.2), 0.2, rng.uniform(0.3, 1.2)
        corners += (corners[-1] + np.cumsum([rise, hold, fall, 0.3])).tolist()
        loads += [one := rng.uniform(1.5, 3.0), one, 0.0, 0.0]
    time = np.arange(round(corners[-1] * rate)) / rate
    return time, np.interp(time, corners, loads)


def errors_at(rate: float, play: float, of_press: float = 0.0, lost: float = 0.0) -> ForceErrors:
    """Errors of eight taxels whose presses err as a whole besides, in each half on its own."""
    rng, (_, load) = np.random.default_rng(12), presses_at(rate, 11)
    rises = np.diff(load, prepend=0.0) > 1e-9
    falls = np.diff(load, prepend=0.0) < -1e-9
    half = np.cumsum((rises & ~np.roll(rises, 1)) | (falls & ~np.roll(falls, 1)))
    way = np.where(half % 2 == 1, 1.0, -1.0)
    force = np.repeat(load[:, None], 8, axis=1)
    wrong = of_press * rng.normal(size=half.max() + 1)[half] - play * way
    miss = force * (wrong[:, None] + 2e-3 * rng.normal(size=force.shape))
    law = Equilibration('polynomial').fit(force / 4, force, half)
    told = force + 1e-3 * rng.normal(size=(len(load), 1)) * (load > 0)[:, None]
    told[rng.uniform(size=len(load)) < lost] = np.nan
    miss[np.isnan(told)] = np.nan
    return force_errors(miss, told, law, 0.25, np.arange(len(load)) == 0)


@pytest.mark.parametrize('lost', [0.0, 0.2])
@pytest.mark.parametrize('rate', [20.0, 100.0, 2000.0])
def test_hysteresis_does_not_depend_on_the_rate_or_on_lost_rows(rate: float, lost: float) -> None:
    found = errors_at(rate, 0.02, lost=lost)
    assert found.alike[1] == pytest.approx(0.02, abs=2e-3)


@pytest.mark.parametrize('rate', [20.0, 100.0, 2000.0])
def test_presses_that_err_as_a_whole_are_no_hysteresis_however_many_rows(rate: float) -> None:
    found = errors_at(rate, 0.0, of_press=0.02)
    assert (found.alike[1] < 2e-3).all()
    assert found.alike[0, 3:] == pytest.approx(0.02, rel=0.3)
