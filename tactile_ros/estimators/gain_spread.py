"""How much the gain of a sensor differs from run to run, as a part of the covariance.

Rows of one run share the state of its skin: errors on them do not tell how far a new run's gain
may lie. The variance of the gain is estimated from runs that the estimator had not seen, by a
scaled inverse chi-square posterior (Gelman et al., Bayesian Data Analysis, 3rd ed., sec. 2.6)
whose prior speaks where there are few runs, or only one. A fit on n runs has the mean of their
gains, so that a new run's gain lies off by sqrt(1 + 1 / n) standard deviations.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.training import fitted
from tactile_ros.types import Array, Integers, as_shape


class GainSpread:
    """Standard deviation of the gain of an unseen run about that of the fit.

    Parameters
    ----------
    prior : float
        Standard deviation of the gain between runs before any was seen.
    weight : float
        How many runs the prior counts for.

    Attributes
    ----------
    spread_ : float
        Standard deviation of the gain of an unseen run about that of a fit on all runs.
    runs_ : int
        Runs that were seen.

    Examples
    --------
    >>> force = np.array([[1.0], [2.0], [1.0], [2.0]])
    >>> said = force * np.array([[1.1], [1.1], [0.9], [0.9]])
    >>> spread = GainSpread(prior=0.1).fit(said, force, np.array([0, 0, 1, 1]))
    >>> round(spread.spread_, 3), spread.covariance(np.array([[10.0]])).round(3).tolist()
    (0.1, [[[1.0]]])
    """

    spread_: float
    runs_: int

    def __init__(self, prior: float = 0.025, weight: float = 1.0) -> None:
        self.prior = prior
        self.weight = weight

    def fit(
        self, predictions: Array, y: Array, runs: Integers, presses: Integers | None = None
    ) -> GainSpread:
        """Learn from predictions of runs by estimators that had not seen them.

        Parameters
        ----------
        predictions, y : ndarray, shape (s, k)
            Predictions and targets; rows that are not finite are left out.
        runs : ndarray of int, shape (s,)
            Run of each row; with one run only nothing is learned and the prior stays.
        presses : ndarray of int, shape (s,), or None
            Presses, each with a gain of its own; None: one gain for each run.

        Returns
        -------
        GainSpread
            Itself.
        """
        said, told = as_shape('predictions', predictions, (-1, -1)), as_shape('y', y, (-1, -1))
        keep = np.isfinite(said).all(axis=1) & np.isfinite(told).all(axis=1)
        names = np.unique(runs[keep])
        pressed = runs if presses is None else presses
        squares = [
            _deviation(said[rows], told[rows], pressed[rows])
            for rows in (keep & (runs == name) for name in names)
        ]
        self.runs_ = len(names)
        variance = self.prior**2
        if self.runs_ > 1:
            between = np.array(squares) / (1 + 1 / (self.runs_ - 1))
            total = self.weight * variance + float(between.sum())
            variance = total / (self.weight + self.runs_)
        self.spread_ = float(np.sqrt(variance * (1 + 1 / max(self.runs_, 1))))
        return self

    def covariance(self, mean: Array, share: Array | None = None) -> Array:
        """Covariance of the error of predictions by their unknown gain.

        Parameters
        ----------
        mean : ndarray, shape (s, k)
            Predictions.
        share : ndarray, shape (s,), or None
            Share of the variance of the gain that is unknown, 0 in a run that was learned from;
            None: all of it.

        Returns
        -------
        ndarray, shape (s, k, k)
            To be added to the covariance within runs (unit of the predictions, squared).

        Raises
        ------
        NotCalibratedError
            Before a fit.
        """
        fitted(self, 'spread_')
        size = self.spread_ * mean
        cells = size[:, :, None] * size[:, None, :]
        return cells if share is None else cells * share[:, None, None]


def _deviation(said: Array, told: Array, presses: Integers) -> float:
    """Mean square of gain less one over the presses of a run, by the load they carried."""
    _, press = np.unique(presses, return_inverse=True)
    load = np.bincount(press.reshape(-1), (told**2).sum(axis=1))
    answer = np.bincount(press.reshape(-1), (said * told).sum(axis=1))
    loaded = load > 1e-6 * load.max(initial=0.0)
    if not loaded.any():
        return 0.0
    error = answer[loaded] / load[loaded] - 1
    return float((load[loaded] * error**2).sum() / load[loaded].sum())
