# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The multipole skin's specimens and lesson, and the groups of its fit."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.worlds import multipole_fidelity
from reference import multipole_world as world
from tactile_ros.estimators.few_shot import Presses
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin import twin
from tactile_ros.sensors.multipole_skin.config import nine_heads
from tactile_ros.sensors.multipole_skin.press_fit import FOLDS, Labels, drawn_skin
from tactile_ros.sensors.multipole_skin.recogniser import Recogniser, press_bank
from tactile_ros.sensors.multipole_skin.specimen import NONE, Flaws, Specimen
from tactile_ros.sensors.multipole_skin.twin import NOISE
from tactile_ros.types import Recording

CONFIG = load_sensor('multipole_skin').config()
WHOLE = Specimen(CONFIG, NONE)  # type: ignore[arg-type]


def test_nine_heads_have_the_sizes_of_the_paper() -> None:
    heads = nine_heads()
    for head, size in zip(heads[::3], (10e-3, 15e-3, 20e-3), strict=True):
        np.testing.assert_allclose(np.ptp(head.loops[0], axis=0), size)
    triangle = heads[1].loops[0]
    np.testing.assert_allclose(np.linalg.norm(triangle[0] - triangle[1]), 10e-3)
    np.testing.assert_allclose(triangle.mean(axis=0), 0, atol=1e-12)


@pytest.mark.parametrize('kind', ['M1', 'M2', 'M3', 'M4'])
def test_the_sheet_is_magnetised_as_its_name_says(kind: str) -> None:
    skin = Specimen(replace(CONFIG, magnetisation=kind), NONE)  # type: ignore[type-var]
    direction = np.sign(skin.moments)
    assert (skin.places[:, 2] > CONFIG.layer_thickness).all()  # type: ignore[attr-defined]
    total = np.abs(skin.moments).sum()
    assert total == pytest.approx(0.1 * 75e-3**2 * 2e-3 / (4e-7 * np.pi))
    if kind == 'M1':
        np.testing.assert_array_equal(direction, np.tile([0, 0, 1.0], (len(direction), 1)))
        return
    along = np.unique(skin.places[:, 1])
    column = [direction[skin.places[:, 1] == y, 1][0] for y in along]
    signs = {'M2': (1, 1), 'M3': (-1, 1), 'M4': (1, -1)}[kind]
    assert (column[0], column[-1]) == signs
    assert np.count_nonzero(np.diff(column)) == {'M2': 0, 'M3': 1, 'M4': 7}[kind]


@pytest.mark.parametrize('kind', ['M1', 'M4'])
def test_without_flaws_it_is_the_world_without_flaws(kind: str) -> None:
    # finite elements, another grid of dipoles, and a dense matrix for the punch, whose cells make
    # it narrower or wider by some per cent
    other = world.World(0, world.IDEAL, kind)
    skin = Specimen(replace(CONFIG, magnetisation=kind), NONE)  # type: ignore[type-var]
    head = world.regular('circle', 48, 8e-3)
    pose, depths = np.array([6e-3, -9e-3, 0.8]), np.array([2e-4, 8e-4])
    wanted = other.press(head, pose[:2], pose[2], depths) - other.rest()
    found = skin.press(head, pose, depths) - skin.rest()
    cosine = (found * wanted).sum() / np.sqrt(np.square(found).sum() * np.square(wanted).sum())
    assert cosine > 0.997
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(wanted), rel=0.04)
    assert skin.stiffness(head) == pytest.approx(other.stiffness, rel=0.05)
    assert np.abs(skin.rest() - other.rest()).max() < 0.01 * np.abs(other.rest()).max()


def test_it_errs_by_less_than_the_noise_can_tell() -> None:
    # the same carpet under exact mechanics; the bench of fidelity says what the carpet costs
    exact = multipole_fidelity.PressedSheet(CONFIG, 1.25e-3, points=2)  # type: ignore[arg-type]
    head = world.regular('', 96, multipole_fidelity.RADIUS)
    found = WHOLE.press(head, np.array([3e-3, -4e-3, 0]), np.array([0.5e-3])) - WHOLE.rest()
    error = found.ravel() - exact.change(3e-3, -4e-3, 0.5e-3)
    assert np.sqrt(np.square(error).mean()) < NOISE / 6
    assert np.abs(error).max() < NOISE / 2


def test_flaws_are_as_large_as_they_are_said_to_be() -> None:
    several = [Specimen(CONFIG, Flaws(gap=0.0), seed) for seed in range(4)]  # type: ignore[arg-type]
    again = Specimen(CONFIG, Flaws(gap=0.0), 0)  # type: ignore[arg-type]
    np.testing.assert_array_equal(several[0].rest(), again.rest())
    assert np.abs(several[0].rest() - several[1].rest()).max() > 0.1e-3
    off = np.array([one.chips for one in several]) - CONFIG.positions  # type: ignore[attr-defined]
    assert off.std() == pytest.approx(0.15e-3, rel=0.2)
    gains = np.linalg.norm([one.responses for one in several], axis=3)
    assert gains.std() == pytest.approx(0.03, rel=0.2)
    axes = np.array([one.responses for one in several]) / gains[..., None]
    aside = np.stack([axes[..., 0, 1], axes[..., 1, 2], axes[..., 2, 0]])
    assert aside.std() == pytest.approx(0.02, rel=0.2)
    bands = np.array([one.sheet.strengths for one in several])
    assert (bands / bands.mean(axis=1, keepdims=True)).std() == pytest.approx(0.05, rel=0.4)


def test_one_without_flaws_is_as_drawn_and_magnets_that_turn_read_otherwise() -> None:
    np.testing.assert_allclose(WHOLE.rest(), drawn_skin(CONFIG).rest(), atol=1e-9)  # type: ignore[arg-type]
    field = np.array([1e-5, 2e-5, -3e-5])
    np.testing.assert_allclose(WHOLE.stray(field), np.tile(field, (20, 1)))
    head, pose = world.box('', 12e-3, 8e-3), np.array([2e-3, 5e-3, 0.4])
    deep, shallow = (WHOLE.terms(head, pose, d) for d in (1e-3, 0.4e-3))  # sums of powers of depth
    change = [0.4e-3 ** np.arange(1, 4) @ terms.reshape(3, -1) for terms in (deep, shallow)]
    np.testing.assert_allclose(change[0], change[1], atol=NOISE / 40)
    turning = Specimen(CONFIG, replace(NONE, turning=1.0))  # type: ignore[arg-type]
    soft = turning.terms(head, pose)[0]
    assert np.abs(deep[0] - soft).max() > 0.05 * np.abs(deep[0]).max()


SPEC = load_sensor('multipole_skin')
HEADS = len(SPEC.config().objects)  # type: ignore[attr-defined]


@pytest.fixture(scope='module')
def played() -> Recording:
    """One known head and the new one, since each costs a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(twin, 'KNOWN', 1)
        return twin.new_head(SPEC.config(), seed=3, noise=0.0)  # type: ignore[arg-type]


def of_presses(recording: Recording, name: str) -> np.ndarray:
    """Truth of each press."""
    column = recording.truth[name]
    touched = recording.truth['in_contact'] == 1
    numbers = recording.truth['repetition'][touched]
    return np.array([column[touched][numbers == i][0] for i in range(numbers.max() + 1)])


def test_known_heads_press_then_the_new_one_then_all(played: Recording) -> None:
    lesson, labels = SPEC.new_class, of_presses(played, 'label')
    assert (lesson.label, lesson.presses) == (twin.NEW.name, twin.SHOTS)
    assert twin.NEW.name not in [head.name for head in SPEC.config().objects]  # type: ignore[attr-defined]
    assert twin.SHOTS < twin.TAUGHT
    taught = slice(twin.BEFORE, twin.BEFORE + twin.TAUGHT)
    assert (labels[taught] == HEADS).all()
    assert (labels[: twin.BEFORE] < HEADS).all()
    late = labels[twin.BEFORE + twin.TAUGHT :]
    assert len(late) == twin.AFTER
    assert set(late) == {labels[0], HEADS}
    place = of_presses(played, 'position')[:, :2]
    new = labels == HEADS
    assert np.ptp(place[new], axis=0).max() < 10 * twin.RETURNS[0]
    assert np.ptp(place[~new], axis=0).min() > twin.SPAN


def test_readings_grow_with_depth_and_return_to_rest(played: Recording) -> None:
    change = np.abs(played.values - played.values[0]).max(axis=(1, 2))
    touched = played.truth['in_contact'] == 1
    assert change[~touched].max() < 0.1 * change.max()
    force = played.truth['force'][:, 2]
    assert 1 < np.nanmax(force) < 12
    one = touched & (played.truth['repetition'] == 0)
    assert np.corrcoef(change[one], force[one])[0, 1] > 0.99


PLACES = np.repeat(1e-3 * np.array([[0, 0], [5, 0], [0, 5], [5, 5], [9, 9], [-9, 9.0]]), 6, axis=0)
COUNT = len(PLACES)
POSES = np.array([[4e-3, 6e-3, 0.1], [-8e-3, 3e-3, 0.5]])


def labels(place: np.ndarray, number: np.ndarray, group: np.ndarray | None = None) -> Labels:
    place = np.column_stack([place, np.zeros(COUNT)])
    group = np.zeros(COUNT, np.int64) if group is None else group
    return Labels(np.arange(COUNT) % 3, place, np.zeros(COUNT), group, number)


def test_folds_hold_places_presses_or_groups_out_together() -> None:
    # hard case 8: presses of one place in both parts are told by their place
    number, group, unknown = np.arange(COUNT), np.arange(COUNT) // 4, np.full_like(PLACES, np.nan)
    for some, kept in (
        (labels(PLACES, number), PLACES @ [1e3, 1e6]),
        (labels(PLACES + 1e-3 * (number % 2)[:, None], number // 2), number // 2),  # heads rolled
        (labels(unknown, number, group), group),
    ):
        for fold in range(FOLDS):
            out = some.folds == fold
            assert not set(kept[out]) & set(kept[~out])
            assert out.any()


@pytest.fixture(scope='module')
def recogniser() -> Recogniser:
    drawn = drawn_skin(CONFIG)  # type: ignore[arg-type]
    heads = CONFIG.objects[:2]  # type: ignore[attr-defined]
    return Recogniser(drawn, heads, np.full(drawn.chips.size, 1e-6), drawn.common)


@pytest.mark.parametrize('turning', [0.0, 1.0])
def test_magnets_may_turn_with_the_body_or_not_where_no_press_told(
    recogniser: Recogniser, turning: float
) -> None:
    bank = press_bank(replace(recogniser.model, turning=turning), recogniser.outlines)
    parts = bank.at(np.array([0, 1]), POSES)[:, 0]
    patterns = np.einsum('p,npd->nd', 4e-4 ** np.arange(1, 4), parts)
    answers = recogniser.answer(Presses(patterns, np.full(2, 10.0)))
    assert answers.label.tolist() == [0, 1]
    away = np.linalg.norm(answers.pose[:, :2] - POSES[:, :2], axis=1)
    assert away.max() < 0.3e-3


def test_equal_skins_have_the_same_templates_and_others_their_own(recogniser: Recogniser) -> None:
    model, heads = recogniser.model, recogniser.outlines[:1]
    bank = press_bank(model, heads)
    assert press_bank(replace(model, chips=model.chips.copy()), heads) is bank
    assert press_bank(replace(model, chips=model.chips + 1e-5), heads) is not bank
    assert press_bank(model, recogniser.outlines[1:]) is not bank
