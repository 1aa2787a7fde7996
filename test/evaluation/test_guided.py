# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Guide of presses on a linear skin; its bag; errors on places held out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.evaluation.bag import write_recording
from tactile_ros.evaluation.guided import (
    CHECK_FRAMES,
    HeldOut,
    Phase,
    Preflight,
    PressGuide,
    Target,
    grid_of,
    held_out,
    joined,
    where_in_words,
)
from tactile_ros.evaluation.recording_files import load
from tactile_ros.evaluation.replay import with_tare_rows
from tactile_ros.types import ContactStates, Frame, Layout, Recording, TaxelStatus

PITCH = 5e-3
PLACES = PITCH * np.array([[x, y, 0.0] for y in range(4) for x in range(4)])
LAYOUT = Layout(PLACES, ('output',), '1', rate_hz=100.0, sensor='taxel_array')
NOISE = 5e-4


@dataclass
class Skin:
    """Readings of a skin that is pressed where the guide says, as fast as frames are asked for."""

    guide: PressGuide
    seed: int = 0
    drift: float = 0.0

    def __post_init__(self) -> None:
        self.rng, self.frames, self.load = np.random.default_rng(self.seed), 0, 0.0

    def next(self, load: float) -> Frame:
        number = self.guide.number
        place = PLACES[5] if number is None else self.guide.targets[number].position
        spread = np.exp(-0.5 * np.square((PLACES - place) / PITCH).sum(axis=1))
        self.frames += 1
        values = 0.1 + self.drift * self.frames + 0.05 * load * spread
        values = values + NOISE * self.rng.normal(size=len(PLACES))
        return Frame(self.frames * 10_000_000, self.frames, values[:, None])

    def until(self, phase: Phase, load: float = 0.0, force: float | None = None) -> None:
        """Feed the guide until it says so."""
        true = np.array([np.nan, np.nan, 7.0 + (load if force is None else force)])
        for _ in range(1000):
            self.guide.step(self.next(load), true)
            if self.guide.phase is phase:
                return
        raise AssertionError((phase, self.guide))

    def press(self, load: float) -> None:
        self.until(Phase.HOLD, load)
        self.until(Phase.RELEASE, load)
        self.until(Phase.REST)


def guide_of(*targets: Target, **options: object) -> PressGuide:
    return PressGuide(LAYOUT, [*targets], hold_s=0.3, **options)  # type: ignore[arg-type]


def pressed(loads: tuple[float, ...], **options: object) -> PressGuide:
    guide = guide_of(*(Target(place) for place in PLACES[: len(loads)]), **options)
    skin = Skin(guide, drift=1e-5)
    for one in loads:
        skin.until(Phase.PRESS)
        skin.press(one)
    skin.until(Phase.DONE)
    return guide


def test_guide_keeps_each_press_with_its_rest_and_its_truth() -> None:
    guide = pressed((1.0, 2.0, 3.0))
    assert [number for number, _ in guide.presses] == [0, 1, 2]
    for number, one in guide.presses:
        assert one.tare.sum() == 30
        held = one.truth['in_contact'] == 1
        assert held.sum() >= 30
        np.testing.assert_array_equal(one.truth['position'][held], PLACES[[number] * held.sum()])
        assert np.isnan(one.truth['position'][~held]).all()
        # less what the scale said at rest
        np.testing.assert_allclose(one.truth['force'][held, 2], number + 1.0)


def test_guide_takes_weights_and_places_as_they_are_told() -> None:
    guide = guide_of(Target(PLACES[5], load=2.0))
    skin = Skin(guide)
    skin.until(Phase.PRESS)
    moved = PLACES[5] + 1e-3
    while guide.phase is not Phase.REST:
        guide.step(skin.next(float(guide.phase in (Phase.PRESS, Phase.HOLD))), position=moved)
    ((_, one),) = guide.presses
    held = one.truth['in_contact'] == 1
    np.testing.assert_array_equal(one.truth['force'][held], [[np.nan, np.nan, 2.0]] * held.sum())
    np.testing.assert_allclose(one.truth['position'][held], [moved] * held.sum())


def test_guide_follows_a_force_that_moves() -> None:
    guide = guide_of(Target(PLACES[5]), steady_truth=False)
    skin = Skin(guide)
    skin.until(Phase.PRESS)
    for one in (*np.linspace(0.2, 2.0, 20), *[2.0] * 100):
        guide.step(skin.next(one), np.array([0.0, 0.0, 7.0 + one]))
    skin.until(Phase.REST)
    force = guide.presses[0][1].truth['force'][:, 2]
    assert np.nanmin(force) < 1.0 < np.nanmax(force)


def test_guide_refuses_a_press_that_is_too_short() -> None:
    guide = guide_of(Target(PLACES[5]))
    skin = Skin(guide)
    skin.until(Phase.PRESS)
    skin.until(Phase.HOLD, 1.0)
    skin.until(Phase.REST)
    assert guide.remark == 'held too short: press there again'
    assert not guide.presses
    skin.until(Phase.PRESS)
    skin.press(1.0)
    assert (len(guide.presses), guide.remark) == (1, '')


def test_guide_labels_no_press_that_overshoots_and_no_force_without_its_rest() -> None:
    guide = guide_of(Target(PLACES[5], load=1.0), Target(PLACES[5]))
    skin = Skin(guide)
    skin.until(Phase.PRESS)
    for one in [4.0] * 8 + [1.0] * 60 + [0.0] * 10:  # a weight that is dropped
        guide.step(skin.next(one))
    held = guide.presses[0][1].truth['in_contact'] == 1
    assert 30 <= held.sum() <= 60
    assert not held[30:38].any()
    # a scale that was silent at rest says nothing of the press: its offset is unknown
    while guide.phase is not Phase.PRESS:
        guide.step(skin.next(0.0))
    skin.press(1.0)
    assert 'force' in guide.presses[0][1].truth
    guide = guide_of(Target(PLACES[5]))
    skin = Skin(guide)
    while guide.phase is not Phase.PRESS:
        guide.step(skin.next(0.0))
    skin.press(1.0)
    assert 'force' not in guide.presses[0][1].truth


def test_guide_takes_no_weight_that_lies_on_for_the_next_rest() -> None:
    guide = guide_of(Target(PLACES[5]), Target(PLACES[6]))
    skin = Skin(guide)
    skin.until(Phase.PRESS)
    skin.until(Phase.RELEASE, 1.0)
    for _ in range(9000):
        guide.step(skin.next(1.0))
    assert (guide.phase, len(guide.presses)) == (Phase.RELEASE, 0)
    assert guide.remark.startswith('let go: the readings do not come back')
    assert len(guide._pressed) <= 6000  # nothing grows
    skin.until(Phase.REST)
    assert len(guide.presses) == 1
    # creep that stays is no weight: it ends after a while
    skin.until(Phase.PRESS)
    skin.until(Phase.RELEASE, 1.0)
    for _ in range(1000):
        guide.step(skin.next(0.4))
    skin.until(Phase.REST, 0.4)
    assert len(guide.presses) == 2


@pytest.mark.parametrize('level', [0.0, 0.1, 100.3])
def test_guide_sees_touches_of_a_sensor_without_noise(level: float) -> None:
    guide = guide_of(Target(PLACES[5]))
    for i in range(400):
        values = np.full((16, 1), level)
        values[3] = np.nan  # dead
        values[5] += guide.phase in (Phase.PRESS, Phase.HOLD) and i > 200
        guide.step(Frame(i, i, values))
        assert i > 200 or guide.phase in (Phase.CHECK, Phase.REST, Phase.PRESS)
    assert (guide.phase, len(guide.presses)) == (Phase.DONE, 1)


def test_guide_learns_slow_noise_and_waits_for_readings() -> None:
    guide, rng, values = guide_of(Target(PLACES[5])), np.random.default_rng(0), np.zeros((16, 1))
    phases = set()
    for i in range(3000):
        values = 0.98 * values + 0.2 * rng.normal(size=(16, 1))
        guide.step(Frame(i, i, values))
        phases.add(guide.phase)
    assert phases == {Phase.CHECK, Phase.REST, Phase.PRESS}
    guide = guide_of(Target(PLACES[5]))
    for i in range(2000):
        guide.step(Frame(i, i, np.full((16, 1), np.nan)))
    assert guide.phase is Phase.REST
    assert guide.remark.startswith('the readings wander')


def test_guide_asks_again_and_goes_on_after_a_crash() -> None:
    first = pressed((1.0, 2.0))
    again = guide_of(*first.targets, presses=first.presses[:1])
    assert again.number == 1
    twice = guide_of(*first.targets, presses=[*first.presses[:1]] * 2)
    assert (twice.number, twice.wanted.tolist()) == (1, [2, 1])
    first.repeat([1])
    assert (first.number, first.phase) == (1, Phase.REST)
    assert first.wanted.tolist() == [1, 2]


def test_guide_calls_no_quiet_skin_touched() -> None:
    guide = guide_of(Target(PLACES[5]))
    skin = Skin(guide, seed=3, drift=2e-6)
    skin.until(Phase.PRESS)
    for _ in range(3000):
        guide.step(skin.next(0.0))
        assert guide.phase is Phase.PRESS


def test_preflight_names_what_is_wrong() -> None:
    rng = np.random.default_rng(0)
    layout = Layout(PLACES[:4], ('Bx', 'By', 'Bz'), 'T', rate_hz=100.0)
    values = 3e-5 + 1e-7 * rng.normal(size=(CHECK_FRAMES, 4, 3))
    values[:, 1] = 0.0
    values[:, 2] += 3e-6 * rng.normal(size=(CHECK_FRAMES, 3))
    status = np.array([0, 0, 0, TaxelStatus.SATURATED], np.uint8)
    found = Preflight.of(layout, [Frame(i, i, one, status=status) for i, one in enumerate(values)])
    assert found.problems == (
        'taxels [1] do not change at rest: dead, or their steps are too coarse to tell',
        'taxels [3] are saturated at rest',
        'taxels [2] are ten times as noisy as the others',
        'uniform field at rest: 52 uT (magnets and stray)',
    )  # fmt: skip
    assert (found.noise > 0).all()


def test_grid_covers_the_layout() -> None:
    places = grid_of(LAYOUT, 24)
    assert 16 <= len(places) <= 30
    for edge in (0, 3):
        for axis in (0, 1):
            assert (np.abs(places[:, axis] - edge * PITCH) < 1e-9).any()
    line = Layout(PLACES[:4], ('output',), '1')
    np.testing.assert_array_equal(grid_of(line, 20), PLACES[:4])


def test_bag_of_presses_reads_back_as_they_were(tmp_path: Path) -> None:
    guide = pressed((1.0, 2.0))
    whole = joined(guide.presses, guide.targets)
    write_recording(whole, tmp_path / 'bag')
    (found,) = load(tmp_path / 'bag').recordings
    back, problem = with_tare_rows(found)
    assert problem == ''
    np.testing.assert_array_equal(back.values, whole.values)
    np.testing.assert_array_equal(back.tare, whole.tare)
    for name in ('position', 'force', 'in_contact', 'repetition'):
        np.testing.assert_allclose(back.truth[name], whole.truth[name], err_msg=name)


class Summing:
    """Force as the sum of all changes of readings, times what it learned."""

    def fit(self, one: Recording) -> Summing:
        held = one.truth['in_contact'] == 1
        self.newtons = one.truth['force'][held, 2].mean() / self.changes(one)[held].mean()
        return self

    def changes(self, one: Recording) -> np.ndarray:
        return (one.values - one.values[one.tare].mean(axis=0)).sum(axis=(1, 2))

    def process_batch(self, one: Recording) -> ContactStates:
        force = np.zeros((len(one), 3))
        force[:, 2] = self.newtons * self.changes(one)
        return ContactStates.assemble(len(one), 16, {'force': force})


def test_errors_are_of_places_that_were_not_learned() -> None:
    rng = np.random.default_rng(1)
    guide = pressed(tuple(rng.uniform(0.5, 3.0, 16)))
    found = held_out(Summing, guide.presses, guide.targets)
    assert np.isfinite(found.force).all()
    assert 0.1 < np.sqrt(np.mean(found.force**2)) < 1.0
    assert str(found).startswith('force 0.')
    # a hold of ten times as many frames costs no more, and has the same error
    rows = [np.r_[np.flatnonzero(p.tare), np.repeat(np.flatnonzero(~p.tare), 10)]
            for _, p in guide.presses]  # fmt: skip
    longer = [(n, p.select(r)) for (n, p), r in zip(guide.presses, rows, strict=True)]
    lengths: list[int] = []

    class Counted(Summing):
        def fit(self, one: Recording) -> Summing:
            lengths.append(len(one))
            return super().fit(one)

    again = held_out(Counted, longer, guide.targets)
    np.testing.assert_allclose(again.force, found.force, rtol=0.1)
    assert max(lengths) <= 15 * (max(int(p.tare.sum()) for _, p in longer) + 25)


def test_worst_presses_are_above_their_goal_or_twice_the_median() -> None:
    errors = HeldOut(np.array([1.0, 1.1, 0.9, 2.5]) * 1e-3, np.full(4, np.nan))
    assert errors.worst(None, None) == [3]
    assert errors.worst(1e-3, None) == [1, 3]
    assert str(errors) == 'place 1.5 mm (RMS of 4 presses)'
    assert where_in_words(PLACES[[0, 15]], PLACES) == 'at the rim'
    assert where_in_words(PLACES[[5]], PLACES) == 'in the middle'
