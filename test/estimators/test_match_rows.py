"""Loops over one press choose and say what arrays do."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.press_search import (
    inverse_rows,
    orthonormal_rows,
    places_rows,
    starts_rows,
)
from tactile_ros.estimators.press_templates import template_rows

RNG = np.random.default_rng(6)


def test_places_are_those_whose_spans_see_most() -> None:
    seen = RNG.normal(size=3 * 200).astype(np.float32)
    near = np.zeros(10, np.int64)
    places_rows(seen, 3, near)
    whole = np.square(seen).reshape(3, 200).sum(axis=0)
    np.testing.assert_array_equal(near, np.argsort(-whole)[:10])


def test_places_that_nothing_is_seen_of_are_places_still() -> None:
    near = np.zeros(10, np.int64)
    places_rows(np.zeros(3 * 200, np.float32), 3, near)
    assert sorted(near) == list(range(10))


def test_starts_are_the_likeliest_turns_and_places_of_each_head() -> None:
    first, turns, step = np.array([0, 5, 6]), np.array([5, 1, 7]), np.array([0.3, 6.0, 0.2])
    score, place = RNG.normal(size=(4, 13)).astype(np.float32), RNG.normal(size=(4, 2))
    pose = np.full((6, 4), 9.0)
    starts_rows(score, first, turns, step, place, pose)
    for i in range(3):
        part = score[:, first[i] : first[i] + turns[i]]
        for j, best in enumerate(np.argsort(-part, axis=None)[:2]):
            where, turn = np.unravel_index(best, part.shape)
            wanted = [*place[where], turn * step[i], 9.0]
            np.testing.assert_array_equal(pose[2 * i + j], wanted)


def test_the_inverse_of_steps_is_in_their_units() -> None:
    half = RNG.normal(size=(9, 4))
    normal, scale, cov = half.T @ half, np.array([1e3, 2e3, 5.0, 1e4]), np.empty((4, 4))
    inverse_rows(normal, scale, cov)
    np.testing.assert_allclose(cov, np.linalg.inv(normal) / np.outer(scale, scale), rtol=1e-10)


def test_rows_become_orthonormal_as_columns_do() -> None:
    span = RNG.normal(size=(3, 60)) + 3.0
    wanted = np.linalg.qr(span.T)[0]
    orthonormal_rows(span)
    np.testing.assert_allclose(span @ span.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(np.abs(np.sum(span * wanted.T, axis=1)), 1.0, rtol=1e-12)


def test_rows_without_weight_are_left_out_of_a_template() -> None:
    # at a node three of four rows count along each axis; the fourth may be anything
    half, turns, width = 3, 5, 12
    sides = 2 * half + 1
    flat = RNG.normal(size=(turns * sides * sides, width)).astype(np.float32)
    grid, about = np.array([1e-3, 2e-3, half, half], float), np.array([0.0, turns / 2.0, turns])
    work, parts = np.empty((3, width), np.float32), np.empty((4, width), np.float32)
    pose = np.array([1e-3, -2e-3, 2 * 2.0 / turns, 0.0])
    template_rows(flat, grid, about, pose, work, parts)
    table = flat.reshape(turns, sides, sides, width).astype(float)
    near = table[1:4, 3:6, 1:4]
    knot = np.array([1.0, 4.0, 1.0]) / 6.0
    np.testing.assert_allclose(parts[0], np.einsum('i,j,k,ijkd->d', knot, knot, knot, near), 1e-5)
    flat[:] = np.nan
    flat.reshape(turns, sides, sides, width)[1:4, 3:6] = table[1:4, 3:6]
    template_rows(flat, grid, about, pose, work, parts)
    assert np.isfinite(parts).all()
