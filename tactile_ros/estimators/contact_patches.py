"""Patches of contact on an array of any layout: touched taxels that are connected.

Touched taxels that are connected through neighbours are one patch; where little pressure joins two
patches they are two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers

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
def connected(counts: Integers, others: Integers) -> Integers:
    """Component of each of n nodes, numbered by their first nodes.

    Parameters
    ----------
    counts : ndarray of int, shape (n,)
        Links that begin at each node.
    others : ndarray of int
        Where they end, node after node.

    Examples
    --------
    >>> connected(np.array([1, 0, 0, 1, 0]), np.array([2, 4])).tolist()
    [0, 1, 0, 2, 2]
    """
    root, link = np.arange(len(counts)), 0
    for node in range(len(counts)):
        for _ in range(counts[node]):
            a, b = node, others[link]
            link += 1
            while root[a] != a:
                a = root[a]
            while root[b] != b:
                b = root[b]
            root[max(a, b)] = min(a, b)
    label, number = np.empty(len(counts), np.int64), 0
    for node in range(len(counts)):
        if root[node] == node:
            label[node] = number
            number += 1
        else:  # the root of an earlier node
            label[node] = label[root[node]]
    return label


SECOND = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])  # places of second powers among powers


@compiled
def is_torn(links: Integers, first: Integers, among: Bools, count: int) -> bool:
    """Whether some of `count` taxels, marked in (t,), are not connected to the others."""
    left, front = among.copy(), np.empty(count, np.int64)
    reached, done = 0, 0
    for k in range(len(left)):
        if left[k]:
            front[0], left[k], reached = k, False, 1
            break
    while done < reached:
        here = front[done]
        done += 1
        for n in range(first[here], first[here + 1]):
            other = links[n]
            if left[other]:
                front[reached], left[other] = other, False
                reached += 1
    return reached < count


@compiled
def is_one(
    links: Integers, first: Integers, areas: Array, joined: float, least: float, load: Array,
    touched: Bools,
) -> int:  # fmt: skip
    """How many taxels the one patch of a frame has; 0: there are several, or none."""
    pressure, count, cores = np.maximum(load, least) / areas, 0, 0
    most = 0.0
    for k in range(len(load)):
        if touched[k]:
            count += 1
            most = max(most, pressure[k])
    core = touched & (pressure > joined * most)
    for k in range(len(load)):
        cores += core[k]
    if is_torn(links, first, touched, count):
        return 0
    return 0 if cores < count and is_torn(links, first, core, cores) else count


@compiled
def lone_patch(
    links: Integers, first: Integers, areas: Array, powers: Array, joined: float, least: float,
    load: Array, variance: Array, touched: Bools, centre: Array, cov: Array,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Taxels, load, its variance and area of the one patch; 0 taxels: there are several or none.

    `centre` (3,) and `cov` (3, 3) are filled.
    """
    sums, total, area = np.zeros(10), 0.0, 0.0
    count = is_one(links, first, areas, joined, least, load, touched)
    if not count:
        return 0, total, total, area
    centre[:] = 0.0
    for k in range(len(load)):
        if touched[k]:
            weight = max(load[k], least)
            total += weight
            area += areas[k]
            centre += weight * powers[k, 1:4]
            sums += variance[k] * powers[k]
    centre /= total
    for m in range(3):
        for n in range(3):
            own = sums[0] * centre[m] * centre[n]
            rest = sums[SECOND[m, n]] - centre[m] * sums[1 + n] - centre[n] * sums[1 + m]
            cov[m, n] = (rest + own) / (total * total)
    return count, total, sums[0], area


JOINED = 0.1  # of a patch's largest pressure: less joins nothing
LEAST = 1e-12  # load of a touched taxel (unit of loads)
BLUR = 0.1  # of a taxel's area: variance of a centre that one taxel tells
SHARP = 0.016  # the same over the square of the taxels, where a patch has a middle
FEW_TAXELS = 4  # have none
OPEN = 2.4  # rad without a neighbour: a taxel at the rim, where a body is cut off on one side
LAYER = 3.0  # neighbours of a taxel, on average: with less the taxels lie in a line
BLOCK = 200_000  # taxels of frames that are looked at in one go


@dataclass(frozen=True)
class Patches:
    """Patches of s frames, strongest first, at most k of each."""

    label: Integers  # (s, t) patch of each taxel; -1: none
    count: Integers  # (s,) patches of each frame
    # (s, k) sum of the loads of the taxels, and its variance; NaN: no patch
    load: Array
    variance: Array
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
        self.positions, self.areas, self.most = positions, areas, most
        self.pairs = neighbours(positions)
        self._near: list[list[int]] = [[] for _ in positions]
        for i, j in self.pairs.tolist():
            self._near[i].append(j)
            self._near[j].append(i)
        ahead = np.bincount(self.pairs[:, 0], minlength=len(positions)).max(initial=1)
        self._ahead = np.repeat(np.arange(len(positions))[:, None], ahead, axis=1)
        self._links = np.array([j for nodes in self._near for j in nodes], np.int64)
        self._first = np.cumsum([0] + [len(nodes) for nodes in self._near])
        for i, nodes in enumerate(self._near):
            later = [j for j in nodes if j > i]
            self._ahead[i, : len(later)] = later
        x, y, z = positions.T
        one = np.ones(len(positions))
        self._powers = np.stack([one, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z], axis=1)
        self.size = float(np.median(areas))
        self._rim = np.array([self._is_rim(i) for i in range(len(positions))])
        self._across = None if 2 * len(self.pairs) > LAYER * len(positions) else self._lines()
        self._lone(areas, areas, np.ones(len(areas), bool))  # compiled now, not under a frame
        connected(*np.zeros((2, 1), np.int64))

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
        samples, taxels = load.shape
        step = max(BLOCK // taxels, 1)
        blocks = [slice(i, i + step) for i in range(0, samples, step)]
        if len(blocks) == 1:
            return self._block(load, variance, touched)
        found = [self._block(load[b], variance[b], touched[b]) for b in blocks]
        return Patches(
            *(np.concatenate([vars(one)[name] for one in found]) for name in vars(found[0]))
        )

    def _block(self, load: Array, variance: Array, touched: Bools) -> Patches:
        """Patches of as many frames as fit."""
        if len(load) == 1:
            alone = self._lone(load[0], variance[0], touched[0])
            if alone is not None:
                return alone
        node = np.flatnonzero(touched)
        if not len(node):
            return self._nothing(load.shape)
        row, taxel = np.divmod(node, load.shape[1])
        weight = np.maximum(load.reshape(-1)[node], LEAST)
        patch = self._parted(node, taxel, weight / self.areas[taxel], len(load))
        count = int(patch.max(initial=-1)) + 1
        total = np.bincount(patch, weight, count)
        home = np.zeros(count, np.int64)
        home[patch] = row
        order = np.lexsort((-total, home))
        rank = np.empty(count, np.int64)
        rank[order] = np.arange(count) - np.searchsorted(home[order], home[order])
        kept = rank < self.most
        told = self._measured(patch, taxel, weight, variance.reshape(-1)[node], count)
        label = np.full(load.shape, -1, np.int64)
        label[row, taxel] = np.where(kept[patch], rank[patch], -1)
        columns = []
        for column in told:
            wide = np.full((len(load), self.most, *column.shape[1:]), np.nan)
            wide[home[kept], rank[kept]] = column[kept]
            columns.append(wide)
        return Patches(label, np.bincount(home[kept], minlength=len(load)), *columns)

    def _nothing(self, shape: tuple[int, ...]) -> Patches:
        """No patch in any frame (s, t)."""
        blank = np.empty((15, shape[0], self.most))
        blank.fill(np.nan)
        tail = (shape[0], self.most)
        return Patches(
            np.full(shape, -1), np.zeros(shape[0], np.int64), blank[0], blank[1],
            blank[2:5].reshape(*tail, 3), blank[5:14].reshape(*tail, 3, 3), blank[14],
        )  # fmt: skip

    def _lone(self, load: Array, variance: Array, touched: Bools) -> Patches | None:
        """The one patch of one frame; None: there are several or none."""
        found = self._nothing((1, len(load)))
        count, total, spread, area = lone_patch(
            self._links, self._first, self.areas, self._powers, JOINED, LEAST,
            load, variance, touched, found.position[0, 0], found.position_cov[0, 0],
        )  # fmt: skip
        if not count:
            return None
        self._blur_one(found.position_cov[0, 0], load, touched, count)
        found.label[0, touched] = 0
        found.count[0] = 1
        found.load[0, 0], found.variance[0, 0], found.area[0, 0] = total, spread, area
        return found

    def _blur_one(self, cov: Array, load: Array, touched: Bools, count: int) -> None:
        """As `_blur`, of the one patch of a frame (3, 3)."""
        cut = np.count_nonzero(self._rim & touched) > 0
        part = (BLUR if count <= FEW_TAXELS or cut else SHARP) * self.size / (count * count)
        cov[0, 0] += part
        cov[1, 1] += part
        if self._across is not None:
            taxel = np.flatnonzero(touched)
            weight = np.maximum(load[taxel], LEAST)
            self._add_across(cov[None], weight, taxel, np.zeros(count, np.int64))

    def _blur(
        self, cov: Array, count: Array, weight: Array, taxel: Integers, patch: Integers
    ) -> None:
        """Add to covariances (n, 3, 3) that taxels do not tell where they are pressed.

        Counted for even and domed presses of any size that lie anywhere on a matrix: at its edge
        a body presses parts of taxels, and what one side makes of it the other takes back.
        """
        cut = np.bincount(patch, self._rim[taxel], len(cov)) > 0
        part = np.where((count <= FEW_TAXELS) | cut, BLUR, SHARP)
        cov[:, [0, 1], [0, 1]] += (part * self.size / (count * count))[:, None]
        if self._across is not None:
            self._add_across(cov, weight, taxel, patch)

    def _add_across(self, cov: Array, weight: Array, taxel: Integers, patch: Integers) -> None:
        """The same across lines of taxels, where nothing is taken back: anywhere is as likely."""
        assert self._across is not None
        total = np.bincount(patch, weight, len(cov))
        for (i, j), own in zip(((0, 0), (0, 1), (1, 1)), self._across, strict=True):
            cov[:, i, j] += np.bincount(patch, weight * own[taxel], len(cov)) / total
            cov[:, j, i] = cov[:, i, j]

    def _is_rim(self, taxel: int) -> bool:
        """Whether a taxel has no neighbour on one side."""
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

    def _measured(
        self, patch: Integers, taxel: Integers, weight: Array, variance: Array, count: int
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Load, variance, centre (n, 3), its covariance (n, 3, 3) and area of every patch."""
        powers = self._powers[taxel].T
        terms = [*(weight * powers[:4]), *(variance * powers), self.areas[taxel], powers[0]]
        sums: Array = np.array([np.bincount(patch, term, count) for term in terms]).T
        total, spread = np.maximum(sums[:, 0], 1e-100), sums[:, 4]
        centre = sums[:, 1:4] / total[:, None]
        first, second = sums[:, 5:8], sums[:, 4 + SECOND]
        mixed = centre[:, :, None] * first[:, None]
        own = spread[:, None, None] * centre[:, :, None] * centre[:, None]
        cov = (second - mixed - mixed.transpose(0, 2, 1) + own) / total[:, None, None] ** 2
        self._blur(cov, sums[:, -1], weight, taxel, patch)
        return total, spread, centre, cov, sums[:, -2]

    def _parted(self, node: Integers, taxel: Integers, pressure: Array, rows: int) -> Integers:
        """Patch of each touched taxel (n,): connected ones, cut where little joins them."""
        whole = self._connected(node, taxel, rows)
        peak = np.zeros(int(whole.max()) + 1)
        np.maximum.at(peak, whole, pressure)
        core = pressure > JOINED * peak[whole]
        if core.all():
            return whole
        patch = np.full(len(node), -1)
        patch[core] = self._connected(node[core], taxel[core], rows)
        return self._with_rims(patch, whole, core, taxel)

    def _connected(self, node: Integers, taxel: Integers, rows: int) -> Integers:
        """Component of each touched taxel (n,), numbered by their first ones."""
        taxels = len(self.positions)
        number = np.full(rows * taxels, -1)
        number[node] = np.arange(len(node))
        others = number[self._ahead[taxel] + (node - taxel)[:, None]]
        hit = others >= 0
        return connected(np.count_nonzero(hit, axis=1), others[hit])

    def _with_rims(
        self, patch: Integers, whole: Integers, core: Bools, taxel: Integers
    ) -> Integers:
        """Patches with their lightly pressed rims: each taxel to the nearest of its whole."""
        owner = np.zeros(int(patch.max()) + 1, np.int64)
        owner[patch[core]] = whole[core]
        cores = np.bincount(owner)
        only = np.zeros(len(cores), np.int64)
        only[owner] = np.arange(len(owner))
        rim = np.flatnonzero(~core)
        patch[rim] = only[whole[rim]]
        torn = rim[cores[whole[rim]] > 1]
        if not len(torn):
            return patch
        inner, place = np.flatnonzero(core), self.positions[taxel]
        inner = inner[cores[whole[inner]] > 1]
        for part in np.unique(whole[torn]):
            mine, there = torn[whole[torn] == part], inner[whole[inner] == part]
            away = np.square(place[mine, None] - place[None, there]).sum(axis=2)
            patch[mine] = patch[there[np.argmin(away, axis=1)]]
        return patch
