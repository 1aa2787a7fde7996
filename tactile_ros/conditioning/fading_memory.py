"""Memory of a viscoelastic skin: exponentially fading means of the past change of field.

Stress in a linear viscoelastic body depends on its past strain through decaying exponentials (a
Prony series), so the means of the change of field over several time constants, besides the change
itself, are what a regressor needs to tell loading from unloading and a fresh press from a held
one. Between frames the change is taken as linear in time, which makes the means depend on the
signal and not on the rate, the jitter or the gaps with which it was sampled.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tactile_ros.types import Array, Bools, Integers, as_shape

SECONDS_PER_NS = 1e-9
FEW = 64  # frames up to which each is taken by itself: to the last bit as they are live


class FadingMemory:
    """Fading means of one stream, one frame at a time or many at once with the same numbers.

    Parameters
    ----------
    time_constants : ndarray, shape (m,)
        Time constants of the memory (s).

    Raises
    ------
    ValueError
        If a time constant is not positive.

    Notes
    -----
    With the change x linear between two frames dt apart and a = exp(-dt / tau), the mean
    follows mean' = a mean + (g - a) x + (1 - g) x' exactly, g = (1 - a) tau / dt.

    Examples
    --------
    >>> history = FadingMemory(np.array([0.5]))
    >>> for stamp_ns in (0, 500_000_000, 1_000_000_000):
    ...     mean = history.step(np.ones(1), stamp_ns)
    >>> round(float(mean[0, 0]), 3)
    0.865
    """

    def __init__(self, time_constants: Array) -> None:
        self.time_constants = as_shape('time_constants of FadingMemory', time_constants, (-1,))
        if not (self.time_constants > 0).all():
            msg = f'time_constants of FadingMemory must be positive; received {time_constants}'
            raise ValueError(msg)
        self._rate = -SECONDS_PER_NS / self.time_constants[:, None]
        self.reset()

    def reset(self) -> None:
        """Forget the past: what came before counts as rest."""
        self._stamp_ns: int | None = None
        self._last = np.zeros(0)
        self._lag = np.zeros((len(self.time_constants), 0))

    def step(self, change: Array, stamp_ns: int) -> Array:
        """Take one frame into the memory.

        Parameters
        ----------
        change : ndarray, shape (d,)
            Change since the tare; NaN: not measured, the last change is held.
        stamp_ns : int
            Acquisition time; a frame that is not newer than the last one is not remembered.

        Returns
        -------
        ndarray, shape (m, d)
            Means after this frame (unit of change), 0 at the first frame.
        """
        self._take(change, stamp_ns)
        return self._last - self._lag

    def behind(self, change: Array, stamp_ns: int) -> Array:
        """As `step`, but how far the means are behind the change, shape (m, d)."""
        self._take(change, stamp_ns)
        return self._lag + (change - self._last)

    def _take(self, change: Array, stamp_ns: int) -> None:
        missing = np.isnan(change)
        if np.count_nonzero(missing):
            change = np.where(missing, self._last if self._last.size else 0.0, change)
        if self._stamp_ns is None:
            self._last, self._lag = change.copy(), np.tile(change, (len(self.time_constants), 1))
            self._stamp_ns = stamp_ns
            return
        elapsed = stamp_ns - self._stamp_ns
        if elapsed <= 0:
            return
        exponent = elapsed * self._rate
        # the change less its mean fades, and takes in the average of the step since
        step = np.expm1(exponent) / exponent * (change - self._last)
        self._lag *= np.exp(exponent, out=exponent)
        self._lag += step
        self._last, self._stamp_ns = change.copy(), stamp_ns  # a caller may use its array again

    def __call__(self, change: Array, stamp_ns: Integers, restart: Bools) -> Array:
        """Take many frames into the memory; the same numbers as `step` frame by frame.

        Parameters
        ----------
        change : ndarray, shape (s, d)
            Change since the tare in time order; NaN: not measured.
        stamp_ns : ndarray, shape (s,)
            Acquisition times, irregular and with gaps.
        restart : ndarray, shape (s,)
            Frames before which the past is forgotten: a new stream, or a tare.

        Returns
        -------
        ndarray, shape (s, m, d)
            Means after each frame (unit of change).
        """
        if len(change) == 0:
            return np.zeros((0, len(self._rate), change.shape[1]))
        if len(change) <= FEW:
            return self._steps(change, stamp_ns, restart)
        begins = restart.copy()
        begins[0] |= self._stamp_ns is None
        newer, elapsed = _elapsed(stamp_ns, begins, self._stamp_ns)
        taken = slice(None) if newer.all() else np.flatnonzero(newer)
        fresh = begins[taken]
        if len(fresh) == 0:
            return np.repeat((self._last - self._lag)[None], len(change), axis=0)
        held = _hold(change[taken], fresh, self._last)
        seed = np.zeros((len(self._rate), change.shape[1])) if fresh[0] else self._last - self._lag
        means = _fade(elapsed[taken], held, fresh, self._rate, self._last, seed)
        self._last, self._lag = held[-1].copy(), held[-1] - means[-1]
        self._stamp_ns = int(stamp_ns[taken][-1])
        if newer.all():
            return means
        return np.asarray(np.concatenate([seed[None], means])[np.cumsum(newer)])

    def _steps(self, change: Array, stamp_ns: Integers, restart: Bools) -> Array:
        """As a call, frame by frame."""
        means = np.empty((len(change), len(self._rate), change.shape[1]))
        for i in range(len(change)):
            if restart[i]:
                self.reset()
            means[i] = self.step(change[i], int(stamp_ns[i]))
        return means


def _weights(exponent: Array) -> tuple[Array, Array, Array]:
    """Weights of the old mean, the last and the new change, for -dt / tau < 0."""
    decay = np.exp(exponent)
    average = np.expm1(exponent) / exponent
    return decay, average - decay, 1.0 - average


def _elapsed(stamp_ns: Integers, begins: Bools, previous_ns: int | None) -> tuple[Bools, Integers]:
    """Which frames are newer than all before them since the last restart, and by how much."""
    newest = np.empty_like(stamp_ns)
    newest[0] = stamp_ns[0] if previous_ns is None else previous_ns
    newest[1:] = stamp_ns[:-1]
    if not ((stamp_ns > newest) | begins).all():
        edges = np.unique(np.concatenate([[0], np.flatnonzero(begins), [len(stamp_ns)]]))
        for first, last in pairwise(edges):
            past = newest[first:last]
            # the first entry is of the frame before the restart, and counts only without one
            past[0] = stamp_ns[first] - 1 if begins[first] else past[0]
            past[:] = np.maximum.accumulate(past)
    return (stamp_ns > newest) | begins, np.where(begins, 1, stamp_ns - newest)


def _hold(change: Array, begins: Bools, last: Array) -> Array:
    """Bridge what was not measured by the last change known since the restart."""
    missing = np.isnan(change)
    if not missing.any():
        return change
    rows = np.arange(len(change))
    start = np.maximum.accumulate(np.where(begins, rows, -1))[:, None]
    known = np.maximum.accumulate(np.where(missing, -1, rows[:, None]), axis=0)
    before = np.where(start < 0, last if last.size else 0.0, 0.0)
    found = np.take_along_axis(change, np.maximum(known, 0), axis=0)
    return np.where((known >= 0) & (known >= start), found, before)


def _fade(
    elapsed: Integers, change: Array, begins: Bools, rate: Array, last: Array, seed: Array
) -> Array:
    """Means after each frame, shape (s, m, d), from the means `seed` before the first.

    Blocks of about sqrt(s) frames advance together from zero, then every block takes over the end
    of the one before it, faded by the product of its decays: about 2 sqrt(s) vector operations,
    and sums of terms that only shrink, however long a gap is.
    """
    count, width = change.shape
    length = max(int(np.sqrt(count)), 1)
    blocks = -(-count // length)
    table = np.zeros((3, blocks * length, len(rate), 1))
    table[:, :count, :, 0] = _weights(elapsed[:, None] * rate[:, 0])
    table[:, :count][:, begins] = 0.0
    decay, before, now = table.reshape(3, blocks, length, len(rate), 1)
    path = np.zeros((blocks * length + 1, 1, width))
    path[0] = last if last.size else 0.0
    path[1 : count + 1, 0] = change
    past = path[:-1].reshape(blocks, length, 1, width)
    present = path[1:].reshape(blocks, length, 1, width)
    means = np.empty((blocks, length, len(rate), width))
    running = np.zeros((blocks, len(rate), width))
    for i in range(length):
        running = decay[:, i] * running + before[:, i] * past[:, i] + now[:, i] * present[:, i]
        means[:, i] = running
    carry = seed
    for i, share in enumerate(np.cumprod(decay, axis=1)):
        means[i] += share * carry
        carry = means[i, -1]
    return means.reshape(blocks * length, len(rate), width)[:count]
