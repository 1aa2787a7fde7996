"""Noise of the baselines that readings are counted from, and what it does to regressors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.baseline import learned_doubt

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tactile_ros.regression.head import Head
    from tactile_ros.signals import Columns, Signals
    from tactile_ros.types import Array

MANY = 30  # frames of a tare whose noise regressors need not mind


class TareNoise:
    """Of the tares of a fit, beside those in use.

    Attributes
    ----------
    noise_, doubt_ : float
        Of a channel (T); variance that baselines left in what was learned, over that of a frame.
    """

    noise_ = 0.0
    doubt_ = 0.0

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

    def shake(self, known: Columns, signals: Signals, heads: Iterable[Head], width: int) -> None:
        """Add to covariances what the noise of few frames does to regressors, in place.

        By differences of their answers to readings (s, width) that are wrong by the noise.
        """
        doubt = self.doubt(signals)
        rows = np.flatnonzero(doubt > 1 / MANY)
        if not len(rows) or not self.noise_:
            return
        x, rest = (part.reshape(-1, width)[rows] for part in (signals.delta, signals.baseline))
        for head in heads:
            level, steps = head.predict(x, rest)[0], self.noise_ * np.eye(width)
            moved = np.stack([head.predict(x + step, rest)[0] - level for step in steps], axis=2)
            moved *= np.sqrt(doubt[rows])[:, None, None]
            first, second = head.cells
            cov = np.array(known[f'{head.target}_cov'], np.float64)
            added = np.zeros((len(rows), *cov.shape[1:]))
            added[:, first, second] = np.matmul(moved, moved.transpose(0, 2, 1))
            cov[rows] += added
            known[f'{head.target}_cov'] = cov


def noise_of_rest(signals: Signals) -> float:
    """Standard deviation of resting readings, over all channels; 0 where nothing rests."""
    rest = signals.delta[signals.good & (signals.in_contact == 0)]
    return float(np.sqrt((rest**2).mean())) if len(rest) else 0.0
