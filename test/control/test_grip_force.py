# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The grip-force law: never outside limits, safe when inputs fail, and good at its work."""

from __future__ import annotations

import dataclasses
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.control import (
    Drive,
    GraspOutcome,
    GraspSequence,
    GripConfig,
    GripForce,
    GripInput,
    GripPhase,
    GripStep,
    qb_softhand,
)

CONFIG = GripConfig()
QUICK = GripConfig(closing_rate=1.0)
SAYS = (np.array([0, 1], np.int8), np.array([-1, -1], np.int8))
SOFT = Drive(0.7, 9.0, own=7.0, spread=1.3, fastest=5.0, travel=0.04)
OPEN = GripInput(
    np.zeros(2), np.zeros(2), np.ones(2, bool), np.zeros(2, np.int8), np.zeros(2), np.zeros(2),
    0.0, pressed=np.zeros(2),
)  # fmt: skip


def test_an_input_that_misfits_is_named() -> None:
    OPEN.refuse_misfit(2, 2)
    with pytest.raises(ValueError, match=r'closure of GripInput must have shape \(3,\)'):
        OPEN.refuse_misfit(2, 3)
    crossed = dataclasses.replace(OPEN, new=np.zeros(3, bool))
    with pytest.raises(ValueError, match=r'new of GripInput must have shape \(2,\)'):
        crossed.refuse_misfit(2, 2)


class Run:
    """A law against the springs of the reference world."""

    def __init__(self, module: ModuleType, config: GripConfig = QUICK, **about: object) -> None:
        self.world = module.GripWorld(rate_hz=config.rate_hz, **about)
        count = len(self.world.gains)
        sides = (1, -1) if count > 1 else None
        self.law = GripForce(config, tuple(range(count)), sides)
        self.law.enable()
        self.change: dict[str, object] = {}
        self.forces: list[np.ndarray] = []
        self.made: list[GripStep] = []

    def step(self) -> GripStep:
        given = dataclasses.replace(self.world.given(), **self.change)
        made = self.law.step(given, 1.0 / self.law.config.rate_hz)
        self.world.advance(made)
        self.forces.append(self.world.force.copy())
        self.made.append(made)
        return made

    def run(self, seconds: float) -> GripStep:
        for _ in range(round(seconds * self.law.config.rate_hz)):
            made = self.step()
        return made

    def grasp(self, force: float = 2.0, seconds: float = 3.0, adapt: bool = False) -> GripStep:
        self.law.grasp(force, adapt)
        return self.run(seconds)


@pytest.mark.parametrize('stiffness', [8.0, 60.0, 300.0])
def test_a_quick_hand_holds_balloon_and_steel(worlds: ModuleType, stiffness: float) -> None:
    one = Run(worlds, CONFIG, stiffness=stiffness)
    made = one.grasp(seconds=5.0)
    assert made.settled
    assert np.max(one.forces) <= 2.0 * 1.1
    assert np.mean(one.forces[-100:]) == pytest.approx(2.0, rel=0.02)
    phases = [step.phase for step in one.made]
    assert phases == sorted(phases)


def test_a_slow_hand_too(worlds: ModuleType) -> None:
    one = Run(worlds, qb_softhand(), stiffness=60.0, dead_time=0.1, lag=0.1)
    assert one.grasp(seconds=8.0).settled
    assert np.max(one.forces) <= 2.0 * 1.1


@pytest.mark.parametrize('noise', [0.02, 0.1])
def test_stated_noise_settles_at_the_asked_force(worlds: ModuleType, noise: float) -> None:
    one = Run(worlds, noise=noise)
    one.change = {'sigma': np.array([noise])}
    made = one.grasp(seconds=5.0, adapt=True)
    assert made.phase == GripPhase.HOLD
    assert any(step.settled for step in one.made)
    assert np.mean(one.forces[-100:]) == pytest.approx(2.0, rel=0.1)
    assert not any(step.slipping.any() for step in one.made)


def test_fingers_of_a_fixed_object_have_each_its_own_force(worlds: ModuleType) -> None:
    one = Run(worlds, gains=(1.0, 1.0))
    one.grasp(seconds=4.0)
    np.testing.assert_allclose(np.mean(one.forces[-50:], axis=0), 2.0, rtol=0.05)


def test_sensors_that_disagree_walk_a_free_object_no_further_than_they_may(
    worlds: ModuleType,
) -> None:
    one = Run(worlds, gains=(0.9, 1.1), free=True)
    one.grasp(seconds=10.0)
    early = abs(one.world.place)
    one.run(5.0)
    assert abs(one.world.place) == pytest.approx(early, abs=0.005)
    assert early < 0.25
    assert 1.7 < one.world.force[0] < 2.4


def test_a_sensor_that_fails_does_not_let_the_others_crush(worlds: ModuleType) -> None:
    one = Run(worlds, gains=(1.0, 0.1), free=True)
    one.grasp(seconds=10.0)
    assert np.max(one.forces) < 2.0 * 1.8
    assert np.mean(one.forces[-100:]) < 2.0 * 1.3
    assert not one.made[-1].settled
    assert any('finger 1 presses' in one for one in one.law.shortfalls())


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'age': np.array([0.2, 0.0])}, 'finger 0 is stale (0.200 s)'),
        ({'age': np.array([0.0, -0.5])}, 'finger 1 is stale (-0.500 s)'),
        ({'valid': np.array([True, False])}, 'finger 1 says that it is not valid'),
        ({'normal': np.array([np.nan, 1.0])}, 'finger 0 gives a force that is not a number'),
        ({'normal': np.array([1.0, 1e308])}, 'finger 1 reads 1e+308 N, which no finger can'),
        ({'closure_age': 0.2}, 'joint states are stale (0.200 s)'),
        ({'closure': np.array([0.3, np.nan])}, 'closure of drive 1 is not a number'),
        ({'blocked': 'no order yet'}, 'no order yet'),
    ],
)
def test_each_refusal_has_its_sentence(change: dict[str, object], sentence: str) -> None:
    law = GripForce(dataclasses.replace(CONFIG, fewest_fingers=2), (0, 1))
    law.enable()
    law.grasp(2.0)
    made = law.step(dataclasses.replace(OPEN, **change), 0.01)
    assert (made.phase, made.send, made.refusal) == (GripPhase.FAULT, False, sentence)


@pytest.mark.parametrize('dt', [0.0, -0.01, np.nan, np.inf, 0.2])
def test_a_time_step_that_cannot_be_sends_nothing(dt: float) -> None:
    law = GripForce(CONFIG, (0, 1))
    law.enable()
    law.grasp(2.0)
    made = law.step(OPEN, dt)
    assert not made.send
    assert made.refusal.startswith('time step must be above 0 and at most 0.100 s')


def test_a_bias_is_named_before_anything_moves(worlds: ModuleType) -> None:
    one = Run(worlds, gains=(1.0, 1.0))
    one.change = {'normal': np.array([0.0, 1.0])}
    one.run(0.3)
    one.law.grasp(2.0)
    made = one.step()
    assert made.fault == ('finger 1 reads 1.00 N before closing: tare it while nothing touches it')
    assert not made.send
    assert GraspSequence(CONFIG).step(made, 0.01).outcome == GraspOutcome.FAULT


def soft_law() -> GripForce:
    law = GripForce(QUICK, (0, 1), (1, -1), [SOFT, SOFT], ('index', 'thumb'))
    law.enable()
    for _ in range(30):
        law.step(OPEN, 0.01)
    law.grasp(2.0)
    return law


def test_a_finger_that_reads_nothing_while_its_drive_leans_is_named() -> None:
    law, rng = soft_law(), np.random.default_rng(1)
    peak = 0.0
    for _ in range(300):
        deep = np.maximum(np.array([x.command for x in law.laws]) - 0.4, 0.0)
        true = np.nan_to_num(SOFT.own * deep)
        normal = np.array([true[0], 0.0]) + 0.02 * rng.normal(size=2)
        closure = np.minimum([x.command for x in law.laws], 0.4)
        made = law.step(
            dataclasses.replace(
                OPEN, normal=normal, closure=np.nan_to_num(closure), pressed=true + 0.1
            ),
            0.01,
        )  # fmt: skip
        peak = max(peak, true[1])
        if made.fault:
            break
    assert made.fault.startswith('thumb reads')
    assert peak < 1.2 * 2.0


def test_forces_that_freeze_stop_the_grip() -> None:
    law = soft_law()
    for k in range(400):
        command = np.nan_to_num([x.command for x in law.laws])
        true = SOFT.own * np.maximum(command - 0.4, 0.0)
        normal = np.minimum(true, 1.0) + 1e-3 * (k % 7) * (true < 1.0)
        closure = np.minimum(command, 0.4)
        given = dataclasses.replace(OPEN, normal=normal, closure=closure, pressed=true)
        made = law.step(given, 0.01)
        if made.fault:
            break
    assert 'to the last bit while its drive moves' in made.fault
    assert true.max() < 1.3 * 2.0


@pytest.mark.parametrize('stops', ['disable', 'abandon'])
def test_a_stopped_law_goes_on_from_what_it_holds(worlds: ModuleType, stops: str) -> None:
    one = Run(worlds)
    one.grasp()
    before = len(one.forces)
    one.law.disable() if stops == 'disable' else one.law.abandon('joint states are stale')
    assert not one.run(0.3).send
    one.law.enable()
    one.law.grasp(2.0)
    one.run(1.0)
    assert np.min(one.forces[before:]) > 0.95 * 2.0
    assert one.made[-1].settled


def test_a_law_that_finds_something_held_presses_as_the_drive_does() -> None:
    law = GripForce(CONFIG, (0,), None, [SOFT])
    law.enable()
    law.grasp(2.0, held=True)
    given = GripInput(
        np.array([2.0]), np.zeros(1), np.ones(1, bool), np.zeros(1, np.int8), np.zeros(1),
        np.array([0.5]), 0.0, pressed=np.array([2.0]),
    )  # fmt: skip
    made = law.step(given, 0.01)
    assert made.contact[0] == 0.5
    assert made.closure[0] == pytest.approx(0.5 + 2.0 / SOFT.own, abs=0.01)


def test_a_new_target_in_hand_has_no_bump(worlds: ModuleType) -> None:
    one = Run(worlds)
    one.grasp()
    before = len(one.forces)
    one.law.grasp(3.0)
    one.run(2.0)
    after = np.array(one.forces[before:])
    assert after.min() > 1.9
    assert after[-1, 0] == pytest.approx(3.0, rel=0.02)


@pytest.mark.parametrize('action', ['hold', 'open'])
def test_without_any_input_the_safe_action(worlds: ModuleType, action: str) -> None:
    one = Run(worlds, dataclasses.replace(QUICK, safe_action=action))
    one.grasp()
    one.change = {'age': np.array([1.0])}
    made = one.run(1.0)
    assert made.phase == GripPhase.FAULT
    assert made.refusal == 'finger 0 is stale (1.000 s)'
    assert made.send == (action == 'open')
    assert (one.world.force[0] < 0.1) == (action == 'open')
    one.change = {}
    assert one.run(0.3).phase == (GripPhase.HOLD if action == 'hold' else GripPhase.RELEASE)


def test_a_force_that_is_not_new_is_not_regulated_twice(worlds: ModuleType) -> None:
    one = Run(worlds)
    one.grasp(seconds=0.6)
    one.change = {'new': np.zeros(1, bool)}
    one.run(0.1)
    closures = [float(made.closure[0]) for made in one.made[-9:]]
    assert np.ptp(closures[-6:]) == 0.0


def test_a_finger_that_falls_silent_is_named_and_the_others_go_on(worlds: ModuleType) -> None:
    one = Run(worlds, gains=(1.0, 1.0))
    one.grasp()
    one.change = {'age': np.array([0.0, 1.0])}
    made = one.run(1.0)
    assert made.warning == 'finger 1 is stale: it keeps its place'
    assert made.phase == GripPhase.HOLD
    np.testing.assert_allclose(one.world.force, 2.0, rtol=0.1)


def test_one_drive_for_several_fingers(worlds: ModuleType) -> None:
    world = worlds.GripWorld()
    law = GripForce(QUICK, (0, 0, 0))
    law.enable()
    law.grasp(2.0)
    for _ in range(450):
        given = world.given()
        given = dataclasses.replace(
            given, normal=np.array([1.0, 1.1, 0.9]) * given.normal, tangential=np.zeros(3),
            valid=np.ones(3, bool), slip=np.zeros(3, np.int8), age=np.zeros(3),
        )  # fmt: skip
        made = law.step(given, 0.01)
        world.advance(made)
    assert made.settled
    assert world.force[0] == pytest.approx(2.0, rel=0.03)


def test_release_opens_and_ends(worlds: ModuleType) -> None:
    one = Run(worlds)
    one.grasp()
    one.law.release('the object was lost')
    assert one.run(0.1).refusal == 'the object was lost'
    made = one.run(2.0)
    assert made.phase == GripPhase.IDLE
    assert made.refusal == 'the object was lost; a new grasp is needed'
    assert one.world.closure[0] == pytest.approx(0.0, abs=0.01)


@given(st.data())
@settings(max_examples=60)
def test_no_input_makes_a_command_outside_limits_or_rate(data: st.DataObject) -> None:
    numbers = st.one_of(st.floats(-5, 5), st.sampled_from([np.nan, np.inf, -np.inf, 1e308, 0.0]))
    law = GripForce(QUICK, (0, 1), (1, -1), [SOFT, Drive(5.0, 300.0)])
    law.enable()
    law.grasp(2.0)
    last = None
    for _ in range(25):
        pair = st.lists(numbers, min_size=2, max_size=2).map(np.array)
        made = law.step(
            GripInput(
                data.draw(pair), data.draw(pair), data.draw(st.sampled_from([True, False]))
                & np.ones(2, bool), data.draw(st.sampled_from(SAYS)),
                np.abs(data.draw(pair)), data.draw(pair), float(data.draw(numbers)),
                sigma=data.draw(pair), pressed=data.draw(pair),
            ),
            0.01,
        )  # fmt: skip
        if not made.send:
            continue
        assert np.isfinite(made.closure).all()
        assert (made.closure <= 3.0).all()
        assert (made.closure >= -4.0).all()
        if last is not None:
            assert (np.abs(made.closure - last) <= np.array([5.0, 1.0]) * 0.01 + 1e-9).all()
        last = made.closure


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (((), None), 'drives of GripForce must be numbers from 0 without gaps'),
        (((0, 2), None), 'drives of GripForce must be numbers from 0 without gaps'),
        (((0, 1), (1, 2)), 'sides of GripForce must be -1, 0 or 1'),
    ],
)
def test_fingers_that_cannot_be(arguments: tuple[object, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        GripForce(CONFIG, *arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize('force', [0.0, -1.0, np.nan, 11.0, [2.0, 0.0]])
def test_targets_that_cannot_be(force: object) -> None:
    law = GripForce(CONFIG, (0, 1))
    with pytest.raises(ValueError, match='the law is not active'):
        law.grasp(2.0)
    law.enable()
    with pytest.raises(ValueError, match=r'target_force must be above 0\.1 and at most 10 N'):
        law.grasp(force)  # type: ignore[arg-type]
