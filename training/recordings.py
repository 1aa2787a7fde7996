# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Turn the published csv files of eFlesh into the integer counts that the package carries.

    python training/recordings.py FOLDER [DESTINATION]

FOLDER holds spatial/, normal/, shear/ and slip/ as in the README beside the recordings. Fields are
the chips' own counts, times are microseconds since the run's start, probe positions micrometres
and the scale's readings hundredths of a gram (-100: no reading), so that nothing is lost or
invented. All but the scale's are packed, which makes the files a quarter smaller; `unpacked`
beside the recordings gives the same numbers back.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

RECORDINGS = Path(__file__).parents[1] / 'tactile_ros/sensors/reskin_board/recordings'
FINE = (0.6, 0.6, 0.968)
COARSE = (2.4, 2.4, 3.872)
RUNS = (
    ('spatial', 'spatial/20250316_155729', COARSE),
    ('normal_1', 'normal/20250401_014340', COARSE),
    ('normal_2', 'normal/20250401_015717', COARSE),
    ('shear', 'shear/20250416_200533', FINE),
)


def counts(
    field_ut: npt.NDArray[np.float64], quantum_ut: tuple[float, ...]
) -> npt.NDArray[np.int16]:
    """Fields (..., n) in microtesla as whole counts of the chips, shape (..., n)."""
    exact = field_ut / np.tile(quantum_ut, field_ut.shape[-1] // 3)
    whole = np.round(exact)
    if np.abs(exact - whole).max() > 0.02:
        msg = 'fields must be whole multiples of the quantum; is this another gain?'
        raise ValueError(msg)
    return np.asarray(whole, np.int16)


def packed(table: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """Bytes (b, n, s), which compress well, of whole numbers (s, n) or (s,) below 2^62.

    They are those of the differences along time, lowest first, as many as are needed. The sign is
    the lowest bit, so that small steps down have no high bytes either.
    """
    whole = np.asarray(table, np.int64)
    columns = whole[:, None] if whole.ndim == 1 else whole
    steps = np.diff(columns.T, axis=-1, prepend=0)
    code = (steps << 1) ^ (steps >> 63)
    planes = max(1, -(-int(code.max(initial=0)).bit_length() // 8))
    return np.stack([(code >> 8 * i & 255).astype(np.uint8) for i in range(planes)])


def convert_run(folder: Path, quantum_ut: tuple[float, ...]) -> dict[str, npt.NDArray[np.generic]]:
    """Arrays of one run: counts, resting readings and whom they serve, time, probe, scale."""
    sensor = np.loadtxt(folder / 'sensor.csv', delimiter=',')
    states = np.loadtxt(folder / 'states.csv', delimiter=',')
    post = np.loadtxt(folder / 'sensor_post_baselines.csv', delimiter=',')
    channels = sensor.shape[1] - 1
    rest = counts(sensor[:, 1:] - post[:, -channels:], quantum_ut)
    # the resting reading changes where a new touch or press cycle begins
    first = np.ones(len(rest), bool)
    first[1:] = (rest[1:] != rest[:-1]).any(axis=1) | (len(rest) > 4000 and channels == 15)
    arrays: dict[str, npt.NDArray[np.generic]] = {
        'counts': packed(counts(sensor[:, 1:], quantum_ut)),
        'rest': packed(rest[first]),
        'touch': packed(np.cumsum(first) - 1),
        'quantum_ut': np.asarray(quantum_ut),
        'start_unix_s': np.array(int(sensor[0, 0])),
        'time_us': packed(np.round(1e6 * (sensor[:, 0] - int(sensor[0, 0])))),
        'probe_um': packed(np.round(1e3 * states[:, 1:4])),
    }
    if states.shape[1] > 4:
        arrays['scale_cg'] = np.round(100 * states[:, 4]).astype(np.int32)
    return arrays


def main() -> None:
    """Write one npz per run beside the others, or in the folder that is given."""
    source = Path(sys.argv[1])
    destination = Path(sys.argv[2]) if len(sys.argv) > 2 else RECORDINGS
    for name, folder, quantum in RUNS:
        arrays = convert_run(source / folder, quantum)
        np.savez_compressed(destination / f'{name}.npz', **arrays)  # type: ignore[arg-type]
    slip = np.load(source / 'slip' / 'slip.npz')
    np.savez_compressed(
        destination / 'slip.npz',
        counts=packed(counts(slip['values_ut'].astype(np.float64), FINE).reshape(-1, 30)),
        quantum_ut=np.asarray(FINE),
        label=packed(slip['label']),
        sequence=packed(slip['sequence']),
        shape=np.array(slip['values_ut'].shape),
    )


if __name__ == '__main__':
    main()
