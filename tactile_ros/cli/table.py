"""Tables of the terminal and of --json."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types.contracts import Cell


def figure(value: Cell, digits: int = 3) -> str:
    """A cell as text: `-` where nothing is known, few digits otherwise."""
    if value is None or (isinstance(value, float) and value != value):  # noqa: PLR0124
        return '-'
    if isinstance(value, float):
        return f'{value:.{digits}g}' if abs(value) < 1000 else f'{value:.0f}'
    return str(value)


def show(columns: Sequence[str], rows: Sequence[Sequence[Cell]], title: str = '') -> None:
    """Print a table; numbers to the right."""
    texts = [[figure(cell) for cell in row] for row in rows]
    widths = [max(len(r[i]) for r in (list(columns), *texts)) for i in range(len(columns))]
    numeric = [all(not isinstance(row[i], str) for row in rows) for i in range(len(columns))]
    if title:
        print(f'\n{title}')
    for line in (list(columns), ['-' * w for w in widths], *texts):
        cells = [
            c.rjust(w) if n else c.ljust(w) for c, w, n in zip(line, widths, numeric, strict=True)
        ]
        print('  '.join(cells).rstrip())


def as_objects(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> list[dict[str, Cell]]:
    """The same table as a list of objects; what is not finite becomes null."""
    return [dict(zip(columns, (_plain(cell) for cell in row), strict=True)) for row in rows]


def _plain(cell: Cell) -> Cell:
    """A cell as json has it, numbers of numpy as numbers."""
    value: Cell = cell.item() if isinstance(cell, np.generic) else cell
    return None if isinstance(value, float) and not np.isfinite(value) else value


def show_json(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    """Print the same table as a list of objects; what is not finite becomes null."""
    print(json.dumps(as_objects(columns, rows), indent=2))
