# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Independent gradiometer: 300 points, stray field, clipping, temperature, covariance, noise.

The world has a gap, remanence, gains and places of pixels of its own; the config names the nominal
ones. Frames are independent and carry no stamps; frames at rest go in as tare rows.
"""

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
from tactile_ros.types import Array, Bools, ContactStates, Recording

FULL_SCALE, STRAY = 3.5, 2e-3  # N, T
DATA = world('gradiometer')


def nominal() -> Pipeline:
    """Pipeline by the nominal config, not fitted."""
    return pipeline_with(
        'gradiometer', positions=DATA['pixels_m'], gap=float(DATA['gap_m']),
        remanence=float(DATA['remanence']), saturation=float(DATA['saturation']),
        full_scale=FULL_SCALE,
    )  # fmt: skip


LAYOUT = nominal().layout


def frames(
    values: Array, celsius: Array | None = None, tare: Bools | None = None, **truth: Array
) -> Recording:
    """Recording at 35 C, where nothing else is given."""
    count = len(values)
    celsius = np.full(count, 35.0) if celsius is None else celsius
    tare = np.zeros(count, bool) if tare is None else tare
    return recording(LAYOUT, values, temperature=celsius, tare=tare, truth=truth)


def loaded(name: str, count: int | None = None) -> Recording:
    """First points of one set with their forces and torques."""
    values = DATA[name][:count]
    return frames(
        values, DATA[f'{name}_T'][:count], force=DATA[f'{name}_force'][:count],
        torque=DATA[f'{name}_torque'][:count], in_contact=np.ones(len(values), np.int8),
    )  # fmt: skip


def unloaded(values: Array, tare: Bools | None = None, **truth: Array) -> Recording:
    """Frames that nothing touches: their force is zero."""
    count = len(values)
    return frames(
        values, tare=tare, force=np.zeros((count, 3)), in_contact=np.zeros(count, np.int8),
        **truth,
    )  # fmt: skip


@cache
def fitted(kind: str = 'isothermal') -> Pipeline:
    """Fitted on frames at rest and on points of one kind."""
    sets = [unloaded(DATA['rest'][:500], np.ones(500, bool))]
    if kind == 'thermal':
        sets.append(loaded('thermal_train'))
    else:
        sets.append(loaded('train', 1500 if kind == 'many' else 300))
    if kind == 'turned':  # the resting skin turned to 12 sides of a known field of 0.5 mT
        sets.append(unloaded(DATA['turn'], stray_field=DATA['turn_field']))
    return nominal().fit(*sets)


@cache
def states(name: str, kind: str = 'isothermal') -> ContactStates:
    """Answers to one set."""
    return fitted(kind).process_batch(frames(DATA[name], DATA.get(f'{name}_T')))


def force(name: str, kind: str = 'isothermal') -> Array:
    """Forces of one set."""
    return answered(states(name, kind).force)


def error(name: str, kind: str = 'isothermal') -> Array:
    """Errors of the forces of one set."""
    return force(name, kind) - DATA[f'{name}_force']


def against_chain() -> Array:
    """Rms error of each component from 300 points over that of the printed chain from 13 000."""
    ours = rms(error('test'))
    print('mN:', 1e3 * ours, 'chain', 1e3 * DATA['chain'], 'bound', 1e3 * DATA['test_bound'])
    return ours / DATA['chain']


def leak(kind: str) -> float:
    """Largest change of any component under a uniform 2 mT (% of full scale)."""
    still = force('stray_none', kind)
    change = [np.abs(force(f'stray_{k}', kind) - still).max() for k in ('x', 'z', 'xz')]
    return float(100 * max(change) / FULL_SCALE)


def field() -> float:
    """Worst rms error of the uniform field (x, z) after turning in a known one (% of 2 mT)."""
    worst = []
    for kind in ('x', 'z', 'xz', 'none'):
        found = answered(states(f'stray_{kind}', 'turned').stray_field[:, [0, 2]])
        worst.append(rms(found - DATA[f'stray_{kind}_field'][:, [0, 2]]).max())
    return float(100 * max(worst) / STRAY)


def clipped() -> float:
    """Frames with a clipped channel that pass as valid (%); inf if clean ones are refused."""
    clean, missed = (np.asarray(states(k).valid, bool).mean() for k in ('test', 'clip'))
    return float(100 * missed) if clean >= 0.999 else float('inf')


def thermal() -> float:
    """Fz over 0..50 C over that at 35 C (ratio), 1500 frames each; inf if that is bad itself."""
    warm, still = rms(error('thermal', 'thermal')), rms(error('test', 'many'))
    return float(warm[2] / still[2]) if still[2] <= 1.5 * DATA['chain'][2] else float('inf')


def inside(name: str, sigmas: float) -> Array:
    """Share of errors of each component inside some sigmas (%)."""
    sigma = np.sqrt(np.einsum('sii->si', answered(states(name).force_cov)))
    off = error(name)
    return np.array([coverage(off[:, k], sigmas * sigma[:, k]) for k in range(3)])


def sigmas() -> float:
    """Distance from 68.3 inside one sigma, mean of three components (points)."""
    share = inside('test', 1)
    print('% inside one sigma:', share.round(1))
    return float(np.abs(share - 68.3).mean())


def noise() -> float:
    """Std at rest and mid load over the Cramer-Rao bound with an unknown field (ratio)."""
    return float(max((force(k).std(0) / DATA[f'{k}_bound']).max() for k in ('rest', 'mid')))


TASKS = (
    Task('grad_fx_fy', 'Fx, Fy over the printed chain', 'ratio', 0.28, 0.087,
         lambda: max(against_chain()[:2])),
    Task('grad_fz', 'Fz over the printed chain', 'ratio', 1.3, 0.41, lambda: against_chain()[2]),
    Task('grad_stray', 'leak of 2 mT, force calibration alone', '%', 0.03, 0,
         lambda: leak('isothermal')),
    Task('grad_stray_calibrated', 'leak of 2 mT, turned in a known field', '%', 0.01, 0,
         lambda: leak('turned')),
    Task('grad_stray_field', 'uniform field of 2 mT', '%', 0.1, 0, field),
    Task('grad_thermal', 'Fz, 0..50 C over 35 C', 'ratio', 1.3, 1, thermal, slow=True),
    Task('grad_near14_min', 'inside two sigma, magnet at 14 mm', '%', 90, 95.4,
         lambda: inside('near14', 2).mean()),
    Task('grad_noise', 'noise over its bound', 'ratio', 1.1, 1, noise),
    Task('grad_clip', 'clipped frames that pass', '%', 0, 0, clipped),
    Task('grad_coverage', 'off 68.3 inside one sigma', 'points', 8, 0, sigmas),
)  # fmt: skip
