"""Drawings about classes: what was named against what was there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.figure import Figure
from tactile_ros.evaluation.svg import Plot

if TYPE_CHECKING:
    from tactile_ros.evaluation.metrics import Named
    from tactile_ros.evaluation.result import Dataset
    from tactile_ros.types import Array

LIMITS = (2.0, 5.0, 15.0, 40.0)  # % of a true class, between five shades
WRITTEN = 16  # classes up to which every share is written too
SHOWN = 0.5  # % below which a share is left empty
STRAYED = 3  # confusions that the caption names


def confusions(dataset: Dataset) -> list[Figure]:
    """A matrix for every kind of class that the first answer names."""
    return [_confusion(found) for found in dataset.answers[0].named]


def _confusion(found: Named) -> Figure:
    """Share of each true class that is named as each."""
    table = np.nan_to_num(found.table)
    count = len(table)
    ends = (-0.5, count - 0.5)
    told = f'{found.name} named against true {found.name}'
    plot = Plot(
        ends, ends, f'named {found.name}', f'true {found.name}', (380, 380), told=told, whole=True
    )
    true, said = np.nonzero(table >= SHOWN)
    kinds = [f's{min(1 + int(np.searchsorted(LIMITS, share)), 4)}' for share in table[true, said]]
    plot.boxes(said.astype(float), true.astype(float), 0.94, kinds)
    if count <= WRITTEN:
        for row, column in zip(true.tolist(), said.tolist(), strict=True):
            plot.text(column, row, f'{table[row, column]:.0f}', 'middle')
    bounds = ('0.5–2', '2–5', '5–15', '> 15 %')
    key = tuple((f's{i + 1}', words) for i, words in enumerate(bounds))
    return Figure(f'Which {found.name} is taken for which', _caption(found, table), str(plot), key)


def _caption(found: Named, table: Array) -> str:
    """Accuracy, and what is confused most."""
    text = f'{found.right:.1f} % of {found.count} rows are named rightly'
    if found.abstained:
        text += f', {found.abstained:.1f} % are not named'
    wrong = table - np.diag(np.diag(table))
    worst = np.argsort(wrong, axis=None)[::-1][:STRAYED]
    pairs = [divmod(int(k), len(table)) for k in worst if wrong.flat[k] >= SHOWN]
    if pairs:
        said = ', '.join(f'{a} for {b} ({wrong[a, b]:.0f} %)' for a, b in pairs)
        text += f'; taken most often: {said}'
    return f'{text}. A row adds up to 100 % with those not named.'
