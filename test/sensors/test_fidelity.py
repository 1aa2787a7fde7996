# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Models that sensors choose by their config and noise, and what a wrong one would do."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import magpylib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.worlds import multipole_fidelity as skin
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
from tactile_ros.sensors.magnet_pad.inversion import PadInversion
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


def test_more_noise_needs_a_smaller_table() -> None:
    sizes = [gradiometer.field_model(DISC, noise).chosen.numbers for noise in (1e-4, 1e-5, 1e-6)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[2]


def test_all_models_are_measured_where_that_is_asked_for() -> None:
    choice, models = gradiometer.every_model(DISC, 3e-6)
    assert len(choice.rated) == len(models)
    assert {rated.name for rated in choice.rated} == {model.name for model in models}
    assert 'cubic' in choice.name


def test_terms_of_the_gradiometer_pay_and_cost() -> None:
    stray, warm, tilt = gradiometer.terms(DISC, 3e-6, 20)
    assert stray.unknowns == 2
    assert stray.pays
    assert 1.0 < stray.cost < 2.0
    assert warm.pays
    assert tilt.pays
    calm = gradiometer.terms(DISC, 1e-2, 20)[0]
    assert not calm.pays  # at 10 mT of noise 1 mT is no matter


def carried(spread: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return spread * rng.normal(size=(100, 3, 3)), 0.1 * rng.normal(size=(100, 3, 3))


def test_a_pad_takes_more_dipoles_when_it_hears_more() -> None:
    moved, turned = carried(3e-4)
    found = [pad.block_model(PAD, n, moved, turned).chosen for n in (1e-3, 3e-5, 1e-7)]
    assert [rated.size for rated in found] == [(1,), (2,), (EXACT,)]
    assert [rated.operations for rated in found] == sorted(rated.operations for rated in found)
    choice = pad.block_model(PAD, 4e-6, moved, turned)
    fresh = np.stack(carried(3e-4, 1), axis=1).reshape(100, -1)
    truth = pad.block_field(PAD, 0).readings(fresh)
    model = pad.block_field(PAD, choice.size[0])
    assert rate(model, truth, fresh, np.array(4e-6)).share < 1.5 * SHARE


def test_the_sheet_at_rest_may_need_its_closed_form() -> None:
    choice, models = skin.rest_model(SKIN, 4e-6)
    assert choice.name == 'exact bands'
    rough, _ = skin.rest_model(SKIN, 1e-2)
    assert rough.name == '1 harmonics'
    plain, _ = skin.rest_model(replace(SKIN, magnetisation='M1'), 4e-6)
    assert not any('harmonics' in rated.name for rated in plain.rated)
    assert len(models) == len(choice.rated)


def test_a_half_space_and_springs_have_the_wrong_sign() -> None:
    states = skin.pressed_states(3)
    pictures = {
        law: skin.pressed_model(SKIN, 2.5e-3, law).readings(states).reshape(-1)
        for law in ('bonded', 'even', 'half-space', 'springs')
    }
    sizes = {law: np.linalg.norm(p) for law, p in pictures.items()}
    like = {
        law: p @ pictures['bonded'] / (sizes[law] * sizes['bonded']) for law, p in pictures.items()
    }
    assert like['even'] > 0.95
    assert like['half-space'] < 0.1
    assert like['springs'] < -0.2


def test_in_a_bonded_layer_magnets_move_more_sideways_than_down() -> None:
    pressed = skin.PressedSheet(SKIN, 1.25e-3)
    moved = pressed.movement(0.0, 0.0, skin.DEEPEST)
    at = np.hypot(*pressed.places[:, :2].T)
    outward = (moved[:, :2] * pressed.places[:, :2]).sum(axis=1) / np.maximum(at, 1e-9)
    edge = np.abs(at - skin.RADIUS) < 1.5e-3
    assert outward[edge].mean() > 0.2 * skin.DEEPEST
    assert (outward[edge] > 0).all()


def test_some_carpet_under_exact_mechanics_is_below_a_third_of_the_noise() -> None:
    states = skin.pressed_states(1, corners=1)
    assert states[0, 2] == skin.DEEPEST
    choice, _, finest = skin.pressed_choice(SKIN, 4e-6, states)
    assert choice.chosen.name != finest.name
    error = {rated.name: rated.worst for rated in choice.rated}
    coarse = [error[f'{pitch:g} mm, bonded layer'] for pitch in (5.0, 2.5, 1.25)]
    assert coarse == sorted(coarse, reverse=True)
    assert error['2.5 mm with 2 x 2 points, bonded layer'] < 0.5 * error['2.5 mm, bonded layer']


def test_the_twin_of_the_gradiometer_reads_as_its_disc_does() -> None:
    module = import_module('tactile_ros.sensors.gradiometer.twin')
    recording = module.presses(DISC, 3, 8, noise=0.0)
    rows = [0, int(recording.truth['force'][:, 2].argmax())]
    stiffness = np.array([0.2 * 3.5 / 1.1e-3, 0.2 * 3.5 / 1.1e-3, 3.5 / 1.5e-3])
    for row in rows:
        place = np.array([0, 0, 3e-3]) - recording.truth['force'][row] / stiffness
        magnet = magpylib.magnet.Cylinder(
            dimension=(2e-3, 1e-3), polarization=(0, 0, 1.4), position=place
        )
        error = recording.values[row] - magnet.getB(DISC.positions)[:, [0, 2]]
        assert np.abs(error).max() < module.NOISE / 3


@pytest.mark.parametrize(
    ('gap', 'name'), [(20e-3, 'dipole'), (2.5e-3, 'cubic'), (0.8e-3, 'exact')]
)
def test_a_twin_takes_what_its_gap_needs(gap: float, name: str) -> None:
    module = import_module('tactile_ros.sensors.gradiometer.twin')
    assert name in module.disc_model(replace(DISC, gap=gap)).name


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
    assert stray.pays
    assert stray.buys > 10
    assert 1.0 < warm.cost < 1.5
    assert not body_model.terms(PAD, 4e-3, 30)[1].pays


@pytest.mark.parametrize('asked', [True, False])
def test_a_pad_may_do_without_the_stray_term(asked: bool) -> None:
    config = replace(PAD, stray_term=asked)
    inversion = PadInversion(config, np.ones(6, bool), 4e-6)
    assert (inversion.common is not None) == asked
