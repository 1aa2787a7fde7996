# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Patches of contact on an array of any layout: touched taxels that are connected.

Touched taxels that are connected through neighbours are one patch; where little pressure joins two
patches they are two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tactile_ros.types import Array, Bools, Integers

JOINED = 0.1  # of a patch's largest pressure: less joins nothing
LEAST = 1e-12  # load of a touched taxel (unit of loads)
BLUR = 0.1  # of a taxel's area: variance of a centre that one taxel tells
SHARP = 0.016  # the same over the square of the taxels, where a patch has a middle
FEW_TAXELS = 4  # have none
OPEN = 2.4  # rad without a neighbour: a taxel at the rim, where a body is cut off on one side
LAYER = 3.0  # neighbours of a taxel, on average: with less the taxels lie in a line
REACH = 3.0  # of the way to the nearest taxel: no neighbour lies farther
BETWEEN = 0.9  # of the half way: a taxel as near to the middle of a pair lies between
ROUND = 16  # taxels around a pair that are looked at
BLOCK = 20_000  # taxels of frames that are looked at together


def neighbours(positions: Array) -> Integers:
    """Pairs (n, 2) of taxels at positions (t, 3) that are neighbours, the lower index first.

    Two taxels are neighbours where no third one lies in the ball on their line, less a tenth:
    corners of a square are, every second one of a row or a ring is not. Nothing beyond three
    times the way to the nearest taxel is a neighbour.

    Examples
    --------
    >>> row = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0]])
    >>> neighbours(row).tolist()
    [[0, 1], [1, 2], [1, 3], [2, 3]]
    """
    count = len(positions)
    if count < 2:
        return np.zeros((0, 2), np.int64)
    tree = cKDTree(positions)
    near = tree.query(positions, 2)[0][:, 1]
    others = tree.query(positions, min(4 * ROUND, count))[1]
    first = np.repeat(np.arange(count), others.shape[1])
    pairs = np.column_stack([first, others.reshape(-1)])
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    a, b = positions[pairs[:, 0]], positions[pairs[:, 1]]
    away = np.linalg.norm(a - b, axis=1)
    close = away <= REACH * np.maximum(near[pairs[:, 0]], near[pairs[:, 1]])
    pairs, a, b, away = pairs[close], a[close], b[close], away[close]
    distance, who = tree.query((a + b) / 2, min(3, count))
    third = (who != pairs[:, :1]) & (who != pairs[:, 1:])
    blocked = (third & (distance < BETWEEN * away[:, None] / 2)).any(axis=1)
    return np.asarray(pairs[~blocked], np.int64)


@dataclass(frozen=True)
class Patches:
    """Patches of s frames, strongest first, at most k of each; NaN where there is none."""

    label: Integers  # (s, t) patch of each taxel; -1: none
    count: Integers  # (s,) patches of each frame
    load: Array  # (s, k) sum of the loads of the taxels
    variance: Array  # (s, k) of the sum
    position: Array  # (s, k, 3) centre of pressure (m)
    position_cov: Array  # (s, k, 3, 3) of the centre (m2)


class PatchFinder:
    """Connected patches, of each frame the `most` strongest, on taxels at positions (t, 3).

    Examples
    --------
    >>> row = np.arange(5)[:, None] * np.array([1e-3, 0, 0])
    >>> finder = PatchFinder(row, np.full(5, 1e-6), 2)
    >>> load = np.array([[1.0, 1.0, 0.0, 0.0, 3.0]])
    >>> found = finder.find(load, 0 * load, load > 0)
    >>> found.label.tolist(), found.load.tolist()
    ([[1, 1, -1, -1, 0]], [[3.0, 2.0]])
    """

    def __init__(self, positions: Array, areas: Array, most: int) -> None:
        self.positions, self.areas, self.most = positions, areas, most
        self.pairs = neighbours(positions)
        self._near: list[list[int]] = [[] for _ in positions]
        for i, j in self.pairs.tolist():
            self._near[i].append(j)
            self._near[j].append(i)
        self.size = float(np.median(areas))
        self._rim = np.array([self._is_rim(i) for i in range(len(positions))])
        layer = 2 * len(self.pairs) > LAYER * len(positions)
        self._across = np.zeros((3, len(positions))) if layer else self._lines()

    def find(self, load: Array, variance: Array, touched: Bools) -> Patches:
        """Patches of frames, in the unit of the loads (s, t).

        These and their variances (s, t) have no NaN; `touched` (s, t) are taxels on which
        something lies.
        """
        step = max(BLOCK // len(self.areas), 1)
        blocks = [slice(i, i + step) for i in range(0, max(len(load), 1), step)]
        parts = [self._find(load[rows], variance[rows], touched[rows]) for rows in blocks]
        return Patches(
            **{
                name: np.concatenate([vars(part)[name] for part in parts])
                for name in vars(parts[0])
            }
        )

    def _find(self, load: Array, variance: Array, touched: Bools) -> Patches:
        """Patches of a few frames."""
        weight = np.maximum(load, LEAST)
        row, taxel = np.nonzero(touched)
        own = self._parts(weight / self.areas, touched)[touched]
        _, first, patch = np.unique(own, return_index=True, return_inverse=True)
        patch, count, of_row = patch.reshape(-1), len(first), row[first]

        def sum_of(values: Array) -> Array:
            return np.bincount(patch, values, count).astype(np.float64)  # of none: integers

        weight = weight[touched]
        whole, taxels = sum_of(weight), sum_of(np.ones(len(patch)))
        share = weight / whole[patch]
        centre = np.stack([sum_of(share * axis) for axis in self.positions[taxel].T], axis=1)
        away = (self.positions[taxel] - centre[patch]).T
        scale = variance[touched] / whole[patch] ** 2
        cov = np.array([[sum_of(scale * a * b) for a in away] for b in away]).transpose(2, 0, 1)
        # taxels do not tell where they are pressed; across a line nothing is taken back
        xx, xy, yy = (sum_of(share * one[taxel]) for one in self._across)
        blunt = (taxels <= FEW_TAXELS) | (sum_of(self._rim[taxel]) > 0)
        blur = np.where(blunt, BLUR, SHARP) * self.size / (taxels * taxels)
        cov[:, :2, :2] += np.array([[xx + blur, xy], [xy, yy + blur]]).transpose(2, 0, 1)
        order = np.lexsort([-whole, of_row])
        rank = np.empty(count, np.int64)
        rank[order] = np.arange(count) - np.searchsorted(of_row[order], of_row[order])
        label = np.full(touched.shape, -1)
        label[touched] = np.where(rank < self.most, rank, -1)[patch]
        kept = rank < self.most
        at, shape = (of_row[kept], rank[kept]), (len(load), self.most)

        def column(values: Array) -> Array:
            wide = np.full((*shape, *values.shape[1:]), np.nan)
            wide[at] = values[kept]
            return wide

        return Patches(
            label, np.bincount(of_row[kept], minlength=len(load)), column(whole),
            column(sum_of(variance[touched])), column(centre), column(cov),
        )  # fmt: skip

    def _parts(self, pressure: Array, touched: Bools) -> Integers:
        """Number (s, t) of the patch of each touched taxel.

        Connected taxels are one patch; where little pressure joins two, each lightly pressed taxel
        goes to the nearest firmly pressed one.
        """
        whole, peak = self._components(touched), np.zeros(touched.size)
        np.maximum.at(peak, whole[touched], pressure[touched])
        core = touched & (pressure > JOINED * peak[whole])
        label, light = self._components(core), touched & ~core
        only, split = np.full(touched.size, -1), np.zeros(touched.size, bool)
        only[whole[core]] = label[core]
        split[whole[core & (only[whole] != label)]] = True
        label[light] = only[whole[light]]
        for row, taxel in np.argwhere(light & split[whole]):
            away = np.square(self.positions - self.positions[taxel]).sum(axis=1)
            same = core[row] & (whole[row] == whole[row, taxel])
            label[row, taxel] = label[row, np.where(same, away, np.inf).argmin()]
        return label

    def _components(self, among: Bools) -> Integers:
        """Number (s, t) of the connected taxels that each marked one is of."""
        i, j = self.pairs.T  # sorted by the first of each
        row, pair = np.nonzero(among[:, i] & among[:, j])
        before = row * among.shape[1]
        first = np.searchsorted(before + i[pair], np.arange(among.size + 1))
        entries = np.ones(len(row)), (before + j[pair]).astype(np.int32), first.astype(np.int32)
        links = csr_matrix(entries, (among.size, among.size))
        found: Integers = connected_components(links, directed=False)[1]
        return found.reshape(among.shape)

    def _is_rim(self, taxel: int) -> bool:
        """Taxels without a neighbour on one side."""
        away = self.positions[self._near[taxel], :2] - self.positions[taxel, :2]
        angle = np.sort(np.arctan2(away[:, 1], away[:, 0]))
        return len(angle) == 0 or np.diff(angle, append=angle[0] + 2 * np.pi).max() > OPEN

    def _lines(self) -> Array:
        """Variances xx, xy, yy (3, t) of a place across the line in which each taxel lies."""
        own = np.zeros((3, len(self.positions)))
        for i, nodes in enumerate(self._near):
            if not nodes:
                own[[0, 2], i] = self.areas[i] / 12
                continue
            away = self.positions[nodes, :2] - self.positions[i, :2]
            reach = np.linalg.norm(away, axis=1)
            along = away[-1] - away[0] if len(nodes) > 1 else away[0]
            x, y = along / np.linalg.norm(along)
            wide = float(self.areas[i] / reach.mean()) ** 2 / 12
            own[:, i] = wide * y * y, -wide * x * y, wide * x * x
        return own
