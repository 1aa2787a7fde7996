"""Turn the published csv files of eFlesh into the integer counts that this folder carries.

    python -m tactile_ros.sensors.reskin_board.recordings.convert FOLDER [DESTINATION]

FOLDER holds spatial/, normal/, shear/ and slip/ as in the README beside this file. Fields are the
chips' own counts (differences along time), times are microseconds since the run's start, probe
positions micrometres and the scale's readings hundredths of a gram (-100: no reading), so that
nothing is lost or invented.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

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


def steps(table: npt.NDArray[np.int16]) -> npt.NDArray[np.int16]:
    """Channel-major differences along time (modulo 2^16), which compress to half; shape (n, s)."""
    columns = np.ascontiguousarray(table.T)
    return np.diff(columns, axis=-1, prepend=np.int16(0)).astype(np.int16)


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
    arrays = {
        'count_steps': steps(counts(sensor[:, 1:], quantum_ut)),
        'rest_steps': steps(rest[first]),
        'touch': (np.cumsum(first) - 1).astype(np.int16),
        'quantum_ut': np.asarray(quantum_ut),
        'start_unix_s': np.array(int(sensor[0, 0])),
        'time_us': np.round(1e6 * (sensor[:, 0] - int(sensor[0, 0]))).astype(np.int64),
        'probe_um': np.round(1e3 * states[:, 1:4]).astype(np.int32),
    }
    if states.shape[1] > 4:
        arrays['scale_cg'] = np.round(100 * states[:, 4]).astype(np.int32)
    return arrays


def main() -> None:
    """Write one npz per run beside this file, or in the folder that is given."""
    source = Path(sys.argv[1])
    destination = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parent
    for name, folder, quantum in RUNS:
        arrays = convert_run(source / folder, quantum)
        np.savez_compressed(destination / f'{name}.npz', **arrays)  # type: ignore[arg-type]
    slip = np.load(source / 'slip' / 'slip.npz')
    np.savez_compressed(
        destination / 'slip.npz',
        count_steps=steps(counts(slip['values_ut'].astype(np.float64), FINE).reshape(-1, 30)),
        quantum_ut=np.asarray(FINE),
        label=slip['label'],
        sequence=slip['sequence'].astype(np.int16),
        shape=np.array(slip['values_ut'].shape),
    )


if __name__ == '__main__':
    main()
