"""Which taxels of any layout are neighbours, and which are connected through them.

Taxels are neighbours where no other taxel lies between them, whatever the layout.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Integers

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


def connected(counts: Integers, others: Integers) -> Integers:
    """Component of each of n nodes.

    Parameters
    ----------
    counts : ndarray of int, shape (n,)
        Links that begin at each node.
    others : ndarray of int
        Where they end, node after node.

    Returns
    -------
    ndarray of int, shape (n,)
        Numbered by their first nodes.

    Examples
    --------
    >>> connected(np.array([1, 0, 0, 1, 0]), np.array([2, 4])).tolist()
    [0, 1, 0, 2, 2]
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    starts = np.zeros(len(counts) + 1, np.int32)
    np.cumsum(counts, out=starts[1:])
    links = (np.ones(len(others)), others.astype(np.int32), starts)
    graph = csr_matrix(links, shape=(len(counts), len(counts)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def flooded(near: list[list[int]], nodes: list[int], count: int) -> tuple[list[int], int]:
    """Component of a few of `count` nodes, numbered by their first nodes, and how many there are.

    It is quicker than a graph.
    """
    label = [-2] * count
    for node in nodes:
        label[node] = -1
    number = -1
    for node in nodes:
        if label[node] != -1:
            continue
        number += 1
        label[node] = number
        front = [node]
        while front:
            for other in near[front.pop()]:
                if label[other] == -1:
                    label[other] = number
                    front.append(other)
    return label, number + 1
