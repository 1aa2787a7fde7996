# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Patches of contact on an array of any layout: touched taxels that are connected.

Touched taxels that are connected through neighbours are one patch; where little pressure joins two
patches they are two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.physics.compiled import compiled
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


def neighbours(positions: Array) -> Integers:
    """Pairs of taxels that are neighbours.

    Parameters
    ----------
    positions : ndarray, shape (t, 3)
        Centres (m).

    Returns
    -------
    ndarray of int, shape (n, 2)
        Each pair once, the lower index first.

    Notes
    -----
    Two taxels are neighbours where no third one lies in the ball on their line, less a tenth:
    corners of a square are, every second one of a row or a ring is not. Nothing beyond three
    times the way to the nearest taxel is a neighbour.

    Examples
    --------
    >>> row = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0]])
    >>> neighbours(row).tolist()
    [[0, 1], [1, 2], [1, 3], [2, 3]]
    """
    from scipy.spatial import cKDTree

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


@compiled
def flood(links: Integers, first: Integers, among: Bools, label: Integers) -> int:
    """Write the component of each taxel (t,) that is marked, -1 of others; return their number.

    Neighbours of taxel k are `links[first[k] : first[k + 1]]`; components are numbered by their
    first taxels.
    """
    front, count = np.empty(len(among), np.int64), 0
    label[:] = -1
    for k in range(len(among)):
        if not among[k] or label[k] >= 0:
            continue
        front[0], label[k], reached, done = k, count, 1, 0
        while done < reached:
            here = front[done]
            done += 1
            for n in range(first[here], first[here + 1]):
                other = links[n]
                if among[other] and label[other] < 0:
                    label[other] = count
                    front[reached] = other
                    reached += 1
        count += 1
    return count


@compiled
def part(
    links: Integers, first: Integers, positions: Array, pressure: Array, touched: Bools,
    label: Integers,
) -> int:  # fmt: skip
    """Write the patch of each touched taxel (t,), and return their number.

    Connected taxels are one patch; where little pressure joins two, each lightly pressed taxel
    goes to the nearest firmly pressed one.
    """
    whole = np.empty(len(touched), np.int64)
    wholes = flood(links, first, touched, whole)
    peak, core = np.zeros(wholes), np.zeros(len(touched), np.bool_)
    for k in range(len(touched)):
        if touched[k]:
            peak[whole[k]] = max(peak[whole[k]], pressure[k])
    for k in range(len(touched)):
        core[k] = touched[k] and pressure[k] > JOINED * peak[whole[k]]
    count = flood(links, first, core, label)
    join_rims(positions, touched, core, whole, wholes, label)
    return count


@compiled
def join_rims(
    positions: Array, touched: Bools, core: Bools, whole: Integers, wholes: int, label: Integers
) -> None:
    """Give lightly pressed taxels to the nearest firmly pressed one of their whole."""
    only, parts = np.full(wholes, -1), np.zeros(wholes, np.int64)
    for k in range(len(touched)):
        if core[k] and only[whole[k]] != label[k]:
            only[whole[k]] = label[k]
            parts[whole[k]] += 1
    own = label.copy()
    for k in range(len(touched)):
        if not touched[k] or core[k]:
            continue
        label[k] = only[whole[k]]
        nearest = np.inf
        for n in range(len(touched) if parts[whole[k]] > 1 else 0):
            if own[n] >= 0 and whole[n] == whole[k]:
                away = np.square(positions[n] - positions[k]).sum()
                if away < nearest:
                    nearest, label[k] = away, own[n]


@compiled
def spread_of_centres(
    positions: Array, across: Array, weight: Array, variance: Array, label: Integers,
    total: Array, centre: Array, cov: Array,
) -> None:  # fmt: skip
    """Add to the covariance of each centre what the errors of its taxels make."""
    for k in range(len(label)):
        r = label[k]
        if r < 0:
            continue
        away = positions[k] - centre[r]
        scale, share = variance[k] / total[r] ** 2, weight[k] / total[r]
        for m in range(3):
            for n in range(3):
                cov[r, m, n] += scale * away[m] * away[n]
        # taxels do not tell where they are pressed; across a line nothing is taken back
        cov[r, 0, 0] += share * across[0, k]
        cov[r, 0, 1] += share * across[1, k]
        cov[r, 1, 0] += share * across[1, k]
        cov[r, 1, 1] += share * across[2, k]


@compiled
def rank_patches(
    own: Integers, weight: Array, rim: Bools, patches: int, rank: Integers, sums: Array
) -> None:
    """Write load, taxels and taxels at the rim of patches (n, 3), and their ranks by load."""
    sums[:] = 0.0
    for k in range(len(own)):
        if own[k] >= 0:
            sums[own[k], 0] += weight[k]
            sums[own[k], 1] += 1
            sums[own[k], 2] += rim[k]
    order = np.argsort(-sums[:, 0], kind='mergesort')
    for r in range(patches):
        rank[order[r]] = r


@compiled
def patches_of_rows(
    links: Integers, first: Integers, positions: Array, areas: Array, rim: Bools, across: Array,
    size: float, load: Array, variance: Array, touched: Bools, label: Integers, count: Integers,
    total: Array, spread: Array, centre: Array, cov: Array, area: Array,
) -> None:  # fmt: skip
    """Fill the patches of rows (s, t): see `Patches`."""
    most = total.shape[1]
    own = np.empty(load.shape[1], np.int64)
    for s in range(len(load)):
        weight = np.maximum(load[s], LEAST)
        patches = part(links, first, positions, weight / areas, touched[s], own)
        sums, rank = np.empty((patches, 3)), np.empty(patches, np.int64)
        rank_patches(own, weight, rim, patches, rank, sums)
        kept = sums.copy()
        for p in range(patches):
            kept[rank[p]] = sums[p]
        total[s, :patches], spread[s, :patches], area[s, :patches] = kept[:most, 0], 0.0, 0.0
        centre[s, :patches], cov[s, :patches] = 0.0, 0.0
        count[s] = min(patches, most)
        for k in range(len(own)):
            r = rank[own[k]] if own[k] >= 0 else -1
            r = r if r < most else -1
            label[s, k] = r
            if r >= 0:
                centre[s, r] += weight[k] / total[s, r] * positions[k]
                spread[s, r] += variance[s, k]
                area[s, r] += areas[k]
        spread_of_centres(
            positions, across, weight, variance[s], label[s], total[s], centre[s], cov[s]
        )
        for r in range(count[s]):
            taxels = kept[r, 1]
            blunt = taxels <= FEW_TAXELS or kept[r, 2] > 0
            blur = (BLUR if blunt else SHARP) * size / (taxels * taxels)
            cov[s, r, 0, 0] += blur
            cov[s, r, 1, 1] += blur


@dataclass(frozen=True)
class Patches:
    """Patches of s frames, strongest first, at most k of each; NaN where there is none."""

    label: Integers  # (s, t) patch of each taxel; -1: none
    count: Integers  # (s,) patches of each frame
    load: Array  # (s, k) sum of the loads of the taxels
    variance: Array  # (s, k) of the sum
    position: Array  # (s, k, 3) centre of pressure (m)
    position_cov: Array  # (s, k, 3, 3) of the centre (m2)
    area: Array  # (s, k) of the touched taxels (m2)


class PatchFinder:
    """Connected patches on one array.

    Parameters
    ----------
    positions : ndarray, shape (t, 3)
        Centres of the taxels (m).
    areas : ndarray, shape (t,)
        Of the taxels (m2).
    most : int
        Patches of a frame that are kept (k), the strongest.

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
        self.positions, self.areas = np.ascontiguousarray(positions), np.ascontiguousarray(areas)
        self.most = most
        pairs = neighbours(positions)
        self._near: list[list[int]] = [[] for _ in positions]
        for i, j in pairs.tolist():
            self._near[i].append(j)
            self._near[j].append(i)
        self._links = np.array([j for nodes in self._near for j in nodes], np.int64)
        self._first = np.cumsum([0] + [len(nodes) for nodes in self._near])
        self.size = float(np.median(areas))
        self._rim = np.array([self._is_rim(i) for i in range(len(positions))])
        layer = 2 * len(pairs) > LAYER * len(positions)
        self._across = np.zeros((3, len(positions))) if layer else self._lines()
        self.find(areas[None], areas[None], np.ones((1, len(areas)), bool))  # compiled now

    def find(self, load: Array, variance: Array, touched: Bools) -> Patches:
        """Patches of frames.

        Parameters
        ----------
        load, variance : ndarray, shape (s, t)
            Of each taxel, and its variance; any unit, no NaN.
        touched : ndarray, shape (s, t)
            Taxels on which something lies.

        Returns
        -------
        Patches
            In the unit of the loads.
        """
        shape = (len(load), self.most)
        found = Patches(
            np.empty(load.shape, np.int64), np.empty(len(load), np.int64),
            np.full(shape, np.nan), np.full(shape, np.nan), np.full((*shape, 3), np.nan),
            np.full((*shape, 3, 3), np.nan), np.full(shape, np.nan),
        )  # fmt: skip
        patches_of_rows(
            self._links, self._first, self.positions, self.areas, self._rim, self._across,
            self.size, np.ascontiguousarray(load), np.ascontiguousarray(variance),
            np.ascontiguousarray(touched), found.label, found.count, found.load, found.variance,
            found.position, found.position_cov, found.area,
        )  # fmt: skip
        return found

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
