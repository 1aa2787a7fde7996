"""Multilayer perceptrons that vote: a small ensemble, trained at once.

Layers of tanh units trained by Adam (Kingma and Ba, ICLR 2015) on the length of the error rather
than its square, since a few touches are far off; members differ by their start and by the order of
their samples, and their mean errs less than any of them (Hansen and Salamon, Neural network
ensembles, IEEE TPAMI 12, 1990).
"""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.regression import Standardisation, fitted, predict_rows, training_rows
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    Single = npt.NDArray[np.float32]

MOST_STEPS, FEWEST_STEPS = 20_000, 1_500
WARM_UP = 0.05
MOMENTUM, INERTIA = 0.9, 0.99
FLOOR = 1e-3
BLOCK = 256


class Perceptron:
    """Mean of several perceptrons with two hidden layers.

    Parameters
    ----------
    members : int
        Perceptrons in the ensemble.
    width : int
        Units in each hidden layer.
    epochs : int
        Passes over the samples; shortened so that there are at most 20 000 steps.
    batch : int
        Samples of a step.
    rate : float
        Largest step of Adam; it falls to nothing along a cosine.
    softness : float
        Errors below this share of the targets' spread count by their square.
    pattern : bool
        See the direction of the features and the logarithm of their length instead of the
        features: where a touch is shows in the pattern, how deep it is in the length.
    seed : int
        Of starts and orders.

    Attributes
    ----------
    first_, second_, last_ : ndarray, shapes (m, p, w), (m, w, w), (m, w, k)
        Weights of the three layers, members along the first axis; of the features as they come,
        to the unit of y.

    Examples
    --------
    >>> x = np.linspace(-1, 1, 200)[:, None]
    >>> net = Perceptron(members=2, width=8).fit(x, np.sin(3 * x))
    >>> bool(np.abs(net.predict(x) - np.sin(3 * x)).max() < 0.1)
    True
    """

    moving_: Array  # (d,) 1 for features that moved in the fit, else 0
    length_: float  # length below which the logarithm flattens (unit of the features)
    first_: Array
    second_: Array
    last_: Array
    # constants; the last of all members together
    first_level_: Array
    second_level_: Array
    last_level_: Array

    def __init__(
        self, members: int = 8, width: int = 48, epochs: int = 300, batch: int = 64,
        rate: float = 1e-2, softness: float = 0.06, pattern: bool = False, seed: int = 0,
    ) -> None:  # fmt: skip
        self.members = members
        self.width = width
        self.epochs = epochs
        self.batch = batch
        self.rate = rate
        self.softness = softness
        self.pattern = pattern
        self.seed = seed

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> Perceptron:
        """Learn from x (s, d) and y (s, k) of one unit; groups are not used; see `Estimator`."""
        rows = training_rows(x, y, groups)
        # a column that never moved tells nothing, and must not drown the pattern of the others
        self.moving_ = (Standardisation().fit(rows.x).gain_ > 0).astype(np.float64)
        length = np.sqrt(((rows.x * self.moving_) ** 2).sum(axis=1))
        self.length_ = float(FLOOR * np.median(length) + np.finfo(np.float64).tiny)
        seen = self._seen(rows.x)
        scale, targets = Standardisation().fit(seen), Standardisation().fit(rows.y).share_spread()
        # Adam scales every input on its own, which helps where inputs are not correlated
        turn = np.linalg.eigh(scale(seen).T @ scale(seen))[1]
        trained = self._train(scale(seen) @ turn, targets(rows.y), self._trust(length))
        self._keep(*trained, scale, turn, targets)
        return self

    def sketch(self) -> Perceptron:
        """A cheaper one for trials, with three quarters of the members: it errs slightly more."""
        fewer = copy.deepcopy(self)
        fewer.members = max(1, 3 * self.members // 4)
        return fewer

    def predict(self, x: Array) -> Array:
        """Mean of the members, shape (s, k), at features (s, d); see `Estimator`."""
        fitted(self, 'last_level_')
        return predict_rows(x, self.first_.shape[1] - int(self.pattern), self._answer)

    def _answer(self, x: Array) -> Array:
        seen = self._seen(x)
        if len(seen) <= BLOCK:
            return self._forward(seen)
        # blocks that stay in the cache: twice as fast as one sweep
        parts = [self._forward(seen[i : i + BLOCK]) for i in range(0, len(seen), BLOCK)]
        return np.concatenate(parts)

    def _forward(self, seen: Array) -> Array:
        hidden = np.matmul(seen, self.first_)
        hidden += self.first_level_
        np.tanh(hidden, out=hidden)
        hidden = np.matmul(hidden, self.second_)
        hidden += self.second_level_
        np.tanh(hidden, out=hidden)
        return np.asarray(np.matmul(hidden, self.last_).sum(axis=0) + self.last_level_)

    def _seen(self, x: Array) -> Array:
        """What the units see of the features, shape (s, p)."""
        if not self.pattern:
            return x
        length = np.sqrt((x * x) @ self.moving_)[:, None] + self.length_
        seen = np.empty((len(x), x.shape[1] + 1))
        np.divide(x * self.moving_, length, out=seen[:, :-1])
        np.log(length, out=seen[:, -1:])
        return seen

    def _trust(self, length: Array) -> Array:
        """Weight of each sample (s,), of mean 1: noise turns the pattern of faint touches."""
        if not self.pattern:
            return np.ones(len(length))
        trust = length / np.hypot(length, np.median(length) + self.length_)
        trust += np.finfo(np.float64).tiny
        return np.asarray(trust / trust.mean())

    def _train(self, x: Array, y: Array, trust: Array) -> tuple[list[Array], list[Array]]:
        """Weights and levels of the three layers, members along the first axis."""
        inputs, targets = x.astype(np.float32), y.astype(np.float32)
        size = trust.astype(np.float32)[:, None]
        rng = np.random.default_rng(self.seed)
        sizes = (x.shape[1], self.width, self.width, y.shape[1])
        shapes = [(self.members, a, b) for a, b in pairwise(sizes)]
        shapes += [(self.members, 1, b) for b in sizes[1:]]
        flat = np.zeros(sum(int(np.prod(shape)) for shape in shapes), np.float32)
        slope = np.zeros_like(flat)
        layers, slopes = _views(flat, shapes), _views(slope, shapes)
        for weights in layers[:3]:
            weights[:] = rng.normal(size=weights.shape) / np.sqrt(weights.shape[1])
        batch = min(self.batch, len(x))
        steps = int(np.clip(self.epochs * len(x) // batch, FEWEST_STEPS, MOST_STEPS))
        step = _adam(flat, slope, steps, self.rate)
        for rows in _batches(len(x), batch, steps, self.members, rng):
            self._backward(inputs[rows], targets[rows], size[rows], layers, slopes)
            step()
        kept = [layer.astype(np.float64) for layer in layers]
        return kept[:3], kept[3:]

    def _backward(
        self, x: Single, y: Single, trust: Single, layers: list[Single], slopes: list[Single]
    ) -> None:
        """Slopes of the mean weighted soft length of the error of every member, in place."""
        seen = [x]
        for k in range(3):
            answer = seen[-1] @ layers[k] + layers[3 + k]
            seen.append(np.tanh(answer) if k < 2 else answer)
        miss = seen[-1] - y
        size = np.sqrt((miss * miss).sum(axis=-1, keepdims=True) + np.float32(self.softness**2))
        back = miss * trust / (size * np.float32(x.shape[1]))
        for k in (2, 1, 0):
            np.matmul(seen[k].transpose(0, 2, 1), back, out=slopes[k])
            slopes[3 + k][:] = back.sum(axis=1, keepdims=True)
            if k:
                back = (back @ layers[k].transpose(0, 2, 1)) * (1 - seen[k] * seen[k])

    def _keep(
        self, weights: list[Array], levels: list[Array], scale: Standardisation, turn: Array,
        targets: Standardisation,
    ) -> None:  # fmt: skip
        """Store the layers, scales and the mean of the members absorbed in the outer ones."""
        first = turn @ weights[0]
        self.first_ = scale.gain_[:, None] * first
        self.first_level_ = levels[0] - (scale.mean_ * scale.gain_)[None] @ first
        self.second_, self.second_level_ = weights[1], levels[1]
        self.last_ = weights[2] * (targets.spread_ / self.members)
        self.last_level_ = levels[2].mean(axis=0)[0] * targets.spread_ + targets.mean_


def _views(flat: Single, shapes: Sequence[tuple[int, ...]]) -> list[Single]:
    """Parts of one array under their own shapes."""
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    parts = np.split(flat, ends[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


def _adam(flat: Single, slope: Single, steps: int, rate: float) -> Callable[[], None]:
    """One step of Adam on `flat` along `slope` at each call; the rate rises, then falls."""
    mean, square = np.zeros_like(flat), np.zeros_like(flat)
    count = 0

    def step() -> None:
        nonlocal count
        count += 1
        share = count / steps
        size = rate * min(1.0, share / WARM_UP) * 0.5 * (1 + np.cos(np.pi * share))
        mean[:] = MOMENTUM * mean + (1 - MOMENTUM) * slope
        square[:] = INERTIA * square + (1 - INERTIA) * slope * slope
        unbiased = np.sqrt(1 - INERTIA**count) / (1 - MOMENTUM**count)
        flat[:] -= np.float32(size * unbiased) * mean / (np.sqrt(square) + np.float32(1e-8))

    return step


def _batches(
    samples: int, batch: int, steps: int, members: int, rng: np.random.Generator
) -> Iterator[Integers]:
    """Rows (m, b) of every step: each member in its own order, again and again."""
    left = steps
    while left > 0:
        order = np.stack([rng.permutation(samples) for _ in range(members)])
        for first in range(0, samples - batch + 1, batch):
            if left == 0:
                return
            left -= 1
            yield order[:, first : first + batch]
