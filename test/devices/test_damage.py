"""The share of damage that the format cannot show."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.devices.simulated_serial import DAMAGES, Damage, damage, unseen

QUANTUM = np.array([2.4e-6, 2.4e-6, 3.872e-6])


def recording() -> np.ndarray:
    return np.random.default_rng(0).integers(-4000, 4000, (200, 5, 3)) * QUANTUM


@pytest.mark.parametrize('kind', DAMAGES)
def test_damage_is_seeded_and_does_what_it_says(kind: Damage) -> None:
    frame = np.random.default_rng(1).bytes(82)
    grows = {'dropped': -1, 'truncated': -1, 'doubled': 1, 'inserted': 1}.get(kind, 0)
    changed = 0
    for seed in range(50):
        hurt = damage(frame, kind, np.random.default_rng(seed))
        assert hurt == damage(frame, kind, np.random.default_rng(seed))
        assert np.sign(len(hurt) - len(frame)) == grows
        changed += hurt != frame
    assert changed > 40


@pytest.mark.parametrize('kind', ['dropped', 'doubled', 'inserted', 'truncated'])
def test_damage_of_the_length_never_passes(kind: Damage) -> None:
    share = unseen(recording(), 25.0, kind, seed=2, trials=150)
    assert share.passed == 0
    assert share.good_lost <= 1


def test_most_flipped_bits_pass_and_the_grid_shows_half_of_them() -> None:
    plain = unseen(recording(), 25.0, 'flipped', seed=3, trials=300)
    gridded = unseen(recording(), 25.0, 'flipped', seed=3, trials=300, quantum=QUANTUM)
    assert 0.8 < plain.passed < 0.95
    assert plain.good_lost == gridded.good_lost == 0
    assert gridded.misled < 0.6 * plain.misled
