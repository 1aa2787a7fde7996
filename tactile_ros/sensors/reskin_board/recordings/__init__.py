# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Recordings of a real board (eFlesh, MIT licence beside this file), held as integer counts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactile_ros.sensors.reskin_board.config import ReskinBoardConfig, layout
from tactile_ros.types import Array, Integers, Layout, Recording

NEWTON_PER_GRAM = 9.80665e-3
NAMES = ('spatial', 'normal_1', 'normal_2', 'shear', 'slip')
TARE_LEAD_NS = 20_000_000
SLIP_TARE_ROWS = 10
# the two boards' true places are not published: 20 mm to either side, so that none coincide
BESIDE = np.array([20e-3, 0.0, 0.0])

# what training/recordings.py packs
PACKED = {'counts', 'rest', 'touch', 'time_us', 'probe_um', 'label', 'sequence'}

Arrays = dict[str, npt.NDArray[np.generic]]


def load(name: str, board: Layout) -> Recording:
    """Load one of the shipped recordings; ValueError if there is none of that name.

    'spatial': 31 x 31 places, 5 touches each; 'normal_1', 'normal_2': ten press cycles; 'shear':
    two boards, ten cycles along one axis, called x; 'slip': 90 pulls, two boards. A tare row, the
    resting reading that came with it, is before every touch or cycle. Truth is `position` (m, from
    the middle of the scanned square) or `force` (N), `session` and `repetition`. The board has 5
    chips, or 10 for 'shear' and 'slip'.
    """
    if name not in NAMES:
        msg = f'name of a shipped recording must be one of {", ".join(NAMES)}; received {name!r}'
        raise ValueError(msg)
    with np.load(Path(__file__).parent / f'{name}.npz', allow_pickle=False) as file:
        arrays: Arrays = {key: file[key] for key in file.files}
    arrays.update({key: unpacked(arrays[key]) for key in PACKED & arrays.keys()})
    return _slip(arrays, board) if name == 'slip' else _run(name, arrays, board)


def shipped() -> dict[str, Recording]:
    """All shipped recordings by name, with layouts of five chips or of two boards side by side."""
    board = ReskinBoardConfig()
    pair = replace(
        board, positions=np.concatenate([board.positions - BESIDE, board.positions + BESIDE])
    )
    chips = {'shear': pair, 'slip': pair}
    return {name: load(name, layout(chips.get(name, board))) for name in NAMES}


def unpacked(planes: npt.NDArray[np.generic]) -> Integers:
    """Whole numbers, shape (s, n) or (s,) where n is 1, from bytes (b, n, s); see `packed`."""
    code = sum(plane.astype(np.int64) << 8 * i for i, plane in enumerate(planes))
    steps = (code >> 1) ^ -(code & 1)
    table: Integers = np.cumsum(steps, axis=-1).T
    return table[:, 0] if table.shape[1] == 1 else table


def _fields(counts: npt.NDArray[np.generic], quantum_ut: npt.NDArray[np.generic]) -> Array:
    """Counts (s, n) as fields (s, t, 3) in tesla."""
    quantum = 1e-6 * quantum_ut.astype(np.float64)
    fields: Array = counts.astype(np.float64).reshape(len(counts), -1, 3) * quantum
    return fields


def _run(name: str, arrays: Arrays, board: Layout) -> Recording:
    """One run with a tare row in front of every touch."""
    values = _fields(arrays['counts'], arrays['quantum_ut'])
    rest = _fields(arrays['rest'], arrays['quantum_ut'])
    touch = np.asarray(arrays['touch'], np.int64)
    first = np.searchsorted(touch, np.arange(len(rest)))
    stamp_ns = arrays['time_us'].astype(np.int64) * 1000
    truth = _position(arrays) if name == 'spatial' else _force(arrays, touch, name)
    session = np.full(len(values), 2 if name == 'normal_2' else 1)
    known: dict[str, npt.ArrayLike] = {**truth, 'session': session}
    return Recording.from_arrays(
        board,
        np.insert(values, first, rest, axis=0),
        stamp_ns=np.insert(stamp_ns, first, stamp_ns[first] - TARE_LEAD_NS),
        tare=np.insert(np.zeros(len(values), bool), first, values=True),
        truth={key: _with_blanks(np.asarray(value), first) for key, value in known.items()},
    )


def _with_blanks(column: npt.NDArray[np.generic], first: Integers) -> npt.NDArray[np.generic]:
    """Truth with unknown rows where the tare rows go; what they belong to stays known."""
    if column.dtype.kind == 'f':
        return np.insert(column, first, np.nan, axis=0)
    return np.insert(column, first, column[first], axis=0)


def _position(arrays: Arrays) -> dict[str, npt.NDArray[np.generic]]:
    """Place of the probe, from the middle of the grid, and how often it was there before."""
    plane = 1e-6 * arrays['probe_um'][:, :2].astype(np.float64)
    plane = plane - 0.5 * (plane.min(axis=0) + plane.max(axis=0))
    _, place = np.unique(np.round(plane, 6), axis=0, return_inverse=True)
    place = np.ravel(place)
    order = np.argsort(place, kind='stable')
    count = np.empty(len(place), np.int64)
    starts = np.searchsorted(place[order], place[order])
    count[order] = np.arange(len(place)) - starts
    position = np.column_stack([plane, np.full(len(plane), np.nan)])
    return {'position': position, 'repetition': count}


def _force(arrays: Arrays, cycle: Integers, name: str) -> dict[str, npt.NDArray[np.generic]]:
    """Reading of the scale on its one axis, NaN where it gave none."""
    grams = 0.01 * arrays['scale_cg'].astype(np.float64)
    newton = np.where(grams == -1.0, np.nan, grams * NEWTON_PER_GRAM)
    force = np.full((len(newton), 3), np.nan)
    force[:, 0 if name == 'shear' else 2] = newton
    return {'force': force, 'repetition': cycle}


def _slip(arrays: Arrays, board: Layout) -> Recording:
    """Ninety pulls of 300 frames at 100 Hz, one stream and one label each."""
    pulls, length, _ = (int(n) for n in arrays['shape'])
    values = _fields(arrays['counts'], arrays['quantum_ut'])
    row = np.arange(pulls * length)
    return Recording.from_arrays(
        board,
        values,
        stamp_ns=row * 10_000_000,
        stream=row // length,
        tare=row % length < SLIP_TARE_ROWS,
        truth={
            'slip': np.repeat(arrays['label'].astype(np.int64), length),
            'repetition': row // length,
        },
    )
