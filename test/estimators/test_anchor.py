"""Anchored rows: what a group has in common weighs more, and later groups are told better."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.regression import center_by_group, ridge_weights


def test_common_part_is_scaled_and_the_rest_stays() -> None:
    rng = np.random.default_rng(0)
    terms, target = rng.normal(size=(12, 2)), rng.normal(size=(12, 1))
    groups, load = np.repeat(np.arange(3), 4), rng.uniform(0, 1, 12)
    found, told = center_by_group(terms, target, groups, load, weight=9.0)
    for group in range(3):
        own = groups == group
        common = np.stack([np.ones(4), load[own]], axis=1)
        for before, after in ((terms, found), (target, told)):
            fit = common @ np.linalg.lstsq(common, before[own], rcond=None)[0]
            np.testing.assert_allclose(after[own], before[own] + 2 * fit, atol=1e-12)


def test_weight_one_changes_nothing_and_single_rows_scale_whole() -> None:
    terms, target = np.arange(6.0).reshape(3, 2), np.arange(3.0)[:, None]
    groups, load = np.arange(3), np.arange(3.0)
    same = center_by_group(terms, target, groups, load, weight=1.0)
    assert same[0] is terms
    assert same[1] is target
    found, told = center_by_group(terms, target, groups, load, weight=4.0)
    np.testing.assert_allclose(found, 2 * terms)
    np.testing.assert_allclose(told, 2 * target)


def test_a_skin_that_goes_on_softening_is_told_better() -> None:
    rng = np.random.default_rng(1)
    rows, presses = 60, 12
    load = np.tile(np.sin(np.linspace(0, np.pi, rows)), presses)[:, None]
    press = np.repeat(np.arange(presses), rows)
    soft = 0.02 * press[:, None]
    # a disturbance within each press hides that the second channel tells how soft the skin is
    wander = 0.1 * rng.normal(size=load.shape)
    x = np.concatenate([load * (1 + soft) + wander, load * (1 - soft) + 2 * wander], axis=1)
    x += 0.01 * rng.normal(size=x.shape)
    seen = press < 6
    miss = []
    for weight in (1.0, 100.0):
        rows_of = center_by_group(x[seen], load[seen], press[seen], load[seen, 0], weight)
        off = x[~seen] @ ridge_weights(*rows_of, 1e-9) - load[~seen]
        miss.append(np.abs([(off * load[~seen])[press[~seen] == p].sum() for p in range(6, 12)]))
    assert miss[1].mean() < 0.5 * miss[0].mean()
