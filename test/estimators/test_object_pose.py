# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Objects in a world of fine cells: tubes at any angle, the jaw, washers, none of these."""

from collections.abc import Sequence
from functools import lru_cache
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from reference import taxel_world
from tactile_ros.estimators.object_pose import ObjectPose
from tactile_ros.types import Outline


@lru_cache
def world() -> ModuleType:
    return taxel_world


def own_frame(
    array: SimpleNamespace, place: Sequence[float], yaw: float
) -> tuple[np.ndarray, np.ndarray]:
    x, y = array.x - place[0], array.y - place[1]
    cos, sin = np.cos(yaw), np.sin(yaw)
    return cos * x + sin * y, cos * y - sin * x


def turned(found: float, yaw: float) -> float:
    return float(np.rad2deg(abs((found - yaw + np.pi) % (2 * np.pi) - np.pi)))


@pytest.mark.parametrize('profile', ['round', 'hertz', 'flat'])
def test_tubes_at_any_angle_on_sixteen_taxels(profile: str) -> None:
    w = world()
    array = w.radial((8e-3, 25e-3), (16,))
    elbow = Outline('elbow', (), 10e-3, np.pi / 2)
    objects = ObjectPose(array.positions, array.areas, array.outlines, (elbow,))
    rng, errors = np.random.default_rng(31), []
    for yaw in rng.uniform(-np.pi, np.pi, 12):
        place, half = rng.uniform(-2e-3, 2e-3, 2), rng.uniform(5.5e-3, 8e-3)
        pressure = w.on_tube(*own_frame(array, place, yaw), 10e-3, np.pi / 2, half, profile)
        force = 1.5 * array.forces(pressure) / array.areas[0]
        force = force + 1e-3 * rng.normal(size=16)
        found = objects.locate(force, np.full(16, 1e-3), np.ones(16, bool), 0.002)
        assert found.label == 0
        assert found.order == 1
        errors.append(turned(found.pose[2], yaw))
    assert np.median(errors) < 0.2
    assert np.sort(errors)[-2] < 0.5


def test_the_jaw_is_near_the_bound_and_never_flips() -> None:
    w = world()
    corners = 1e-3 * np.array([[-8, -6], [10, -6], [10, 0], [-2, 0], [-2, 8], [-8, 8.0]])
    array = w.matrix(40, 50, 1e-3)
    part = Outline('part', (corners,))
    objects = ObjectPose(array.positions, array.areas, None, (part,))
    rng, errors, places = np.random.default_rng(7), [], []
    for yaw in rng.uniform(-np.pi, np.pi, 12):
        place = rng.uniform(-4e-3, 4e-3, 2)
        force = array.forces(w.on_polygon(*own_frame(array, place, yaw), corners)) * 1e6
        force = force * (1 + 0.003 * rng.normal(size=2000)) + 1e-3 * rng.normal(size=2000)
        found = objects.locate(force, np.full(2000, 1e-3), np.ones(2000, bool), 0.003)
        errors.append(turned(found.pose[2], yaw))
        places.append(np.linalg.norm(found.pose[:2] - place))
    assert max(errors) < 0.03
    assert np.sqrt(np.mean(np.square(places))) < 2e-6


@pytest.mark.parametrize('layout', ['matrix', 'rings'])
def test_errors_are_as_large_as_they_are_said_to_be(layout: str) -> None:
    w = world()
    rings = (4e-3, 9e-3, 15e-3, 21e-3), (12, 18, 26)
    array = w.matrix(9, 10, 4e-3) if layout == 'matrix' else w.radial(*rings)
    corners = 1e-3 * np.array([[-9, -7], [8, -7], [8, -1], [-3, -1], [-3, 9], [-9, 9.0]])
    ring, part = w.washer('ring', 13e-3, 6e-3), Outline('part', (corners,))
    objects = ObjectPose(array.positions, array.areas, array.outlines, (ring, part))
    rng, taxels, ratios = np.random.default_rng(17), len(array.positions), {0: [], 1: []}
    for i in range(60):
        pose = rng.uniform(-1, 1, 3) * np.array([3e-3, 3e-3, np.pi])
        x, y = own_frame(array, pose[:2], pose[2])
        pressed = w.on_polygon(x, y, corners) if i % 2 else w.on_washer(x, y, 13e-3, 6e-3)
        force = array.forces(pressed) / array.areas.mean()
        force = force * (1 + 0.0025 * rng.normal(size=taxels)) + 1e-3 * rng.normal(size=taxels)
        found = objects.locate(force, np.full(taxels, 1e-3), np.ones(taxels, bool), 0.0025)
        assert found.label == i % 2
        ratios[i % 2] += list((found.pose - pose)[:2] / np.sqrt(np.diag(found.cov)[:2]))
    for told in ratios.values():
        assert 0.6 < np.sqrt(np.mean(np.square(told))) < 1.4


def test_a_part_that_is_nearly_symmetric_flips_only_where_it_says_so() -> None:
    w = world()
    array = w.matrix(6, 7, 5e-3)
    corners = 1e-3 * np.array([[-8, -5], [8, -5], [8, 3], [6, 5], [-8, 5.0]])
    objects = ObjectPose(array.positions, array.areas, None, (Outline('plate', (corners,)),))
    assert objects.objects[0][0].order == 1
    rng, errors, sigmas = np.random.default_rng(23), [], []
    for yaw in rng.uniform(-np.pi, np.pi, 30):
        place = rng.uniform(-2e-3, 2e-3, 2)
        force = array.forces(w.on_polygon(*own_frame(array, place, yaw), corners)) / array.areas
        force = force + 0.045 * rng.normal(size=42)
        found = objects.locate(force, np.full(42, 0.045), np.ones(42, bool), 0.003)
        errors.append(turned(found.pose[2], yaw))
        sigmas.append(np.rad2deg(np.sqrt(found.cov[2, 2])))
    flipped, said = np.array(errors) > 90, np.square(np.array(sigmas) / 180)
    assert 0 < flipped.sum() < 15
    assert (said[flipped] > 0.005).all()  # none was thought impossible
    assert 0.4 * flipped.sum() < said.sum() < 2.5 * flipped.sum()


def test_what_fits_to_no_outline_is_none_of_these() -> None:
    w = world()
    array = w.matrix(8, 9, 5e-3)
    objects = ObjectPose(array.positions, array.areas, None, (w.washer('w', 14e-3, 6e-3),))
    disc = array.forces(w.on_washer(array.x, array.y, 16e-3, -1.0)) / array.areas
    noise = np.full(72, 1e-3)
    assert objects.locate(disc, noise, np.ones(72, bool), 0.003).label == -1
    assert objects.locate(np.zeros(72), noise, np.ones(72, bool), 0.003).label == -1
    speckle = 12 * noise * np.random.default_rng(0).normal(size=72)
    assert objects.locate(speckle, noise, np.ones(72, bool), 0.003).label == -1


def test_two_washers_that_look_alike_share_the_probability() -> None:
    w = world()
    array = w.matrix(8, 9, 5e-3)
    twins = (w.washer('a', 14e-3, 6e-3), w.washer('b', 14.02e-3, 6.02e-3))
    objects = ObjectPose(array.positions, array.areas, None, twins)
    force = array.forces(w.on_washer(array.x, array.y, 14.01e-3, 6.01e-3)) / array.areas
    rng, told = np.random.default_rng(5), []
    for _ in range(10):
        noisy = force + 5e-3 * rng.normal(size=72)
        told.append(objects.locate(noisy, np.full(72, 5e-3), np.ones(72, bool), 0.02))
    assert np.mean([found.probability for found in told if found.label >= 0]) < 0.9
    assert {found.label for found in told} >= {0, 1}


def test_of_few_taxels_every_object_is_compared_and_the_probability_is_honest() -> None:
    w = world()
    array = w.radial((6e-3, 26e-3), (24,))
    rims = ((12.0, 6.5), (13.5, 5.0), (11.0, 8.0), (10.0, 5.0))
    washers = [w.washer(f'w{i}', 1e-3 * a, 1e-3 * b) for i, (a, b) in enumerate(rims)]
    objects = ObjectPose(array.positions, array.areas, array.outlines, washers)
    rng, right, said = np.random.default_rng(3), [], []
    for i in range(60):
        outer, inner = 1e-3 * np.array(rims[i % 4])
        x, y = rng.uniform(-4e-3, 4e-3, 2)
        force = array.forces(w.on_washer(array.x - x, array.y - y, outer, inner)) / array.areas[0]
        force = force * (1 + 4e-3 * rng.normal(size=24)) + 5e-4 * rng.normal(size=24)
        found = objects.locate(force, np.full(24, 5e-4), np.ones(24, bool), 0.004)
        if found.label >= 0:
            right.append(found.label == i % 4)
            said.append(found.probability)
    assert len(right) > 42
    assert np.mean(right) > 0.6
    assert np.mean(said) < np.mean(right) + 0.1


def test_pressed_taxels_are_those_of_fine_cells_and_slopes_are_differences() -> None:
    w = world()
    array = w.matrix(8, 9, 5e-3)
    objects = ObjectPose(array.positions, array.areas, None, (w.washer('w', 14e-3, 6e-3),))
    fields = objects.objects[1][0]
    for x, y in np.random.default_rng(0).uniform(-5e-3, 5e-3, (8, 2)):
        state = np.array([x, y, 0.3, 1.0, 0.1, -0.2])
        slopes = objects.fine.pressed(fields, state)[1]
        even = objects.fine.pressed(fields, np.array([x, y, 0.0, 1.0, 0.0, 0.0]))[0]
        truth = array.forces(w.on_washer(array.x - x, array.y - y, 14e-3, 6e-3))
        wrong = (even - truth) / array.areas[0]
        assert np.sqrt(np.mean(wrong**2)) < 0.008
        assert np.abs(wrong).max() < 0.05
        for m, step in ((0, 1e-4), (1, 1e-4), (3, 1e-3), (4, 1e-3), (5, 1e-3)):
            away = np.zeros(6)
            away[m] = step
            high, low = (objects.fine.pressed(fields, state + s * away)[0] for s in (1, -1))
            wanted = (high - low) / (2 * step)
            np.testing.assert_allclose(slopes[:, m], wanted, atol=0.12 * np.abs(wanted).max())
