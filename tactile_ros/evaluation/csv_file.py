"""Recordings as .csv with a header line, for spreadsheets and other people's loggers.

Columns, in any order: `stamp_ns` or `time_s`, `sequence`, `stream`, `tare`; a reading as
`<channel>_<taxel>` (`Bx_0`), chips as `temperature_c_<taxel>` and `status_<taxel>`; truth as its
name (`cell`), with `_x _y _z` for vectors (`force_z`) and `_<n>` for other arrays. An empty cell
is unknown.
"""

from __future__ import annotations

import csv
import math
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.errors import RecordingError
from tactile_ros.types import STATE_FIELDS, TRUTH_KEYS, Recording, field_shape

if TYPE_CHECKING:
    import os

    from tactile_ros.types import Array, Layout

MOST_ROWS = 5_000_000
NS_PER_S = 1_000_000_000


def read_csv(path: str | os.PathLike[str], layout: Layout) -> Recording:
    """Read a recording of a sensor of known layout.

    Parameters
    ----------
    path : path-like
        Of a file with a header line.
    layout : Layout
        Its taxels and channels name the columns.

    Returns
    -------
    Recording
        Readings in the unit of the layout.

    Raises
    ------
    RecordingError
        If a column of the readings is missing, unknown or not a number.
    """
    file = Path(path)
    columns = _columns(file)
    try:
        return _recording(columns, layout)
    except (ValueError, OverflowError, KeyError) as err:
        msg = f'{file} is no recording of {layout.shape}: {err}'
        raise RecordingError(msg) from err


def _columns(file: Path) -> dict[str, list[str]]:
    """Cells of every column under its name."""
    try:
        with file.open(newline='', encoding='utf-8') as opened:
            rows = list(islice(csv.reader(opened), MOST_ROWS + 1))
    except OSError as err:
        msg = f'{file} cannot be read: {err.strerror}'
        raise RecordingError(msg) from err
    except (csv.Error, UnicodeDecodeError) as err:
        msg = f'{file} is no csv file: {err}'
        raise RecordingError(msg) from err
    if len(rows) < 2:
        msg = f'{file} has no rows under its header line'
        raise RecordingError(msg)
    names = [name.strip() for name in rows[0]]
    wrong = next((n for n, row in enumerate(rows, 1) if row and len(row) != len(names)), None)
    if wrong is not None or len(set(names)) != len(names):
        where = f'line {wrong}' if wrong else 'the header'
        msg = f'{file}: {where} does not fit the {len(names)} columns'
        raise RecordingError(msg)
    body = [row for row in rows[1:] if row]
    return {name: [row[i].strip() for row in body] for i, name in enumerate(names)}


def _recording(columns: dict[str, list[str]], layout: Layout) -> Recording:
    """Take known columns out of the table; what remains is refused by name."""
    taxels, channels = layout.shape
    samples = len(next(iter(columns.values())))
    names = [f'{channel}_{taxel}' for taxel in range(taxels) for channel in layout.channels]
    chips = [f'temperature_c_{taxel}' for taxel in range(taxels)]
    bits = [f'status_{taxel}' for taxel in range(taxels)]
    for name in names:
        if name not in columns:
            msg = f'column {name!r} is missing'
            raise ValueError(msg)
    values = _floats(columns, names).reshape(samples, taxels, channels)
    stamps = _stamps(columns)
    found = {name: _integers(columns, name) for name in ('sequence', 'stream', 'tare')}
    temperature = _floats(columns, chips) if chips[0] in columns else None
    status = _floats(columns, bits) if bits[0] in columns else None
    truth = _truth(columns, taxels)
    if columns:
        msg = f'column {next(iter(columns))!r} is not known'
        raise ValueError(msg)
    return Recording.from_arrays(
        layout, values, stamps, temperature_c=temperature, status=status, truth=truth, **found
    )


def _floats(columns: dict[str, list[str]], names: list[str]) -> Array:
    """Numbers of several columns, shape (s, n); empty cells are NaN."""
    table = [[float(cell) if cell else math.nan for cell in columns.pop(name)] for name in names]
    return np.array(table, np.float64).T


def _integers(columns: dict[str, list[str]], name: str) -> npt.NDArray[np.int64] | None:
    """Whole numbers of a column, shape (s,); None where it is absent."""
    if name not in columns:
        return None
    return np.array([int(cell) for cell in columns.pop(name)], np.int64)


def _stamps(columns: dict[str, list[str]]) -> npt.NDArray[np.int64] | None:
    """Acquisition times (ns) from whole nanoseconds or from seconds."""
    if 'time_s' not in columns:
        return _integers(columns, 'stamp_ns')
    seconds = [cell.partition('.') for cell in columns.pop('time_s')]
    return np.array([int(s) * NS_PER_S + int(f'{part:0<9.9}') for s, _, part in seconds], np.int64)


def _truth(columns: dict[str, list[str]], taxels: int) -> dict[str, Array]:
    """Truth from the columns that bear its names."""
    truth = {}
    for key in TRUTH_KEYS:
        shape = field_shape(key, taxels) if key in STATE_FIELDS else ()
        names = _names(key, shape)
        if any(name in columns for name in names):
            samples = len(next(iter(columns.values())))
            blank = [''] * samples
            filled = {name: columns.pop(name, blank) for name in names}
            truth[key] = _floats(filled, names).reshape(samples, *shape)
    return truth


def _names(key: str, shape: tuple[int, ...]) -> list[str]:
    """Names of the columns that hold one key."""
    if not shape:
        return [key]
    if shape == (3,):
        return [f'{key}_{axis}' for axis in 'xyz']
    return [f'{key}_{n}' for n in range(math.prod(shape))]
