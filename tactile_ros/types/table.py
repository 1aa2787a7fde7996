"""A table of figures: its title, its columns with their units, its rows, what to know of it."""

from __future__ import annotations

from dataclasses import dataclass

Cell = str | float | int | None


@dataclass(frozen=True)
class Table:
    """Figures to print or to write as json.

    Attributes
    ----------
    title : str
        What the figures are.
    columns : tuple of str
        Names with units, such as 'gap (mm)'.
    rows : tuple of tuple
        One cell for each column: text, a number, or None or NaN where nothing is known.
    notes : tuple of str
        Sentences that stand below.

    Raises
    ------
    ValueError
        If a row has another number of cells than there are columns.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the rows."""
        for row in self.rows:
            if len(row) != len(self.columns):
                msg = f'rows of {self.title!r} must have {len(self.columns)} cells; received {row}'
                raise ValueError(msg)
