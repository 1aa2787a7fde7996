"""Drawings of reports as PNG files, for slides and papers: light, each with its headline."""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING

from tactile_ros.evaluation.browser import photograph
from tactile_ros.evaluation.figures import colours_of, figures_of
from tactile_ros.evaluation.page import key_of
from tactile_ros.evaluation.stylesheet import STYLE

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from tactile_ros.evaluation.figure import Figure
    from tactile_ros.evaluation.result import Result

VIEW = re.compile(r'<svg class="plot" viewBox="0 0 ([\d.]+) ([\d.]+)"')
MARGIN, HEADLINE, KEY = 16, 30, 26  # pixels
OTHER = re.compile(r'[^a-z0-9]+')


def file_name(title: str) -> str:
    """A headline as the name of a file.

    Examples
    --------
    >>> file_name('Place, unseen points: (mm)')
    'place_unseen_points_mm'
    """
    return OTHER.sub('_', title.lower()).strip('_')


def figure_page(figure: Figure) -> tuple[str, tuple[int, int]]:
    """A page with one drawing alone, and the size of a window that it fills."""
    sizes = [(float(a), float(b)) for a, b in VIEW.findall(figure.drawing)]
    wide = max(a for a, _ in sizes)
    high = sum(b * wide / a + 10 for a, b in sizes)
    key = KEY if figure.key else 0
    body = f'<h3>{escape(figure.title)}</h3>{key_of(figure)}{figure.drawing}'
    return light_page(body), (round(wide) + 2 * MARGIN, round(high) + HEADLINE + key + 2 * MARGIN)


def light_page(body: str) -> str:
    """A page in light colours, whatever the reader prefers."""
    light = STYLE.replace('prefers-color-scheme: dark', 'not all').replace('light dark', 'light')
    return (
        f'<!DOCTYPE html><html lang="en"><meta charset="utf-8"><style>{light}'
        f'body {{ padding: {MARGIN}px; background: var(--card); }}</style>{body}</html>'
    )


def write_figures(folder: Path, figures: Iterable[Figure], prefix: str = '') -> Iterable[Path]:
    """Write every drawing as PNG; yield each path when it is there."""
    for figure in figures:
        page, size = figure_page(figure)
        name = file_name(f'{prefix} {figure.title}')
        yield photograph(page, folder / f'{name}.png', size)


def write_drawings(folder: Path, result: Result) -> Iterable[Path]:
    """Write the drawings of an evaluation as PNG, named after their recordings."""
    colours = colours_of(result)
    for dataset in result.datasets:
        yield from write_figures(folder, figures_of(dataset, colours), dataset.name)
