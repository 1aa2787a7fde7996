# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hands in MuJoCo with their pads' bytes and their drivers' messages in the loop; no screen."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from reference import hand_scenes as scenes
from reference.grasp_film import Film
from reference.grasp_trials import Trials, fingertips, fitted, grips, mistaken, named, rig_of
from reference.hand_scenes import Handling, Touched, solid
from reference.hand_world import HandWorld, message, scene_text
from tactile_ros.control import GripConfig, GripPhase
from tactile_ros.errors import MissingPackageError
from tactile_ros.hands.drivers import TRAJECTORY
from tactile_ros.nodes.grip_loop import Decision
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.simulation import skins
from tactile_ros.simulation.hands import (
    LAG,
    HandModel,
    allegro_hand,
    on_half_cylinder,
    parallel_hand,
    soft_hand,
)
from tactile_ros.simulation.skins import AVERAGED, Fingertip, magnet_pad_skin
from tactile_ros.types import GripCommand

mujoco = pytest.importorskip('mujoco', reason='simulated hands need MuJoCo')

GRAVITY, MASS = 9.81, 0.1


@pytest.fixture(scope='module')
def trials() -> Iterator[Trials]:
    """Gradiometers that are calibrated on few presses."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(skins, 'DISC_PRESSES', 20)
        yield Trials()


@pytest.mark.parametrize('hand', [parallel_hand(), soft_hand(), allegro_hand()])
def test_hand_models_have_the_joints_and_limits_of_their_drivers(hand: HandModel) -> None:
    model = mujoco.MjModel.from_xml_string(scene_text(hand.bodies, hand.rest))
    limits = hand.description.driver.limits
    for i, name in enumerate(hand.description.driver.joints):
        low, high = model.joint(name).range
        assert low == pytest.approx(limits.lower[i], abs=1e-9)
        assert high == pytest.approx(limits.upper[i], abs=1e-9)
        assert model.actuator(name).trnid[0] == model.joint(name).id
    for sensor, pad in hand.pads.items():
        assert model.site(pad).id >= 0
        assert any(sensor in finger.sensors for finger in hand.description.fingers.values())


@pytest.mark.parametrize('rate_hz', [25.0, 100.0])
def test_parallel_hand_has_points_and_lag_of_its_rate(rate_hz: float) -> None:
    hand = parallel_hand(rate_hz=rate_hz)
    sent = message(TRAJECTORY)
    hand.description.driver.topics[0].fill(sent, GripCommand(0, np.zeros(2), np.zeros(2)))
    assert sent.points[0].time_from_start.nanosec == round(2e9 / rate_hz)
    assert hand.lag == pytest.approx(LAG + 1.0 / np.log(2.0) / rate_hz)


def test_hand_world_holds_a_cube_by_its_bytes(trials: Trials) -> None:
    hand = parallel_hand()
    config = fitted(GripConfig(), hand)
    commands, phases = [], []
    with fingertips(trials.strong, hand.pads, 3) as tips:
        world = HandWorld(rig_of(hand, tips, config), solid('cube', MASS))
        world.put(np.full(2, 0.0145))
        cube = world.data.body('object').id

        def bear() -> None:
            world.data.xfrc_applied[cube, 2] = MASS * GRAVITY * (world.time < 2.0)

        def watch(_: HandWorld, decided: Decision) -> None:
            phases.append(decided.made.phase)
            if decided.command is not None:
                commands.append(decided.command.position)

        world.before_step = bear
        world.stage.enable()
        world.run(0.05)
        world.stage.grasp(2.0, [], 0.0, adapt=False)
        world.run(3.0, watch)
        forces = {name: force for name, (force, _) in world.pad_forces().items()}
        estimated = {name: pad.state.force for name, pad in world.pads.items()}
        fallen = -world.data.body('object').xpos[2]
    assert phases[-1] == GripPhase.HOLD
    assert fallen < 1e-3
    for name, force in forces.items():
        assert force[2] == pytest.approx(2.0, rel=0.02)
        assert estimated[name][2] == pytest.approx(force[2], rel=0.02)
        # x of both sensors looks up; the skin bears half of the weight
        assert force[0] == pytest.approx(MASS * GRAVITY / 2, rel=0.05)
        assert estimated[name][0] == pytest.approx(force[0], abs=0.05)
    limits = hand.description.driver.limits
    assert (np.array(commands) >= limits.lower).all()
    assert (np.array(commands) <= limits.upper).all()
    assert (np.abs(np.diff(commands, axis=0)) <= limits.velocity / config.rate_hz + 1e-12).all()


def test_load_scene_repeats_itself(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenes, 'CARRIES', 0.5)
    handling = Handling.draw('slippery', 2)
    first, second = (trials.carry(handling, 2, grips(5.0)['adaptive']) for _ in range(2))
    np.testing.assert_array_equal(first.trace, second.trace)


def test_adaptive_grip_holds_what_a_fixed_force_drops(trials: Trials) -> None:
    handling = Handling.draw('heavier', 5)
    compared = grips(0.6 * handling.needed)
    fixed, adaptive = (trials.carry(handling, 5, compared[name]) for name in ('fixed', 'adaptive'))
    assert not fixed.held
    assert adaptive.held
    assert adaptive.slid < 1e-3
    assert adaptive.trace[-1, 3] > 2 * adaptive.trace[0, 3]  # the target grows with the load


def test_magnet_leaves_the_gradiometer_alone_and_not_one_pixel(
    trials: Trials, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scenes, 'COMES', 3.0)
    monkeypatch.setattr(scenes, 'CLOSES', 6.5)
    held, single = trials.balloon(single=False), trials.balloon(single=True)
    assert held.error_until(0.05) < 0.02 * 3.5
    assert held.fate == 'held'
    assert 0.014 < held.invalid_from < 0.03
    assert single.error_until(0.05) > 0.05 * 3.5
    assert single.fate.startswith(('crushed', 'released'))


# a stiffness learned from measured joints alone makes the first one ring for two seconds
@pytest.mark.parametrize(('hand', 'seed', 'settled_s'), [('allegro', 3001, 0.5), ('soft', 1, 1.5)])
def test_grasp_of_a_cube_settles(hand: str, seed: int, settled_s: float, trials: Trials) -> None:
    grasp = trials.forces(hand, 'cube', seed)
    assert grasp.touched
    assert grasp.held or hand == 'soft'
    assert grasp.overshoot < 0.1
    assert grasp.settled < settled_s
    assert grasp.steady < 0.02


def test_magnet_pad_skin_reads_a_contact_as_its_model_does() -> None:
    config = MagnetPadConfig()
    skin = magnet_pad_skin(config)
    none, still = np.zeros(3), np.zeros((2, 3))
    rest = skin.signal(none, none, still)
    place, force = np.array([4e-3, 0.0, config.radius]), np.array([0.0, 0.0, 2.0])
    change = skin.signal(place, force, still) - rest
    twice = skin.signal(place, 2 * force, still) - rest
    assert np.abs(change).max() > 50e-6
    np.testing.assert_allclose(twice, 2 * change, atol=0.2 * np.abs(change).max())
    outside = np.tile([1e-3, 0.0, -2e-3], (2, 1))
    np.testing.assert_allclose(skin.signal(place, force, outside) - rest - change, outside)
    crowned = on_half_cylinder(np.array([0.03, 0.003, 0.003]), 0.01, 0.04)
    np.testing.assert_allclose(crowned, [0.02, 0.01 / np.sqrt(2), 0.01 / np.sqrt(2)])


def test_named_judges_by_the_nearest_cell() -> None:
    cells = np.array([[-1e-3, 0.0, 0.0], [1e-3, 0.0, 0.0]])
    place, cov = np.array([0.5e-3, 0.0, 0.0]), 1e-8 * np.eye(3)
    right, wrong = (named(Touched(place, at, cov), cells) for at in (place + 1e-4, -place))
    assert (right.true, right.estimated, wrong.estimated) == (1, 1, 0)
    assert right.error == pytest.approx(1e-4 * np.sqrt(3))
    assert right.chance < 1e-6
    nothing = named(Touched(np.full(3, np.nan), np.full(3, np.nan), cov), cells)
    assert (nothing.true, nothing.estimated) == (-1, -1)
    assert mistaken(cells, place, 0.25e-6 * np.eye(3)) == pytest.approx(0.1587, abs=1e-4)


def test_film_says_in_one_sentence_that_nothing_can_draw(
    trials: Trials, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mujoco, 'Renderer', None)
    film, hand = Film(10.0, (0.0, 0.0, 0.0), 0.3, 120.0, -20.0), parallel_hand()
    with fingertips(trials.strong, hand.pads, 0) as tips:
        world = HandWorld(rig_of(hand, tips, GripConfig()), solid('cube', MASS))
        with pytest.raises(MissingPackageError, match='need OpenGL without a screen'):
            film(world)


def test_film_shows_forces_below_its_pictures(tmp_path: Path) -> None:
    image = pytest.importorskip('PIL.Image')
    film = Film(10.0, (0.0, 0.0, 0.0), 0.3, 120.0, -20.0)
    film.pictures = 2 * [np.zeros((240, 320, 3), np.uint8)]
    film.forces = [{'left': 1.0, 'right': 0.5}, {'left': 1.5}]  # then the right one is not valid
    with image.open(film.save(tmp_path / 'a.gif')) as made:
        assert (made.n_frames, made.size) == (2, (320, 360))
        first = np.asarray(made.convert('RGB'))[240:].astype(int)
        made.seek(1)
        assert np.abs(np.asarray(made.convert('RGB'))[240:] - first).max() > 100


def test_fingertip_estimates_a_lasting_contact_from_the_mean_of_its_frames(trials: Trials) -> None:
    made_of = trials.gentle
    force, errors = np.array([0.1, 0.0, 1.0]), []
    for seed in range(8):
        with Fingertip(made_of.skin, made_of.pipeline, seed, made_of.pipeline) as tip:
            tip.tare()
            single = [tip.estimate(np.zeros(3), force).force for _ in range(AVERAGED)]
            lasting = tip.lasting()
        errors.append((np.std(single, axis=0), np.abs(lasting.force - np.mean(single, axis=0))))
    spread, apart = np.mean(errors, axis=0)
    assert (apart < 0.2 * spread + 1e-4).all()
    with Fingertip(made_of.skin, made_of.pipeline, 0) as tip:
        assert tip.lasting() is None
