# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Figures 2, 4 and 5 of [1] remade: field, change and SNR by the method of magnetisation.

The sheet is folded none, one or three times when it is magnetised (M1 and M2, M3, M4), so that M4
has eight bands. [1] gives neither the remanence nor where in a cluster the chips sit, on which
the answer hangs: heads press all around the middle of cluster A1. Skins have no flaws.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.evaluation.figures import Plot, standalone
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
from tactile_ros.sensors.multipole_skin.specimen import NONE, POWERS, Specimen, snr
from tactile_ros.sensors.multipole_skin.twin import NOISE
from tactile_ros.types import Outline

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.types import Array

METHODS = ('M1', 'M2', 'M3', 'M4')
ANGLE = np.linspace(0, 2 * np.pi, 48, endpoint=False)
HEAD = Outline('tapered', (2e-3 * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)]),))
DEPTH, DEEPEST = 0.5e-3, 1e-3  # m
AROUND = {'quick': 3, 'normal': 5, 'full': 9}  # places along each side of the square around A1
REACH = 6e-3  # m, of that square
A1, A2 = slice(0, 4), slice(4, 8)  # chips
MAPPED, CELL = 30, 11  # cells of the map along a side, and their size in pixels


def run(extent: str, command: str) -> BenchResult:
    """Figures by method, and their drawings."""
    config = MultipoleSkinConfig()
    skins = {kind: Specimen(replace(config, magnetisation=kind), NONE) for kind in METHODS}
    line = np.linspace(-REACH, REACH, AROUND[extent])
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    depths = DEEPEST * np.linspace(0.02, 1.0, 50)
    from reference import multipole_world as world

    rows, a1, a2 = [], {}, {}
    for kind, skin in skins.items():
        rows += _rows(kind, skin, places, world)
        a1[kind] = _changes(skin, np.zeros(2), depths)[:, A1]
        a2[kind] = _changes(skin, skin.config.positions[A2, :2].mean(axis=0), depths)[:, A2]
    notes = [
        f'head: flat, 4 mm wide, {1e3 * DEPTH:g} mm deep; noise {1e6 * NOISE:g} uT; remanence '
        f'{config.remanence:g} T for all methods',
        'ours: mean over places around the middle of A1; bound: the best of these places; peer: '
        'the same at the middle by finite elements and another grid of dipoles',
        'paper: prints curves, no figures; says that M4 has the largest field and SNR',
    ]
    snrs = {kind: snr(np.linalg.norm(one, axis=2).max(axis=1), NOISE) for kind, one in a1.items()}
    drawings = {
        'rest': _profile(skins),
        'map': _map(skins['M4']),
        'snr': _lines(depths, snrs, 'SNR at A1 (dB)', 'Signal over noise by method'),
        'a1': _lines(depths, _total(a1), 'change at A1 (uT)', 'Change at A1 by method'),
        'a2': _lines(depths, _total(a2), 'change at A2 (uT)', 'Change at A2 by method'),
    }
    return BenchResult('multipole_figures', command, [], rows, notes, drawings)


def _changes(skin: Specimen, place: Array, depths: Array) -> Array:
    """Change of the readings (s, t, 3) (T) under the head at depths (s,)."""
    terms = skin.terms(HEAD, np.array([*place, 0.0]), DEEPEST)
    return np.asarray(np.tensordot(depths[:, None] ** POWERS, terms, axes=1))


def _rows(kind: str, skin: Specimen, places: Array, world: ModuleType) -> list[Row]:
    """Field at rest, change and SNR of one method."""
    other = world.World(0, world.IDEAL, kind)
    head = world.regular('tapered', 48, 2e-3)
    theirs = other.press(head, np.zeros(2), 0.0, np.array([DEPTH]))[0] - other.rest()
    ours = np.array([_changes(skin, place, np.array([DEPTH]))[0] for place in places])
    largest = _largest(ours)
    rest, still = (np.linalg.norm(one.rest(), axis=1).mean() for one in (skin, other))
    peer = float(_largest(theirs[None])[0])
    return [
        Row(f'{kind}: field at the chips at rest (figure 2)', 'mT', 1e3 * float(rest), 'high',
            peer=1e3 * float(still)),
        Row(f'{kind}: change at A1 (figure 5)', 'uT', 1e6 * float(largest.mean()), 'high',
            peer=1e6 * peer, bound=1e6 * float(largest.max())),
        Row(f'{kind}: SNR at A1 (figure 4)', 'dB', float(snr(largest, NOISE).mean()), 'high',
            peer=float(snr(np.array(peer), NOISE)), bound=float(snr(largest, NOISE).max())),
    ]  # fmt: skip


def _largest(change: Array) -> Array:
    """Largest change of a chip of A1 (n,) (T) of changes (n, t, 3)."""
    return np.asarray(np.linalg.norm(change[:, A1], axis=2).max(axis=1))


def _total(changes: dict[str, Array]) -> dict[str, Array]:
    """Changes (s, 4, 3) (T) of the chips of one cluster, all together (uT), as in figure 5."""
    return {kind: 1e6 * np.linalg.norm(one, axis=2).sum(axis=1) for kind, one in changes.items()}


def _lines(depths: Array, curves: dict[str, Array], label: str, told: str) -> str:
    """Curves over the depth, one for each method."""
    every = np.concatenate(list(curves.values()))
    low, high = min(0.0, float(every.min())), 1.05 * float(every.max())
    plot = Plot((0.0, 1.25), (low, high), 'depth (mm)', label, (420, 280), description=told)
    for i, (kind, curve) in enumerate(curves.items()):
        plot.line(1e3 * depths, curve, f'line c{i}')
        plot.text(1e3 * float(depths[-1]), float(curve[-1]), kind)
    return standalone(plot)


def _profile(skins: dict[str, Specimen]) -> str:
    """Field at rest across the bands, in the plane of the Hall elements."""
    y = np.linspace(-37.5e-3, 37.5e-3, 301)
    height = skins['M4'].chips[:, 2].mean()
    points = np.column_stack([0 * y, y, np.full(len(y), height)])
    plot = Plot((-38, 38), (-16, 16), 'y (mm)', 'Bz at rest (mT)', (520, 280),
                description='Field at rest in the plane of the chips, by method')  # fmt: skip
    for i, (kind, skin) in enumerate(skins.items()):
        field = 1e3 * skin.sheet.field(points)[:, 2]
        plot.line(1e3 * y, field, f'line c{i}')
        top = int(np.abs(field).argmax())
        plot.text(1e3 * float(y[top]), float(field[top]), kind, 'middle', shift=-8)
    return standalone(plot)


def _map(skin: Specimen) -> str:
    """Bz of M4 in the plane of the Hall elements, and the chips over it."""
    line = 37.5e-3 * (2 * (np.arange(MAPPED) + 0.5) / MAPPED - 1)
    x, y = np.meshgrid(line, -line)
    points = np.stack([x, y, np.full_like(x, skin.chips[:, 2].mean())], axis=-1)
    field = skin.sheet.field(points)[..., 2]
    share = field / np.abs(field).max()
    drawn = [
        f'<rect x="{CELL * j}" y="{CELL * i}" width="{CELL}" height="{CELL}" '
        f'fill="{"#b2182b" if part > 0 else "#2166ac"}" fill-opacity="{abs(part):.2f}"/>'
        for (i, j), part in np.ndenumerate(share)
    ]
    side = MAPPED * CELL
    for chip in skin.chips[:, :2]:
        px, py = (0.5 + chip / 75e-3 * [1, -1]) * side
        drawn.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="3" fill="none" stroke="#111"/>')
    told = 'Field at rest of M4 in the plane of the chips: red up, blue down, rings chips'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{side}" height="{side}" viewBox="0 0 '
        f'{side} {side}" role="img" aria-label="{told}"><rect width="100%" height="100%" '
        f'fill="#fff"/>{"".join(drawn)}</svg>\n'
    )
