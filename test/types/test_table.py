"""Tables of figures: every row has a cell for every column."""

from __future__ import annotations

import pytest

from tactile_ros.types.table import Table


def test_rows_have_a_cell_for_each_column() -> None:
    Table('t', ('a', 'b'), ((1.0, None), ('x', 2)))
    with pytest.raises(ValueError, match="rows of 't' must have 2 cells"):
        Table('t', ('a', 'b'), ((1.0,),))
