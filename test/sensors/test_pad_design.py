# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Conditions 1 and 2 of [2], its remedies and the search, on pads that fail on purpose."""

import argparse
from dataclasses import replace

import numpy as np
import pytest

from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad.config import surface_cells
from tactile_ros.sensors.magnet_pad.design import (
    LOADS,
    Requirements,
    add_arguments,
    blocks,
    changes,
    evenly,
    least_forces,
    place_bound,
    quiet_enough,
    remedies,
    rest_field,
    softest,
    stiffest,
    tables,
)

CONFIG = replace(load_sensor('magnet_pad').config(), cells=surface_cells(5, 5))


def asked(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return parser.parse_args(words)


def test_the_pad_of_the_paper_satisfies_both_conditions() -> None:
    rest = 1e3 * np.linalg.norm(rest_field(CONFIG), axis=1)
    assert ((rest > 3.0) & (rest < 3.7)).all()  # [2]: 3.3 and 3.65 mT
    assert quiet_enough(CONFIG, Requirements()).all()
    force = least_forces(CONFIG, Requirements())
    assert 0.3 < force.max() <= 1.5  # [2]: 1.5 N at most


def test_condition_1_asks_every_chip_and_condition_2_the_norm() -> None:
    tight = replace(CONFIG, saturation=np.array([1e-3, 1e-3, 3.4e-3]))
    assert not quiet_enough(tight, Requirements()).all()
    near = CONFIG.positions.copy()
    near[1, 2] = 5e-3  # right under a magnet
    holds = quiet_enough(replace(CONFIG, positions=near), Requirements(largest=40.0))
    assert holds.tolist() == [True, False]
    required, force = Requirements(), least_forces(CONFIG, Requirements())
    for cell in (0, 7, 12):
        size = np.linalg.norm(changes(CONFIG, required, force[cell : cell + 1])[cell, 0], axis=1)
        assert size.max() == pytest.approx(required.resolution, rel=0.02)
    assert LOADS[0] < force.min()


def test_a_stiff_body_is_softened_as_far_as_needed() -> None:
    stiff = replace(CONFIG, shear_modulus=10 * CONFIG.shear_modulus)
    required = Requirements()
    first = remedies(stiff, required, least_forces(stiff, required))[0]
    assert first.what == 'softer body'
    after = least_forces(first.config, required)
    assert 0.85 * required.force < after.max() <= required.force
    assert stiffest(stiff, required) == pytest.approx(stiffest(CONFIG, required), rel=1e-2)


def test_a_block_wants_a_chip_and_a_few_cells_a_magnet() -> None:
    cells = CONFIG.cells
    corner = np.array([0, 1, 5, 6, 24])
    parts = blocks(cells, corner)
    assert [part.tolist() for part in parts] == [[0, 1, 5, 6], [24]]
    force = np.full(len(cells), 0.1)
    force[corner] = 9.0
    found = remedies(CONFIG, Requirements(), force)
    assert [one.what for one in found] == ['softer body', 'extra chip', 'more magnets']
    chip, magnet = found[1].config, found[2].config
    assert len(chip.positions) == 3
    np.testing.assert_allclose(chip.positions[2, :2], cells[[0, 1, 5, 6], :2].mean(axis=0))
    assert len(magnet.magnet_positions) == 4


def test_the_search_brackets_the_stiffness() -> None:
    pad, required = evenly(CONFIG, 3, 2), Requirements()
    hard = stiffest(pad, required)
    soft = softest(pad, required, hard)
    assert 0 < soft < hard
    felt = least_forces(replace(pad, shear_modulus=hard), required)
    assert (
        felt.max()
        <= required.force
        < least_forces(replace(pad, shear_modulus=2 * hard), required).max()
    )
    assert place_bound(pad, required, 4e-6) < 1e-3
    # on the axis of mirror symmetry one chip cannot tell left from right under one magnet
    assert place_bound(evenly(CONFIG, 1, 1), required, 4e-6) > place_bound(pad, required, 4e-6)


def test_tables_and_refusals() -> None:
    found = tables(CONFIG, asked('--magnets', '3', '--chips', '2', '--force', '0.4'))
    assert [len(table.rows) for table in found[:2]] == [2, 5]
    assert 'does not hold' in found[1].notes[0]
    assert len(found[2].rows) > 1
    assert len(found[3].rows) == 6
    with pytest.raises(ValueError, match='above 0'):
        tables(CONFIG, asked('--force', '20'))
