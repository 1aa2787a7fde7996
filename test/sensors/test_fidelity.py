# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Models that sensors choose by their config and noise, and what a wrong one would do."""

from dataclasses import replace
from importlib import import_module

import magpylib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_ros.enrolment import Touches
from tactile_ros.physics.fidelity import SHARE, rate
from tactile_ros.physics.field_table import reach_under, table_disc_model
from tactile_ros.physics.magnetics import EXACT, exact_disc
from tactile_ros.sensors.gradiometer import twin as gradiometer
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.magnet_pad import body_model
from tactile_ros.sensors.magnet_pad import body_model as pad
from tactile_ros.sensors.magnet_pad.body_model import NOISE, movement
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig

DISC, PAD, SKIN = GradiometerConfig(), MagnetPadConfig(), MultipoleSkinConfig()
OTHER = replace(DISC, gap=4e-3, disc_diameter=3e-3, disc_height=2e-3, remanence=1.1)


@pytest.mark.parametrize('config', [DISC, OTHER], ids=['paper', 'other'])
@pytest.mark.parametrize('noise', [1e-6, 9e-6, 1e-4])
def test_the_table_of_an_inversion_holds_in_states_that_were_not_tried(
    config: GradiometerConfig, noise: float
) -> None:
    choice = gradiometer.field_model(config, noise)
    assert choice.chosen.share <= SHARE
    disc = gradiometer.disc_of(config)
    reach = reach_under(config.positions, config.gap, config.disc_height)
    model = table_disc_model(config.positions, disc, reach, (choice.size[0], choice.size[1]))
    assert model.name == choice.name
    states = gradiometer.states_of(config, 1000, seed=7)
    truth = exact_disc(config.positions, disc).readings(states)
    assert rate(model, truth, states, np.array(noise)).share < 1.5 * SHARE


def test_terms_of_the_gradiometer_pay_and_cost() -> None:
    stray, warm, tilt = gradiometer.terms(DISC, 3e-6, 20)
    assert stray.unknowns == 2
    assert 1.0 < stray.cost < 2.0
    assert all(term.within < term.without for term in (stray, warm, tilt))
    calm = gradiometer.terms(DISC, 1e-2, 20)[0]
    assert calm.within > calm.without  # at 10 mT of noise 1 mT is no matter


def test_a_pad_takes_more_dipoles_when_it_hears_more() -> None:
    touches, fresh = pad.scene_touches(PAD, 60), pad.scene_touches(PAD, 200)[68:]
    found = [pad.field_choice(PAD, touches, n).chosen for n in (1e-3, 3e-5, 1e-7)]
    assert [rated.size for rated in found] == [(1,), (2,), (EXACT,)]
    assert [rated.operations for rated in found] == sorted(rated.operations for rated in found)
    states = np.stack(movement(PAD, fresh), axis=1).reshape(len(fresh), -1)
    truth, model = (pad.block_field(PAD, n) for n in (EXACT, found[1].size[0]))
    assert rate(model, truth.readings(states), states, np.array(3e-5)).share < 1.5 * SHARE


def test_the_twin_of_the_pad_reads_as_its_blocks_do() -> None:
    module = import_module('tactile_ros.sensors.magnet_pad.twin')
    recording = module.presses(PAD, 3, 15, noise=0.0)
    row = int(np.linalg.norm(recording.truth['force'], axis=1).argmax())
    touch = body_model.touches_at(*(recording.truth[k][[row]] for k in ('position', 'force')))
    moved, turned = (one[0] for one in movement(PAD, touch))
    exact = [
        sum(
            magpylib.magnet.Cuboid(
                dimension=PAD.magnet_size,
                polarization=(0, 0, PAD.remanence),
                position=place,
                orientation=Rotation.from_rotvec(turn),
            ).getB(PAD.positions)
            for place, turn in zip(PAD.magnet_positions + shift, turns, strict=True)
        )
        for shift, turns in ((moved, turned), (0 * moved, 0 * turned))
    ]
    assert np.abs(moved).max() > 2e-4
    assert np.abs(turned).max() > 0.02
    # a model of blocks is chosen for changes since rest
    change = recording.values[row] - recording.values[0]
    assert np.abs(change - (exact[0] - exact[1])).max() < NOISE / 3


def test_the_body_of_the_pads_twin_is_linear_in_the_load() -> None:
    module = import_module('tactile_ros.sensors.magnet_pad.twin')
    place, force = np.array([[7e-3, 0.0, 10e-3]]), np.array([[0.0, 0.0, 8.0]])
    press = np.array([0])
    half = Touches(press, place, 0.5 * force, np.array([0.5]))
    moved, turned = module.carried(PAD, half)
    whole = movement(PAD, body_model.touches_at(place, force))
    np.testing.assert_allclose(2 * moved, whole[0], rtol=1e-12)
    np.testing.assert_allclose(2 * turned, whole[1], rtol=1e-12)
    places, share = np.vstack([place, place, place * np.nan]), np.array([1.0, 0.1, 0.0])
    three = Touches(np.array([0, 0, -1]), places, share[:, None] * force, share)
    moved, _ = module.carried(PAD, three)
    np.testing.assert_allclose(moved[1], 0.1 * moved[0], rtol=1e-12)
    assert not moved[2].any()


def test_terms_of_the_pad_pay() -> None:
    stray, warm = body_model.terms(PAD, 4e-6, 30)
    assert stray.unknowns == 3
    assert stray.buys > 10
    assert 1.0 < warm.cost < 1.5
    calm = body_model.terms(PAD, 4e-3, 30)[1]
    assert calm.within > calm.without
