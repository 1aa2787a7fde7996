"""Pressure under parts on a plane: even under a flat one, that of a sunk circle under a tube."""

from __future__ import annotations

import numpy as np

from tactile_ros.physics.outlines import inside
from tactile_ros.types import Array, Outline

SUNK = 0.5  # of a tube's radius: half the width of its contact


def part_pressure(part: Outline, points: Array) -> Array:
    """Pressure of a part at points of its own frame, 1 at most.

    Parameters
    ----------
    part : Outline
        Flat, or an angle tube of a radius `thickness`.
    points : ndarray, shape (n, 2)
        In the part's frame (m).

    Returns
    -------
    ndarray, shape (n,)
        Even under a flat part; under a tube what a circle sinks in below its chord.

    Examples
    --------
    >>> square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    >>> part_pressure(Outline('square', (square,)), np.array([[0.0, 0.0], [2.0, 0.0]])).tolist()
    [1.0, 0.0]
    """
    if part.bend is None:
        return inside(part.loops, points).astype(np.float64)
    x, y = points.T
    radius = float(part.thickness or 0.0)
    chord = np.sqrt(1 - SUNK**2) * radius
    found = np.zeros(len(x))
    for turn in (0.0, part.bend):
        along = np.cos(turn) * x + np.sin(turn) * y
        across = np.cos(turn) * y - np.sin(turn) * x
        depth = np.sqrt(np.maximum(radius**2 - across**2, 0.0)) - chord
        there = (along > 0) & (depth > 0)
        found = np.maximum(found, np.where(there, depth / (radius - chord), 0.0))
    return found


def washer(name: str, outer: float, inner: float, corners: int = 96) -> Outline:
    """Outline of a washer of two radii (m)."""
    turn = 2 * np.pi * np.arange(corners) / corners
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    return Outline(name, (outer * rim, (inner * rim)[::-1]))


def read_parts(text: str) -> tuple[Outline, ...]:
    """Parts of a text.

    Parameters
    ----------
    text : str
        Parts apart by semicolons: `washer OUTER INNER` (radii in mm), `tube BEND RADIUS` (degrees
        and mm), `polygon X Y X Y ...` (corners in mm, counter-clockwise). Empty: none.

    Returns
    -------
    tuple of Outline
        Named by their text.

    Raises
    ------
    ValueError
        If a part cannot be read.

    Examples
    --------
    >>> [part.name for part in read_parts('washer 16 8; tube 90 9')]
    ['washer_16_8', 'tube_90_9']
    """
    return tuple(_part(words.split()) for words in text.split(';') if words.strip())


def _part(words: list[str]) -> Outline:
    """One part of its words."""
    name = '_'.join(words)
    try:
        sizes = [float(word) for word in words[1:]]
        if words[0] == 'washer' and len(sizes) == 2 and sizes[0] > sizes[1] > 0:
            return washer(name, 1e-3 * sizes[0], 1e-3 * sizes[1])
        if words[0] == 'tube' and len(sizes) == 2 and sizes[1] > 0:
            return Outline(name, (), 1e-3 * sizes[1], float(np.deg2rad(sizes[0])))
        if words[0] == 'polygon' and len(sizes) >= 6 and len(sizes) % 2 == 0:
            return Outline(words[0], (1e-3 * np.reshape(sizes, (-1, 2)),))
    except ValueError as err:
        msg = f'parts must be numbers after their kind; received {" ".join(words)!r}'
        raise ValueError(msg) from err
    msg = (
        'parts must be "washer OUTER INNER", "tube BEND RADIUS" or "polygon X Y X Y X Y ..." in '
        f'mm and degrees, apart by semicolons; received {" ".join(words)!r}'
    )
    raise ValueError(msg)
