# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Figures 2, 4 and 5 of [1] remade: field, change and SNR by the method of magnetisation.

The sheet is folded none, one or three times when it is magnetised (M1 and M2, M3, M4), so that M4
has eight bands. [1] gives neither the remanence nor where in a cluster the chips sit, on which
the answer hangs: heads press all around the middle of cluster A1. Skins have no flaws.
"""

from dataclasses import replace

import numpy as np

from benchmarks.harness.plots import curves
from benchmarks.harness.rows import BenchResult, Row
from reference import multipole_world as world
from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
from tactile_ros.sensors.multipole_skin.specimen import NONE, POWERS, Specimen, snr
from tactile_ros.sensors.multipole_skin.twin import NOISE
from tactile_ros.types import Array

METHODS = ('M1', 'M2', 'M3', 'M4')
HEAD = world.regular('tapered', 48, 2e-3)
DEPTH, DEEPEST = 0.5e-3, 1e-3  # m
AROUND = {'quick': 3, 'normal': 5, 'full': 9}  # places along each side of the square around A1
REACH = 6e-3  # m, of that square
CLUSTERS = {'a1': slice(0, 4), 'a2': slice(4, 8)}  # chips
ACROSS = np.linspace(-37.5e-3, 37.5e-3, 301)  # m, the bands


def run(extent: str, command: str) -> BenchResult:
    """Figures by method, and their drawings."""
    config = MultipoleSkinConfig()
    line = np.linspace(-REACH, REACH, AROUND[extent])
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    depths = DEEPEST * np.linspace(0.02, 1.0, 50)
    rows, lines = [], {'rest': {}, 'snr': {}, 'a1': {}, 'a2': {}}
    for kind in METHODS:
        skin = Specimen(replace(config, magnetisation=kind), NONE)
        rows += _rows(kind, skin, places)
        height = np.full(len(ACROSS), skin.chips[:, 2].mean())
        points = np.column_stack([0 * ACROSS, ACROSS, height])
        lines['rest'][kind] = 1e3 * ACROSS, 1e3 * skin.sheet.field(points)[:, 2]
        for name, chips in CLUSTERS.items():
            middle = np.zeros(2) if name == 'a1' else config.positions[chips, :2].mean(axis=0)
            size = np.linalg.norm(_changes(skin, middle, depths)[:, chips], axis=2)
            lines[name][kind] = 1e3 * depths, 1e6 * size.sum(axis=1)
            if name == 'a1':
                lines['snr'][kind] = 1e3 * depths, snr(size.max(axis=1), NOISE)
    notes = [
        f'head: flat, 4 mm wide, {1e3 * DEPTH:g} mm deep; noise {1e6 * NOISE:g} uT; remanence '
        f'{config.remanence:g} T for all methods',
        'ours: mean over places around the middle of A1; bound: the best of these places; peer: '
        'the same at the middle by finite elements and another grid of dipoles',
        'paper: prints curves, no figures; says that M4 has the largest field and SNR',
    ]
    labels = {
        'rest': (
            'y (mm)',
            'Bz at rest (mT)',
            'Field at rest in the plane of the chips, by method',
        ),
        'snr': ('depth (mm)', 'SNR at A1 (dB)', 'Signal over noise by method'),
        'a1': ('depth (mm)', 'change at A1 (uT)', 'Change at A1 by method'),
        'a2': ('depth (mm)', 'change at A2 (uT)', 'Change at A2 by method'),
    }
    drawings = {name: curves(lines[name], labels[name][:2], labels[name][2]) for name in lines}
    return BenchResult('multipole_figures', command, [], rows, notes, drawings)


def _changes(skin: Specimen, place: Array, depths: Array) -> Array:
    """Change of the readings (s, t, 3) (T) under the head at depths (s,)."""
    terms = skin.terms(HEAD, np.array([*place, 0.0]), DEEPEST)
    return np.asarray(np.tensordot(depths[:, None] ** POWERS, terms, axes=1))


def _rows(kind: str, skin: Specimen, places: Array) -> list[Row]:
    """Field at rest, change and SNR of one method."""
    other = world.World(0, world.IDEAL, kind)
    theirs = other.press(HEAD, np.zeros(2), 0.0, np.array([DEPTH]))[0] - other.rest()
    ours = np.array([_changes(skin, place, np.array([DEPTH]))[0] for place in places])
    largest, peer = (
        np.linalg.norm(change[..., CLUSTERS['a1'], :], axis=-1).max(axis=-1)
        for change in (ours, theirs)
    )
    rest, still = (1e3 * np.linalg.norm(one.rest(), axis=1).mean() for one in (skin, other))
    return [
        Row(f'{kind}: {what}', unit, float(mean), 'high', peer=float(there), bound=bound)
        for what, unit, mean, there, bound in (
            ('field at the chips at rest (figure 2)', 'mT', rest, still, None),
            ('change at A1 (figure 5)', 'uT', 1e6 * largest.mean(), 1e6 * peer,
             1e6 * float(largest.max())),
            ('SNR at A1 (figure 4)', 'dB', snr(largest, NOISE).mean(), snr(peer, NOISE),
             float(snr(largest, NOISE).max())),
        )
    ]  # fmt: skip
