"""The grip-force law: never outside limits, safe when inputs fail, and good at its work."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.control import (
    GraspOutcome,
    GraspSequence,
    GripConfig,
    GripForce,
    GripInput,
    GripPhase,
    GripStep,
    qb_softhand,
)
from tactile_ros.control.force_pi import FARTHEST
from tactile_ros.control.grip_force import GripWatch, refuse_step
from tactile_ros.types import Array, ContactState


def state(force: tuple[float, float, float], valid: bool = True, slip: int = 0) -> ContactState:
    known = {
        'force': np.array([force]), 'valid': np.array([valid]),
        'slip': np.array([slip], np.int8),
    }  # fmt: skip
    return ContactState.assemble(2, known)


def test_forces_come_from_states() -> None:
    given = GripInput.of(
        [state((3.0, 4.0, 2.0), slip=1), None, state((np.nan, np.nan, 1.0), valid=False)],
        [0.0, 1.0, 0.01], [0.2], 0.0,
    )  # fmt: skip
    np.testing.assert_array_equal(given.normal, [2.0, np.nan, 1.0])
    np.testing.assert_array_equal(given.tangential, [5.0, np.nan, np.nan])
    assert given.valid.tolist() == [True, False, False]
    assert given.slip.tolist() == [1, -1, 0]


def test_misfits_are_named() -> None:
    with pytest.raises(ValueError, match=r'age of GripInput must have shape \(1,\)'):
        GripInput.of([None], [0.0, 0.0], [0.2], 0.0)
    given = GripInput.of([None], [0.0], [0.2], 0.0)
    with pytest.raises(ValueError, match=r'closure of GripInput must have shape \(2,\)'):
        given.refuse_misfit(1, 2)
    with pytest.raises(ValueError, match=r'normal of GripInput must have shape \(3,\)'):
        given.refuse_misfit(3, 1)
    given.refuse_misfit(1, 1)
    crossed = dataclasses.replace(given, new=np.zeros(2, bool))
    with pytest.raises(ValueError, match=r'new of GripInput must have shape \(1,\)'):
        crossed.refuse_misfit(1, 1)


CONFIG = GripConfig()
GOOD = GripInput(
    np.array([1.0, 2.0]), np.array([0.1, 0.2]), np.array([True, True]),
    np.zeros(2, np.int8), np.array([0.01, 0.02]), np.array([0.3, 0.3]), 0.03,
)  # fmt: skip


def judged(config: GripConfig = CONFIG, **change: object) -> tuple[str, GripWatch]:
    watch = GripWatch(config, 2)
    given = dataclasses.replace(GOOD, **change)  # type: ignore[arg-type]
    return watch.judge(given, given.normal.tolist(), [True, True]), watch


def test_good_inputs_pass_with_the_oldest_age() -> None:
    why, watch = judged()
    assert not why
    assert watch.good == [True, True]
    assert watch.age == 0.03


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'age': np.array([0.2, 0.0])}, 'finger 0 is stale (0.200 s)'),
        ({'age': np.array([0.0, -0.5])}, 'finger 1 is stale (-0.500 s)'),
        ({'age': np.array([np.nan, 0.0])}, 'finger 0 is stale (nan s)'),
        ({'valid': np.array([True, False])}, 'finger 1 says that it is not valid'),
        ({'normal': np.array([np.nan, 1.0])}, 'finger 0 gives a force that is not a number'),
        ({'normal': np.array([1.0, np.inf])}, 'finger 1 gives a force that is not a number'),
        ({'closure_age': 0.2}, 'joint states are stale (0.200 s)'),
        ({'closure': np.array([0.3, np.nan])}, 'closure of drive 1 is not a number'),
        ({'blocked': 'no order yet'}, 'no order yet'),
        ({'blocked': 'no order yet', 'age': np.full(2, np.inf)}, 'no order yet'),
    ],
)
def test_each_refusal_has_its_sentence(change: dict[str, object], sentence: str) -> None:
    why, _ = judged(dataclasses.replace(CONFIG, fewest_fingers=2), **change)
    assert why == sentence


def test_one_finger_of_two_is_enough_unless_told() -> None:
    why, watch = judged(valid=np.array([True, False]))
    assert not why
    assert watch.good == [True, False]


def test_a_hand_without_joint_states_may_be_allowed() -> None:
    config = dataclasses.replace(CONFIG, closure_required=False)
    assert not judged(config, closure_age=np.inf, closure=np.full(2, np.nan))[0]
    assert judged(config, blocked='no order yet')[0] == 'no order yet'


@pytest.mark.parametrize('dt', [0.0, -0.01, np.nan, np.inf, 0.2])
def test_time_steps_that_cannot_be(dt: float) -> None:
    assert refuse_step(dt, 0.1).startswith('time step must be above 0 and at most 0.100 s')
    assert not refuse_step(0.01, 0.1)


def grip_input(force: float) -> GripInput:
    return GripInput(
        np.array([force, np.nan]), np.array([0.1, 0.1]), np.array([True, True]),
        np.zeros(2, np.int8), np.array([0.02, 0.01]), np.array([0.3, 0.3]), 0.0,
    )  # fmt: skip


def test_every_field_is_told_in_its_shape() -> None:
    law = GripForce(GripConfig(), (0, 1))
    law.enable()
    law.grasp(2.0)
    for _ in range(5):
        made = law.step(grip_input(1.0), 0.01)
    assert set(vars(made)) == {field.name for field in dataclasses.fields(GripStep)}
    assert made.force[0] == 1.0
    assert np.isnan(made.force[1])
    assert made.touching.tolist() == [True, False]
    assert made.touching.dtype == made.slipping.dtype == bool
    assert made.load[0] == 0.1
    assert made.input_age == 0.02
    for name in ('closure', 'stiffness', 'stiffness_std'):
        assert getattr(made, name).shape == (2,)


def test_a_later_step_does_not_change_it() -> None:
    law = GripForce(GripConfig(), (0, 1))
    law.enable()
    law.grasp(2.0)
    first = law.step(grip_input(0.0), 0.01)
    kept = first.closure.copy()
    law.step(grip_input(0.0), 0.01)
    np.testing.assert_array_equal(first.closure, kept)


ANY = st.floats(allow_nan=True, allow_infinity=True)
NEAR = 1e-12
QB = {'dead_time': 0.1, 'lag': 0.1, 'rate_hz': 25.0}
TARGET = 2.0


def quiet(fingers: int = 2, drives: int = 2, force: float = 0.0) -> GripInput:
    return GripInput(
        np.full(fingers, force), np.zeros(fingers), np.ones(fingers, bool),
        np.zeros(fingers, np.int8), np.zeros(fingers), np.full(drives, 0.2), 0.0,
    )  # fmt: skip


def closing(config: GripConfig | None = None, **asked: object) -> GripForce:
    law = GripForce(GripConfig() if config is None else config, (0, 1), (1, -1))
    law.enable()
    law.grasp(TARGET, **asked)  # type: ignore[arg-type]
    return law


@st.composite
def inputs(draw: st.DrawFn) -> GripInput:
    def numbers(count: int) -> Array:
        near = st.floats(0, 3)
        return np.array(draw(st.lists(near | ANY, min_size=count, max_size=count)), np.float64)

    bits = st.lists(st.booleans(), min_size=2, max_size=2)
    ages = np.array(draw(st.lists(st.just(0.0) | ANY, min_size=2, max_size=2)))
    slips = np.array(draw(st.lists(st.sampled_from([-1, 0, 1]), min_size=2, max_size=2)), np.int8)
    return GripInput(
        numbers(2), numbers(2), np.array(draw(bits)), slips, ages, numbers(2),
        draw(st.just(0.0) | ANY),
    )  # fmt: skip


EVENTS = st.lists(
    st.tuples(
        inputs(),
        st.floats(0.001, 0.1) | ANY,
        st.sampled_from(['', '', '', '', 'grasp', 'release', 'disable', 'enable']),
    ),
    max_size=30,
)


@pytest.mark.parametrize('action', ['hold', 'open'])
@settings(max_examples=60, deadline=None)
@given(EVENTS)
def test_no_input_makes_a_command_outside_limits_or_rate(
    action: str, events: list[tuple[GripInput, float, str]]
) -> None:
    config = GripConfig(safe_action=action, closure_low=0.05, closure_high=0.8)
    law, last, low = closing(config), None, 0.05  # or where a hand was that is opened further
    for given_, dt, event in events:
        idle = law.phase == GripPhase.IDLE
        if event == 'grasp':
            law.enable()
            law.grasp(1.0)
        elif event:
            getattr(law, event)()
        last = None if event in ('enable', 'disable') or (event and idle) else last
        made = law.step(given_, dt)
        assert not made.send or law.active
        assert made.send or made.refusal
        if not made.send:
            continue
        low = min(low, np.min(given_.closure, initial=0.05, where=np.isfinite(given_.closure)))
        assert ((made.closure >= max(low, 0.05 - FARTHEST)) & (made.closure <= 0.8)).all()
        if last is not None:
            assert (np.abs(made.closure - last) <= config.closure_rate * dt + NEAR).all()
        last = made.closure
        assert np.isfinite(made.target_force).all()


def test_the_first_command_starts_from_the_measured_closure() -> None:
    law = closing()
    start = dataclasses.replace(quiet(), closure=np.array([0.31, 0.47]))
    made = law.step(start, 0.01)
    assert (made.closure >= start.closure).all()
    assert (made.closure - start.closure <= 0.25 * 0.01 + NEAR).all()


@pytest.mark.parametrize('begin', ['grasp', 'release'])
def test_a_hand_that_was_left_alone_starts_from_the_measured_closure_again(begin: str) -> None:
    law = closing()
    for _ in range(50):
        law.step(quiet(), 0.01)
    law.release()
    while law.step(quiet(), 0.01).phase != GripPhase.IDLE:
        pass
    law.grasp(TARGET) if begin == 'grasp' else law.release()
    moved = dataclasses.replace(quiet(), closure=np.array([0.31, 0.97]))
    made = law.step(moved, 0.01)
    assert made.send
    np.testing.assert_allclose(made.closure, moved.closure, atol=0.5 * 0.01 + NEAR)


def test_a_hand_that_was_given_up_waits_for_a_new_grasp_and_says_why() -> None:
    law = closing()
    law.step(quiet(), 0.01)
    law.abandon('joint states are stale (1.200 s)')
    for _ in range(20):
        made = law.step(quiet(force=1.0), 0.01)
        assert (made.send, made.phase) == (False, GripPhase.IDLE)
    assert made.refusal == 'joint states are stale (1.200 s); a new grasp is needed'
    law.grasp(TARGET)
    assert law.step(quiet(), 0.01).send
    law.release('the object was lost')
    opening = law.step(quiet(), 0.01)
    assert (opening.send, opening.refusal) == (True, 'the object was lost')
    while law.step(quiet(), 0.01).phase != GripPhase.IDLE:
        pass
    assert law.step(quiet(), 0.01).refusal == 'the object was lost; a new grasp is needed'


def test_never_a_command_when_not_active_or_not_asked() -> None:
    law = GripForce(GripConfig(), (0, 1))
    assert law.step(quiet(), 0.01).refusal == 'not active'
    law.enable()
    idle = law.step(quiet(), 0.01)
    assert (idle.send, idle.phase) == (False, GripPhase.IDLE)
    assert idle.refusal == 'no grasp was asked for'
    law.grasp(TARGET)
    assert law.step(quiet(), 0.01).send
    law.disable()
    assert not law.step(quiet(), 0.01).send
    with pytest.raises(ValueError, match='grasp must follow enable'):
        law.grasp(TARGET)


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (((0, 2), None), r'must be numbers from 0 without gaps; received \[0, 2\]'),
        (((), None), 'drives of GripForce must be numbers from 0'),
        (((0, 1), (1,)), 'sides of GripForce must be -1, 0 or 1 for each finger'),
        (((0, 1), (1, 2)), 'sides of GripForce must be -1, 0 or 1 for each finger'),
    ],
)  # fmt: skip
def test_fingers_that_cannot_be(arguments: tuple[object, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        GripForce(GripConfig(), *arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize('force', [0.0, -1.0, np.nan, 11.0, [1.0, np.inf]])
def test_targets_that_cannot_be(force: object) -> None:
    law = closing()
    with pytest.raises(ValueError, match=r'target_force must be above 0\.15 and at most 10\.0 N'):
        law.grasp(force)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match='fingers of grasp must name at least one of 2'):
        law.grasp(1.0, fingers=[False, False])


def test_phases_in_their_order(worlds: ModuleType) -> None:
    _, phases, _ = grip(worlds.GripWorld(gains=(1.0, 1.0), free=True), sides=(1, -1))
    seen = [phases[0], *(b for a, b in pairwise(phases) if a != b)]
    assert seen == [GripPhase.CLOSE, GripPhase.TOUCH, GripPhase.LOAD, GripPhase.HOLD]


def grip(
    world: object,
    config: GripConfig | None = None,
    sides: tuple[int, ...] | None = None,
    seconds: float = 8.0,
) -> tuple[Array, list[GripPhase], GripStep]:
    """Forces (s, f) and phases of a grasp of 2 N, and its last step."""
    config = GripConfig() if config is None else config
    law = GripForce(config, range(len(world.gains)), sides)  # type: ignore[attr-defined]
    law.enable()
    law.grasp(TARGET, adapt=False)
    forces, phases = [], []
    for _ in range(round(seconds * config.rate_hz)):
        made = law.step(world.given(), 1 / config.rate_hz)  # type: ignore[attr-defined]
        world.advance(made)  # type: ignore[attr-defined]
        forces.append(world.force)  # type: ignore[attr-defined]
        phases.append(made.phase)
    return np.array(forces), phases, made


def figures(forces: Array, phases: list[GripPhase], rate_hz: float) -> tuple[float, float, float]:
    """Overshoot, time from load until within five percent (s), steady error, of the target."""
    error = np.abs(forces / TARGET - 1).max(axis=1)
    outside = np.flatnonzero(error > 0.05)
    begins = phases.index(GripPhase.LOAD)
    settled = (outside.max() + 1 - begins) / rate_hz
    steady = np.abs(forces[-len(forces) // 5 :].mean(axis=0) / TARGET - 1).max()
    return float(forces.max() / TARGET - 1), float(settled), float(steady)


@pytest.mark.parametrize('stiffness', [8.0, 15.0, 60.0, 150.0, 300.0])
@pytest.mark.parametrize('seed', [0, 1, 2])
def test_a_quick_hand_holds_balloon_and_steel(
    worlds: ModuleType, stiffness: float, seed: int
) -> None:
    forces, phases, _ = grip(worlds.GripWorld(stiffness=stiffness, seed=seed))
    over, settled, steady = figures(forces, phases, 100.0)
    assert over <= 0.10
    assert settled <= 0.5
    assert steady <= 0.02


@pytest.mark.parametrize('stiffness', [8.0, 20.0, 60.0, 120.0])
@pytest.mark.parametrize('seed', [0, 1, 2])
def test_a_slow_hand_too(worlds: ModuleType, stiffness: float, seed: int) -> None:
    world = worlds.GripWorld(stiffness=stiffness, seed=seed, **QB)
    forces, phases, _ = grip(world, qb_softhand(), seconds=12.0)
    over, settled, steady = figures(forces, phases, 25.0)
    assert over <= 0.10
    assert settled <= 1.5
    assert steady <= 0.02


@pytest.mark.parametrize(
    'other', [{'dead_time': 0.03}, {'lag': 0.08}, {'lag': 0.03}, {'noise': 0.03}]
)
def test_a_hand_that_is_not_as_told_still_settles(
    worlds: ModuleType, other: dict[str, float]
) -> None:
    forces, phases, _ = grip(worlds.GripWorld(stiffness=60.0, **other))
    over, settled, steady = figures(forces, phases, 100.0)
    assert over <= 0.10
    assert settled <= 1.0
    assert steady <= 0.02


def test_an_object_that_stiffens(worlds: ModuleType) -> None:
    forces, phases, _ = grip(worlds.GripWorld(stiffness=200.0, exponent=1.5))
    over, _, steady = figures(forces, phases, 100.0)
    assert over <= 0.10
    assert steady <= 0.02


def test_sensors_that_disagree_do_not_walk_the_object(worlds: ModuleType) -> None:
    """Two fingers whose sensors differ by ten percent: the object stays, the force is between."""
    world = worlds.GripWorld(gains=(1.0, 1.1), free=True)
    forces, _, _ = grip(world, sides=(1, -1), seconds=4.0)
    place = world.place
    forces, _, _ = grip(world, sides=(1, -1), seconds=8.0)
    assert forces[-1] == pytest.approx(TARGET / 1.05, rel=0.01)
    assert abs(world.place - place) < 2e-3


def test_a_sensor_that_fails_does_not_let_the_others_crush(worlds: ModuleType) -> None:
    """One finger reads a tenth of the truth: the other rules, and the step says they disagree."""
    world = worlds.GripWorld(gains=(1.0, 0.1), free=True)
    forces, phases, made = grip(world, sides=(1, -1))
    assert forces[-1] == pytest.approx(1.2 * TARGET, rel=0.02)
    assert forces.max() <= 1.5 * TARGET  # without a bound 2.2
    assert phases[-1] == GripPhase.HOLD
    assert made.disagreement == pytest.approx(0.9, abs=0.03)


def test_without_sides_they_would(worlds: ModuleType) -> None:
    world = worlds.GripWorld(gains=(1.0, 1.1), free=True)
    grip(world, seconds=12.0)
    assert abs(world.place) > 0.02


def test_a_lost_sensor_leaves_the_others_at_work(worlds: ModuleType) -> None:
    world = worlds.GripWorld(gains=(1.0, 1.0), free=True)
    config = GripConfig()
    law = GripForce(config, (0, 1), (1, -1))
    law.enable()
    law.grasp(TARGET, adapt=False)
    for i in range(1000):
        felt = world.given()
        if i > 500:
            felt = dataclasses.replace(felt, valid=np.array([True, False]))
        if i == 700:
            law.grasp(3.0, adapt=False)
        made = law.step(felt, 0.01)
        world.advance(made)
        held = made.closure[1] if i == 501 else held if i > 501 else np.nan  # noqa: F821
    assert made.send
    assert made.closure[1] == held
    assert np.isnan(made.force[1])
    assert world.force == pytest.approx(3.0, rel=0.02)


NEWS = st.lists(
    st.tuples(st.lists(st.booleans(), min_size=2, max_size=2), st.floats(0.0, 4.0)), max_size=30
)


@settings(max_examples=60, deadline=None)
@given(NEWS, st.floats(0.0, 4.0), st.lists(st.booleans(), min_size=6, max_size=20))
def test_a_force_that_is_not_new_moves_nothing_for_long(
    history: list[tuple[list[bool], float]], force: float, first: list[bool]
) -> None:
    """Whatever went before, and whether one finger is silent or both: one step, then still."""
    law = closing()
    for new, other in history:
        law.step(dataclasses.replace(quiet(force=other), new=np.array(new)), 0.01)
    last = law.step(quiet(force=force), 0.01).closure
    path = [last]
    for one in first:  # the other finger is silent
        given_ = dataclasses.replace(quiet(force=force), new=np.array([one, False]))
        path.append(law.step(given_, 0.01).closure)
    moved = np.diff(path, axis=0)
    assert not moved[1:].any()
    assert (np.abs(moved) <= 0.01 * law.config.closure_rate + NEAR).all()


def test_the_old_force_counts_once(worlds: ModuleType) -> None:
    """Sensors four times slower than the law: the same grip, a little calmer."""
    config = GripConfig(input_rate_hz=25.0)
    for stiffness in (15.0, 60.0, 150.0):
        world = worlds.GripWorld(stiffness=stiffness)
        law = GripForce(config, (0,))
        law.enable()
        law.grasp(TARGET, adapt=False)
        forces, phases = [], []
        for i in range(1000):
            felt = world.given() if i % 4 == 0 else felt  # noqa: F821
            given_ = dataclasses.replace(felt, new=np.array([i % 4 == 0]))
            made = law.step(given_, 0.01)
            world.advance(made)
            forces.append(world.force)
            phases.append(made.phase)
        over, settled, steady = figures(np.array(forces), phases, 100.0)
        assert over <= 0.10
        assert settled <= 1.0
        assert steady <= 0.02


@pytest.mark.parametrize('action', ['hold', 'open'])
def test_without_any_input_the_safe_action(worlds: ModuleType, action: str) -> None:
    world = worlds.GripWorld()
    law = GripForce(GripConfig(safe_action=action), (0,))
    law.enable()
    law.grasp(TARGET)
    for _ in range(500):
        before = law.step(world.given(), 0.01)
        world.advance(before)
    stale = dataclasses.replace(world.given(), age=np.array([0.5]))
    made = [law.step(stale, 0.01) for _ in range(10)]
    assert all(one.phase == GripPhase.FAULT for one in made)
    assert all(one.refusal == 'finger 0 is stale (0.500 s)' for one in made)
    if action == 'hold':
        assert not any(one.send for one in made)
        assert all(one.closure == before.closure for one in made)
        assert law.step(world.given(), 0.01).closure == pytest.approx(before.closure, abs=1e-3)
    else:
        assert all(one.send for one in made)
        assert made[-1].closure == pytest.approx(before.closure - 10 * 0.01 * 0.1)
        assert law.step(world.given(), 0.01).phase == GripPhase.RELEASE


def test_a_hand_that_is_silent_is_not_opened_either() -> None:
    law = closing(GripConfig(safe_action='open'))
    law.step(quiet(), 0.01)
    made = law.step(dataclasses.replace(quiet(), closure_age=0.5), 0.01)
    assert (made.send, made.refusal) == (False, 'joint states are stale (0.500 s)')


def test_a_bad_time_step_sends_nothing() -> None:
    law = closing()
    law.step(quiet(), 0.01)
    for dt in (np.nan, -1.0, 0.0, 10.0):
        made = law.step(quiet(), dt)
        assert not made.send
        assert made.refusal.startswith('time step must be')


def test_one_drive_for_several_fingers(worlds: ModuleType) -> None:
    """The mean of the touching fingers is regulated."""
    law = GripForce(GripConfig(), (0, 0))
    law.enable()
    law.grasp(TARGET, adapt=False)
    world = worlds.GripWorld()
    for _ in range(800):
        one = world.given()
        both = dataclasses.replace(
            one, normal=one.normal * [0.8, 1.2], tangential=np.zeros(2),
            valid=np.ones(2, bool), slip=np.zeros(2, np.int8), age=np.zeros(2),
        )  # fmt: skip
        world.advance(law.step(both, 0.01))
    assert world.force == pytest.approx(TARGET, rel=0.02)


def test_slip_raises_the_command(worlds: ModuleType) -> None:
    world = worlds.GripWorld(tangential=0.5)
    law = GripForce(GripConfig(), (0,))
    law.enable()
    law.grasp(TARGET)
    for i in range(900):
        felt = world.given()
        if 500 <= i < 510:
            felt = dataclasses.replace(felt, slip=np.ones(1, np.int8))
        made = law.step(felt, 0.01)
        world.advance(made)
        if i == 499:
            before = made
    assert made.closure > before.closure
    assert made.target_force > 1.2 * before.target_force
    assert world.force > 1.2 * TARGET
    assert 0.0 < made.friction < 0.3


def test_release_opens_at_its_rate_and_ends(worlds: ModuleType) -> None:
    law = closing()
    for _ in range(50):
        law.step(quiet(), 0.01)
    law.release()
    made = [law.step(quiet(), 0.01) for _ in range(100)]
    assert made[0].phase == GripPhase.RELEASE
    assert made[-1].phase == GripPhase.IDLE
    assert not made[-1].send


def test_empty_hand_ends_as_no_object() -> None:
    config = GripConfig()
    law, sequence, closure = closing(config), GraspSequence(config), np.full(2, 0.2)
    for _ in range(1500):
        made = law.step(dataclasses.replace(quiet(), closure=closure), 0.01)
        closure = made.closure
        progress = sequence.step(made, 0.01)
    assert progress.outcome == GraspOutcome.NO_OBJECT
    assert (made.closure <= config.closure_high).all()


def test_a_hand_with_fewer_fingers_is_shut_without_the_others() -> None:
    config = GripConfig()
    law, sequence = closing(config, fingers=(True, False)), GraspSequence(config)
    closure = [0.2, 0.2]
    for _ in range(1500):
        made = law.step(dataclasses.replace(quiet(), closure=np.array(closure)), 0.01)
        closure = made.closure.tolist()
        progress = sequence.step(made, 0.01)
    assert closure == [1.0, 0.2]
    assert progress.outcome == GraspOutcome.NO_OBJECT


def test_a_hand_that_feels_nothing_is_not_shut() -> None:
    law = closing()
    assert not law.step(dataclasses.replace(quiet(), valid=np.zeros(2, bool)), 0.01).shut


def test_a_new_target_in_hand_has_no_bump(worlds: ModuleType) -> None:
    world = worlds.GripWorld()
    law = GripForce(GripConfig(), (0,))
    law.enable()
    law.grasp(TARGET, adapt=False)
    for _ in range(600):
        before = law.step(world.given(), 0.01)
        world.advance(before)
    law.grasp(3.0, adapt=False)
    made = law.step(world.given(), 0.01)
    assert abs(made.closure - before.closure) < 0.01
    for _ in range(100):
        world.advance(made)
        made = law.step(world.given(), 0.01)
    assert world.force == pytest.approx(3.0, rel=0.02)
    assert made.phase == GripPhase.HOLD


def test_a_soft_drive_holds_its_touch_while_it_waits_for_the_other() -> None:
    """Two soft drives at a thing that does not give way; the second comes half a second later."""
    config = GripConfig(
        dead_time=0.02, lag=0.01, stiffness_low=1.0, stiffness_high=20.0, closure_rate=20.0
    )
    law, touched = closing(config), np.array([0.2, 0.3])
    soft, period = 5.0, 1 / config.rate_hz  # N for a closure of the command; s
    sent, free = [np.zeros(2)] * 3, np.zeros(2)  # what waits for the dead time, where it would be
    waited = []
    for _ in range(400):
        free = free + (sent[-3] - free) * (1 - np.exp(-period / config.lag))
        force = soft * np.maximum(free - touched, 0.0)
        measured = np.minimum(free, touched)
        made = law.step(dataclasses.replace(quiet(), normal=force, closure=measured), period)
        sent.append(made.closure)
        if made.phase == GripPhase.TOUCH:
            waited.append(force[0])
        if made.phase == GripPhase.LOAD:
            break
    assert len(waited) * period > 0.2
    assert min(waited) > config.contact_on
    assert max(waited) < 1.5 * config.touch_force


def test_a_hand_opened_beyond_its_open_posture_comes_slowly_and_stops_at_a_touch() -> None:
    law = closing()
    flat = dataclasses.replace(quiet(), closure=np.array([-1.1, -2.0]))
    made = law.step(flat, 0.01)
    np.testing.assert_allclose(made.closure, flat.closure, atol=0.5 * 0.01 + NEAR)
    for _ in range(50):
        made = law.step(dataclasses.replace(quiet(), closure=made.closure), 0.01)
    assert (made.closure < -0.5).all()
    touched = dataclasses.replace(quiet(), normal=np.array([3.0, 3.0]), closure=made.closure)
    for _ in range(50):
        touched = dataclasses.replace(touched, closure=law.step(touched, 0.01).closure)
    assert (touched.closure <= made.closure).all()
