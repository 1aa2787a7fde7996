"""Errors of the baselines that readings are counted from, and what they do to regressors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.baseline import learned_doubt
from tactile_ros.sensors.magnet_pad.warmth import Warmth, noise_of_rest

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.regression.head import Head
    from tactile_ros.types import Array, Columns, Integers, Signals

MANY = 30  # frames of a tare whose noise regressors need not mind


class TareNoise:
    """Of the tares of a fit, beside those in use.

    Attributes
    ----------
    noise_, doubt_ : float
        Of a channel (T); variance that baselines left in what was learned, over that of a frame.
    warmth_ : Warmth
        How they change with the temperature.
    """

    noise_ = 0.0
    doubt_ = 0.0

    def __init__(self) -> None:
        self.warmth_ = Warmth()

    def fit(self, signals: Signals) -> TareNoise:
        """Learn from conditioned frames."""
        good = signals.good
        self.noise_ = noise_of_rest(signals)
        doubt = None if signals.doubt is None else signals.doubt[good]
        self.doubt_ = learned_doubt(signals.baseline[good], doubt)
        return self

    def doubt(self, signals: Signals) -> Array:
        """Variance (s,) of the baseline over a frame's: in use and in the fit; 0 for its own."""
        own = np.zeros(len(signals.good)) if signals.doubt is None else signals.doubt
        return np.asarray(np.where(own > 0, own + self.doubt_, 0.0))

    def shake(self, known: Columns, signals: Signals, heads: Sequence[Head], width: int) -> None:
        """Add to covariances what errors of the baseline do to regressors, in place.

        By differences of their answers to readings (s, width) that are wrong by the noise of few
        frames, a channel after the other, and by a temperature that is not well known.
        """
        if not heads:
            return
        doubt, (warm, by) = self.doubt(signals), self.warmth_.unsure(signals, self.noise_)
        rows = np.flatnonzero(doubt > 1 / MANY) if self.noise_ else np.zeros(0, np.int64)
        x, rest = (part.reshape(-1, width) for part in (signals.delta, signals.baseline))
        steps = self.noise_ * np.eye(width)
        for head in heads:
            if len(rows):
                few = [_moved(head, x[rows], rest[rows], step) for step in steps]
                _add(known, head, rows, np.sqrt(doubt[rows])[:, None] * np.stack(few))
            if len(warm):
                _add(known, head, warm, _moved(head, x[warm], rest[warm], by)[None])

    def warm(
        self,
        known: Columns,
        signals: Signals,
        x: Array,
        answer: Callable[[Array, Integers], Columns],
    ) -> None:
        """Add to covariances what a temperature that is not well known does to models, in place.

        `answer` gives places and forces, those that the models tell, of readings (r, d) like those
        of some rows (r,) of x (s, d).
        """
        rows, by = self.warmth_.unsure(signals, self.noise_)
        other = answer(x[rows] + by, rows) if len(rows) else {}
        for target in ('position', 'force'):
            if target in other:
                level = np.asarray(known[target], np.float64)[rows]
                moved = np.nan_to_num(np.asarray(other[target], np.float64) - level)
                cov = np.array(known[f'{target}_cov'], np.float64)
                cov[rows] += moved[:, :, None] * moved[:, None]
                known[f'{target}_cov'] = cov


class Tared:
    """What an estimation says of its baselines.

    Attributes
    ----------
    tares_ : TareNoise
        Of the fit.
    """

    tares_: TareNoise

    def warmed(self, base: Array, then_c: Array, now_c: Array | None) -> Array:
        """Change of baselines since the chips told other temperatures."""
        return self.tares_.warmth_.change(base, then_c, now_c)

    def forget_warmth(self) -> None:
        """Before a fit: it begins with magnets of neodymium, whatever was learned before."""
        self.tares_.warmth_ = Warmth()


def _moved(head: Head, x: Array, rest: Array, by: Array) -> Array:
    """What answers (s, y) to readings (s, d) move by, where these are others by `by`."""
    return np.asarray(head.predict(x + by, rest)[0] - head.predict(x, rest)[0])


def _add(known: Columns, head: Head, rows: Integers, moved: Array) -> None:
    """Add to the covariances of some rows what answers move by, (k, r, y), in place."""
    first, second = head.cells
    cov = np.array(known[f'{head.target}_cov'], np.float64)
    added = np.zeros((len(rows), *cov.shape[1:]))
    added[:, first, second] = np.einsum('kri,krj->rij', moved, moved)
    cov[rows] += added
    known[f'{head.target}_cov'] = cov
