# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The grip-force law: never outside limits, safe when inputs fail, and good at its work."""

import dataclasses

import numpy as np
import pytest

from reference.grip_world import GripWorld
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
SOFT = Drive(0.7, 9.0, own=7.0, spread=1.3, fastest=5.0)
OPEN = GripInput(
    np.zeros(2), np.zeros(2), np.ones(2, bool), np.zeros(2, np.int8), np.zeros(2), np.zeros(2),
    0.0, pressed=np.zeros(2),
)  # fmt: skip
HOSTILE = np.array([np.nan, np.inf, -np.inf, 1e308, 0.0, 0.3, 2.0, -5.0, 5.0])


def active(config: GripConfig, *about: object) -> GripForce:
    law = GripForce(config, *about)
    law.enable()
    law.grasp(2.0)
    return law


class Run:
    """A law against the springs of the reference world."""

    def __init__(
        self, config: GripConfig = QUICK, plants: list[Drive] | None = None, **about: object
    ) -> None:
        self.world = GripWorld(rate_hz=config.rate_hz, **about)
        count = len(self.world.gains)
        self.law = GripForce(config, range(count), (1, -1) if count > 1 else None, plants)
        self.law.enable()
        self.change: dict[str, object] = {}
        self.forces: list[np.ndarray] = []
        self.made: list[GripStep] = []

    def run(self, seconds: float) -> GripStep:
        for _ in range(round(seconds * self.law.config.rate_hz)):
            given = dataclasses.replace(self.world.given(), **self.change)
            made = self.law.step(given, 1.0 / self.law.config.rate_hz)
            self.world.advance(made)
            self.forces.append(self.world.force.copy())
            self.made.append(made)
        return made

    def grasp(self, seconds: float = 3.0, adapt: bool = False) -> GripStep:
        self.law.grasp(2.0, adapt)
        return self.run(seconds)


@pytest.mark.parametrize(
    ('config', 'about'),
    [
        (CONFIG, {'stiffness': 8.0}),
        (CONFIG, {'stiffness': 60.0}),
        (CONFIG, {'stiffness': 300.0}),
        (qb_softhand(), {'stiffness': 60.0, 'dead_time': 0.1, 'lag': 0.1}),
    ],
)
def test_grip_force_holds_balloon_and_steel(config: GripConfig, about: dict[str, float]) -> None:
    one = Run(config, **about)
    assert one.grasp(8.0 if config.rate_hz < 100.0 else 5.0).settled
    assert np.max(one.forces) <= 2.0 * 1.1
    assert np.mean(one.forces[-100:]) == pytest.approx(2.0, rel=0.02)
    phases = [step.phase for step in one.made]
    assert phases == sorted(phases)


@pytest.mark.parametrize('noise', [0.02, 0.1])
def test_grip_force_settles_under_stated_noise(noise: float) -> None:
    one = Run(noise=noise)
    one.change = {'sigma': np.array([noise])}
    assert one.grasp(5.0, adapt=True).phase == GripPhase.HOLD
    assert any(step.settled for step in one.made)
    assert np.mean(one.forces[-100:]) == pytest.approx(2.0, rel=0.1)
    assert not any(step.slipping.any() for step in one.made)


def test_grip_force_gives_each_finger_of_a_fixed_object_its_own_force() -> None:
    one = Run(gains=(1.0, 1.0))
    one.grasp(4.0)
    np.testing.assert_allclose(np.mean(one.forces[-50:], axis=0), 2.0, rtol=0.05)
    one.change = {'age': np.array([0.0, 1.0])}  # one falls silent, the other goes on
    made = one.run(1.0)
    assert made.warning == 'finger 1 is stale: it keeps its place'
    assert made.phase == GripPhase.HOLD
    np.testing.assert_allclose(one.world.force, 2.0, rtol=0.1)


@pytest.mark.parametrize('soft', [True, False])
def test_grip_force_leaves_a_load_to_the_springs_of_soft_drives(soft: bool) -> None:
    one = Run(plants=[SOFT] * 2 if soft else None, gains=(1.0, 1.0), stiffness=7.0)
    one.change = {'tangential': np.full(2, 0.8)}
    assert one.grasp(4.0).settled
    moved = []
    for load in (0.1, 0.8):  # the first relaxes
        # the object leans on one finger
        one.change = {'normal': np.array([1.2, 1.9]), 'tangential': np.full(2, load)}
        one.run(0.05)  # until the load is seen
        before = len(one.made)
        one.run(1.0)
        moved.append(np.ptp([made.closure for made in one.made[before:]], axis=0).max() > 1e-3)
    assert moved == [True, not soft]


def test_grip_force_sees_a_load_however_far_it_was_raised() -> None:
    one = Run(plants=[SOFT] * 2, gains=(1.0, 0.9), stiffness=7.0, free=True)
    one.grasp(0.6, adapt=True)
    for load in (0.0, 0.6):  # one finger presses askew, and the other feels what comes
        one.change = {'tangential': np.array([1.0, load])}
        one.run(3.0)
    place = np.array([made.closure for made in one.made[-200:]]) @ [0.5, -0.5]
    assert one.made[-1].target_force[0] > 2.0 * 1.3
    assert np.ptp(place) < 2e-3


def test_grip_force_walks_a_free_object_no_further_where_sensors_disagree() -> None:
    one = Run(gains=(0.9, 1.1), free=True)
    one.grasp(6.0)
    one.run(1.0)
    early = abs(one.world.place)
    one.run(3.0)
    assert abs(one.world.place) == pytest.approx(early, abs=0.005)
    assert early < 0.25
    assert 1.7 < one.world.force[0] < 2.4


def test_grip_force_crushes_nothing_where_a_sensor_fails() -> None:
    one = Run(gains=(1.0, 0.1), free=True)
    one.grasp(10.0)
    assert np.max(one.forces) < 2.0 * 1.8
    assert np.mean(one.forces[-100:]) < 2.0 * 1.3
    assert not one.made[-1].settled
    assert any('finger 1 presses' in said for said in one.law.shortfalls())


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'age': np.array([0.2, 0.0])}, 'finger 0 is stale (0.200 s)'),
        ({'age': np.array([0.0, -0.5])}, 'finger 1 is stale (-0.500 s)'),
        ({'age': np.array([0.0, np.inf])}, 'finger 1 never came'),
        ({'valid': np.array([True, False])}, 'finger 1 says that it is not valid'),
        ({'normal': np.array([np.nan, 1.0])}, 'finger 0 gives a force that is not a number'),
        ({'normal': np.array([1.0, 1e308])}, 'finger 1 reads 1e+308 N, which no finger can'),
        ({'closure_age': 0.2}, 'joint states are stale (0.200 s)'),
        ({'closure': np.array([0.3, np.nan])}, 'closure of drive 1 is not a number'),
        ({'blocked': 'no order yet'}, 'no order yet'),
    ],
)
def test_grip_force_says_why_it_refuses(change: dict[str, object], sentence: str) -> None:
    law = active(dataclasses.replace(CONFIG, fewest_fingers=2), (0, 1))
    made = law.step(dataclasses.replace(OPEN, **change), 0.01)
    assert (made.phase, made.send, made.refusal) == (GripPhase.FAULT, False, sentence)


@pytest.mark.parametrize('dt', [0.0, -0.01, np.nan, np.inf, 0.2])
def test_grip_force_sends_nothing_in_a_time_that_cannot_be(dt: float) -> None:
    made = active(CONFIG, (0, 1)).step(OPEN, dt)
    assert not made.send
    assert made.refusal.startswith('time step must be above 0 and at most 0.100 s')


def test_grip_force_names_a_bias_before_anything_moves() -> None:
    one = Run(gains=(1.0, 1.0))
    one.change = {'normal': np.array([0.0, 1.0])}
    one.run(0.3)
    made = one.grasp(0.01)
    assert made.fault == 'finger 1 reads 1.00 N before closing: tare it while nothing touches it'
    assert not made.send
    assert GraspSequence(CONFIG).step(made, 0.01).outcome == GraspOutcome.FAULT


@pytest.mark.parametrize('joints', [1, 4])  # steps from one joint state to the next
@pytest.mark.parametrize(
    ('dies', 'fault', 'most'),
    [
        ('reads nothing', 'thumb reads', 1.3),
        ('freezes', 'to the last bit while its drive moves', 1.3),
        ('reads a tenth', 'while its drive presses', 2.6),
    ],
)
def test_grip_force_is_stopped_by_a_sensor_that_its_drive_contradicts(
    dies: str, fault: str, most: float, joints: int
) -> None:
    law = GripForce(QUICK, (0, 1), (1, -1), [SOFT, SOFT], ('index', 'thumb'))
    law.enable()
    for _ in range(30):
        law.step(OPEN, 0.01)
    law.grasp(2.0)
    rng = np.random.default_rng(1)
    shares = {'freezes': (1.0, 1.0), 'reads nothing': (1.0, 0.0), 'reads a tenth': (0.1, 0.1)}
    for step in range(400):
        command = np.nan_to_num([one.command for one in law.laws])
        true = SOFT.own * np.maximum(command - 0.4, 0.0)
        normal = np.minimum(true * shares[dies], 1.0 if dies == 'freezes' else np.inf)
        normal = normal + 0.02 * rng.normal(size=2) * (normal < 1.0)
        given = dataclasses.replace(
            OPEN,
            normal=normal,
            closure=np.minimum(command, 0.4),
            pressed=true + 0.1 if step % joints == 0 else np.full(2, np.nan),
        )
        made = law.step(given, 0.01)
        if made.fault:
            break
    assert fault in made.fault
    assert true.max() < most * 2.0


@pytest.mark.parametrize('stops', ['disable', 'abandon', 'new target'])
def test_grip_force_goes_on_from_what_it_holds(stops: str) -> None:
    one = Run()
    one.grasp()
    before = len(one.forces)
    if stops != 'new target':
        one.law.disable() if stops == 'disable' else one.law.abandon('joint states are stale')
        assert not one.run(0.3).send
        one.law.enable()
    wanted = 3.0 if stops == 'new target' else 2.0
    one.law.grasp(wanted)
    assert one.run(2.0).settled
    assert np.min(one.forces[before:]) > 0.95 * 2.0
    assert one.forces[-1][0] == pytest.approx(wanted, rel=0.02)


def test_grip_force_presses_what_is_held_already_as_the_drive_does() -> None:
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


@pytest.mark.parametrize('action', ['hold', 'open'])
def test_grip_force_takes_the_safe_action_without_any_input(action: str) -> None:
    one = Run(dataclasses.replace(QUICK, safe_action=action))
    one.grasp()
    one.run(1.0)
    one.change = {'tangential': np.array([1.0])}
    assert one.run(0.5).loaded
    one.change = {'age': np.array([1.0])}
    made = one.run(1.0)
    assert not made.loaded  # or joints would be held against the opening
    assert (made.phase, made.refusal) == (GripPhase.FAULT, 'finger 0 is stale (1.000 s)')
    assert made.send == (action == 'open')
    assert (one.world.force[0] < 0.1) == (action == 'open')
    one.change = {}
    assert one.run(0.3).phase == (GripPhase.HOLD if action == 'hold' else GripPhase.RELEASE)


def test_grip_force_integrates_no_force_twice() -> None:
    one = Run()
    one.grasp(0.6)
    one.change = {'new': np.zeros(1, bool)}
    one.run(0.1)
    assert np.ptp([float(made.closure[0]) for made in one.made[-6:]]) == 0.0


def test_grip_force_leaves_no_limit_or_rate_by_hostile_inputs() -> None:
    rng = np.random.default_rng(3)
    for _ in range(60):
        law, last = active(QUICK, (0, 1), (1, -1), [SOFT, Drive(5.0, 300.0)]), None
        calm = rng.random()
        for _ in range(40):
            pair = [np.where(rng.random(2) < calm, 0.1 * rng.random(2), rng.choice(HOSTILE, 2))
                    for _ in range(6)]  # fmt: skip
            given = GripInput(
                pair[0], pair[1], rng.random(2) < 0.9, rng.integers(-1, 2, 2).astype(np.int8),
                np.abs(pair[2]), pair[3], rng.choice([0.0, 0.0, *HOSTILE]), sigma=pair[4],
                pressed=pair[5],
            )  # fmt: skip
            made = law.step(given, 0.01)
            if not made.send:
                continue
            assert np.isfinite(made.closure).all()
            assert (made.closure <= 3.0).all()
            assert (made.closure >= -4.0).all()
            if last is not None:
                moved = np.abs(made.closure - last)
                assert (moved <= np.array([5.0, 1.0]) * 0.01 + 1e-9).all()
            last = made.closure


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (((), None), 'drives of GripForce must be numbers from 0 without gaps'),
        (((0, 2), None), 'drives of GripForce must be numbers from 0 without gaps'),
        (((0, 1), (1, 2)), 'sides of GripForce must be -1, 0 or 1'),
    ],
)
def test_grip_force_refuses_fingers(arguments: tuple[object, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        GripForce(CONFIG, *arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize('force', [0.0, -1.0, np.nan, 11.0, [2.0, 0.0]])
def test_grip_force_refuses_targets_and_misfits(force: object) -> None:
    law = GripForce(CONFIG, (0, 1))
    with pytest.raises(ValueError, match='the law is not active'):
        law.grasp(2.0)
    law.enable()
    with pytest.raises(ValueError, match=r'target_force must be above 0\.1 and at most 10 N'):
        law.grasp(force)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r'new of GripInput must have shape \(2,\)'):
        law.step(dataclasses.replace(OPEN, new=np.zeros(3, bool)), 0.01)
    with pytest.raises(ValueError, match=r'closure of GripInput must have shape \(2,\)'):
        law.step(dataclasses.replace(OPEN, closure=np.zeros(3)), 0.01)
