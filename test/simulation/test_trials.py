# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hands in MuJoCo with their pads' bytes and their drivers' messages in the loop; no screen."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.control import GripConfig, GripPhase
from tactile_ros.errors import MissingPackageError
from tactile_ros.hands.drivers import TRAJECTORY
from tactile_ros.nodes.grip_loop import GripLoop
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.simulation import scenes
from tactile_ros.simulation.allegro_hand import allegro_hand, on_half_cylinder
from tactile_ros.simulation.engine import Film, load_engine, scene_text
from tactile_ros.simulation.hand_world import HandWorld, Rig, message
from tactile_ros.simulation.mjcf import solid
from tactile_ros.simulation.parallel_hand import LAG, parallel_hand
from tactile_ros.simulation.scenes import Handling, Touched, mistaken, named
from tactile_ros.simulation.skins import AVERAGED, Fingertip, gradiometer_presses, magnet_pad_skin
from tactile_ros.simulation.soft_hand import soft_hand
from tactile_ros.simulation.trials import Tips, Trials, fitted, grips
from tactile_ros.types import GripCommand

if TYPE_CHECKING:
    from tactile_ros.hands import HandDescription
    from tactile_ros.simulation.hand_world import Decided
    from tactile_ros.simulation.mjcf import HandModel

mujoco = pytest.importorskip('mujoco', reason='simulated hands need MuJoCo')

GRAVITY, MASS = 9.81, 0.1


def stage(hand: HandDescription, config: GripConfig, fingers: list[str]) -> GripLoop:
    return GripLoop(hand, config, fingers)


@pytest.fixture(scope='module')
def trials() -> Trials:
    return Trials(stage)


def test_without_mujoco_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    with pytest.raises(MissingPackageError, match=r'need MuJoCo: pip install mujoco$'):
        load_engine()


@pytest.mark.parametrize('hand', [parallel_hand(), soft_hand(), allegro_hand()])
def test_models_have_the_joints_and_limits_of_their_drivers(hand: HandModel) -> None:
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
def test_points_of_the_two_fingers_and_the_lag_they_add_follow_the_rate(rate_hz: float) -> None:
    hand = parallel_hand(rate_hz=rate_hz)
    sent = message(TRAJECTORY)
    hand.description.driver.topics[0].fill(sent, GripCommand(0, np.zeros(2), np.zeros(2)))
    assert sent.points[0].time_from_start.nanosec == round(2e9 / rate_hz)
    assert hand.lag == pytest.approx(LAG + 1.0 / np.log(2.0) / rate_hz)


def test_pads_of_the_allegro_hand_oppose_each_other() -> None:
    hand = allegro_hand()
    model = mujoco.MjModel.from_xml_string(scene_text(hand.bodies, hand.rest))
    data = mujoco.MjData(model)
    data.qpos[:] = hand.description.posture('pre_grasp', np.zeros(16))
    mujoco.mj_kinematics(model, data)
    out = {name: data.site(pad).xmat.reshape(3, 3)[:, 2] for name, pad in hand.pads.items()}
    across = np.array(hand.across) / np.linalg.norm(hand.across)
    assert out['thumb'] @ across > 0.98
    assert out['index'] @ across < -0.95
    assert out['middle'] @ across < -0.95


def test_two_fingers_hold_a_cube_by_what_their_bytes_say(trials: Trials) -> None:
    hand = parallel_hand()
    config = fitted(GripConfig(), hand)
    commands, phases = [], []
    with Tips(trials.strong, list(hand.pads), 3) as tips:
        rig = Rig(hand, tips, stage(hand.description, config, []), config.rate_hz)
        world = HandWorld(rig, solid('cube', MASS, (0.0, 0.0, -0.0)))
        world.put(np.full(2, 0.0145))
        cube = world.data.body('object').id

        def bear() -> None:
            world.data.xfrc_applied[cube, 2] = MASS * GRAVITY * (world.time < 2.0)

        def watch(_: HandWorld, decided: Decided) -> None:
            phases.append(decided.made.phase)
            if decided.command is not None:
                commands.append(decided.command.position)

        world.before_step = bear
        world.stage.enable()
        world.run(0.05)
        world.stage.grasp(2.0, [], 0.0, adapt=False)
        world.run(3.0, watch)
        forces = {name: force for name, (force, _) in world.pad_forces().items()}
        told = {name: felt.state.force for name, felt in world.felt.items()}
        fallen = -world.data.body('object').xpos[2]
    assert phases[-1] == GripPhase.HOLD
    assert fallen < 1e-3
    for name, force in forces.items():
        assert force[2] == pytest.approx(2.0, rel=0.02)
        assert told[name][2] == pytest.approx(force[2], rel=0.02)
        # x of both sensors looks up; the skin bears half of the weight
        assert force[0] == pytest.approx(MASS * GRAVITY / 2, rel=0.05)
        assert told[name][0] == pytest.approx(force[0], abs=0.05)
    limits = hand.description.driver.limits
    assert (np.array(commands) >= limits.lower).all()
    assert (np.array(commands) <= limits.upper).all()
    assert (np.abs(np.diff(commands, axis=0)) <= limits.velocity / config.rate_hz + 1e-12).all()


def test_a_scene_repeats_itself(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenes, 'CARRIES', 1.0)
    handling = Handling.draw('slippery', 2)
    grip = grips(5.0)['adaptive']
    first, second = (trials.carry(handling, 2, grip) for _ in range(2))
    np.testing.assert_array_equal(first.trace, second.trace)


def test_an_adaptive_grip_holds_what_a_fixed_force_drops(trials: Trials) -> None:
    handling = Handling.draw('heavier', 5)
    fixed = trials.carry(handling, 5, grips(0.6 * handling.needed)['fixed'])
    adaptive = trials.carry(handling, 5, grips(0.6 * handling.needed)['adaptive'])
    assert not fixed.held
    assert adaptive.held
    assert adaptive.slid < 1e-3
    # what it grips with follows the load: the target has grown with it
    assert adaptive.trace[-1, 3] > 2 * adaptive.trace[0, 3]


def test_a_magnet_leaves_the_gradiometer_alone_and_not_one_pixel(
    trials: Trials, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scenes, 'COMES', 6.0)
    monkeypatch.setattr(scenes, 'CLOSES', 6.5)
    held, single = trials.balloon(single=False), trials.balloon(single=True)
    assert held.error_until(0.05) < 0.02 * 3.5
    assert held.fate == 'held'
    assert 0.014 < held.invalid_from < 0.03
    assert single.error_until(0.05) > 0.05 * 3.5
    assert single.fate.startswith(('crushed', 'released'))


def test_the_field_of_the_magnet_is_that_of_the_figure(trials: Trials) -> None:
    hand = soft_hand()
    with Tips(trials.gentle, ['thumb'], 0) as tips:
        config = GripConfig(rate_hz=25.0)
        rig = Rig(hand, tips, stage(hand.description, config, ['thumb']), config.rate_hz)
        scene = scenes.BalloonScene(rig)
        assert not scene._field(0.0, np.zeros((1, 3)), np.eye(3)).any()
        share = (scenes.FAR - 0.05) / (scenes.FAR - scenes.NEAR)
        scene._begins = -share * scenes.COMES
        field = scene._field(0.0, np.zeros((1, 3)), np.eye(3))
    assert scene.distance == pytest.approx(0.05)
    assert np.linalg.norm(field) == pytest.approx(3e-3)


def test_the_allegro_like_hand_settles_though_its_joints_stand_still(trials: Trials) -> None:
    # a stiffness learned from measured joints alone rings here, for two seconds
    grasp = trials.forces('allegro', 'cube', 3001)
    assert grasp.touched
    assert grasp.held
    assert grasp.overshoot < 0.1
    assert grasp.settled < 0.5
    assert grasp.steady < 0.02


def test_the_soft_hand_settles_on_a_cube(trials: Trials) -> None:
    grasp = trials.forces('soft', 'cube', 1)
    assert grasp.touched
    assert grasp.overshoot < 0.1
    assert grasp.settled < 1.5
    assert grasp.steady < 0.02


def test_a_pad_reads_a_contact_of_the_scene_as_its_model_does() -> None:
    config = MagnetPadConfig()
    skin = magnet_pad_skin(config, 8.0)
    none, still = np.zeros(3), np.zeros((2, 3))
    rest = skin.signal(none, none, still)
    place, force = np.array([4e-3, 0.0, config.radius]), np.array([0.0, 0.0, 2.0])
    change = skin.signal(place, force, still) - rest
    twice = skin.signal(place, 2 * force, still) - rest
    assert np.abs(change).max() > 50e-6
    np.testing.assert_allclose(twice, 2 * change, atol=0.2 * np.abs(change).max())
    outside = np.tile([1e-3, 0.0, -2e-3], (2, 1))
    np.testing.assert_allclose(skin.signal(place, force, outside) - rest - change, outside)


def test_crowned_pads_stand_for_half_cylinders() -> None:
    place = on_half_cylinder(np.array([0.03, 0.003, 0.003]), 0.01, 0.04)
    np.testing.assert_allclose(place, [0.02, 0.01 / np.sqrt(2), 0.01 / np.sqrt(2)])


def test_cells_are_judged_by_the_nearest_centre() -> None:
    cells = np.array([[-1e-3, 0.0, 0.0], [1e-3, 0.0, 0.0]])
    place = np.array([0.5e-3, 0.0, 0.0])
    right = named(Touched(place, place + 1e-4, 1e-8 * np.eye(3)), cells)
    assert (right.true, right.told) == (1, 1)
    assert right.error == pytest.approx(1e-4 * np.sqrt(3))
    assert right.chance < 1e-6
    wrong = named(Touched(place, -place, 1e-8 * np.eye(3)), cells)
    assert (wrong.true, wrong.told) == (1, 0)
    nothing = named(Touched(np.full(3, np.nan), np.full(3, np.nan), np.eye(3)), cells)
    assert (nothing.true, nothing.told) == (-1, -1)
    assert mistaken(cells, place, 0.25e-6 * np.eye(3)) == pytest.approx(0.1587, abs=1e-4)


def test_presses_of_a_calibration_reach_full_scale_and_differ_by_seed(trials: Trials) -> None:
    config = trials.gentle.skin.config
    one, other = (gradiometer_presses(config, seed) for seed in (1, 2))
    assert one.truth['force'][:, 2].max() > 0.85 * config.full_scale
    assert not np.array_equal(one.values, other.values)


def test_messages_are_blank_as_adapters_expect() -> None:
    for topic in (
        hand.description.driver.topics[-1] for hand in (parallel_hand(), allegro_hand())
    ):
        assert hasattr(message(topic.kind), 'header')


def test_a_film_says_in_one_sentence_that_nothing_can_draw(
    trials: Trials, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mujoco, 'Renderer', None)
    film = Film(10.0)
    hand = parallel_hand()
    with Tips(trials.strong, list(hand.pads), 0) as tips:
        rig = Rig(hand, tips, stage(hand.description, GripConfig(), []), 100.0)
        world = HandWorld(rig, solid('cube', MASS))
        with pytest.raises(MissingPackageError, match='need OpenGL without a screen'):
            film(world)


def test_a_contact_that_lasts_is_told_by_the_mean_of_its_frames(trials: Trials) -> None:
    made_of = trials.gentle
    force, errors = np.array([0.1, 0.0, 1.0]), []
    for seed in range(8):
        with Fingertip(made_of.skin, made_of.pipeline, seed, made_of.pipeline) as tip:
            tip.tare()
            single = [tip.feel(np.zeros(3), force).force for _ in range(AVERAGED)]
            lasting = tip.lasting()
        assert lasting is not None
        errors.append((np.std(single, axis=0), np.abs(lasting.force - np.mean(single, axis=0))))
    spread, apart = np.mean(errors, axis=0)
    assert (apart < 0.2 * spread + 1e-4).all()
    with Fingertip(made_of.skin, made_of.pipeline, 0) as tip:
        assert tip.lasting() is None
