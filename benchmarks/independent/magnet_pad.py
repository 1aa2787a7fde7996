# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Independent half-cylinder pad of three block magnets over two chips.

The config names the nominal geometry only; magnets and chips of the world lie elsewhere. Frames
are independent and carry no stamps.
"""

from functools import cache

import numpy as np

from benchmarks.independent.recordings import (
    Task,
    answered,
    coverage,
    marked,
    pipeline_with,
    recording,
    rms,
    world,
)
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Array, Bools, ContactStates, Integers, Recording

Truth = dict[str, Array]
DATA = world('magnet_pad')


def nominal() -> Pipeline:
    """Pipeline by the nominal config, not fitted."""
    return pipeline_with(
        'magnet_pad', positions=DATA['hall_m'], magnet_positions=DATA['magnets_m'],
        magnet_axes=np.tile([0.0, 0.0, 1.0], (3, 1)), magnet_size=DATA['magnet_size_m'],
        remanence=float(DATA['remanence']), radius=float(DATA['radius_m']),
        length=float(DATA['length_m']), shear_modulus=float(DATA['G_pa']),
        cells=DATA['cell_centres'],
    )  # fmt: skip


LAYOUT = nominal().layout


def frames(
    values: Array, tare: Bools | None = None, stream: Integers | None = None, **truth: Array
) -> Recording:
    """Recording with truth, where some is given."""
    tare = np.zeros(len(values), bool) if tare is None else tare
    return recording(LAYOUT, values, tare=tare, stream=stream, truth=truth)


def touched(name: str, rows: Bools | slice = slice(None)) -> tuple[Array, Truth]:
    """Values and truth of rows of one set."""
    keys = {'position': 'position', 'cell': 'cell', 'force': 'force', 'repetition': 'rep'}
    truth = {key: DATA[f'{name}_{stored}'][rows] for key, stored in keys.items()}
    values = DATA[name][rows]
    return values, {**truth, 'in_contact': np.ones(len(values), np.int8)}


def mounted(session: int) -> tuple[Array, dict[str, Array], Truth]:
    """One mounting in one stream: values, tare and stream, truth; frames at rest first."""
    rest = DATA[f'session{session}_rest']
    values, truth = touched(f'session{session}')
    for key, column in truth.items():
        blank = 0 if key == 'in_contact' else np.nan if column.dtype.kind == 'f' else -1
        before = np.full((len(rest), *column.shape[1:]), blank, column.dtype)
        truth[key] = np.concatenate([before, column])
    values = np.concatenate([rest, values])
    stream = np.full(len(values), session)
    columns = {'tare': marked(len(values), len(rest)), 'stream': stream}
    return values, columns, {**truth, 'session': stream}


@cache
def fitted(kind: str = 'touches') -> Pipeline:
    """Fitted on one of: touches, rig (the fixed one of the paper), rest alone, four sessions."""
    if kind == 'sessions':
        parts = [mounted(session) for session in range(4)]
        sets = [frames(values, **columns, **truth) for values, columns, truth in parts]
    else:
        count = len(DATA['rest'])
        rest = np.ones(count, bool), None
        sets = [frames(DATA['rest'], *rest, in_contact=np.zeros(count, np.int8))]
    if kind in ('touches', 'rig'):
        of_touches = touched('touch', DATA['touch_rep'] < 3)
        values, truth = of_touches if kind == 'touches' else touched('rig')
        sets.append(frames(values, **truth))
    return nominal().fit(*sets)


@cache
def held_out(kind: str = 'touches') -> tuple[ContactStates, Truth]:
    """Answers to and truth of the last two repetitions."""
    values, truth = touched('touch', DATA['touch_rep'] >= 3)
    return fitted(kind).process_batch(frames(values)), truth


def distance(kind: str) -> float:
    """Mean error of the place (mm)."""
    found, truth = held_out(kind)
    away = answered(found.position) - truth['position']
    return float(1e3 * np.linalg.norm(away, axis=1).mean())


def hits(states: ContactStates, truth: Truth, rows: Bools | slice = slice(None)) -> float:
    """Share of right cells (%); one that is not named is wrong."""
    return float(100 * np.mean((np.asarray(states.cell) == truth['cell'])[rows]))


def force() -> float:
    """Rms error of the size of 1.5..10 N, held-out repetitions (N)."""
    found, truth = held_out()
    sizes = (np.linalg.norm(f, axis=1) for f in (answered(found.force), truth['force']))
    return float(rms(np.subtract(*sizes)))


def under_stray(name: str, kind: str) -> float:
    """Right cells under an unknown uniform 0.5 mT (%)."""
    values, truth = touched(name)
    return hits(fitted(kind).process_batch(frames(values)), truth)


def new_sessions() -> float:
    """Right cells in six new mountings, fitted on four others, the paper's fixed rig (%)."""
    shares = []
    for session in range(4, 10):
        values, columns, truth = mounted(session)
        found = fitted('sessions').process_batch(frames(values, **columns))
        shares.append(hits(found, truth, ~columns['tare']))
    print('% per mounting:', np.round(shares, 1))
    return float(np.mean(shares))


def sigmas() -> float:
    """Distance from 68.3 inside one sigma, mean of axial and tangential direction (points)."""
    found, truth = held_out()
    place, cov = truth['position'], answered(found.position_cov)
    away = answered(found.position) - place
    around = np.stack([0 * place[:, 0], place[:, 2], -place[:, 1]], 1)
    around /= np.hypot(place[:, 1], place[:, 2])[:, None]
    shares = []
    for axis in (np.tile([1.0, 0.0, 0.0], (len(place), 1)), around):
        sigma = np.sqrt(np.einsum('si,sij,sj->s', axis, cov, axis))
        shares.append(coverage(np.einsum('si,si->s', away, axis), sigma))
    print('% inside one sigma:', np.round(shares, 1))
    return float(np.mean(np.abs(np.array(shares) - 68.3)))


TASKS = (
    Task('pad_position', 'place, mean', 'mm', 0.28, 0.25, lambda: distance('touches')),
    Task('pad_cells_min', 'cells of 25', '%', 94.5, 95.8, lambda: hits(*held_out())),
    Task('pad_force', 'size of the force, rms', 'N', 0.34, 0.19, force),
    Task('pad_stray_min', 'cells, 0.5 mT, fixed rig', '%', 88.5, 90.0,
         lambda: under_stray('stray', 'rig')),
    Task('pad_stray_anywhere_min', 'cells, 0.5 mT, anywhere', '%', None, 79,
         lambda: under_stray('stray_anywhere', 'touches')),
    Task('pad_new_session_min', 'cells in six new mountings', '%', 95.5, None, new_sessions,
         slow=True),
    Task('pad_nominal', 'place, nominal model', 'mm', 1.2, 0.56, lambda: distance('rest')),
    Task('pad_coverage', 'off 68.3 inside one sigma', 'points', 5, 0, sigmas),
)  # fmt: skip
