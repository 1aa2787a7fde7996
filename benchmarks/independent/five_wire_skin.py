# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Independent five-wire sheet: uneven border, calibrated on 16, 25 or 49 points of 30 presses."""

from functools import cache

import numpy as np

from benchmarks.independent.recordings import (
    Task,
    answered,
    coverage,
    pipeline_with,
    recording,
    rms,
    world,
)
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Array, ContactStates, Integers, Recording

DATA = world('five_wire')


def nominal() -> Pipeline:
    """Pipeline by the nominal config, not fitted."""
    return pipeline_with(
        'five_wire_skin', size=(0.1, 0.1), sheet_resistance=100.0,
        reference_resistance=float(DATA['Rref']), touch_size=0.015,
    )  # fmt: skip


LAYOUT = nominal().layout


def frames(values: Array, **truth: Array) -> Recording:
    """Recording of frames of one taxel."""
    return recording(LAYOUT, values[:, None, :], truth=truth)


def labelled(values: Array, load: Array, place: Array, touched: Integers) -> Recording:
    """Frames with truth: the sheet knows neither fx nor fy, nor a place that nobody touches."""
    force = np.column_stack([np.full((len(load), 2), np.nan), load])
    place = np.column_stack([place, np.where(touched > 0, 0.0, np.nan)])
    return frames(values, force=force, position=place, in_contact=touched)


@cache
def calibrated(side: int, rest: bool = False) -> Pipeline:
    """Fitted on side x side points, with untouched frames where wanted."""
    values, load, place = (DATA[f'cal{side}{part}'] for part in ('', '_F', '_xy'))
    touched = np.ones(len(values), int)
    if rest:
        untouched = DATA['rest']
        values, load = np.concatenate([values, untouched]), np.r_[load, np.zeros(len(untouched))]
        place = np.concatenate([place, np.full((len(untouched), 2), np.nan)])
        touched = np.r_[touched, np.zeros(len(untouched), int)]
    return nominal().fit(labelled(values, load, place, touched))


def asked(side: int, name: str = 'test', rest: bool = False) -> ContactStates:
    """Answers to one set."""
    return calibrated(side, rest).process_batch(frames(DATA[name]))


def position() -> float:
    """Mean distance anywhere 8 mm inside the border, 25 calibration points (mm)."""
    away = answered(asked(5).position[:, :2]) - DATA['test_xy']
    return float(1e3 * np.nanmean(np.hypot(*away.T)))


def force() -> float:
    """Rms error of 3..15 N anywhere 12.5 mm inside the border, 49 calibration points (N)."""
    inner = (np.abs(DATA['test_xy'] - 0.05) <= 0.0375).all(1)
    return float(rms((answered(asked(7).force[:, 2]) - DATA['test_F'])[inner]))


def squares() -> float:
    """Rms error of other presses at the 16 calibration points over its Cramer-Rao bound."""
    off = answered(asked(4, 'squares').force[:, 2]) - DATA['squares_F']
    return float(rms(off) / rms(DATA['squares_sigma']))


def touch() -> float:
    """Worse of untouched frames left free and presses of 0.5..3 N placed within 1 mm (%)."""
    none, light = asked(5, 'untouched', rest=True), asked(5, 'light', rest=True)
    free = (np.asarray(none.in_contact) == 0) & ~np.isfinite(none.position[:, :2]).any(1)
    away = np.nan_to_num(light.position[:, :2], nan=1.0) - DATA['light_xy']
    placed = (np.asarray(light.in_contact) == 1) & (np.hypot(*away.T) < 1e-3)
    return float(100 * min(free.mean(), placed.mean()))


def sigmas() -> float:
    """Largest distance from 68.3 inside one sigma of x, y (25 points) and Fz (49) (points)."""
    places, forces = asked(5), asked(7)
    away = answered(places.position[:, :2]) - DATA['test_xy']
    variances = np.diagonal(np.asarray(places.position_cov), axis1=1, axis2=2)
    sigma = np.sqrt(answered(variances[:, :2]))
    shares = [coverage(away[:, k], sigma[:, k]) for k in (0, 1)]
    off = answered(forces.force[:, 2]) - DATA['test_F']
    shares.append(coverage(off, np.sqrt(answered(np.asarray(forces.force_cov)[:, 2, 2]))))
    print('% inside one sigma of x, y, Fz:', np.round(shares, 1))
    return float(np.abs(np.array(shares) - 68.3).max())


TASKS = (
    Task('sheet_position', 'place anywhere, 25 points, mean', 'mm', 0.050, 0.044, position),
    Task('sheet_force', 'force anywhere, 49 points, rms', 'N', 0.31, 0.13, force),
    Task('sheet_squares', 'force at 16 squares over its bound', 'ratio', 1.08, 1, squares),
    Task('sheet_touch_min', 'light presses found, rest left free', '%', 99, 100, touch),
    Task('sheet_coverage', 'off 68.3 inside one sigma, worst', 'points', 6, 0.9, sigmas),
)
